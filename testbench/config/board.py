"""Two boards: [nominal], which the firmware is designed for, and [plant], which it meets.

Both have a key for each field of `Device`; [nominal] has tolerances as well. A key that follows one of [nominal]
takes its value where a file does not give it, so that a file states its board once.

Source  docs/configuration.md, docs/boards/README.md
"""

from pydantic import create_model, model_validator

from analog_frontend.parts import device
from analog_frontend.parts.provenance import PLANT
from testbench.config import scenario
from testbench.config.section import Section, number


class _Board(Section):
    """A gyroscope with its analog board."""

    @model_validator(mode="after")
    def _check_device(self):
        try:
            device.validate(self.device())
        except ValueError as problem:
            name, _, text = str(problem).partition(" ")
            raise scenario.Problem(f".{name}", text) from None
        return self

    def device(self):
        """As the record that the plant is built from."""
        return device.Device(**{name: getattr(self, name) for name in device.Device._fields})


def _key(field):
    default = device.Device._field_defaults[field.name]
    unit = "" if field.unit == "1" else field.unit
    return type(default), number(default, unit, field.lo, field.hi, PLANT[field.name].text)


_KEYS = {field.name: _key(field) for field in device.FIELDS}


class _Plant(_Board):
    """The board that the firmware meets, SI units. A key that a file does not give has the value of [nominal]."""


class _Nominal(_Board):
    """The board that the firmware is designed for: every key of [plant] with its default, unit and limits, and the
    tolerances of the boards that it must work with. All hold at temp_ref_degc."""

    f_tolerance: float = number(0.005, "", 0.0, 0.1, "largest relative error that fx_hz and fy_hz share")
    q_tolerance: float = number(2.0, "", 1.0, 100.0, "ratio of the greatest to the least value of qx, and of qy")
    transducer_tolerance: float = number(
        0.1,
        "",
        0.0,
        0.5,
        "largest relative error of both k_vf_*_n_per_v, dcdx_f_per_m and dcdy_f_per_m",
    )
    capacitor_tolerance: float = number(
        0.1, "", 0.0, 0.5, "largest relative error of c0_f, cp_f, both cref_*_f and sid_c_f"
    )
    split_tolerance: float = number(0.1, "", 0.0, 0.9, "largest relative error of fx_hz - fy_hz")


Plant = create_model("Plant", __base__=_Plant, __doc__=_Plant.__doc__, **_KEYS)
Nominal = create_model("Nominal", __base__=_Nominal, __doc__=_Nominal.__doc__, **_KEYS)

# (section, key) -> the key of [nominal] whose value it takes where a file does not give it
FOLLOWS = {("plant", name): name for name in _KEYS} | {
    ("firmware", "nominal_frequency_hz"): "fx_hz",
    ("firmware", "kick_v"): "drive_dac_span_v",
    ("firmware", "drive_ceiling_v"): "drive_dac_span_v",
    ("firmware", "quadrature_ceiling_v"): "quad_dac_span_v",
}


def inherit_nominal(tree):
    """(tree, keys): nested dicts with every key that follows [nominal] filled in, and the (section, key) filled."""
    nominal = tree.get("nominal")
    if not isinstance(nominal, dict):
        return tree, ()
    tree, filled = dict(tree), []
    for (section, key), source in FOLLOWS.items():
        section_values = tree.get(section, {})
        if source in nominal and isinstance(section_values, dict) and key not in section_values:
            tree[section] = section_values | {key: nominal[source]}
            filled.append((section, key))
    return tree, filled


def drop_inherited(tree, paths):
    """The tree without the values that equal a key of [nominal] among the dotted `paths`: they follow its new value."""
    tree = {name: dict(section) for name, section in tree.items()}
    for (section, key), source in FOLLOWS.items():
        if f"nominal.{source}" in paths and tree[section][key] == tree["nominal"][source]:
            del tree[section][key]
    return tree

"""A plan of a recording: configuration, conditions, repeats, roles. TOML in, one line for what is wrong.

    name, lab, device_serial, ...   head of the record
    repeats, seed                   power-ons of each condition; each has noise of its own, counted up from seed
    dac                             "frame" or "tick": how often DAC codes are recorded
    fx_scatter_hz                   sd of the drive mode's frequency between power-ons of the simulated board
    [set]                           configuration of the model over the defaults, as --set
    [truth]                         over [set], for the simulated board alone: what an analysis has to find
    [[condition]]                   id, a_um, rate_dps, from_dps, temperature_degc, detune_deg, settle_s, seconds,
                                    role, kind, counter_s (length of the phase reading at the end; 0: none),
                                    rate_ramp_dps_s, temperature_ramp_k_s (of the dwell, which is a sweep then)
    [[prior]]                       param, dist, mean, sd, unit, source, correlation_group

Source    docs/measured.md
"""

import difflib
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench import config as configuration
from testbench.config.toml_text import short_toml
from testbench.errors import ConfigError
from testbench.measured.record import schema
from testbench.storage.inputs import read_toml

MOST_REPEATS, MOST_CONDITIONS = 64, 256
RAMP_FRAMES = 64  # of a step of a ramp


class Condition(NamedTuple):
    """What holds during one dwell; from_dps is the rate before it, if that is another."""

    id: str
    a_um: float = 5.0
    rate_dps: float = 0.0
    from_dps: float | None = None
    temperature_degc: float = 25.0
    detune_deg: float = 0.0
    settle_s: float = 0.3
    seconds: float = 1.0
    role: str = "fit"
    kind: str = "dwell"
    counter_s: float = 0.0
    rate_ramp_dps_s: float = 0.0  # in the dwell, from its begin on
    temperature_ramp_k_s: float = 0.0

    @property
    def is_ramped(self):
        return bool(self.rate_ramp_dps_s or self.temperature_ramp_k_s)

    def profile(self, frames):
        """(rate in deg/s, temperature in degC) of each frame of the dwell; ramps go in steps of RAMP_FRAMES frames."""
        t_s = (np.arange(frames) // RAMP_FRAMES + 0.5) * (RAMP_FRAMES * FRAME_TICKS / TICK_HZ)
        return self.rate_dps + self.rate_ramp_dps_s * t_s, self.temperature_degc + self.temperature_ramp_k_s * t_s


LIMITS = {
    "a_um": (0.1, 10.0, "um"),
    "rate_dps": (-1000.0, 1000.0, "deg/s"),
    "from_dps": (-1000.0, 1000.0, "deg/s"),
    "temperature_degc": (-55.0, 125.0, "degC"),
    "detune_deg": (-60.0, 60.0, "deg"),
    "settle_s": (0.0, 3600.0, "s"),
    "seconds": (0.01, 36000.0, "s"),
    "counter_s": (0.0, 10.0, "s"),
    "rate_ramp_dps_s": (-1000.0, 1000.0, "deg/s^2"),
    "temperature_ramp_k_s": (-10.0, 10.0, "K/s"),
}


class Prior(NamedTuple):
    """What is known of a parameter before the recording."""

    param: str
    mean: float
    sd: float
    unit: str = "1"
    dist: str = "normal"
    source: str = "datasheet"
    correlation_group: str = ""


class Plan(NamedTuple):
    """A checked plan."""

    name: str
    head: dict
    repeats: int
    seed: int
    dac: str
    fx_scatter_hz: float
    model: configuration.Config
    truth: configuration.Config
    hidden: dict  # {dotted key: value} of [truth]
    conditions: tuple
    priors: tuple


HEAD = ("lab", "device_serial", "board_rev", "licence")
KEYS = ("name", "repeats", "seed", "dac", "fx_scatter_hz", "set", "truth", "condition", "prior", *HEAD)


def _check_keys(tree, keys, where):
    for key in tree:
        if key not in keys:
            close_matches = difflib.get_close_matches(str(key), keys, n=1, cutoff=0.5)
            hint = f"did you mean {close_matches[0]}?" if close_matches else f"known: {', '.join(keys)}"
            raise ConfigError(f"{where}: {key} is not a key here; {hint}")


def _bounded_number(value, lo, hi, unit, where):
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not (good and lo <= value <= hi):
        raise ConfigError(f"{where} = {short_toml(value)} is outside {lo:g} .. {hi:g} {unit}".rstrip())
    return float(value)


def _text(value, choices, where):
    if not isinstance(value, str) or (choices and value not in choices):
        choices_text = " | ".join(choices) if choices else "a text"
        raise ConfigError(f"{where} = {short_toml(value)} is not {choices_text}")
    return value


def _flatten_table(table, where):
    if not isinstance(table, dict):
        raise ConfigError(f"{where} = {short_toml(table)} is not a table of section.key = value")
    out = {}
    for key, value in table.items():
        items = {f"{key}.{name}": item for name, item in value.items()} if isinstance(value, dict) else {key: value}
        out |= items
    for key in out:
        section = key.partition(".")[0]
        if section not in ("firmware", "plant", "effects", "noise") or key.count(".") != 1:
            raise ConfigError(f"{where} {key}: expected a key of [firmware], [plant], [effects] or [noise]")
        if key == "noise.seed":
            raise ConfigError(f"{where} {key}: remove it; the plan's key seed sets the noise seed of each repeat")
    return out


def _change_config(config, values, where):
    """Configuration with values in place, all at once."""
    try:
        return configuration.changed(config, values)
    except ConfigError as problem:
        raise ConfigError(f"{where} {str(problem).removeprefix('changed: ')}") from None


def _condition(tree, k, where):
    where = f"{where}: condition[{k}]"
    if not isinstance(tree, dict) or "id" not in tree:
        raise ConfigError(f"{where}: id is missing; every condition needs an id")
    _check_keys(tree, Condition._fields, where)
    values = {"id": _text(tree["id"], (), f"{where}.id")}
    for key, (lo, hi, unit) in LIMITS.items():
        if key in tree:
            values[key] = _bounded_number(tree[key], lo, hi, unit, f"{where}.{key}")
    for key, choices in (("role", schema.ROLES), ("kind", schema.KINDS)):
        if key in tree:
            values[key] = _text(tree[key], choices, f"{where}.{key}")
    return Condition(**values)


def _prior(tree, k, where):
    where = f"{where}: prior[{k}]"
    if not isinstance(tree, dict) or {"param", "mean", "sd"} - set(tree):
        raise ConfigError(f"{where} needs param, mean and sd")
    _check_keys(tree, Prior._fields, where)
    values = dict(tree)
    values["mean"] = _bounded_number(tree["mean"], -1e300, 1e300, "", f"{where}.mean")
    values["sd"] = _bounded_number(tree["sd"], 1e-300, 1e300, "", f"{where}.sd")
    for key in set(values) - {"mean", "sd"}:
        _text(values[key], schema.DISTRIBUTIONS if key == "dist" else (), f"{where}.{key}")
    return Prior(**values)


def from_dict(tree, where="plan"):
    """`Plan` of nested dicts; ConfigError with one line."""
    _check_keys(tree, KEYS, where)
    rows = tree.get("condition", [])
    if not isinstance(rows, list) or not 1 <= len(rows) <= MOST_CONDITIONS:
        raise ConfigError(f"{where}: a plan needs 1 to {MOST_CONDITIONS} conditions; write [[condition]]")
    conditions = tuple(_condition(row, k, where) for k, row in enumerate(rows))
    names = [c.id for c in conditions]
    if len(set(names)) != len(names):
        raise ConfigError(f"{where}: condition ids must differ, found {', '.join(names)}")
    model = _change_config(
        configuration.Config(), _flatten_table(tree.get("set", {}), f"{where}: [set]"), f"{where}: [set]"
    )
    hidden = _flatten_table(tree.get("truth", {}), f"{where}: [truth]")
    truth = _change_config(model, hidden, f"{where}: [truth]")
    priors = tree.get("prior", [])
    if not isinstance(priors, list):
        raise ConfigError(f"{where}: prior = {short_toml(priors)} is not a list; write [[prior]]")
    return Plan(
        name=_text(tree.get("name", "record"), (), f"{where}: name"),
        head={key: _text(tree.get(key, "unknown"), (), f"{where}: {key}") for key in HEAD},
        repeats=int(_bounded_number(tree.get("repeats", 2), 1, MOST_REPEATS, "", f"{where}: repeats")),
        seed=int(_bounded_number(tree.get("seed", 1), 0, 2**53, "", f"{where}: seed")),
        dac=_text(tree.get("dac", "frame"), ("frame", "tick"), f"{where}: dac"),
        fx_scatter_hz=_bounded_number(tree.get("fx_scatter_hz", 0.0), 0.0, 1.0, "Hz", f"{where}: fx_scatter_hz"),
        model=model,
        truth=truth,
        hidden=hidden,
        conditions=conditions,
        priors=tuple(_prior(row, k, where) for k, row in enumerate(priors)),
    )


def read(path):
    """`Plan` of a TOML file."""
    return from_dict(read_toml(path), str(Path(path)))


def with_plant(plan, library, plant_file=""):
    """The same plan for a plant behind the port: path of the library, and of the file for it alone."""
    plant_settings = {"scenario.plant": str(library), "scenario.plant_file": str(plant_file)}
    return plan._replace(truth=configuration.changed(plan.truth, plant_settings, library=True))

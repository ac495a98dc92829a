"""Tables of what a user may type: keys of a configuration, kinds of faults, keys of a target, effects, registers.

Source  docs/configuration.md
"""

from analog_frontend.effects import catalogue
from fpga_model import registers
from fpga_model.design_record import DEFAULT
from testbench.config import Nominal, Plant, provenance, scenario, sections
from testbench.config.config_errors import literal_choices, number_limits, number_text, spaced_unit
from testbench.config.toml_text import toml_value
from testbench.console.text_table import Table
from testbench.design.target import Target
from testbench.engines.engine import FRAME_COLUMNS, TRUTH_COLUMNS


def _limits(info):
    lo, hi = number_limits(info)
    limits = f"{number_text(lo)} .. {number_text(hi)}" if hi is not None else ""
    return " or ".join(toml_value(choice) for choice in literal_choices(info)) or limits


def _default(value):
    text = toml_value(value)
    return f"{value:.6g}" if isinstance(value, float) and len(text) > 12 else text


def section_table(section):
    """Keys of a section: default, limits, unit, kind of its source where known, meaning."""
    model, sources = sections()[section], provenance.SECTIONS.get(section, {})
    heads = ("key", "default", "limits", "unit", *(("kind",) if sources else ()), "meaning")
    rows = []
    for key, info in model.model_fields.items():
        if model is Nominal and key in Plant.model_fields:
            continue
        kind = (sources[key].kind,) if sources else ()
        why = f"; {sources[key].text}" if section == "firmware" else ""
        meaning = f"{info.description or ''}{why}"
        rows.append((key, _default(info.default), _limits(info), spaced_unit(info).strip(), *kind, meaning))
    return Table(f"{section}: {' '.join(model.__doc__.split())}", heads, rows, numeric=())


def fault_table():
    """Kinds of faults of [[scenario.faults]]."""
    rows = []
    for kind, fault in scenario.FAULTS.items():
        if kind == "dac_stuck":
            value = ", ".join(f"{name} {lo} .. {hi}" for name, (lo, hi) in scenario.DAC_CODES.items())
        else:
            value = f"{fault.lo} .. {fault.hi} {fault.unit}".strip() if fault.hi else "0"
        rows.append((kind, ", ".join(fault.channels), value, fault.doc))
    return Table("faults: kinds of [[scenario.faults]]", ("kind", "channels", "value", "effect"), rows, numeric=())


def target_table():
    """Keys of a target for `gyro design`."""
    rows = []
    for key, info in Target.model_fields.items():
        default = "" if info.default is None else _default(info.default)
        rows.append((key, default, _limits(info), spaced_unit(info).strip(), info.description))
    heads = ("key", "default", "limits", "unit", "meaning")
    return Table("target: keys of a file for gyro design", heads, rows, numeric=())


def effect_table():
    """Effects of the catalogue, by id."""
    rows = []
    for effect in sorted(catalogue.LAWS, key=lambda e: e.IDS):
        rows.append((effect.IDS, effect.INFO.name, f"{effect.LIMIT:g}", effect.INFO.unit, effect.DOC))
    heads = ("id", "key of [effects]", "limit", "unit", "what")
    return Table("effects: catalogue of [effects]", heads, rows, numeric=())


def column_table():
    """Columns of a run: one row per 8 kHz frame; the LSB is that of the default design."""
    columns = [(name, unit.format(dds_bits=DEFAULT.dds_bits)) for name, unit, _ in FRAME_COLUMNS]
    columns += [(f"truth_{name}", unit) for name, unit in TRUTH_COLUMNS]
    return Table("columns: 8 kHz rows of a run", ("column", "LSB or unit"), columns, numeric=())


def register_table():
    """Registers of the firmware that a host can read or write."""
    rows = []
    for r in registers.MAP:
        reset = "-" if r.access == "ro" and r.path else f"0x{registers.to_bus(r.reset, r.fmt):X}"
        unit = r.unit or "-"
        rows.append((f"0x{r.address:02X}", r.name.upper(), str(r.fmt), reset, r.access, unit, r.doc))
    heads = ("address", "name", "format", "reset", "access", "unit", "meaning")
    return Table("registers: what a host can read or write", heads, rows, numeric=())

"""A recording of a part in any table, with a TOML file that says what its columns are: its column map.

    kind = "ring-down"       ring-down, spectrum, sweep, meters, levels, driven or rest
    file = "run1.csv"        CSV, Parquet, .npz or MATLAB 5 in the folder of the map or below it
    [columns]                role = {column = "t", unit = "ms", range = [0, 1e5]}; range in that unit, where it is known
    [[readings]]             the roles of which there may be several: readings, spreads, environment, levels, axes
    [head]                   numbers and texts of the recording: see HEADS

Values are put into the product's unit; what is outside its range refuses the file as a slip of the unit.
Errors  FileError: no such role, column or unit, what the kind wants and the map lacks, a file outside the folder
Source  docs/quality.md
"""

import difflib
import hashlib
import re
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from testbench.errors import FileError
from testbench.measured.formats.contents import InputOutput, Levels, Meters, Sweep, Trace, ZeroRateRecord, on_grid
from testbench.measured.formats.table import numeric_columns, read_table
from testbench.measured.quality import backwards, units
from testbench.measured.quality.finding import QualityError
from testbench.measured.quality.rows.series import grid_step, noise_sd
from testbench.measured.quality.sheet import AXIS, Column, Sheet
from testbench.storage import inputs

KIND = re.compile(rb"""^\s*kind\s*=\s*["']([\w-]+)["']""", re.M)
TOML = re.compile(rb"""(?:[ \t\r]*(?:#.*)?\n)*[ \t]*(?:[\w."'-]+[ \t]*=|\[\[?[\w."' -]+\]\]?[ \t\r]*(?:#.*)?$)""", re.M)
SI = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "u": 1e-6, "n": 1e-9}
UNITS = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "V": {f"{p}V": f for p, f in SI.items()},
    "Hz": {f"{p}Hz": f for p, f in SI.items()},
    "dBm": {"dBm": 1.0, "dBW": None} | {f"{p}W": None for p in SI},
    "dB of amplitude": dict.fromkeys(("V", "mV", "uV", "m", "um", "nm")),
    "dB": {"dB": 1.0},
    "deg": {"deg": 1.0, "rad": 180 / np.pi},
    "1": {"1": 1.0, "": 1.0},
    "deg/s": {"deg/s": 1.0, "rad/s": 180 / np.pi, "mdeg/s": 1e-3, "deg/h": 1 / 3600, "count": 1.0},
    "": {},
}
ROLE_UNITS = {  # kind: {role: unit of the product}; those of OPTIONAL may be left out
    "ring-down": {"time": "s", "power": "dBm", "amplitude": "dB of amplitude"},
    "spectrum": {"frequency": "Hz", "power": "dBm"},
    "sweep": {"frequency": "Hz"}
    | {f"{s}_{p}": u for s in ("s11", "s21") for p, u in (("re", "1"), ("im", "1"))}
    | {f"{s}_{p}": u for s in ("s11", "s21") for p, u in (("db", "dB"), ("deg", "deg"))},
    "meters": {"time": "s", "source": "V"},
    "levels": {"code": "1"},
    "driven": {"time": "s", "input": "V", "output": "V"},
    "rest": {"time": "s"},
}
OPTIONAL = {"sweep": {"s11_re", "s11_im", "s11_db", "s11_deg", "s21_re", "s21_im", "s21_db", "s21_deg"}}
OPTIONAL |= {"ring-down": {"power", "amplitude"}, "levels": {"code"}, "driven": {"time"}, "rest": {"time"}}
SEVERAL = {"meters": {"readings": "V", "spreads": "V", "environment": ""}, "levels": {"levels": "V"}}
SEVERAL |= {"rest": {"axes": "deg/s"}}
HEADS = {"sample", "frequency_hz", "quality", "rate_hz", "lsb_deg_per_s", "date"}
FEWEST = {"ring-down": 64, "spectrum": 64, "sweep": 64, "meters": 20, "levels": 1, "driven": 4096, "rest": 20_000}
HEAD_BYTES = 4096
MOST, MOST_DB = 1e12, 200.0  # of any number in the product's unit, and of a parameter in dB
UW_DBM = -30.0
GRID_TOLERANCE = 1e-3  # of a sampling interval: how far instants may be off a regular grid


class Role(BaseModel):
    """One column: its name in the table, its unit, what it can be, and what it is called."""

    model_config = ConfigDict(extra="forbid", strict=True)
    column: str
    unit: str = ""
    range: Annotated[list[int | float], Field(min_length=2, max_length=2)] | None = None
    name: str = ""


class Map(BaseModel):
    """A column map as it stands in its file."""

    model_config = ConfigDict(extra="forbid", strict=True)
    kind: Literal["ring-down", "spectrum", "sweep", "meters", "levels", "driven", "rest"]
    file: str
    columns: dict[str, Role] = {}
    readings: list[Role] = []
    spreads: list[Role] = []
    environment: list[Role] = []
    levels: list[Role] = []
    axes: list[Role] = []
    head: dict[str, int | float | str] = {}


LISTS = ("readings", "spreads", "environment", "levels", "axes")
COLUMN = '{column = "NAME", unit = "UNIT"}'


def is_map(head, *kinds):
    """True if the first bytes are those of a column map of one of the kinds; none named: of any."""
    kind_match = KIND.search(head)
    return kind_match is not None and kind_match[1].decode() in (kinds or ROLE_UNITS)


def is_map_file(path, *kinds):
    """True if a file is a column map of one of the kinds; none named: of any."""
    return is_map(inputs.head(path, HEAD_BYTES), *kinds)


def refuse_other_toml(path):
    """FileError if a file is TOML, but no column map of a known kind."""
    path = Path(path)
    if path.suffix != ".toml" and not TOML.match(inputs.head(path, HEAD_BYTES)):
        return
    try:
        data = inputs.read_toml(path, error=FileError)
    except FileError:
        if path.suffix == ".toml" or is_map_file(path):
            raise
        return  # a text of another kind whose first line is an assignment
    kind = data.get("kind")
    if isinstance(kind, str) and kind in ROLE_UNITS:
        return
    if kind is not None:
        nearest = difflib.get_close_matches(str(kind), ROLE_UNITS, 1, 0.5)
        hint = f"; nearest is {nearest[0]}" if nearest else ""
        raise FileError(f"{path}: kind {str(kind)[:40]!r} is unknown; known: {', '.join(ROLE_UNITS)}{hint}")
    if isinstance(data.get("columns"), dict) and any(name.startswith("adc_") for name in data["columns"]):
        raise FileError(
            f"{path}: is a map of gyro measured import; run gyro measured import DATA --map {path} -o FILE.h5, "
            "then gyro measured trace FILE.h5"
        )
    raise FileError(
        f"{path}: is TOML, but no column map (docs/quality.md): it has no kind; known: {', '.join(ROLE_UNITS)}"
    )


def _check_form(path, data):
    wrong_keys = [key for key in data if key not in Map.model_fields]
    if wrong_keys:
        raise FileError(
            f"{path}: {wrong_keys[0]}: is not a known key; known: {', '.join(Map.model_fields)}; "
            f"a role is written under [columns]: {wrong_keys[0]} = {COLUMN}"
        )
    if not isinstance(data.get("file"), str):
        raise FileError(f'{path}: file: expected the name of the table, file = "run1.csv"')
    columns = data.get("columns", {})
    if not isinstance(columns, dict):
        raise FileError(f"{path}: columns: expected a table [columns] with ROLE = {COLUMN}")
    for role in columns:
        if role in LISTS:
            raise FileError(
                f"{path}: columns.{role}: {role}: several columns are allowed, so write [[{role}]] outside [columns]"
            )
    for role in LISTS:
        if role in data and not (isinstance(data[role], list) and all(isinstance(r, dict) for r in data[role])):
            raise FileError(f"{path}: {role}: several columns are allowed, so write [[{role}]] outside [columns]")
    entries = [*columns.items(), *((role, r) for role in LISTS for r in data.get(role, ()))]
    for role, entry in entries:
        if not isinstance(entry, dict) or not isinstance(entry.get("column"), str):
            raise FileError(f"{path}: {role}: expected {COLUMN}, with the column's name as text")
        wrong_keys = [key for key in entry if key not in Role.model_fields]
        if wrong_keys:
            raise FileError(
                f"{path}: {role}.{wrong_keys[0]}: is not a known key; known: {', '.join(Role.model_fields)}"
            )


def read(path):
    """Content of the recording that a map describes: what the reader of its kind gives."""
    path = Path(path)
    data = inputs.read_toml(path, error=FileError)
    _check_form(path, data)
    stated = inputs.validate_data(data, Map, path)
    file = (path.parent / stated.file).resolve()
    if not file.is_relative_to(path.parent.resolve()):
        raise FileError(f"{path}: file: {stated.file[:80]!r} is outside the folder of the map")
    mapped = _MappedTable(path, stated, file)
    return MAKERS[stated.kind](mapped)


class _MappedTable:
    """The columns of a map in the product's units: `one` by role, `many` by role as a list."""

    def __init__(self, path, stated, file):
        self.path, self.stated, self.file, self.table = path, stated, file, read_table(file)
        self.head = stated.head
        for name in self.head:
            if name not in HEADS:
                raise FileError(f"{path}: head.{name}: is not a known key; known: {', '.join(sorted(HEADS))}")
        unit_by_role, several = ROLE_UNITS[stated.kind], SEVERAL.get(stated.kind, {})
        for role in stated.columns:
            if role not in unit_by_role:
                raise FileError(
                    f"{path}: columns.{role}: is not a role of kind {stated.kind}; known: {', '.join(unit_by_role)}"
                )
        for role in LISTS:
            if getattr(stated, role) and role not in several:
                raise FileError(f"{path}: {role}: is not a role of kind {stated.kind}")
        lacking = [r for r in unit_by_role if r not in stated.columns and r not in OPTIONAL.get(stated.kind, ())]
        lacking += [r for r in list(several)[:1] if not getattr(stated, r)]
        if stated.kind == "ring-down" and len({"power", "amplitude"} & set(stated.columns)) != 1:
            lacking.append("power or amplitude, one of them")
        if lacking:
            raise FileError(f"{path}: kind {stated.kind} needs {', '.join(lacking)}; add them to the map")
        self.one = {role: self._values(role, r, unit_by_role[role]) for role, r in stated.columns.items()}
        self.many = {role: [self._values(role, r, u) for r in getattr(stated, role)] for role, u in several.items()}
        lengths = {len(v) for v in (*self.one.values(), *(v for many in self.many.values() for v in many))}
        if len(lengths) != 1 or min(lengths) < FEWEST[stated.kind]:
            raise FileError(
                f"{path}: columns of {sorted(lengths)} rows; expected one length of at least {FEWEST[stated.kind]}"
            )

    def _values(self, role, r, unit):
        v = numeric_columns(self.file, self.table, [r.column])[r.column]
        if r.range is not None:
            low, high = r.range
            sheet = Sheet(str(self.file), self.stated.kind, (Column(r.column, r.unit, v, limits=(low, high)),))
            limit_violations = list(units.check_limits(sheet))
            if limit_violations:
                raise QualityError(limit_violations)
        if unit and r.unit not in UNITS[unit]:
            unit_names = ", ".join(name for name in UNITS[unit] if name)
            raise FileError(
                f"{self.path}: {role}: unit {r.unit[:20]!r} is none of {unit_names}{self._amplitude_hint(unit, r)}"
            )
        v = self._dbm(role, r, v) if unit in ("dBm", "dB of amplitude") else v
        factor, most = float(UNITS[unit].get(r.unit) or 1.0), MOST_DB if unit == "dB" else MOST
        worst = float(np.max(v) if unit == "dB" else np.max(np.abs(v))) * factor
        if worst > most:
            raise FileError(f"{self.path}: {role}: {worst:.3g} {unit} is above {most:g}")
        return v * factor

    def _amplitude_hint(self, unit, r):
        if unit != "dBm" or r.unit not in UNITS["dB of amplitude"]:
            return ""
        way = "write the role amplitude" if self.stated.kind == "ring-down" else "write a column of its square"
        return f"; the laws need a power: for an amplitude {way}"

    def _dbm(self, role, r, v):
        if r.unit in ("dBm", "dBW"):
            return v + (30.0 if r.unit == "dBW" else 0.0)
        if np.min(v) <= 0:
            raise FileError(f"{self.path}: {role}: {np.min(v):.3g} {r.unit} is not above 0")
        if role == "amplitude":  # its square counts as a power in uW: the laws are in the square of the unit
            return 20 * np.log10(v) + UW_DBM
        return 10 * np.log10(v) + (30.0 + 10 * np.log10(SI[r.unit[:-1]]))

    def names(self, role):
        return tuple(r.name or r.column for r in getattr(self.stated, role))

    @property
    def sha256(self):
        """Of the map and the table together."""
        return hashlib.sha256(inputs.read_bytes(self.path) + inputs.read_bytes(self.file)).hexdigest()

    def sort_by_axis(self, axis, strictly):
        """(columns with a rising axis, findings)."""
        sheet = Sheet(str(self.file), self.stated.kind, _axis_first(self.one, axis))
        order, order_findings = backwards.rising_order(sheet, strictly, self.stated.kind != "sweep")
        if order is not None:
            self.one = {role: v[order] for role, v in self.one.items()}
            self.many = {role: [v[order] for v in many] for role, many in self.many.items()}
        return order_findings

    def rate_hz(self):
        """Sampling rate: of the head, or of regular instants."""
        if "rate_hz" in self.head:
            return self.number("rate_hz", 1e-3, 1e9)
        if "time" not in self.one:
            raise FileError(f"{self.path}: kind {self.stated.kind} needs head.rate_hz or the column time")
        t = self.one["time"]
        step = (t[-1] - t[0]) / (len(t) - 1)
        worst = float(np.max(np.abs(t - t[0] - step * np.arange(len(t))))) if step > 0 else np.inf
        if not worst < max(GRID_TOLERANCE * step, grid_step(t)):
            raise FileError(
                f"{self.path}: time: deviates from a regular grid by {worst:.3g} s, "
                f"above the limit {GRID_TOLERANCE * step:.3g} s"
            )
        return float(1 / step)

    def number(self, name, low, high):
        value = self.head.get(name)
        if not isinstance(value, (int, float)) or not low <= value <= high:
            raise FileError(f"{self.path}: head.{name}: {value!r} is not a number within {low:g} .. {high:g}")
        return float(value)


def _axis_first(one, axis):
    return tuple(Column(role, "", v, AXIS if role == axis else "signal") for role, v in one.items())


def _make_trace(mapped):
    axis = "time" if mapped.stated.kind == "ring-down" else "frequency"
    level_role = "amplitude" if "amplitude" in mapped.one else "power"
    mapped.one = {axis: mapped.one[axis], "power": mapped.one[level_role]}
    order_findings = mapped.sort_by_axis(axis, axis == "time")
    x = mapped.one[axis]
    if x[-1] == x[0]:
        raise FileError(f"{mapped.path}: {axis} is the same in all rows")
    header = {"sample id": str(mapped.head.get("sample", "")), "date and time": str(mapped.head.get("date", ""))}
    header["measurement id"] = mapped.path.stem
    if level_role == "amplitude":
        header["power unit"] = f"{mapped.stated.columns[level_role].unit}^2"
    header["frequency [hz]"] = str(mapped.head.get("frequency_hz", "nan"))
    header["quality factor"] = str(mapped.head.get("quality", "nan"))
    kind = "ringdown" if axis == "time" else "spectrum"
    grid = x if kind == "ringdown" else on_grid(x)
    return Trace(str(mapped.file), header, kind, grid, mapped.one["power"], x, order_findings)


def _make_sweep(mapped):
    one = mapped.one
    s, polar = {"s11": np.zeros(len(one["frequency"]), complex)}, {}
    for name in ("s11", "s21"):
        if {f"{name}_re", f"{name}_im"} <= set(one):
            s[name] = one[f"{name}_re"] + 1j * one[f"{name}_im"]
        elif {f"{name}_db", f"{name}_deg"} <= set(one):
            polar[name] = one[f"{name}_db"], one[f"{name}_deg"]
            s[name] = 10 ** (polar[name][0] / 20) * np.exp(1j * np.deg2rad(polar[name][1]))
    if "s21" not in s:
        raise FileError(f"{mapped.path}: kind sweep needs s21_re and s21_im, or s21_db and s21_deg")
    mapped.one = {"frequency": one["frequency"], "s21": np.abs(s["s21"])}
    mapped.sort_by_axis("frequency", True)
    f, date = one["frequency"], str(mapped.head.get("date", ""))
    return Sweep(str(mapped.file), (date,), f, s, 50.0, False, grid_step(f), polar, bool(polar))


def _make_meters(mapped):
    readings, spreads = (mapped.many[role] for role in ("readings", "spreads"))
    if spreads and len(spreads) != len(readings):
        raise FileError(
            f"{mapped.path}: {len(spreads)} spreads for {len(readings)} readings; give one for each reading, or none"
        )
    order_findings = mapped.sort_by_axis("time", False)
    many = mapped.many
    return Meters(
        mapped.path,
        mapped.sha256,
        mapped.one["time"] - mapped.one["time"][0],
        mapped.one["source"],
        mapped.names("readings"),
        np.column_stack(many["readings"]),
        np.column_stack(many["spreads"]) if spreads else None,
        dict(zip(mapped.names("environment"), many["environment"])),
        order_findings,
    )


def _make_levels(mapped):
    n = len(mapped.many["levels"][0])
    bits = n.bit_length() - 1
    code = mapped.one.get("code", np.arange(n))
    if n != 1 << bits or not 9 <= bits <= 18 or not np.array_equal(np.sort(code - code.min()), np.arange(n)):
        steps = np.unique(np.diff(np.unique(code)))
        grid = f"in steps of {steps[0]:g}" if len(steps) == 1 else f"{len(steps)} different steps"
        different = f" ({len(np.unique(code))} different)" if len(np.unique(code)) != n else ""
        raise FileError(
            f"{mapped.path}: {n} levels: found {code.min():g} .. {code.max():g} {grid}{different}; expected N = 2^9 .. "
            "2^18 levels at codes 0 .. N-1, each once; write a partial table as kind meters, with time and source"
        )
    order = np.argsort(code)
    channels = {name: v[order] for name, v in zip(mapped.names("levels"), mapped.many["levels"])}
    return Levels(mapped.path, mapped.sha256, bits, channels)


def _make_driven(mapped):
    still = [role for role in ("input", "output") if np.ptp(mapped.one[role]) == 0]
    if still:
        raise FileError(f"{mapped.path}: {still[0]} is the same in all rows")
    return InputOutput(str(mapped.path), mapped.one["input"], mapped.one["output"], mapped.rate_hz(), False)


def _make_zero_rate(mapped):
    rate, table = mapped.rate_hz(), np.column_stack(mapped.many["axes"])
    counted = [r.unit == "count" for r in mapped.stated.axes]
    if any(counted):
        if not all(counted):
            raise FileError(f"{mapped.path}: axes: some are in counts; give all in counts, or none")
        lsb, counts = mapped.number("lsb_deg_per_s", 1e-12, 1e6), table
    else:
        # rates on no grid are put on one far finer than their noise
        estimated_lsb = min(grid_step(v) or 1e-3 * noise_sd(v) for v in table.T)
        lsb = mapped.number("lsb_deg_per_s", 1e-12, 1e6) if "lsb_deg_per_s" in mapped.head else estimated_lsb
        if not lsb > 0:
            raise FileError(f"{mapped.path}: axes: one axis has no noise")
        counts = table / lsb
    return ZeroRateRecord(mapped.path, mapped.sha256, np.round(counts).astype(np.int64), lsb, rate)


MAKERS = {"ring-down": _make_trace, "spectrum": _make_trace, "sweep": _make_sweep, "meters": _make_meters}
MAKERS |= {"levels": _make_levels, "driven": _make_driven, "rest": _make_zero_rate}

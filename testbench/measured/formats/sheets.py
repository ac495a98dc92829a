"""What each reader's content is to the checks of data quality: its columns, with role, unit and limits.

of(content, channel)       `quality.sheet.Sheet`; of a converter's levels one channel: that of the largest swing
examine(paths, channel)    findings about files of one part
"""

import numpy as np

from testbench.measured.formats import readers
from testbench.measured.formats.gyro_npz import Rest
from testbench.measured.formats.input_output import InputOutput
from testbench.measured.formats.levels_mat import Levels
from testbench.measured.formats.meters_csv import Meters
from testbench.measured.formats.ringdown_text import Trace
from testbench.measured.formats.touchstone import Sweep
from testbench.measured.quality import examine as checks
from testbench.measured.quality.rows.series import grid_step
from testbench.measured.quality.sheet import AXIS, DB_PER_NEPER, OTHER, SETTING, SLOW, Column, Sheet

DBM = (-300.0, 100.0)
ROOM = (-100.0, 450.0)  # degC or K, % or hPa are others
DAC_V = (-200.0, 200.0)
HIGHEST_HZ = 1e12


def of(content, channel=None):
    """`Sheet` of a reader's content."""
    if isinstance(content, Levels):
        return _levels(content, channel)
    return KINDS[type(content)](content)


def _trace(c):
    if c.kind == "ringdown":
        axis = Column("time", "s", c.x, AXIS)
    else:
        axis = Column(
            "frequency", "Hz", c.printed_x, AXIS, limits=(0.0, HIGHEST_HZ), resolution=float(grid_step(c.printed_x))
        )
    stated = {"frequency_hz": c.frequency_hz, "quality": c.number("quality factor")}
    return Sheet(c.path, c.kind, (axis, Column("power", "dBm", c.power_dbm, limits=DBM)), stated=stated)


def _sweep(c):
    f = Column("frequency", "Hz", c.frequency_hz, AXIS, limits=(0.0, HIGHEST_HZ), resolution=c.rounding_hz)
    columns = [f]
    size = {name: c.size_db.get(name, _db(v)) for name, v in c.s.items()}
    if "s21" in c.s:
        s = c.s["s21"]
        columns += [Column("s21", "dB", size.pop("s21")), Column("s21 angle", "deg", np.angle(s, deg=True), OTHER)]
        print_error = _print_error(s, c.size_db.get("s21"))
        columns += [Column(f"s21 {n}", "1", v, resolution=print_error) for n, v in (("re", s.real), ("im", s.imag))]
    columns += [Column(n, "dB", v, OTHER) for n, v in size.items()]
    return Sheet(c.path, "sweep", tuple(columns))


def _print_error(s, size_db):
    """What print takes away of either part: a digit in the seventh place, or steps of decibels and degrees."""
    least = 1e-6 * float(np.median(np.abs(s)))
    if size_db is None:
        return least
    steps = grid_step(size_db) / DB_PER_NEPER, np.radians(grid_step(np.angle(s, deg=True)))
    return max(least, float(np.max(np.abs(s)) * np.hypot(*steps)))


def _db(s):
    return 20 * np.log10(np.maximum(np.abs(s), 1e-30))


def _meters(c):
    columns = [Column("time", "s", c.seconds, AXIS), Column("source", "V", c.source_v, SETTING)]
    for k, name in enumerate(c.names):
        columns.append(Column(name, "V", c.readings_v[:, k], error=c.readings_v[:, k] - c.source_v))
        if c.spread_v is not None:
            columns.append(Column(f"spread of {name}", "V", c.spread_v[:, k], OTHER))
    for name, v in c.environment.items():
        columns.append(Column(name, "", v, SLOW, limits=ROOM if "temp" in name.lower() else (-np.inf, np.inf)))
    return Sheet(str(c.path), "meters", tuple(columns), np.argsort(c.source_v, kind="stable"))


def _levels(c, channel):
    name = channel if channel in c.channels else max(c.channels, key=lambda n: np.ptp(c.channels[n]))
    v = c.channels[name]
    code = np.arange(len(v)) - (len(v) - 1) / 2
    line = np.mean(v) + code * (code @ v) / (code @ code)
    return Sheet(str(c.path), "levels", (Column(name, "V", v, error=v - line, limits=DAC_V),))


def _driven(c):
    columns = (Column("input", "V", c.input_v, fast=True), Column("output", "V", c.output_v, fast=True))
    return Sheet(c.path, "driven", columns)


def _rest(c):
    columns = tuple(
        Column(f"axis {'xyzuvw'[k]}", "counts", c.counts[:, k].astype(float)) for k in range(c.counts.shape[1])
    )
    return Sheet(str(c.path), "rest", columns, stated={"lsb_deg_per_s": c.lsb_deg_per_s, "rate_hz": c.rate_hz})


KINDS = {Trace: _trace, Sweep: _sweep, Meters: _meters, InputOutput: _driven, Rest: _rest}


def examine(paths, channel=None):
    """Findings about recordings of one part; files that no reader knows have none."""
    held = [c for c in (readers.content(path) for path in paths) if c is not None]
    mended = tuple(f for c in held for f in getattr(c, "quality", ()))
    return (*mended, *checks.examine([of(c, channel) for c in held]))

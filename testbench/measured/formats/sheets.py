"""What each reader's content is to the checks of data quality: its columns, with role, unit and limits.

content_sheet(content, channel)   `quality.sheet.Sheet`; of a converter's levels the channel of the largest swing
examine(paths, channel)           findings about files of one part
"""

import numpy as np

from testbench.measured.formats import readers
from testbench.measured.formats.gyro_npz import ZeroRateRecord
from testbench.measured.formats.input_output import InputOutput
from testbench.measured.formats.levels_mat import Levels
from testbench.measured.formats.meters_csv import Meters
from testbench.measured.formats.ringdown_text import Trace
from testbench.measured.formats.touchstone import Sweep
from testbench.measured.quality import examine as checks
from testbench.measured.quality.rows.series import grid_step
from testbench.measured.quality.sheet import AXIS, OTHER, SETTING, SIGNAL, SLOW, Column, Sheet

DBM = (-300.0, 100.0)
ROOM = (-100.0, 450.0)  # degC or K, % or hPa are others
DAC_V = (-200.0, 200.0)
HIGHEST_HZ = 1e12
SEVENTH = 1e-6  # of a usual response: its seventh digit


def content_sheet(content, channel=None):
    """`Sheet` of a reader's content."""
    if isinstance(content, Levels):
        return _levels_sheet(content, channel)
    return KINDS[type(content)](content)


def _trace_sheet(c):
    if c.kind == "ringdown":
        axis = Column("time", "s", c.x, AXIS)
    else:
        axis = Column(
            "frequency", "Hz", c.printed_x, AXIS, limits=(0.0, HIGHEST_HZ), resolution=float(grid_step(c.printed_x))
        )
    stated = {"frequency_hz": c.frequency_hz, "quality": c.number("quality factor")}
    return Sheet(c.path, c.kind, (axis, Column("power", "dBm", c.power_dbm, limits=DBM)), stated=stated)


def _sweep_sheet(c):
    columns = [Column("frequency", "Hz", c.frequency_hz, AXIS, limits=(0.0, HIGHEST_HZ), resolution=c.rounding_hz)]
    for name, s in c.s.items():
        size_db = c.polar[name][0] if c.decibels and name in c.polar else _db(s)
        columns.append(Column(name, "dB", size_db, OTHER))
    if "s21" in c.s:
        columns += _transmission_columns(c.s["s21"], c.polar.get("s21"), c.decibels)
    return Sheet(c.path, "sweep", tuple(columns))


def _transmission_columns(s, polar, decibels):
    """Columns of S21: signals are those of the file, as its print makes no grid after conversion."""
    parts, angles = (OTHER, SIGNAL) if polar else (SIGNAL, OTHER)
    size, angle = polar or (np.abs(s), np.angle(s, deg=True))
    least = SEVENTH * float(np.median(np.abs(s)))
    return [
        Column("s21 size", "dB" if decibels else "1", size, angles),
        Column("s21 angle", "deg", angle, angles),
        *(Column(f"s21 {n}", "1", v, parts, resolution=least) for n, v in (("re", s.real), ("im", s.imag))),
    ]


def _db(s):
    return 20 * np.log10(np.maximum(np.abs(s), 1e-30))


def _meters_sheet(c):
    columns = [Column("time", "s", c.seconds, AXIS), Column("source", "V", c.source_v, SETTING)]
    for k, name in enumerate(c.names):
        columns.append(Column(name, "V", c.readings_v[:, k], error=c.readings_v[:, k] - c.source_v))
        if c.spread_v is not None:
            columns.append(Column(f"spread of {name}", "V", c.spread_v[:, k], OTHER))
    for name, v in c.environment.items():
        columns.append(Column(name, "", v, SLOW, limits=ROOM if "temp" in name.lower() else (-np.inf, np.inf)))
    return Sheet(str(c.path), "meters", tuple(columns), np.argsort(c.source_v, kind="stable"))


def _levels_sheet(c, channel):
    name = channel if channel in c.channels else max(c.channels, key=lambda n: np.ptp(c.channels[n]))
    v = c.channels[name]
    code = np.arange(len(v)) - (len(v) - 1) / 2
    line = np.mean(v) + code * (code @ v) / (code @ code)
    return Sheet(str(c.path), "levels", (Column(name, "V", v, error=v - line, limits=DAC_V),))


def _driven_sheet(c):
    columns = (Column("input", "V", c.input_v, fast=True), Column("output", "V", c.output_v, fast=True))
    return Sheet(c.path, "driven", columns)


def _zero_rate_sheet(c):
    columns = tuple(
        Column(f"axis {'xyzuvw'[k]}", "counts", c.counts[:, k].astype(float)) for k in range(c.counts.shape[1])
    )
    return Sheet(str(c.path), "rest", columns, stated={"lsb_deg_per_s": c.lsb_deg_per_s, "rate_hz": c.rate_hz})


KINDS = {Trace: _trace_sheet, Sweep: _sweep_sheet, Meters: _meters_sheet}
KINDS |= {InputOutput: _driven_sheet, ZeroRateRecord: _zero_rate_sheet}


def examine(paths, channel=None):
    """Findings about recordings of one part; files that no reader knows have none."""
    file_contents = [c for c in (readers.content(path) for path in paths) if c is not None]
    mended = tuple(f for c in file_contents for f in getattr(c, "quality", ()))
    return (*mended, *checks.examine([content_sheet(c, channel) for c in file_contents]))

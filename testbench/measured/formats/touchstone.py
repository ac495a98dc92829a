"""S-parameters of one or two ports: Touchstone 1, any frequency unit, MA, DB or RI.

    # Hz S dB R 50       frequency, then pairs in the order S11 S21 S12 S22
A frequency column that is a regular grid rounded to the printed digits is put back on its grid: the rounding is
the file's, not the analyser's.   Source    Touchstone File Format Specification 1.1 (EIA/IBIS)
"""

import math
import re

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import column_map
from testbench.measured.formats.contents import Sweep
from testbench.measured.quality import backwards, gaps
from testbench.measured.quality.finding import REFUSE, QualityError
from testbench.measured.quality.sheet import AXIS, Column, Sheet
from testbench.storage import inputs

UNITS = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "ghz": 1e9}
MOST, MOST_DB = 1e15, 200.0  # of any number, and of a parameter in dB
ORDERS = {1: ("s11",), 2: ("s11", "s21", "s12", "s22")}


def is_one(head):
    """True if an option line of Touchstone stands in the first bytes, or those of a column map."""
    return (
        column_map.is_map(head, "sweep")
        or re.search(rb"^\s*#\s*[kMG]?Hz\s+S\s+(dB|MA|RI)\s+R", head, re.I | re.M) is not None
    )


def _pairs(kind, a, b):
    if kind == "ri":
        return a + 1j * b
    size = 10.0 ** (a / 20.0) if kind == "db" else a
    return size * np.exp(1j * np.deg2rad(b))


def _digits(token):
    """Decimal exponent of the last printed digit of a number."""
    mantissa, _, exponent = token.lower().partition("e")
    return int(exponent or 0) - len(mantissa.partition(".")[2])


def load(path):
    """`Sweep` of a file; FileError says line and reason."""
    if column_map.is_map_file(path):
        return column_map.read(path)
    comments, options, rows, last = [], None, [], 0.0
    for number, line in inputs.read_lines(path, "latin-1"):
        line, _, comment = line.partition("!")
        if comment.strip():
            comments.append(comment.strip())
        fields = line.split()
        if not fields:
            continue
        if fields[0].startswith("#"):
            options = options or _options(path, number, line)
            continue
        rows.append(_parse_frequency_row(path, number, fields))
        if len(rows[-1]) != len(rows[0]):
            raise FileError(f"{path}: line {number}: {len(rows[-1])} numbers, but the first row has {len(rows[0])}")
        last = max(last, 10.0 ** _digits(fields[0]))
    if options is None or len(rows) < 16:
        raise FileError(
            f"{path}: {len(rows)} rows and {'no' if options is None else 'an'} option line; "
            "a sweep needs an option line and at least 16 rows"
        )
    unit, kind, ohm = options
    data = np.array(rows)
    ports = {3: 1, 9: 2}.get(data.shape[1])
    if ports is None:
        raise FileError(f"{path}: {data.shape[1]} columns; expected 3 (one port) or 9 (two ports)")
    frequency, rounding = data[:, 0] * unit, last * unit
    frequency, regular = _restore_frequency_grid(path, frequency, rounding, data)
    if kind == "db" and np.max(data[:, 1::2]) > MOST_DB:
        raise FileError(f"{path}: a parameter of {np.max(data[:, 1::2]):.3g} dB is above {MOST_DB:g} dB")
    s = {name: _pairs(kind, data[:, 1 + 2 * k], data[:, 2 + 2 * k]) for k, name in enumerate(ORDERS[ports])}
    for name, value in s.items():
        if not np.all(np.abs(value) < MOST):
            raise FileError(f"{path}: {name} is above {MOST:g}")
    columns = {name: (data[:, 1 + 2 * k], data[:, 2 + 2 * k]) for k, name in enumerate(ORDERS[ports])}
    polar = {} if kind == "ri" else columns
    return Sweep(str(path), tuple(comments), frequency, s, ohm, regular, rounding, polar, kind == "db")


def _parse_frequency_row(path, number, fields):
    """Numbers of a line: all finite, the first one a frequency above 0."""
    try:
        values = [float(f) for f in fields]
    except ValueError:
        raise FileError(f"{path}: line {number}: {' '.join(fields)[:80]!r} is not a row of numbers") from None
    if not all(abs(value) < MOST for value in values) or not values[0] >= 0:
        raise FileError(f"{path}: line {number}: a number is not finite, above {MOST:g}, or the frequency is below 0")
    return values


def _options(path, number, line):
    option_match = re.fullmatch(r"\s*#\s*(\w+)\s+(\w)\s+(\w+)\s+R\s+(\S+)\s*", line, re.I)
    unit, kind = (option_match[1].lower(), option_match[3].lower()) if option_match else ("", "")
    if unit not in UNITS or option_match[2].lower() != "s" or kind not in ("db", "ma", "ri"):
        raise FileError(f"{path}: line {number}: {line.strip()!r}: expected an option line such as '# Hz S dB R 50'")
    try:
        ohm = float(option_match[4])
    except ValueError:
        ohm = math.nan
    if not 0 < ohm < 1e6:
        raise FileError(f"{path}: line {number}: reference resistance {option_match[4]} ohm is outside 0 .. 1e6 ohm")
    return UNITS[unit], kind, ohm


def _restore_frequency_grid(path, frequency, rounding, data):
    """(frequencies, True if they were put back on a regular grid); FileError where they are no sweep upwards."""
    data_columns = [Column(f"column {k + 2}", "", v) for k, v in enumerate(data[:, 1:].T)]
    sheet = Sheet(str(path), "sweep", (Column("frequency", "Hz", frequency, AXIS, resolution=rounding), *data_columns))
    backwards.rising_order(sheet, False, False)
    if frequency[-1] == frequency[0]:
        raise FileError(f"{path}: all frequencies are equal; expected a rising sweep")
    grid = np.linspace(frequency[0], frequency[-1], len(frequency))
    if np.max(np.abs(grid - frequency)) <= 1.01 * rounding:
        return grid, True
    if np.any(np.diff(frequency) == 0):
        missing = list(gaps.check(sheet))
        if missing:  # a grid with a hole cannot be put back, and its print is too coarse to do without
            raise QualityError([f._replace(action=REFUSE) for f in missing])
        backwards.rising_order(sheet, True, False)
    return frequency, False

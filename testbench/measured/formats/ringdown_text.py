"""Power over time (ring-down) or over frequency (spectrum) in dBm: text, header lines `% name: value`, two columns.

    % Sample ID: SP64-32            % time [s], power [dBm]          0.12, -84.3
Rows in reverse order are put right; instants that fall otherwise, or power that is not finite, are refused.
A frequency column that is a rounded regular grid is put back on its grid, as in touchstone.py.
"""

import re

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import column_map, contents
from testbench.measured.formats.contents import Trace
from testbench.measured.quality import backwards
from testbench.measured.quality.sheet import AXIS, Column, Sheet
from testbench.storage import inputs

SHORTEST = 64
MOST = 1e12  # of any number


def is_one(head):
    """True if the first bytes hold the line that names the columns, or are those of a column map."""
    return (
        column_map.is_map(head, "ring-down", "spectrum")
        or re.search(rb"^%\s*(time \[s\]|frequency \[Hz\]),\s*power \[dBm\]", head, re.M) is not None
    )


def load(path):
    """`Trace` of a file; FileError says line and reason."""
    if column_map.is_map_file(path):
        return column_map.read(path)
    header, kind, rows = {}, "", []
    for number, line in inputs.read_lines(path, errors="replace"):
        line = line.strip()
        if not line:
            continue
        if line.startswith("%"):
            text = line.lstrip("% ").strip()
            columns = re.fullmatch(r"(time|frequency) \[(s|Hz)\],\s*power \[dBm\]", text)
            if columns:
                kind = "ringdown" if columns[1] == "time" else "spectrum"
            elif ":" in text:
                name, _, value = text.partition(":")
                header[name.strip().lower()] = value.strip()
            continue
        try:
            x, power = (float(field) for field in line.split(","))
        except ValueError:
            raise FileError(f"{path}: line {number}: {line[:80]!r} is not 'number, number'") from None
        if not (abs(x) < MOST and abs(power) < MOST):
            raise FileError(f"{path}: line {number}: not finite, or above {MOST:g}")
        rows.append((x, power))
    if not kind:
        raise FileError(f"{path}: no line '% time [s], power [dBm]' or '% frequency [Hz], power [dBm]'")
    if len(rows) < SHORTEST:
        raise FileError(f"{path}: {len(rows)} rows, expected at least {SHORTEST}")
    x, power = np.array(rows).T
    order, order_findings = backwards.rising_order(_as_sheet(path, kind, x, power), kind == "ringdown", True)
    if order is not None:
        x, power = x[order], power[order]
    if x[-1] == x[0] or np.all(power == power[0]):
        raise FileError(f"{path}: a column is the same in every row")
    grid = x if kind == "ringdown" else contents.on_grid(x)
    return Trace(str(path), header, kind, grid, power, x, order_findings)


def _as_sheet(path, kind, x, power):
    name, unit = ("time", "s") if kind == "ringdown" else ("frequency", "Hz")
    return Sheet(str(path), kind, (Column(name, unit, x, AXIS), Column("power", "dBm", power)))

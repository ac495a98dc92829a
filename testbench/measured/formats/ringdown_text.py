"""Power over time (ring-down) or over frequency (spectrum) in dBm: text, header lines `% name: value`, two columns.

    % Sample ID: SP64-32            % time [s], power [dBm]          0.12, -84.3
Instants that fall or power that is not finite are refused. A frequency column that is a rounded regular grid is put
back on its grid, as in touchstone.py.
"""

import re
from typing import NamedTuple

import numpy as np

from testbench.errors import FileError
from testbench.storage.inputs import read_lines

SHORTEST = 64
MOST, MOST_DBM = 1e12, 1e3  # of s or Hz, and of dBm


class Trace(NamedTuple):
    """Header as text; abscissa in s (kind "ringdown") or Hz ("spectrum"); power in dBm."""

    path: str
    header: dict
    kind: str
    x: np.ndarray
    power_dbm: np.ndarray

    @property
    def sample(self):
        return self.header.get("sample id", "")

    @property
    def frequency_hz(self):
        try:
            return float(self.header.get("frequency [hz]", "nan"))
        except ValueError:
            return float("nan")


def is_one(head):
    """True if the first bytes hold the line that names the columns."""
    return re.search(rb"^%\s*(time \[s\]|frequency \[Hz\]),\s*power \[dBm\]", head, re.M) is not None


def load(path):
    """`Trace` of a file; FileError says line and reason."""
    header, kind, rows = {}, "", []
    for number, line in read_lines(path, errors="replace"):
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
        if not (abs(x) < MOST and abs(power) < MOST_DBM):
            raise FileError(f"{path}: line {number}: not finite, or above {MOST:g} s or Hz, {MOST_DBM:g} dBm")
        rows.append((x, power))
    if not kind:
        raise FileError(f"{path}: no line '% time [s], power [dBm]' or '% frequency [Hz], power [dBm]'")
    if len(rows) < SHORTEST:
        raise FileError(f"{path}: {len(rows)} rows, {SHORTEST} or more wanted")
    x, power = np.array(rows).T
    steps = np.diff(x)
    if np.any(steps < 0) or (kind == "ringdown" and np.any(steps == 0)):
        raise FileError(f"{path}: the first column falls or stands still")
    if x[-1] == x[0] or np.all(power == power[0]):
        raise FileError(f"{path}: a column is the same in every row")
    if kind == "spectrum":
        x = np.linspace(x[0], x[-1], len(x))
    return Trace(str(path), header, kind, x, power)

"""Readings of voltmeters beside a programmed source: `;` between the columns, first line the names, one row a point.

    date (MMDDYYYY-hh:mm:ss); source (V); readings (V) ...; sdev ...; temp ... (degC); roomtemp; roomr (%); roomp (hPa)

Readings are the columns that are no known name and follow the source; the k-th `sdev` belongs to the k-th reading.
Errors  FileError: another header, a row of another length, what is no number, fewer than 20 points
"""

import re
from datetime import datetime
from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import column_map
from testbench.measured.formats.contents import Meters
from testbench.measured.quality import backwards
from testbench.measured.quality.sheet import AXIS, Column, Sheet
from testbench.storage import inputs

HEAD = "date;source;"
DATE = "%m%d%Y-%H:%M:%S"
ENVIRONMENT = re.compile(r"(temp|room|hum|pres)\w*$", re.I)
SPREAD = re.compile(r"sdev\d*$", re.I)
MIN_POINTS = 20
MAX_POINTS = 1_000_000
MOST = 1e9  # of any number


def is_meters_file(path):
    """True if the first line is that of this format, or the file a column map of it."""
    if column_map.is_map_file(path, "meters"):
        return True
    return inputs.head(path, len(HEAD)).decode("ascii", "replace").lower() == HEAD


def read(path):
    """`Meters` of a file; see the module."""
    path = Path(path)
    if column_map.is_map_file(path):
        return column_map.read(path)
    lines = [line for _, line in inputs.read_lines(path, "ascii", "replace")]
    if not lines or not lines[0].lower().startswith(HEAD):
        raise FileError(f"{path}: line 1: expected {HEAD}..., found {lines[0][:40] if lines else 'nothing'}")
    head = [h.strip() for h in lines[0].strip().rstrip(";").split(";")]
    rows, when = [], []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        cells = line.strip().rstrip(";").split(";")
        if len(cells) != len(head):
            raise FileError(f"{path}: line {number}: {len(cells)} columns, expected {len(head)}")
        try:
            when.append(datetime.strptime(cells[0].strip(), DATE))
            values = [float(c) for c in cells[1:]]
        except ValueError as problem:
            raise FileError(f"{path}: line {number}: {problem}") from None
        if not all(abs(v) < MOST for v in values):
            raise FileError(f"{path}: line {number}: a value is not finite, or above {MOST:g}")
        rows.append(values)
    if not MIN_POINTS <= len(rows) <= MAX_POINTS:
        raise FileError(f"{path}: {len(rows)} points are outside {MIN_POINTS} .. {MAX_POINTS}")
    table, columns = np.array(rows), head[1:]
    meters = [i for i, c in enumerate(columns) if i and not ENVIRONMENT.match(c) and not SPREAD.match(c)]
    spreads = [i for i, c in enumerate(columns) if SPREAD.match(c)]
    if not meters:
        raise FileError(f"{path}: line 1: no column of readings after the source")
    seconds = np.array([(t - when[0]).total_seconds() for t in when])
    axis = Column("time", "s", seconds, AXIS)
    sheet = Sheet(str(path), "meters", (axis, Column("source", "V", table[:, 0])))
    order, order_findings = backwards.rising_order(sheet, False, True)
    if order is not None:
        seconds, table = (seconds - seconds[-1])[order], table[order]
    for name, fixed in (("time", seconds), ("source", table[:, 0]), *((columns[i], table[:, i]) for i in meters)):
        if np.all(fixed == fixed[0]):
            raise FileError(f"{path}: {name} is the same in all {len(rows)} points")
    return Meters(
        path,
        inputs.file_sha256(path),
        seconds,
        table[:, 0],
        tuple(columns[i] for i in meters),
        table[:, meters],
        table[:, spreads] if len(spreads) == len(meters) else None,
        {c: table[:, i] for i, c in enumerate(columns) if ENVIRONMENT.match(c)},
        order_findings,
    )

"""Tables of anybody: CSV, Parquet, NumPy archive or MATLAB 5 file as columns by name; the content decides.

    read_table(path)        {column: (n,) array}: numbers as they stand, in the file's own units; texts as texts
    numeric_columns(table)  columns of one length, all finite, as float64

CSV      `,` `;` tab or blanks between the cells; lines that begin with # % or ! are comments; the first other line
         names the columns unless all its cells are numbers: then they are "1", "2", ...
         an empty cell, nan or null is not a number: NaN; a column with any other text is one of texts
archive, MAT   an array of one row or column is a column; (n, k), k <= 64, is k columns "name[0]", "name[1]", ...
Errors   FileError: damaged, too large, rows of different lengths, duplicate names, no column
Source   docs/inputs.md
"""

import csv

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import mat_file
from testbench.measured.formats.parquet_input import read_parquet
from testbench.storage import inputs
from testbench.storage.npz_input import read_npz

MOST_COLUMNS = 256
WIDEST = 64  # columns of one array
COMMENT = "#%!"
EMPTY = ("", "nan", "null", "na", "n/a")
ARCHIVE, PARQUET, HDF5 = b"PK\x03\x04", b"PAR1", b"\x89HDF"


def read_table(path):
    """Columns of a file by name; see the module."""
    head = inputs.head(path, len(mat_file.MAGIC))
    if head.startswith(PARQUET):
        table = read_parquet(inputs.read_bytes(path), path)
    elif head.startswith(ARCHIVE):
        table = _split(path, read_npz(inputs.read_bytes(path), path))
    elif mat_file.is_mat(head):
        table = _split(path, mat_file.read_mat(path)[0])
    elif head.startswith(HDF5):
        raise FileError(f"{path}: HDF5 (MATLAB 7.3 too); expected CSV, Parquet, .npz or a MATLAB file of version 5")
    else:
        table = _csv(path)
    if not table:
        raise FileError(f"{path}: no column of numbers")
    return table


def numeric_columns(path, table, names):
    """{name: (n,) float64} of columns of a table; FileError: missing, not numbers, not finite, of another length."""
    out = {}
    for name in names:
        if name not in table:
            raise FileError(f"{path}: no column {name!r}; known: {', '.join(list(table)[:20])}")
        v = table[name]
        if v.dtype.kind not in "biuf":
            bad = next((str(c) for c in v.tolist() if not _is_number(str(c))), "")
            raise FileError(f"{path}: column {name!r}: {bad[:40]!r} is not a number")
        v = v.astype(float)
        if not np.all(np.isfinite(v)):
            row = int(np.flatnonzero(~np.isfinite(v))[0])
            raise FileError(f"{path}: column {name!r}: row {row + 1} is empty or not finite")
        out[name] = v
    lengths = {name: len(v) for name, v in out.items()}
    if len(set(lengths.values())) > 1:
        raise FileError(f"{path}: columns of different lengths: {lengths}")
    return out


def _split(path, arrays_by_name):
    """Columns of arrays: vectors as they are, tables by their shorter side."""
    out = {}
    for name, v in arrays_by_name.items():
        if v.dtype.kind not in "biufcU" or v.ndim > 2 or not v.size:
            continue
        if v.ndim < 2 or min(v.shape) == 1:
            out[name] = v.ravel()
        elif min(v.shape) <= WIDEST:
            columns = v if v.shape[1] <= v.shape[0] else v.T
            out |= {f"{name}[{k}]": np.ascontiguousarray(columns[:, k]) for k in range(columns.shape[1])}
    if len(out) > MOST_COLUMNS:
        raise FileError(f"{path}: {len(out)} columns are more than the limit of {MOST_COLUMNS}")
    return out


def _delimiter(line):
    """What stands between the cells of a line; None: blanks."""
    return next((mark for mark in ";\t," if mark in line), None)


def _split_cells(line, mark):
    cells = line.split() if mark is None else next(csv.reader([line], delimiter=mark))
    cells = [cell.strip() for cell in cells]
    return cells[:-1] if mark is not None and cells and not cells[-1] else cells


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return text.lower() in EMPTY
    return True


def _csv(path):
    mark, names, rows, lines = None, None, [], []
    for number, line in inputs.read_lines(path):
        line = line.strip("\ufeff\r\n \t") if number == 1 else line.rstrip("\r\n ")
        if not line.strip() or line.lstrip()[0] in COMMENT:
            continue
        if names is None:
            mark = _delimiter(line)
            cells = _split_cells(line, mark)
            numeric = all(_is_number(cell) for cell in cells)
            names = [str(k + 1) for k in range(len(cells))] if numeric else cells
            _check_column_names(path, number, names)
            if not numeric:
                continue
        cells = _split_cells(line, mark)
        cells += [""] * (len(names) - len(cells) if len(cells) == len(names) - 1 else 0)  # an empty last cell
        if len(cells) != len(names):
            raise FileError(f"{path}: line {number}: {len(cells)} cells, expected {len(names)}")
        rows.append(cells)
        lines.append(number)
    return {name: _parse_column(cells) for name, cells in zip(names, zip(*rows))} if rows else {}


def _check_column_names(path, number, names):
    if len(names) > MOST_COLUMNS:
        raise FileError(f"{path}: line {number}: {len(names)} columns are more than the limit of {MOST_COLUMNS}")
    for k, name in enumerate(names):
        if not name or name in names[:k]:
            raise FileError(f"{path}: line {number}: duplicate or empty column name {name[:40]!r}")


def _parse_column(cells):
    if all(_is_number(cell) for cell in cells):
        return np.array([float("nan") if cell.lower() in EMPTY else float(cell) for cell in cells])
    return np.array(cells)

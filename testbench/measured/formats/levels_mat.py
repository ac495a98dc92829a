"""Levels of a DAC in a MATLAB file (version 5): every vector of 2^N voltages that rises is one channel.

    read(path) -> Levels   voltages (V) at code 0 .. 2^N - 1, N = 9 .. 18, by the name of the variable

Errors  FileError: not such a file, no vector of 2^N finite numbers
"""

from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import column_map, mat_file
from testbench.measured.formats.contents import Levels
from testbench.storage import inputs

BITS = range(9, 19)
MOST_V = 1e6
MIN_MONOTONIC_SHARE = 0.9  # of the steps in one direction, also where blocks of levels are in the wrong place
MIN_RISE = 0.95  # rank correlation of a level with its code would be 1; a signal in time is far from it


def is_levels_file(path):
    """True if the file is of this format and holds at least one table of levels."""
    if column_map.is_map_file(path, "levels"):
        return True
    if not mat_file.is_mat(inputs.head(path, len(mat_file.MAGIC))):
        return False
    try:
        return bool(read(path).channels)
    except FileError:
        return False


def _rises(v):
    """True for a table of levels: a line over the code explains nearly all of it, or nearly all steps go one way."""
    code = np.arange(len(v), dtype=float)
    monotonic_share = max(np.mean(np.diff(v) > 0), np.mean(np.diff(v) < 0))
    return np.std(v) > 0 and (abs(np.corrcoef(code, v)[0, 1]) > MIN_RISE or monotonic_share > MIN_MONOTONIC_SHARE)


def read(path):
    """`Levels` of a file; see the module."""
    path = Path(path)
    if column_map.is_map_file(path):
        return column_map.read(path)
    mat_arrays, digest = mat_file.read_mat(path)
    channels = {}
    for name, value in mat_arrays.items():
        if value.dtype.kind not in "fiu":
            continue
        v = np.asarray(value, float).ravel()
        if len(v) in [1 << b for b in BITS] and np.all(np.abs(v) < MOST_V) and _rises(v):
            channels[name] = v
    if not channels:
        raise FileError(f"{path}: expected a vector of 2^9 .. 2^18 rising levels (V), found none")
    lengths = {len(v) for v in channels.values()}
    if len(lengths) != 1:
        raise FileError(f"{path}: channels of {sorted(lengths)} levels, expected the same number in all")
    return Levels(path, digest, lengths.pop().bit_length() - 1, channels)

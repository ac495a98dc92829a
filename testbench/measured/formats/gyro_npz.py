"""Gyroscope at rest in a NumPy archive: one integer array (samples, axes), its LSB in deg/s and the sample rate in Hz.

The array is found by its shape, the two numbers by the unit in their name (`..._deg_s`, `..._hz`).
Errors  FileError: no archive, an array of objects, no such array or numbers, fewer than 20000 samples
"""

import hashlib
from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import column_map
from testbench.measured.formats.contents import ZeroRateRecord
from testbench.storage import inputs
from testbench.storage.npz_input import read_npz

MIN_SAMPLES = 20_000
MAX_AXES = 6
MAGIC = b"PK\x03\x04"
LSB_DEG_S, RATE_HZ = (1e-12, 1e6), (1e-3, 1e9)  # far beyond any gyroscope


def is_zero_rate_file(path):
    """True if the file is an archive; what is in it only `read` can say."""
    head = inputs.head(path, column_map.HEAD_BYTES)
    return head.startswith(MAGIC) or column_map.is_map(head, "rest")


def _scalar(path, npz_arrays, ending, low, high):
    numbers = [name for name, v in npz_arrays.items() if v.size == 1 and v.dtype.kind in "iuf"]
    matching_names = [name for name in numbers if name.lower().endswith(ending)]
    if len(matching_names) != 1:
        raise FileError(f"{path}: expected one number named ...{ending}, found {len(matching_names)}")
    value = float(npz_arrays[matching_names[0]].item())
    if not low <= value <= high:
        raise FileError(f"{path}: {matching_names[0]} = {value:g} is outside {low:g} .. {high:g}")
    return value


def read(path):
    """`ZeroRateRecord` of a file; see the module."""
    path = Path(path)
    if column_map.is_map_file(path):
        return column_map.read(path)
    data = inputs.read_bytes(path)
    npz_arrays = read_npz(data, path)
    arrays = [v for v in npz_arrays.values() if v.ndim == 2 and v.dtype.kind in "iu" and 1 <= min(v.shape) <= MAX_AXES]
    if len(arrays) != 1:
        raise FileError(f"{path}: expected one integer array (samples, axes), found {len(arrays)}")
    counts = arrays[0] if arrays[0].shape[1] <= MAX_AXES else arrays[0].T
    if len(counts) < MIN_SAMPLES:
        raise FileError(f"{path}: {len(counts)} samples, expected at least {MIN_SAMPLES}")
    if np.any(np.ptp(counts, axis=0) == 0):
        raise FileError(f"{path}: axis {int(np.argmin(np.ptp(counts, axis=0)))} is the same in all samples")
    digest = hashlib.sha256(data).hexdigest()
    lsb, rate = _scalar(path, npz_arrays, "_deg_s", *LSB_DEG_S), _scalar(path, npz_arrays, "_hz", *RATE_HZ)
    return ZeroRateRecord(path, digest, counts, lsb, rate)

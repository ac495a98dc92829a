"""Input and output voltage of a driven part, sampled together: MATLAB 5 file with V1 (input) and V2 (output), volts.

The file holds no sampling rate; the reader of the file has to know it (1e7/2^14 Hz for the published ones).
"""

import numpy as np

from testbench.errors import FileError
from testbench.measured.formats import column_map, mat_file
from testbench.measured.formats.contents import InputOutput

FS_HZ = 1e7 / 2**14
SHORTEST = 4096
MOST_V = 1e6


def is_one(head):
    """True if the first bytes are those of a MATLAB 5 file; what is in it only `load` can say."""
    return mat_file.is_mat(head) or column_map.is_map(head, "driven")


def load(path, fs_hz=FS_HZ):
    """`InputOutput` of a file; None if it is a MATLAB file of something else; FileError if it is damaged."""
    if column_map.is_map_file(path):
        return column_map.read(path)
    mat_arrays, _ = mat_file.read_mat(path, ("V1", "V2", "Ovld1", "Ovld2"))
    if not {"V1", "V2"} <= set(mat_arrays):
        return None
    u, y = (np.asarray(mat_arrays[name]) for name in ("V1", "V2"))
    for name, v in (("V1", u), ("V2", y)):
        if v.dtype.kind not in "fiu" or v.ndim > 2 or min(v.shape, default=1) != 1:
            raise FileError(f"{path} {name}: {v.dtype} {v.shape}, expected one row of numbers (V)")
        if not np.all(np.isfinite(v)):
            raise FileError(f"{path} {name}: contains values that are not finite")
        if np.all(v == v.flat[0]) or np.max(np.abs(v)) > MOST_V:
            raise FileError(f"{path} {name}: is the same in all samples, or above {MOST_V:g} V")
    u, y = u.ravel().astype(float), y.ravel().astype(float)
    if len(u) != len(y) or len(u) < SHORTEST:
        raise FileError(f"{path}: V1 has {len(u)} samples, V2 {len(y)}; expected the same number, at least {SHORTEST}")
    is_overloaded = any(np.any(mat_arrays.get(name, 0)) for name in ("Ovld1", "Ovld2"))
    return InputOutput(str(path), u, y, float(fs_hz), bool(is_overloaded))

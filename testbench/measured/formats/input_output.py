"""Input and output voltage of a driven part, sampled together: MATLAB 5 file with V1 (input) and V2 (output), volts.

The file holds no sampling rate; the reader of the file has to know it (1e7/2^14 Hz for the published ones).
"""

from typing import NamedTuple

import numpy as np

from testbench.errors import FileError

FS_HZ = 1e7 / 2**14
SHORTEST = 4096


class InputOutput(NamedTuple):
    """Voltages (n,), sampling rate, and whether the digitiser says that it was overloaded."""

    path: str
    input_v: np.ndarray
    output_v: np.ndarray
    fs_hz: float
    overloaded: bool


def is_one(head):
    """True if the first bytes are those of a MATLAB 5 file; what is in it only `load` can say."""
    return head.startswith(b"MATLAB 5.0 MAT-file")


def load(path, fs_hz=FS_HZ):
    """`InputOutput` of a file; None if it is a MATLAB file of something else; FileError if it is damaged."""
    import scipy.io

    try:
        with open(path, "rb") as file:
            held = {name for name, _, _ in scipy.io.whosmat(file)}
            if not {"V1", "V2"} <= held:
                return None
            file.seek(0)
            found = scipy.io.loadmat(file, variable_names=["V1", "V2", "Ovld1", "Ovld2"])
    except OSError as problem:
        raise FileError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except (ValueError, TypeError, KeyError, NotImplementedError, scipy.io.matlab.MatReadError) as problem:
        raise FileError(f"{path}: not a readable MATLAB 5 file: {problem}") from None
    u, y = (np.asarray(found[name]) for name in ("V1", "V2"))
    for name, v in (("V1", u), ("V2", y)):
        if v.dtype.kind not in "fiu" or v.ndim > 2 or min(v.shape, default=1) != 1:
            raise FileError(f"{path} {name}: {v.dtype} {v.shape}, expected one row of numbers (V)")
        if not np.all(np.isfinite(v)):
            raise FileError(f"{path} {name}: holds what is not finite")
    u, y = u.ravel().astype(float), y.ravel().astype(float)
    if len(u) != len(y) or len(u) < SHORTEST:
        raise FileError(f"{path}: V1 has {len(u)} samples, V2 {len(y)}; the same number wanted, {SHORTEST} or more")
    over = any(np.any(found.get(name, 0)) for name in ("Ovld1", "Ovld2"))
    return InputOutput(str(path), u, y, float(fs_hz), bool(over))

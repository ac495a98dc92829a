"""MATLAB 5 files: variables that are plain arrays of numbers, their sizes known before anything is unpacked.

    read_mat(path, selected_names)   ({name: array}, SHA-256): numbers of the variables in `selected_names`, or of all

Other kinds of variables (structures, cells, texts, sparse matrices) are left alone.
Errors  FileError: damaged, or larger unpacked than `inputs.expansion` allows
"""

import hashlib
import io
import math
import warnings
import zlib

from testbench.errors import FileError
from testbench.storage import inputs

MAGIC = b"MATLAB 5.0 MAT-file"
HEADER_BYTES = 128
COMPRESSED = 15
KINDS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
PIECE = 1 << 20


def is_mat(head):
    """True if the first bytes are those of a MATLAB 5 file."""
    return head.startswith(MAGIC)


def _check_unpacked_size(data, source_name):
    """FileError if the compressed elements unpack to more than is allowed."""
    at, total = HEADER_BYTES, 0
    order = "little" if data[126:128] == b"IM" else "big"
    while at + 8 <= len(data):
        kind, size = (int.from_bytes(data[k : k + 4], order) for k in (at, at + 4))
        if kind == COMPRESSED:
            unpacker, compressed_bytes = zlib.decompressobj(), data[at + 8 : at + 8 + size]
            while compressed_bytes and not unpacker.eof:
                total += len(unpacker.decompress(compressed_bytes, PIECE))
                compressed_bytes = unpacker.unconsumed_tail
                inputs.expansion(source_name, total, len(data))
        at += 8 + size


def read_mat(path, selected_names=None):
    """({name: array}, SHA-256 of the file); FileError with one line."""
    import scipy.io

    data = inputs.read_bytes(path)
    if not is_mat(data):
        raise FileError(f"{path}: is not a MATLAB 5 file: the first bytes differ")
    with inputs.explain_damage(path, "MATLAB 5 file"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that stand twice: the last one counts
        _check_unpacked_size(data, path)
        variable_shapes = [(name, shape) for name, shape, kind in scipy.io.whosmat(io.BytesIO(data)) if kind in KINDS]
        names = [name for name, _ in variable_shapes if selected_names is None or name in selected_names]
        inputs.expansion(path, sum(8 * math.prod(shape) for name, shape in variable_shapes if name in names), len(data))
        arrays_by_name = scipy.io.loadmat(io.BytesIO(data), variable_names=names) if names else {}
    return {name: arrays_by_name[name] for name in names if name in arrays_by_name}, hashlib.sha256(data).hexdigest()

"""NumPy archives of others: plain arrays, their sizes known before anything is unpacked.

    read_npz(data, source_name)   {name: array} of the bytes of an .npz file

Refused are encrypted members, compression other than deflate, more than MOST_MEMBERS members, objects, a header that
states another size than its member has, and contents larger than `inputs.expansion` allows.
Source  docs/inputs.md
"""

import io
import math
import zipfile

import numpy as np
from numpy.lib import format as npy

from testbench.errors import FileError
from testbench.storage import inputs

MOST_MEMBERS = 64
ENCRYPTED = 1  # bit of the flags of a member
HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_npz(data, source_name):
    """Arrays of an archive by name; FileError with one line."""
    with inputs.explain_damage(source_name, "archive of arrays"), zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        if len(members) > MOST_MEMBERS:
            raise FileError(f"{source_name}: {len(members)} members are more than the limit of {MOST_MEMBERS}")
        inputs.expansion(source_name, sum(member.file_size for member in members), len(data))
        return {member.filename.removesuffix(".npy"): _array(archive, member, source_name) for member in members}


def _array(archive, member, source_name):
    name = f"{source_name}: member {member.filename}"
    if member.flag_bits & ENCRYPTED or member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FileError(f"{name}: is encrypted, or compressed otherwise than by deflate")
    with archive.open(member) as file:
        version = npy.read_magic(file)
        if version not in HEADERS:
            raise FileError(f"{name}: is of .npy version {version[0]}.{version[1]}, expected 1.0 or 2.0")
        shape, fortran, dtype = HEADERS[version](file)
        stated_bytes, stored_bytes = math.prod(shape) * dtype.itemsize, member.file_size - file.tell()
        if dtype.hasobject or dtype.names or stated_bytes != stored_bytes or min(shape, default=0) < 0:
            raise FileError(f"{name}: {dtype} {shape} needs {stated_bytes} bytes, the member has {stored_bytes}")
        array = np.frombuffer(file.read(), dtype) if stated_bytes else np.zeros(0, dtype)
    return array.reshape(shape, order="F" if fortran else "C").copy()

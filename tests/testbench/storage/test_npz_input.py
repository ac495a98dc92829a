"""Archives of arrays: sizes are known before anything is unpacked, and nothing is executed."""

import io
import struct
import zipfile

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.storage.npz_input import read_npz


def archive(members, compression=zipfile.ZIP_DEFLATED):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", compression) as file:
        for name, body in members.items():
            file.writestr(name, body)
    return data.getvalue()


def member(shape="(2,)", kind="'<i8'", body=bytes(16)):
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + body


def test_what_numpy_writes_is_read():
    held = {
        "a": np.arange(6).reshape(2, 3),
        "b": np.asfortranarray(np.ones((3, 2))),
        "c": np.array("x"),
        "d": np.zeros(0),
    }
    for save in (np.savez, np.savez_compressed):
        data = io.BytesIO()
        save(data, **held)
        found = read_npz(data.getvalue(), "a")
        assert list(found) == list(held)
        for name, array in held.items():
            np.testing.assert_array_equal(found[name], array)
            assert found[name].dtype == array.dtype


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: b"x", "is not a readable archive of arrays"),
        (lambda: archive({"a.npy": member("(1000000000000,)")}), "8000000000000 bytes, the member has 16"),
        (lambda: archive({"a.npy": member("(-2,)")}), "the member has 16"),
        (lambda: archive({"a.npy": member("(2,)", "'|O'")}), "object"),
        (lambda: archive({"a.npy": member("__import__('os')")}), "is not a readable archive of arrays"),
        (lambda: archive({"a.npy": member()}, zipfile.ZIP_LZMA), "compressed otherwise than by deflate"),
        (lambda: archive({f"{k}.npy": member() for k in range(65)}), "65 members"),
        (lambda: archive({"a.npy": bytes(1 << 29)}), "536870912 bytes unpacked are more"),
        (lambda: archive({"a.npy": member()})[:60], "is not a readable archive of arrays"),
    ],
)
def test_what_no_writer_makes_is_one_line(made, said):
    with pytest.raises(FileError, match=said) as caught:
        read_npz(made(), "a.npz")
    assert str(caught.value).startswith("a.npz: ")


def test_an_encrypted_member_is_refused():
    data = bytearray(archive({"a.npy": member()}))
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + offset] |= 1
    with pytest.raises(FileError, match="encrypted"):
        read_npz(bytes(data), "a.npz")

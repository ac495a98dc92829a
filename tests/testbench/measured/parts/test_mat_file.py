"""MATLAB 5 files: only plain numbers, and no more than is allowed."""

import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from testbench.errors import FileError
from testbench.measured.formats.mat_file import read_mat


def test_plain_numbers_are_read_and_the_rest_is_left_alone(tmp_path):
    held = {"a": np.arange(6.0), "b": {"c": 1}, "d": "text", "e": np.array([["x"]], object), "f": np.int16(3)}
    for packed in (False, True):
        savemat(tmp_path / "a.mat", held, do_compression=packed)
        found, digest = read_mat(tmp_path / "a.mat")
        assert sorted(found) == ["a", "f"]
        assert found["a"].ravel().tolist() == list(range(6))
        assert len(digest) == 64
        assert list(read_mat(tmp_path / "a.mat", ("f", "g"))[0]) == ["f"]


def element(tmp_path, body):
    savemat(tmp_path / "a.mat", {"a": np.arange(6.0)})
    head, packed = (tmp_path / "a.mat").read_bytes()[:128], zlib.compress(body, 1)
    (tmp_path / "a.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    return tmp_path / "a.mat"


def test_a_compressed_element_is_limited(tmp_path):
    path = element(tmp_path, bytes(300_000_000))
    assert path.stat().st_size < 2_000_000
    with pytest.raises(FileError, match="bytes unpacked are more than the limit of 268435456"):
        read_mat(path)


@pytest.mark.parametrize("body", [b"", b"x", bytes(64), b"\x0e\0\0\0\xff\xff\xff\x7f" + bytes(64)])
def test_damage_is_one_line(tmp_path, body):
    with pytest.raises(FileError, match="is not a readable MATLAB 5 file"):
        read_mat(element(tmp_path, body))
    whole = element(tmp_path, bytes(1000)).read_bytes()
    (tmp_path / "a.mat").write_bytes(whole[:150] + b"\xff" * 8 + whole[158:])
    with pytest.raises(FileError, match="is not a readable MATLAB 5 file"):
        read_mat(tmp_path / "a.mat")

"""HDF5 of others: what leads out of the file, unpacks too much or is none of ours is refused; a crash is one line."""

import os
import signal
import sys
import time

import h5py
import numpy as np
import pytest

from testbench.errors import FileError
from testbench.storage import files, hdf5_input, inputs, sandboxed_read
from testbench.storage.record import RecordError

MOST_OBJECTS = 100  # to write ten thousand takes long


def write(path, make, sealed=True):
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "x"
        make(file)
    if sealed:
        files.seal(path)
    return path


def external(file):
    file.create_dataset("a", (1000,), "i4", external=[("/etc/passwd", 0, 4000)])


def virtual(file):
    layout = h5py.VirtualLayout((100,), "i4")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", (100,))
    file.create_virtual_dataset("a", layout)


def nested(file):
    node = file
    for k in range(40):
        node = node.create_group(f"g{k}")


def many(file):
    for k in range(MOST_OBJECTS):
        file.attrs[f"a{k}"] = 0


def shared_texts(file):
    """Half a gigabyte of text in a small file: all rows name the same one."""
    kind = h5py.string_dtype()
    file.create_dataset("a", (5000,), kind, fillvalue="x" * 100_000)


HOSTILE = {
    "soft": (lambda file: file.update({"a": h5py.SoftLink("/b")}), "/a, a soft or external link"),
    "external": (lambda file: file.update({"a": h5py.ExternalLink("/dev/zero", "/")}), "a soft or external link"),
    "circle": (lambda file: file.create_group("a").update({"b": file["/"]}), "deeper than 16 levels"),
    "storage": (external, "outside of the file"),
    "virtual": (virtual, "outside of the file"),
    "filter": (lambda file: file.create_dataset("a", data=np.zeros(9), chunks=(9,), compression="lzf"), "filter 32000"),
    "size": (lambda file: file.create_dataset("a", (1 << 40,), "i4", chunks=(99,)), "43980465111.. bytes unpacked"),
    "chunk": (
        lambda file: file.create_dataset("a", (1,), "i4", chunks=(1 << 27,), maxshape=(None,)),
        "5368709.. bytes",
    ),
    "depth": (nested, "deeper than 16 levels"),
    "objects": (many, "more than 100 groups"),
    "texts": (shared_texts, "bytes unpacked"),
}


@pytest.mark.parametrize(("name", "sealed"), [*((name, True) for name in HOSTILE), ("soft", False), ("size", False)])
def test_what_leads_out_of_a_file_or_unpacks_too_much_is_refused(tmp_path, monkeypatch, name, sealed):
    monkeypatch.setattr(hdf5_input, "MOST_OBJECTS", MOST_OBJECTS)
    make, said = HOSTILE[name]
    with pytest.raises(RecordError, match=said):
        hdf5_input.open_hdf5(write(tmp_path / "a.h5", make, sealed))


def test_a_plain_file_is_read_with_a_seal_and_without(tmp_path):
    for sealed in (True, False):
        path = write(tmp_path / "a.h5", lambda file: file.create_dataset("b/c", data=np.arange(9), chunks=(3,)), sealed)
        with hdf5_input.open_hdf5(path) as file:
            assert file["b/c"][:].tolist() == list(range(9))
        with hdf5_input.open_bytes(path.read_bytes(), path) as file:
            assert file["b/c"][:].tolist() == list(range(9))


def test_large_files_may_unpack_to_more(tmp_path, monkeypatch):
    monkeypatch.setenv("GYRO_INPUT_MB", "1")
    make = lambda file: file.create_dataset("a", data=np.zeros(1 << 18), chunks=True, compression=1)  # noqa: E731
    with pytest.raises(RecordError, match=r"20971.. bytes unpacked"):
        hdf5_input.open_hdf5(write(tmp_path / "a.h5", make))
    monkeypatch.setenv("GYRO_INPUT_MB", "3")
    hdf5_input.open_hdf5(tmp_path / "a.h5").close()


def test_what_is_no_hdf5_file_is_one_line(tmp_path):
    (tmp_path / "a").write_text("x")
    with pytest.raises(RecordError, match="R01 / expected an HDF5 file, found something else"):
        hdf5_input.open_hdf5(tmp_path / "a")
    with pytest.raises(FileError, match="is not a regular file"):
        hdf5_input.open_hdf5(tmp_path)
    (tmp_path / "b").write_bytes(hdf5_input.SIGNATURE + bytes(100))
    with pytest.raises(RecordError, match="R01"):
        hdf5_input.open_hdf5(tmp_path / "b")


READER = """import sys, time
from pathlib import Path
from testbench.storage import sandboxed_read
sandboxed_read.main(lambda path: {body})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are of POSIX")
@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("time.sleep(60)", "reading takes longer than 1 s"),
        ("bytearray(1 << 33)", "exit code 1"),
        ("__import__('os').kill(__import__('os').getpid(), 9)", f"signal {int(signal.SIGKILL)}"),
        ("print('read', path.name, end='')", None),
    ],
)
def test_a_process_that_hangs_grows_or_dies_is_one_line(tmp_path, monkeypatch, body, said):
    (tmp_path / "reader.py").write_text(READER.format(body=body))
    (tmp_path / "a").write_text("x")
    monkeypatch.setattr(sandboxed_read, "LONGEST_S", 1.0)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path) + os.pathsep + os.environ.get("PYTHONPATH", ""))
    began = time.monotonic()
    if said is None:
        assert sandboxed_read.read_in_subprocess("reader", tmp_path / "a", "test") == b"read a"
        return
    with pytest.raises(FileError, match=f"is not a readable test: .*{said}") as caught:
        sandboxed_read.read_in_subprocess("reader", tmp_path / "a", "test")
    assert len(str(caught.value).splitlines()) == 1
    assert time.monotonic() - began < 30


def test_the_limit_of_text_tables_is_that_of_a_line_and_of_the_file(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("1\n" + "2" * (inputs.LONGEST_LINE + 1))
    with pytest.raises(FileError, match="line 2: 65537 characters"):
        list(inputs.read_lines(path))
    path.write_bytes(b"1\n2\n\xff\n")
    with pytest.raises(FileError, match="line 3: is not UTF-8 text"):
        list(inputs.read_lines(path))
    with open(path, "wb") as file:
        file.truncate(inputs.MOST_TABLE_BYTES + 1)
    with pytest.raises(FileError, match="more than the limit"):
        list(inputs.read_lines(path))

"""Input layer: what is no regular file is refused at once, limits hold before reading, and an error is one line."""

import os
import sys
import time
from dataclasses import dataclass

import pytest

from testbench.errors import ConfigError, FileError
from testbench.storage import inputs


def test_a_regular_file_is_read(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"a": 1}')
    assert inputs.read_bytes(path) == b'{"a": 1}'
    assert inputs.read_text(path) == '{"a": 1}'
    assert inputs.read_json(path) == {"a": 1}
    (tmp_path / "link").symlink_to(path)
    assert inputs.read_json(tmp_path / "link") == {"a": 1}


@pytest.mark.skipif(sys.platform == "win32", reason="FIFOs and devices are of POSIX")
def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    began = time.monotonic()
    for path in (tmp_path / "fifo", tmp_path, "/dev/zero", "/dev/null"):
        with pytest.raises(FileError, match="is not a regular file"):
            inputs.read_bytes(path)
    assert time.monotonic() - began < 5
    with pytest.raises(FileError, match="No such file"):
        inputs.read_bytes(tmp_path / "none")
    with pytest.raises(FileError, match="null"):
        inputs.read_bytes("a\0b")


def test_the_limit_holds_before_reading(tmp_path, monkeypatch):
    path = tmp_path / "large"
    with open(path, "wb") as file:
        file.truncate(1 << 40)  # a sparse file: no memory could hold it
    with pytest.raises(FileError, match=r"1099511627776 bytes are more than the limit of 268435456"):
        inputs.read_bytes(path)
    monkeypatch.setenv("GYRO_INPUT_MB", "1")
    with pytest.raises(FileError, match="limit of 1000000 "):
        inputs.read_bytes(path)
    for wrong in ("x", "-1", "nan", "1e12"):
        monkeypatch.setenv("GYRO_INPUT_MB", wrong)
        with pytest.raises(ConfigError, match="GYRO_INPUT_MB"):
            inputs.read_bytes(path)


def test_expansion_is_limited_by_the_size_of_the_file():
    inputs.expansion("a", inputs.MOST_BYTES, 1)
    inputs.expansion("a", 50 << 30, 1 << 30)
    with pytest.raises(FileError, match="a: 268435457 bytes unpacked"):
        inputs.expansion("a", inputs.MOST_BYTES + 1, 1000)


@dataclass
class Head:
    name: str
    rows: int


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"name": "a", "rows": "two"}', "rows: Input should be a valid integer"),
        ('{"name": "a"}', "rows: Field required"),
        ("[]", "content: Input should be a dictionary or an instance of Head"),
        ("null", "content: Input should be a dictionary or an instance of Head"),
        ("{", "is not a readable JSON"),
        ("[" * 100_000, "is not a readable JSON"),
        ('{"name": "a", "rows": ' + "9" * 5000 + "}", "is not a readable JSON"),
        ("\xff", "is not a readable JSON"),
    ],
)
def test_json_is_of_its_type_or_one_line(tmp_path, text, said):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(FileError) as caught:
        inputs.read_json(path, Head)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)


def test_toml_is_a_dictionary_or_one_line(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("a = 1")
    assert inputs.read_toml(path) == {"a": 1}
    for data, said in ((b"a = ", "is not TOML"), (b"\xff", "byte 0"), (b"a = " + b"[" * 100_000, "is not TOML")):
        path.write_bytes(data)
        with pytest.raises(ConfigError, match=said):
            inputs.read_toml(path)
    path.write_bytes(b"a = " + b"9" * 5000)
    with pytest.raises(ConfigError, match="is not TOML"):
        inputs.read_toml(path)


def test_what_a_library_raises_is_one_line():
    for problem in (ValueError("bad\nheader"), MemoryError(), RecursionError("deep"), KeyError("x")):
        with pytest.raises(FileError) as caught, inputs.explain_damage("a.mat", "MATLAB file"):
            raise problem
        assert str(caught.value).startswith("a.mat: is not a readable MATLAB file: ")
        assert "\n" not in str(caught.value)
    with pytest.raises(FileError, match=r"^as it was$"), inputs.explain_damage("a.mat", "MATLAB file"):
        raise FileError("as it was")

"""Stages of a study: what is kept is read again only as it was written, and one process works in a folder."""

import json
import os

import pytest

from testbench import config
from testbench.errors import FileError
from testbench.paper import study
from testbench.paper.calibration import calibrations

RESULT = {"cases_deg": {"1": {"xe1": 1.5}}, "detuning": [0.1, None, float("inf")]}
DAMAGES = {
    "empty": lambda text: "",
    "half": lambda text: text[: len(text) // 2],
    "list": lambda text: "[]",
    "null": lambda text: "null",
    "huge_integer": lambda text: "7" * 5000,
    "deep": lambda text: "[" * 100_000,
    "edited": lambda text: text.replace("1.5", "2.5"),
    "no_seconds": lambda text: text.replace('"seconds"', '"second"'),
    "seconds": lambda text: json.dumps(json.loads(text) | {"seconds": "long"}),
    "no_hash": lambda text: text.replace('"sha256"', '"sha255"'),
}


@pytest.fixture
def calls(monkeypatch):
    """Calls of the calibration, which gives `RESULT`."""
    made = []

    def many(*args, **kwargs):
        made.append(args)
        return [RESULT]

    monkeypatch.setattr(calibrations, "many", many)
    return made


def calibrated(folder):
    return study.Study(config.Config(), folder, study.SMALL).calibration()


def test_a_stage_is_done_once(calls, tmp_path):
    assert calibrated(tmp_path) == calibrated(tmp_path) == RESULT
    assert len(calls) == 1


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_stage_is_done_again(calls, tmp_path, damage):
    calibrated(tmp_path)
    path = tmp_path / "calibration.json"
    whole = path.read_text()
    path.write_text(DAMAGES[damage](whole))
    assert calibrated(tmp_path) == RESULT
    assert len(calls) == 2
    assert json.loads(path.read_text())["sha256"] == json.loads(whole)["sha256"]


def test_a_fifo_is_not_waited_for(calls, tmp_path):
    os.mkfifo(tmp_path / "calibration.json")
    assert calibrated(tmp_path) == RESULT


def test_one_process_at_a_time(tmp_path):
    one, other = (study.Study(config.Config(), tmp_path, study.SMALL) for _ in range(2))
    with one.alone():
        with pytest.raises(FileError, match=rf"another study is at work here: process {os.getpid()} on "):
            with other.alone():
                pass
    with other.alone():
        pass


def test_a_file_in_the_place_of_the_folder_is_one_line(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileError, match="file: cannot be written"):
        study.Study(config.Config(), tmp_path / "file")

"""What the kills and pairs lean on sees what it must: hangs, tracebacks, several lines, files that differ."""

import signal

import pytest

from tests.processes import (
    HUNG,
    Ended,
    before_sources,
    difference,
    ended,
    killed_after,
    run_to_end,
    start,
    tree_of,
    wrong_end,
)

LINE = "gyro: x.toml: cannot be read: No such file or directory\n"


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (Ended(0, "out", "", 1), None),
        (Ended(2, "", LINE, 1), None),
        (Ended(130, "", "gyro: interrupted\n", 1), None),
        (Ended(2, "2 failed", "", 1), None),
        (Ended(HUNG, "", "", 120), "hangs for 120 s"),
        (Ended(1, "", "Traceback (most recent call last):\n ...\nKeyError: 'x'\n", 1), "traceback: KeyError: 'x'"),
        (Ended(0, "", "Traceback (most recent call last):\nOSError\n", 1), "traceback: OSError"),
        (Ended(-11, "", "", 1), "exit code -11"),
        (Ended(2, "", LINE + LINE, 1), "says 2 lines"),
        (Ended(2, "", "", 1), "says nothing"),
    ],
)
def test_a_wrong_end_is_one_line(found, said):
    wrong = wrong_end(found)
    assert (wrong is None) == (said is None)
    assert said is None or said in wrong


def test_trees_that_differ(tmp_path):
    for name, data in {"a/x": b"1", "a/y": b"2", "b/lock": b"3"}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(data)
    whole = tree_of(tmp_path)
    assert sorted(whole) == ["a/x", "a/y", "b/lock"]
    assert sorted(tree_of(tmp_path, ("*/lock",))) == ["a/x", "a/y"]
    assert difference(whole, tree_of(tmp_path)) is None
    (tmp_path / "a/x").write_bytes(b"0")
    (tmp_path / "a/y").rename(tmp_path / "a/z")
    assert difference(whole, tree_of(tmp_path)) == "a/y is missing; a/z was not there; a/x differs"
    assert tree_of(tmp_path, content=lambda path: b"")["a/x"] == tree_of(tmp_path, content=lambda path: b"")["b/lock"]


def test_processes_end_by_themselves_by_a_signal_or_by_patience(tmp_path):
    assert run_to_end(["--version"], tmp_path).code == 0
    assert killed_after(start(["--version"], tmp_path), 60, signal.SIGKILL).code == 0, "it had ended before"
    assert killed_after(start(["--version"], tmp_path), 0, signal.SIGKILL).code == -signal.SIGKILL
    assert ended(start(["--version"], tmp_path), 0.001).code == HUNG


def test_ctrl_c_while_modules_are_loaded_is_one_line(tmp_path):
    """At any moment from the first source of ours on."""
    for k in range(4):
        found = killed_after(start(["campaign", "--help"], tmp_path), 0.1 * (k + 1), signal.SIGINT)
        assert before_sources(found) or wrong_end(found, (0, 130, -signal.SIGINT)) is None, found.err

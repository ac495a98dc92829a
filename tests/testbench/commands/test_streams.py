"""Standard streams as shells give them: closed, full, without a reader, and in encodings that lack characters."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT / "tests" / "data" / "written_by_0.1.0"
GYRO = f"{sys.executable} -m testbench.commands.main"
CLOSED, FULL = (
    "gyro: standard output: is closed\n",
    "gyro: standard output: cannot be written: No space left on device\n",
)
# Every command that prints soon, with what its exit code is where nothing disturbs it
COMMANDS = {
    "--version": 0,
    "--help": 0,
    "budget": 0,
    "budget --json": 0,
    "loop": 0,
    "campaign --help": 0,
    "golden check nothing --rtl nothing": 2,
    "golden effect --help": 0,
    "golden prove --help": 0,
    f"measured check {DATA}/gyrorec.h5 --no-replay": 0,
    "measured trace --help": 0,
    "report paper --help": 0,
    "run --help": 0,
    "run --seconds -1": 2,
}
# a shell's redirection -> exit code and standard error, or None where they are the command's own
STREAMS = {
    " | head -c 1 > /dev/null": None,
    " | true": None,
    " >&-": (2, CLOSED),
    " > /dev/full": (2, FULL),
    " <&- > /dev/null": None,
    " 2>&- > /dev/null": None,
    " 2> /dev/full > /dev/null": None,
}
# the fast set: each stream of a command that is right, some of one that is refused; help starts three times as fast
QUICK = {
    "golden prove --help": (" | head -c 1 > /dev/null", " >&-", " <&- > /dev/null", " 2> /dev/full > /dev/null"),
    "budget": (" | true", " > /dev/full", " 2>&- > /dev/null"),
    "run --seconds -1": (" > /dev/full",),
}
ENCODINGS = ({"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "latin-1"}, {"LC_ALL": "C"}, {"LC_ALL": "POSIX"},
             {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"})  # fmt: skip


def done(command, **more):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **more}
    line = ["bash", "-c", f"set -o pipefail; {command}"]
    return subprocess.run(
        line, cwd=ROOT, env=environment, capture_output=True, text=True, errors="replace", timeout=120
    )


def quick():
    """The fast set; other streams of its commands are slow."""
    for command, streams in QUICK.items():
        for stream in STREAMS:
            yield pytest.param(command, stream, marks=() if stream in streams else pytest.mark.slow)


def ends_well(command, stream, code):
    wanted = STREAMS[stream]
    found = done(f"{GYRO} {command}{stream}")
    assert "Traceback" not in found.stderr, found.stderr
    assert "Exception ignored" not in found.stderr
    if wanted is None or (code and "full" in stream):  # an error of its own needs no standard output
        assert found.returncode == code, found.stderr
        assert len(found.stderr.splitlines()) <= (code != 0)
    else:
        assert (found.returncode, found.stderr) == wanted


def encodes(command, environment, code):
    found = done(f"{GYRO} {command}", **environment)
    assert found.returncode == code, found.stderr
    assert "Error" not in found.stderr.replace("FileError", "")


@pytest.mark.parametrize(("command", "stream"), list(quick()))
def test_a_stream_that_fails_is_one_line_and_one_without_a_reader_nothing(command, stream):
    ends_well(command, stream, COMMANDS[command])


@pytest.mark.slow
@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize("command", [c for c in COMMANDS if c not in QUICK])
def test_of_every_command(command, stream):
    ends_well(command, stream, COMMANDS[command])


@pytest.mark.parametrize("environment", ENCODINGS[::4], ids=str)
def test_an_encoding_without_a_character_ends_nothing(environment):
    encodes("budget", environment, 0)


@pytest.mark.slow
@pytest.mark.parametrize("environment", ENCODINGS, ids=str)
@pytest.mark.parametrize("command", COMMANDS)
def test_encodings_of_every_command(command, environment):
    encodes(command, environment, COMMANDS[command])


@pytest.mark.parametrize("columns", [pytest.param("40", marks=pytest.mark.slow), "20"])
@pytest.mark.parametrize("command", ["budget", pytest.param("loop", marks=pytest.mark.slow)])
def test_a_narrow_terminal_shows_every_number(command, columns):
    terminal, side = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": columns, "TERM": "dumb"}
    child = subprocess.Popen([*GYRO.split(), command], env=environment, stdout=side, stderr=side)
    os.close(side)
    pieces = []
    try:
        while piece := os.read(terminal, 4096):
            pieces.append(piece)
    except OSError:  # the child has ended
        pass
    os.close(terminal)
    shown = b"".join(pieces).decode()
    assert child.wait() == 0, shown
    wide = done(f"{GYRO} {command}").stdout
    numbers = [word for word in wide.split() if word.lstrip("-").replace(".", "", 1).isdigit()]
    assert len(numbers) > 20
    assert all(number in shown.split() for number in numbers)

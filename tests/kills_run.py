"""Two starts at once, and kills, of `gyro run`: nothing lost, nothing wrong in silence.

    pair(seed, folder)           two starts in one folder, the second after a time drawn by the seed
    kill(seed, folder, number)   a signal after a time drawn by the seed, then what its user would do

Both return None, or one line that says what was wrong: files and printed numbers are byte for byte those of an
undisturbed run, or the command is refused with one line and changes nothing.
"""

import functools
import json
import random
import re
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from tests.processes import difference, ended, killed_after, run_to_end, start, tree_of, wrong_end
from tests.testbench.command import gyro

OUT = "same"
NO_PICTURES = ("--set", "output.pictures=false", "--set", "output.html=false")
TO_LOCK = ("run", "--seconds", "0.01", "--set", "scenario.diagnose=false", *NO_PICTURES, "--out", "locked")
# checkpoints, a write, a fault and a diagnosis: every phase of a run
SETS = ("output.checkpoint_s=0.05", 'scenario.register_writes=[[0.2, "phase_drive_sine", 29300000000]]',
        'scenario.faults=[[0.1, "adc_stuck", "sense_cos", 5, 0.001]]')  # fmt: skip
RUN = ("run", "--resume", "state.h5", "--seconds", "0.4", "--rate-dps", "100", "--json", "--out", OUT,
       *(part for text in SETS for part in ("--set", text)))  # fmt: skip
RESUME = ("run", "--resume-run", OUT, "--json")
REFUSED = re.compile(
    r"gyro: same: (another run is using this folder: process .*|holds an unfinished run; .*|holds no .*)\n"
)
OF_THE_WALL = ("wall_s", "real_time_factor")


class Undisturbed(NamedTuple):
    """Files and numbers of a run that nothing disturbed, how long it took (s), and the state that it starts from."""

    tree: dict
    numbers: dict
    wall_s: float
    state: bytes


def content(path):
    """Bytes of a file, without the identity and the date of a record, and without the seal over them."""
    data = path.read_bytes()
    if path.name == "run.h5":
        data = data[: data.rindex(b"\nftr-gyro sha256 ")]
        data = re.sub(rb"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", b"", data)
        data = re.sub(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", b"", data)
    return data


def results(folder):
    """Files of a run; the report shows times of the wall."""
    return tree_of(Path(folder) / OUT, ("run.html",), content)


def numbers(text):
    """What --json printed, without what a clock on the wall decides."""
    return {key: value for key, value in json.loads(text).items() if key not in OF_THE_WALL}


@functools.cache
def undisturbed():
    """`Undisturbed`, once."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        done = gyro(*TO_LOCK, folder=folder)
        assert done.returncode == 0, done.stderr
        state = (folder / "locked/state.h5").read_bytes()
        (folder / "state.h5").write_bytes(state)
        done = run_to_end(RUN, folder)
        assert done.code == 0, done.err
        return Undisturbed(results(folder), numbers(done.out), done.wall_s, state)


def wrong_result(done, folder):
    """None if a process that ended well left what an undisturbed one leaves."""
    whole = undisturbed()
    if numbers(done.out) != whole.numbers:
        return "other numbers than an undisturbed run"
    return difference(whole.tree, results(folder))


def wrong_refusal(done):
    """None if a process that did not end well said one line that explains it."""
    return wrong_end(done, (2,)) or (None if REFUSED.fullmatch(done.err) else f"refused without a reason: {done.err!r}")


def pair(seed, folder):
    """Two starts; the second may be told to discard, or to resume."""
    whole, draw = undisturbed(), random.Random(seed)
    (Path(folder) / "state.h5").write_bytes(whole.state)
    first = start(RUN, folder)
    time.sleep(draw.uniform(0.0, 1.1 * whole.wall_s))
    second = start(draw.choice((RUN, (*RUN, "--discard"), RESUME)), folder)
    ends = [ended(process) for process in (first, second)]
    for done in ends:
        wrong = wrong_end(done, (0, 2)) or (wrong_refusal(done) if done.code else None)
        if wrong is not None:
            return wrong
    well = [done for done in ends if done.code == 0]
    if not well:
        return f"both are refused: {ends[0].err!r}"
    wrong = [wrong_result(done, folder) for done in well]
    return next((text for text in wrong if text is not None), None)


def kill(seed, folder, number):
    """A kill; then the same command, which must not touch an unfinished run; then the rest of it."""
    whole = undisturbed()
    (Path(folder) / "state.h5").write_bytes(whole.state)
    moment = random.Random(seed).uniform(0.0, 1.05 * whole.wall_s)
    done = killed_after(start(RUN, folder), moment, number)
    wrong = wrong_end(done, (0, 130, -number))
    unfinished = (Path(folder) / OUT / "run.partial/checkpoint.h5").exists()
    again = run_to_end(RUN, folder) if wrong is None else done
    if wrong is None and unfinished:
        wrong = wrong_refusal(again) if again.code else "an unfinished run was begun anew"
        again = run_to_end(RESUME, folder)
    if wrong is None and again.code:
        wrong = f"cannot go on: {again.err!r}"
    wrong = wrong or wrong_result(again, folder)
    return None if wrong is None else f"killed after {moment:.2f} s: {wrong}"


CASES = {"run": (pair, kill)}

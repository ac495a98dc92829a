"""Concurrent starts and kills of `campaign run` in local workers and on a Dask cluster, and of `report paper`.

    pair(seed, folder)            the command twice in one folder, at once or one a moment later
    kill(seed, folder, number)    a signal at a moment that is uniform over an undisturbed run, then the same command

Each returns None, or one line that says what was wrong: a traceback, a hang, a lost or changed point, a file that
differs from those of an undisturbed run. `CASES` names them.
"""

import atexit
import contextlib
import functools
import random
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.processes import before_sources, difference, ended, killed_after, start, tree_of, wrong_end
from tests.testbench.campaign.helpers import OPTIONS, plan_file

AT_ONCE_S = 0.3
NOT_RESULTS = ("journal/*", "claims/*", "lock", "store.json*", "*/journal/*", "*/claims/*", "*/lock", "*/store.json*",
               "timings.json")  # fmt: skip
ENDS = {signal.SIGTERM: (-signal.SIGTERM,), signal.SIGKILL: (-signal.SIGKILL,), signal.SIGINT: (130, -signal.SIGINT)}


class Case(NamedTuple):
    """A command that continues where it was ended.

    arguments  (folder of the plan) -> arguments; the results go to `out` in the working directory
    refusal    what the second of two says
    kept       pattern of files that, once there, may never change again
    env        environment
    """

    arguments: object
    refusal: str
    kept: str
    env: dict
    timeout_s: float = 120.0

    def start(self, folder):
        """Start it with `folder` as working directory."""
        return start(self.arguments(folder), folder, **self.env)

    def run_to_end(self, folder):
        """The same, waited for."""
        return ended(self.start(folder), self.timeout_s)


def tree(folder):
    """Files of the results."""
    return tree_of(Path(folder) / "out", NOT_RESULTS)


@functools.cache
def undisturbed(case_name):
    """(tree, seconds) of a run that nobody disturbs; the second of two, so that nothing is compiled in it."""
    case = BY_NAME[case_name]
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for name in ("first", "second"):
        (folder / name).mkdir()
        done = case.run_to_end(folder / name)
        if done.code != 0:
            raise AssertionError(f"{case_name}: {wrong_end(done) or done.err}")
    if different := difference(tree(folder / "first"), tree(folder / "second")):
        raise AssertionError(f"{case_name}: two undisturbed runs differ: {different}")
    return tree(folder / "second"), done.wall_s


def kept(case, folder):
    """{path: inode and time of change} of the files that are finished."""
    return {p: (p.stat().st_ino, p.stat().st_mtime_ns) for p in (Path(folder) / "out").glob(case.kept)}


def pair_of(name, seed, folder):
    """Two starts in one folder."""
    case, rng = BY_NAME[name], random.Random(seed)
    expected, seconds = undisturbed(name)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    first = case.start(folder)
    delay = rng.uniform(0, AT_ONCE_S) if rng.random() < 0.5 else rng.uniform(0, seconds)
    with contextlib.suppress(subprocess.TimeoutExpired):
        first.wait(delay)
    second = case.start(folder)
    ends = [ended(process, case.timeout_s) for process in (first, second)]
    for done in ends:
        if wrong := wrong_end(done, (0, 2)):
            return f"pair {seed}: {wrong}"
        if done.code == 2 and case.refusal not in done.err:
            return f"pair {seed}: is refused by another line: {done.err.strip()[-300:]}"
    if all(done.code for done in ends):
        return f"pair {seed}: both are refused"
    return _as_expected(f"pair {seed}", expected, folder)


def kill_of(name, seed, folder, number):
    """One start that gets a signal, and the same command again."""
    case, rng = BY_NAME[name], random.Random(f"{seed} {int(number)}")
    expected, seconds = undisturbed(name)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    delay = rng.uniform(0, seconds)
    what = f"kill {seed} by {signal.Signals(number).name} after {delay:.2f} s"
    done = killed_after(case.start(folder), delay, number, case.timeout_s)
    early = number == signal.SIGINT and before_sources(done)
    if not early and (wrong := wrong_end(done, (0, *ENDS[number]))):
        return f"{what}: {wrong}"
    before = kept(case, folder)
    again = case.run_to_end(folder)
    if again.code != 0 or wrong_end(again):
        return f"{what}: the same command {wrong_end(again) or again.err.strip()[-300:]}"
    now = kept(case, folder)
    if lost := [path.name for path in before if now.get(path) != before[path]]:
        return f"{what}: finished and then lost or written again: {', '.join(lost)}"
    return _as_expected(what, expected, folder)


def _as_expected(what, expected, folder):
    different = difference(expected, tree(folder))
    return f"{what}: {different}" if different else None


# ---- commands --------------------------------------------------------------------------------------------------------


def _campaign(*where):
    def arguments(folder):
        return ("campaign", "run", plan_file(folder, 2, 6, 2), "--out", "out", *where, *OPTIONS)

    return arguments


def _paper(folder):
    return ("report", "paper", "--small", "--rest-s", 10, "--workers", 1, "--out", "out")


BY_NAME = {
    "campaign": Case(
        _campaign("--workers", 2),
        "another campaign is running in this store",
        "points/??/*.h5",
        {"GYRO_INSTANT_S": "0.2"},
    ),
    "dask": Case(
        _campaign("--cluster", 1),
        "another campaign is running in this store",
        "points/??/*.h5",
        {"GYRO_INSTANT_S": "0.05"},
    ),
    "paper": Case(_paper, "another study is running in this folder", "store/points/??/*.h5", {}, 600.0),
}
CASES = {name: (functools.partial(pair_of, name), functools.partial(kill_of, name)) for name in BY_NAME}

"""Two starts at once, and kills, of `golden export` and of traces: nothing lost, nothing wrong in silence.

    golden    `gyro golden export`
    trace     `gyro measured trace` of the smallest record, a minute or more each
    tracing   the same core on the toy problem of its tests: every phase of a trace in seconds

    pair(seed, folder)           two starts of one command in one folder, the second after a time drawn by the seed
    kill(seed, folder, number)   a signal after a time drawn by the seed, then the same command again

Both return None, or one line that says what was wrong: results are byte for byte those of an undisturbed command, or
the command is refused with one line. A command that was killed leaves whole results or none.
"""

import functools
import random
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from tests.processes import difference, ended, killed_after, run_to_end, start, tree_of, wrong_end

BLOCK = "pi"
EXPORT = ("golden", "export", BLOCK, "--out", "golden")
UNFINISHED = ("*.part", "*.part/*", "*.old/*")
# The fewest conditions of which a trace is made: a fit, held-out data, repeats for the noise, one prior
PLAN = """
name = "small"
repeats = 2
seed = 1
fx_scatter_hz = 1e-3

[[condition]]
id = "late"
a_um = 4.0
from_dps = -150.0
rate_dps = -150.0
temperature_degc = 25.0
settle_s = 3.0
seconds = 0.6

[[condition]]
id = "held"
a_um = 5.0
from_dps = -100.0
rate_dps = 100.0
temperature_degc = 25.0
settle_s = 3.0
seconds = 0.6
role = "validate"

[[prior]]
param = "plant.fy_hz"
mean = 10863.3
sd = 1e-3
unit = "Hz"
"""
TRACE = ("measured", "trace", "record.h5", "--max-laws", "1", "--checkpoint", "kept", "--json", "trace.json",
         "--report", "trace.html")  # fmt: skip
TRACE_S = 900.0
TOY = """
from testbench.storage.files import write_text
from testbench.tracing.trace import trace
from tests.testbench.tracing.test_resume import OPTIONS, problem
write_text("trace.json", trace(problem(), OPTIONS, checkpoint="kept").text())
"""


class Undisturbed(NamedTuple):
    """Results of a command that nothing disturbed, and how long it took (s)."""

    tree: dict
    wall_s: float


def _results(folder, ignore=UNFINISHED):
    """Results of both commands below a folder: bundles, or page and JSON of a trace."""
    found = tree_of(folder, ("record.h5", "kept/*", *ignore))
    return {name: digest for name, digest in found.items() if not name.endswith(".toml")}


def _undisturbed(what, folder):
    done = ended(start(what, folder), TRACE_S)
    if done.code != 0:
        raise AssertionError(f"undisturbed: exit code {done.code}: {done.err[-300:]}")
    return Undisturbed(_results(folder, ()), done.wall_s)


@functools.cache
def _golden():
    with tempfile.TemporaryDirectory() as folder:
        return _undisturbed(EXPORT, folder)


@functools.cache
def _record():
    """Bytes of the record that is traced."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "plan.toml").write_text(PLAN)
        done = run_to_end(("measured", "record", "plan.toml", "--out", "record.h5"), folder, TRACE_S)
        if done.code != 0:
            raise AssertionError(f"record: exit code {done.code}: {done.err[-300:]}")
        return Path(folder, "record.h5").read_bytes()


@functools.cache
def _trace():
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "record.h5").write_bytes(_record())
        return _undisturbed(TRACE, folder)


def _parts(tree):
    """A tree by what is written as a whole: a bundle, or a single file."""
    parts = {}
    for name, digest in tree.items():
        bundle = "/".join(name.split("/")[:3]) if name.count("/") > 2 else name
        parts.setdefault(bundle, {})[name] = digest
    return parts


def _torn(whole, folder):
    """None if everything below a folder is whole or absent, else what is not."""
    wanted = _parts(whole.tree)
    for name, found in _parts(_results(folder)).items():
        if (wrong := difference(wanted.get(name, {}), found)) is not None:
            return f"{name}: neither whole nor absent: {wrong}"
    return None


def _two(what, whole, seed, folder):
    """Two starts at once in a folder that is prepared."""
    processes = [start(what, folder)]
    time.sleep(random.Random(seed).uniform(0.0, whole.wall_s))
    processes.append(start(what, folder))
    ends = [ended(process, TRACE_S) for process in processes]
    for done in ends:
        if (wrong := wrong_end(done, (0, 2))) is not None:
            return wrong
    if all(done.code for done in ends):
        return _torn(whole, folder) or f"both are refused: {ends[0].err[-200:]!r}"
    return difference(whole.tree, _results(folder, ()))


def _killed(what, whole, seed, folder, number):
    """A kill, then the same command again, in a folder that is prepared."""
    moment = random.Random(seed).uniform(0.0, 1.05 * whole.wall_s)
    done = killed_after(start(what, folder), moment, number, TRACE_S)
    # a signal while Python itself starts ends the process with Python's own words
    wrong = (None if done.code == -number else wrong_end(done, (0, 130))) or _torn(whole, folder)
    if wrong is not None:
        return f"killed after {moment:.2f} s: {wrong}"
    again = ended(start(what, folder), TRACE_S)
    if again.code != 0:
        return f"killed after {moment:.2f} s, then exit code {again.code}: {again.err[-300:]!r}"
    wrong = difference(whole.tree, _results(folder, ()))
    return None if wrong is None else f"killed after {moment:.2f} s, then: {wrong}"


def golden_pair(seed, folder):
    """Two exports of a block into one folder."""
    return _two(EXPORT, _golden(), seed, folder)


def golden_kill(seed, folder, number):
    """An export that gets a signal, and another one behind it."""
    return _killed(EXPORT, _golden(), seed, folder, number)


def trace_pair(seed, folder):
    """Two traces of a record with one folder of checkpoints."""
    whole = _trace()
    Path(folder, "record.h5").write_bytes(_record())
    return _two(TRACE, whole, seed, folder)


def trace_kill(seed, folder, number):
    """A trace that gets a signal, and one that goes on from its checkpoints."""
    whole = _trace()
    Path(folder, "record.h5").write_bytes(_record())
    return _killed(TRACE, whole, seed, folder, number)


@functools.cache
def _toy():
    with tempfile.TemporaryDirectory() as folder:
        return _undisturbed(TOY, folder)


def tracing_pair(seed, folder):
    """Two traces of the toy problem with one folder of checkpoints."""
    return _two(TOY, _toy(), seed, folder)


def tracing_kill(seed, folder, number):
    """A trace of the toy problem that gets a signal, and one that goes on."""
    return _killed(TOY, _toy(), seed, folder, number)


CASES = {
    "golden": (golden_pair, golden_kill),
    "trace": (trace_pair, trace_kill),
    "tracing": (tracing_pair, tracing_kill),
}

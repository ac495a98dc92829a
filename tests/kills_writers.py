"""Two starts at once, and kills, of the commands that write several files: what is left is of one command, old or new.

    pair(seed, folder)           two commands with other contents into one place, the second after a moment
    kill(seed, folder, number)   a command over the results of another one, and a signal

Both return None, or one line that says what was wrong: the place must be byte for byte as one of the two leaves it
undisturbed, and of two at least one must succeed; the other may be refused with one line.
"""

import functools
import io
import random
import re
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.fuzz import corpus
from tests.fuzz.hostile import toml
from tests.kills_golden import PLAN
from tests.processes import ROOT, difference, ended, killed_after, start, tree_of, wrong_end

OUT = "out"
PATIENCE_S = 600.0
# of a study only its results are written together
STORE = ("points/*", "plans/*", "journal/*", "claims/*", "states/*", "predictions/*", "lock", "store.json")
VECTORS = ("golden", "export", "dds")
SMALLER = "[design]\ndds_bits = 40\n"
BITS = ("--set", "design.dds_bits=40")
STUDY = """
name = "small"
engine = "word_lengths"
[set]
scenario.seconds = {seconds}
scenario.diagnose = false
[axes.seed]
noise.seed = [1, 2]
[[axes.design.cases]]
name = "default"
[keep]
frames = 80
tau_s = [10.0]
statistics.rate_word = ["mean", "adev"]
statistics.adc_sense_cos = ["mean"]
statistics.quadrature_code = ["mean"]
"""
# the study itself takes minutes, its files a moment
INFER = """
import json
from pathlib import Path
from testbench.paper.inference import inference_study
found = json.loads(Path({page!r}).read_text())
inference_study.run_inference = lambda progress=None: found | {{"draws": {draws}}}
from testbench.commands.main import main
main(["report", "infer", "--out", "out"])
"""


class Writer(NamedTuple):
    """Two commands that write other things into one place, each a command line or a Python text."""

    one: object
    other: object
    inputs: object = dict  # () -> {name: text or bytes} beside them


def _infer(draws):
    return INFER.format(page=str(ROOT / "docs/boards/paper_inferred.json"), draws=draws)


def _plans():
    return {f"{k}.toml": PLAN.replace("seed = 1", f"seed = {k}") for k in (1, 2)}


def _studies():
    return {f"{k}.toml": STUDY.format(seconds=20 + k) for k in (1, 2)}


def _targets():
    return {f"{k}.toml": f"[target]\nbandwidth_hz = {k}.0\n" for k in (20, 30)}


def _tables():
    """Two power-ons of a laboratory, 400 rows each."""
    files = {"map.toml": toml(corpus.LAB)}
    for k in (1, 2):
        codes = np.random.default_rng(k).integers(-3000, 3000, (400, 4)) * np.minimum(np.arange(400), 1)[:, None]
        text = io.StringIO()
        table = np.column_stack([125e-6 * np.arange(400), codes])
        np.savetxt(text, table, ["%.6f", *["%d"] * 4], ",", header="t,a,b,c,d", comments="")
        files[f"{k}.csv"] = text.getvalue()
    return files


def _both(command, *rest):
    return command, (*command, *rest)


WRITERS = {
    "registers": Writer(*_both(("registers", "--out", OUT), *BITS)),
    "host": Writer(*_both(("host", "--out", OUT), "--bus", "axi")),
    "fmu": Writer(*_both(("fmu", "--out", OUT), *BITS)),
    "c_model": Writer(*_both((*VECTORS, "--c", OUT), "--config", "b.toml"), lambda: {"b.toml": SMALLER}),
    "vectors": Writer(*_both((*VECTORS, "--out", OUT), "--config", "b.toml"), lambda: {"b.toml": SMALLER}),
    "design": Writer(*(("design", f"{k}.toml", "--out", f"{OUT}/board.toml", "--report", OUT) for k in (20, 30)),
                     _targets),
    "infer": Writer(_infer(1), _infer(2)),
    "record": Writer(*(("measured", "record", f"{k}.toml", "--out", f"{OUT}/record", "--envelope", f"{OUT}/hidden.json")
                       for k in (1, 2)), _plans),
    "import": Writer(*(("measured", "import", f"{k}.csv", "--map", "map.toml", "--out", OUT) for k in (1, 2)), _tables),
    "study": Writer(*(("study", f"{k}.toml", "--out", OUT, "--workers", "0") for k in (1, 2)), _studies),
}  # fmt: skip


def _content(path):
    """Bytes of a file, without the identity of a record, and without dates."""
    data = re.sub(rb'"record_id": "[^"]*"', b"", path.read_bytes())
    return re.sub(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?", b"", data)


def _tree(folder):
    return tree_of(Path(folder) / OUT, ("*.part/*", "*.part", *STORE), _content)


def _prepare(writer, folder):
    for name, data in writer.inputs().items():
        Path(folder, name).write_bytes(data.encode() if isinstance(data, str) else data)


@functools.cache
def _undisturbed(name, which):
    """(tree, wall time in s) of a command alone."""
    writer = WRITERS[name]
    with tempfile.TemporaryDirectory() as folder:
        _prepare(writer, folder)
        done = ended(start(writer[which], folder), PATIENCE_S)
        if done.code != 0:
            raise AssertionError(f"{name}: undisturbed: exit code {done.code}: {done.err[-300:]}")
        return _tree(folder), done.wall_s


def pair(name, seed, folder):
    """Two commands that write other things into one place."""
    writer, (_, wall_s) = WRITERS[name], _undisturbed(name, 0)
    _prepare(writer, folder)
    processes = [start(writer.one, folder)]
    time.sleep(random.Random(seed).uniform(0.0, 0.1 * wall_s))
    processes.append(start(writer.other, folder))
    ends = [ended(process, PATIENCE_S) for process in processes]
    for done in ends:
        if wrong := wrong_end(done, (0, 2)) or (done.code and "another" not in done.err and done.err):
            return wrong
    found = [_undisturbed(name, k)[0] for k, done in enumerate(ends) if done.code == 0]
    if not found:
        return f"both are refused: {ends[0].err[-200:]!r}"
    wrong = [difference(tree, _tree(folder)) for tree in found]
    return None if None in wrong else f"of neither: {wrong}"


def kill(name, seed, folder, number):
    """A signal to a command that writes over the results of another one; then that command again."""
    writer, (_, wall_s) = WRITERS[name], _undisturbed(name, 1)
    old, new = _undisturbed(name, 0)[0], _undisturbed(name, 1)[0]
    _prepare(writer, folder)
    if (done := ended(start(writer.one, folder), PATIENCE_S)).code:
        return f"exit code {done.code}: {done.err[-300:]!r}"
    draw = random.Random(seed)
    moment = draw.uniform(*draw.choice(((0.0, 1.05), (0.85, 1.05)))) * wall_s
    killed_after(start(writer.other, folder), moment, number, PATIENCE_S)
    time.sleep(0.1)  # a process that renames may still be at it
    found = _tree(folder)
    if found not in (old, new):
        return f"killed after {moment:.2f} s: neither old nor new: {difference(old, found)}; {difference(new, found)}"
    again = ended(start(writer.other, folder), PATIENCE_S)
    wrong = difference(new, _tree(folder)) if again.code == 0 else again.err[-300:]
    return None if wrong is None else f"killed after {moment:.2f} s, then: {wrong}"


CASES = {name: (functools.partial(pair, name), functools.partial(kill, name)) for name in WRITERS}

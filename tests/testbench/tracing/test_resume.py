"""Predictions and finished work: kept, checked, found again; a killed trace goes on to the same result."""

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from testbench.errors import ConfigError, FileError
from testbench.tracing.problem import trace_checkpoint
from testbench.tracing.problem.predictor import Failed, Predictor
from testbench.tracing.problem.problem import PredictionFailed
from testbench.tracing.problem.trace_checkpoint import Store, digest
from testbench.tracing.trace import Options, trace
from tests.testbench.tracing.toys import Toy

ROOT = Path(__file__).resolve().parents[3]
OPTIONS = Options(n_null=199, power=False)
KILLED = """
import os, signal, sys
from tests.testbench.tracing.test_resume import OPTIONS, problem
from testbench.tracing.problem import trace_checkpoint
from testbench.tracing.trace import trace
left = int(sys.argv[2])
def writing(self, key, ending, data, plain=trace_checkpoint.Store._write):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    plain(self, key, ending, data)
trace_checkpoint.Store._write = writing
trace(problem(), OPTIONS, checkpoint=sys.argv[1])
"""


def problem():
    return Toy(5, {"feed": 0.2, "duffing": 0.08})


def files(folder):
    return sorted(p for p in Path(folder).rglob("*") if p.is_file() and p.suffix != ".part")


@pytest.mark.slow
def test_a_killed_trace_goes_on_and_ends_the_same(tmp_path):
    whole = trace(problem(), OPTIONS, checkpoint=tmp_path / "whole").text()
    steps = len(files(tmp_path / "whole"))
    assert steps > 30
    rng, folder = random.Random(os.getpid()), tmp_path / "killed"
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    for _ in range(2):
        at = str(rng.randrange(1, steps // 2))
        done = subprocess.run([sys.executable, "-c", KILLED, str(folder), at], env=env, cwd=ROOT, check=False)
        assert done.returncode == -signal.SIGKILL, at
    before = len(files(folder))
    resumed, counted = problem(), []
    plain = resumed.predict
    resumed.predict = lambda points, which: counted.append(len(points)) or plain(points, which)
    assert trace(resumed, OPTIONS, checkpoint=folder).text() == whole
    assert before > 0
    asked = trace(problem(), OPTIONS).certificates["points_predicted"]
    assert sum(counted) < asked - 0.5 * before


def test_a_finished_trace_asks_the_problem_nothing_and_a_damaged_file_is_computed_again(tmp_path):
    whole = trace(problem(), OPTIONS, checkpoint=tmp_path).text()
    again = problem()
    again.predict = lambda points, which: pytest.fail("asked again")
    assert trace(again, OPTIONS, checkpoint=tmp_path).text() == whole
    for i, path in enumerate(files(tmp_path)):
        if i % 3 == 0:
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        elif i % 3 == 1:
            path.write_bytes(b"")
    assert trace(problem(), OPTIONS, checkpoint=tmp_path).text() == whole


@pytest.mark.slow
def test_other_data_do_not_find_this_ones_predictions(tmp_path):
    trace(problem(), OPTIONS, checkpoint=tmp_path)
    other = Toy(6, {"feed": 0.2, "duffing": 0.08})
    assert trace(other, OPTIONS, checkpoint=tmp_path).text() == trace(other, OPTIONS).text()


def test_a_folder_that_cannot_be_made_is_one_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="the folder for checkpoints cannot be created"):
        Store(tmp_path / "file" / "below")


def test_digests_see_every_bit():
    a = np.array([1.0, 2.0])
    assert digest(a) == digest(a.copy())
    assert (
        len({digest(a), digest(a + 1e-16), digest(a.reshape(2, 1)), digest(a * (1 + 2e-16)), digest([1.0, 2.0])}) == 4
    )


def test_one_bad_point_does_not_spoil_its_batch():
    toy = Toy(0)
    asks = Predictor(toy)
    good, bad = toy.theta, toy.theta.copy()
    bad[3] = 99.0
    first, second, third = asks([(good, {}), (bad, {}), (good, {"feed": 0.1})], (0, 2))
    assert isinstance(second, Failed)
    assert "out of range" in second.reason
    assert np.array_equal(first[1], toy.predict([(good, {})], [2])[0][0])
    assert not np.array_equal(first[0], third[0])


def test_a_prediction_that_is_not_finite_has_failed_and_a_wrong_shape_is_refused():
    toy = Toy(0)
    plain = toy.predict
    toy.predict = lambda points, which: [[a * np.nan for a in arrays] for arrays in plain(points, which)]
    assert Predictor(toy)([(toy.theta, {})], (0,)) == [Failed("not finite")]
    toy.predict = lambda points, which: [[a[:-1] for a in arrays] for arrays in plain(points, which)]
    with pytest.raises(ConfigError, match=r"fit0\.0: predicted \(31,\) features, measured \(32,\)"):
        Predictor(toy)([(toy.theta, {})], (0,))


def test_a_failure_is_remembered_too(tmp_path):
    toy = Toy(0)

    def fails(points, which):
        raise PredictionFailed("stuck")

    toy.predict = fails
    assert Predictor(toy, Store(tmp_path))([(toy.theta, {})], (0,)) == [Failed("stuck")]
    toy.predict = lambda points, which: pytest.fail("asked again")
    assert Predictor(toy, Store(tmp_path))([(toy.theta, {})], (0,)) == [Failed("stuck")]


@pytest.mark.slow
def test_work_of_other_sources_is_computed_again(tmp_path, monkeypatch):
    whole = trace(problem(), OPTIONS, checkpoint=tmp_path).text()
    monkeypatch.setattr(trace_checkpoint, "code_sha256", lambda: "0" * 64)
    again, asked = problem(), []
    plain = again.predict
    again.predict = lambda points, which: asked.append(len(points)) or plain(points, which)
    assert trace(again, OPTIONS, checkpoint=tmp_path).text() == whole
    assert asked


def test_one_changed_bit_anywhere_is_not_believed(tmp_path):
    store = Store(tmp_path)
    store.save_arrays("ab12", [np.arange(3.0)])
    assert store.load_or_compute("cd34", lambda: {"p": 0.25}) == {"p": 0.25}
    rng = random.Random(1)
    for path in files(tmp_path):
        whole = path.read_bytes()
        for bit in rng.sample(range(8 * len(whole)), 200):
            damaged = bytearray(whole)
            damaged[bit // 8] ^= 1 << bit % 8
            path.write_bytes(damaged)
            if path.suffix == ".npz":
                assert store.load_arrays("ab12") is None
            else:
                assert store.load_or_compute("cd34", lambda: "computed again") == "computed again"
        path.write_bytes(whole)


@pytest.mark.parametrize("ending", [".json", ".npz"])
@pytest.mark.parametrize("damage", ["swapped", "bit", "empty", "list", "fifo", "folder"])
def test_a_file_that_is_not_what_was_kept_is_not_believed(tmp_path, ending, damage):
    store, key, other = Store(tmp_path), digest("one"), digest("other")
    for k, name in enumerate((key, other)):
        store.load_or_compute(name, lambda k=k: {"x": k})
        store.save_arrays(name, [np.arange(3.0) + k])
    path, foreign = (next(tmp_path.rglob(f"{name}{ending}")) for name in (key, other))
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 4
    path.unlink()
    if damage == "fifo":
        os.mkfifo(path)
    elif damage == "folder":
        path.mkdir()
    else:
        path.write_bytes({"swapped": foreign.read_bytes(), "bit": data, "empty": b"", "list": b"[]"}[damage])
    if ending == ".npz":
        assert store.load_arrays(key) is None
    elif damage == "folder":
        with pytest.raises(FileError, match="cannot be written"):
            store.load_or_compute(key, lambda: {"x": 0})
    else:
        assert store.load_or_compute(key, lambda: {"x": "again"}) == {"x": "again"}
    assert store.load_arrays(other)[0].tolist() == [1.0, 2.0, 3.0]
    assert store.load_or_compute(other, lambda: pytest.fail("asked again")) == {"x": 1}

"""Campaigns that name the lanes engine have the files of the frame engine; points that share a call, or do not."""

import json

import numba
import pytest

from testbench.campaign import execute, pool, work
from testbench.campaign.plan import engines, plan
from testbench.campaign.store import Store
from tests.testbench.campaign.helpers import INSTANT, LANES, OWN, campaign, child, finished, plan_file, run_json

needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")

MIXED = """
name = "mixed"
engine = "{engine}"

[set]
scenario.seconds = 0.004
scenario.origin = "power_on"
scenario.diagnose = false

[axes.board]
count = 9
plant.fx_hz = {{ normal = [11002.3, 5.0] }}
noise.seed = {{ range = [1, 9] }}

[[axes.case.cases]]
name = "plain"

[[axes.case.cases]]
name = "longer"
scenario.seconds = 0.0052
scenario.register_writes = [[0.002, "amplitude_setpoint", 123456]]
scenario.faults = [[0.003, "dac_stuck", "sense", 77, 0.0005]]

[[axes.case.cases]]
name = "digital"
firmware.board = "digital_sid"
scenario.seconds = 0.001

[keep]
streams.rate_word = 4
statistics.rate_word = ["mean", "std"]
statistics.truth_x = ["rms"]
"""


def mixed(folder, engine):
    path = folder / f"{engine}.toml"
    path.write_text(MIXED.format(engine=engine))
    return path


@pytest.fixture(scope="module")
def frame(tmp_path_factory):
    """A finished campaign of the frame engine."""
    folder = tmp_path_factory.mktemp("frame")
    run_json(mixed(folder, "frame"), "--out", folder / "s")
    return folder / "s"


@pytest.mark.slow
@needs_compiler
def test_files_are_those_of_the_frame_engine(frame, tmp_path):
    """27 points: boards, and cases of two lengths and two boards."""
    report = run_json(mixed(tmp_path, "lanes"), "--out", tmp_path / "s")
    assert (report["done"], report["failures"]) == (27, [])
    assert finished(tmp_path / "s") == finished(frame)


@needs_compiler
def test_either_engine_continues_what_the_other_began(frame, tmp_path):
    report = run_json(mixed(tmp_path, "lanes"), "--out", frame)
    assert (report["reused"], report["done"]) == (27, 0)
    code, out, err = campaign("rerun", frame, Store.open_folder(frame).addresses()[3])
    assert (code, "identical" in out) == (0, True), err


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("where", ["--workers", "--cluster"])
def test_workers_and_a_cluster_change_nothing(frame, tmp_path, where):
    code, out, err = child("run", mixed(tmp_path, "lanes"), "--out", tmp_path / "s", where, 2)
    assert code == 0, err
    assert "27 points, 0 finished earlier, 27 in this run" in out
    assert finished(tmp_path / "s") == finished(frame)


def test_engines_as_an_axis_are_one_point(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text('[axes.by]\nengine = ["frame", "lanes", "clocked"]\n')
    points, _ = plan.points(plan.read(path))
    assert points[0].address == points[1].address != points[2].address
    assert [point.engine for point in points] == ["frame", "lanes", "clocked"]
    assert json.loads(points[1].identity)["engine"] == "frame"


def test_twins_hang_on_the_same_sources():
    lanes, frame = engines.load("lanes"), engines.load("frame")
    assert lanes.equivalent_to == "frame"
    assert engines.source_hash(lanes) == engines.source_hash(frame)


# ---- batches ---------------------------------------------------------------------------------------------------------


def batches(folder, workers, boards=10, engine=LANES):
    points, _ = plan.points(plan.read(plan_file(folder, 1, boards, 1, engine=engine), (), OWN))
    return [len(batch.identities) for batch in execute.make_batches(points, folder, workers)]


def test_few_points_are_spread_over_all_workers(tmp_path):
    assert batches(tmp_path, 1) == [8, 2]
    assert batches(tmp_path, 2) == [5, 5]
    assert batches(tmp_path, 4) == [3, 3, 3, 1]
    assert batches(tmp_path, 100) == [1] * 10
    assert batches(tmp_path, 2, boards=100) == [8] * 12 + [4]
    assert batches(tmp_path, 2, engine=INSTANT) == [1] * 10


def test_points_of_one_group_share_a_call(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(
        f'engine = "{LANES}"\n[axes.length]\nscenario.seconds = [0.5, 60.0]\n[axes.seed]\nnoise.seed = [1, 2, 3]\n'
    )
    points, states = plan.points(plan.read(path, (), OWN))
    lengths = [
        [json.loads(identity)["config"]["scenario"]["seconds"] for identity in batch.identities]
        for batch in execute.make_batches(points, states)
    ]
    assert lengths == [[0.5] * 3, [60.0] * 3]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["--workers", "--cluster"])
def test_the_mates_of_a_point_that_kills_its_worker_finish(tmp_path, where):
    """A batch whose worker dies is played again point by point, so only the point at fault fails."""
    path = tmp_path / "p.toml"
    path.write_text(f'engine = "{LANES}"\n[axes.rate]\nscenario.rate_dps = [0, 2, 5, 6, 7, 8, 9, 10]\n')
    code, out, err = child("run", path, "--out", tmp_path / "s", where, 1)
    assert code == 2, err
    assert "8 points, 0 finished earlier, 7 in this run" in out
    assert "1 failed" in out


def test_a_batch_alone():
    batch = work.Batch("frame", ["a", "b"])
    assert [one.identities for one in batch.split()] == [["a"], ["b"]]
    assert [one.engine for one in batch.split()] == ["frame"] * 2
    assert [outcome.address for outcome in pool.death_notice(batch, 3, -9)] == batch.addresses

"""The published recordings, if GYRO_DATA_DIR names their folder: under other names, with the same verdicts."""

import os
import shutil
from pathlib import Path

import pytest

from testbench.measured.exam.staged import add_in_stages
from testbench.measured.openers import open_problem
from testbench.measured.parts import paper

ROOT = Path(os.environ.get("GYRO_DATA_DIR", "/nonexistent"))
pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="GYRO_DATA_DIR names no folder")


def renamed(folder, pattern, where):
    """Copies of a set's files under names that say nothing."""
    return [Path(shutil.copy(p, where / f"{k}.data")) for k, p in enumerate(sorted((ROOT / folder).glob(pattern)))]


@pytest.mark.slow
@pytest.mark.parametrize(("chooses", "limit_lsb"), [("1", 1.2 * 0.0626), ("2", 1.2 * 0.0428)])
def test_each_session_of_the_dac_finds_its_segments(tmp_path, chooses, limit_lsb):
    """The limits are 1.2 times what a dictionary of thirty laws left on the same sessions."""
    problem = open_problem(renamed("dac16_levels", "*.mat", tmp_path), {"fit": chooses})
    found = add_in_stages(problem, most=4).json
    row, effects = found["heldout"]["level"], {e["law"]: e for e in found["effects"]}
    assert found["effects"][0]["law"] == "16 segments above a ladder"
    assert "bend of the ladder over 512 codes" in effects
    assert row["after_one_law"] < row["before"] / 5
    assert row["after"] <= limit_lsb


@pytest.mark.slow
def test_the_meters_have_errors_of_their_own_and_one_is_broken(tmp_path):
    (path,) = renamed("dmm_linearity", "*.dsv", tmp_path)
    found = add_in_stages(open_problem([path], {}), most=36).json
    ratio = {name: row["after"] / row["floor"] for name, row in found["heldout"].items()}
    broken = [name for name, r in ratio.items() if r > 1.5]
    before = {name: row["before"] for name, row in found["heldout"].items()}
    assert broken == [max(before, key=before.get)], "the one that nobody explains is the one that was worst"
    laws = {e["law"].split(": ")[1] for e in found["effects"]}
    assert {"turnover", "memory", "gain with temp3"} <= laws


@pytest.mark.slow
def test_the_gyroscopes_third_axis_vibrates_and_settles(tmp_path):
    (path,) = renamed("gyro_static", "*.npz", tmp_path)
    found = add_in_stages(open_problem([path], {}), most=2).json
    assert [e["law"].split(": ")[0] for e in found["effects"]] == ["z", "z"]
    assert "settling" in found["effects"][1]["law"]
    row = found["heldout"]["spectrum z"]
    assert row["after"] < 1.5 * row["floor"] < row["before"]
    for axis in "xy":
        own = found["heldout"][f"spectrum {axis}"]
        assert own["before"] < 1.1 * own["floor"]
        assert own["after"] == own["before"], "no law acts on it"


def test_no_rival_of_a_number_of_the_paper_is_a_winner(tmp_path):
    (path,) = renamed("paper_numbers", "measured*.csv", tmp_path)
    data, _ = paper.report([path], {})
    verdict = {q["name"]: q["verdict"] for q in data["questions"] if q["case"].startswith(("case 1", "case 3 ("))}
    assert data["effects"] == []
    assert verdict["drive-mode feedback-path phase error"] == "fitted"
    assert verdict["sense-mode feedback-path phase error"] == "contradicted"

"""The published recordings themselves: official split of the driven record, other sets, other names. Wants the data.

python -m pytest -m slow tests/testbench/measured/parts/test_published_resonators.py   with GYRO_DATA_DIR set
"""

import json
import os
import shutil

import pytest

from testbench.measured import sets_report
from testbench.measured.exam import exam
from testbench.measured.formats import registry
from testbench.measured.openers import open_problem

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not os.environ.get(registry.FOLDER), reason=f"{registry.FOLDER} is not set"),
]


def traced(set_name):
    return {
        label: sets_report.trace_job(paths, options)[0]
        for label, paths, options in sets_report.jobs(registry.paths(set_name))
    }


def test_driven_resonator_official_split():
    (data,) = traced("silverbox").values()
    held = data["heldout"]
    assert data["effects"][0]["law"] == "duffing"
    assert held["arrow_full"]["unit"] == "mV"
    assert held["arrow_full"]["before"] > 14
    assert held["arrow_full"]["after_one_law"] <= 0.40
    assert held["arrow_full"]["after"] <= 0.32
    assert held["multisine"]["after"] <= 0.31
    assert held["arrow_no_extrapolation"]["after"] < held["arrow_no_extrapolation"]["after_one_law"]


def test_ring_downs_of_several_runs_name_a_damping_and_single_ones_are_candidates():
    for label, data in traced("mems_ringdown").items():
        first = data["effects"][0]["law"] if data["effects"] else ""
        if label in ("SP64-32", "SP64-33"):
            assert first == "damping_cubic"
            assert all(h["after"] < 0.1 * h["before"] for h in data["heldout"].values())
        else:
            assert data["verdict"] in ("none", "noise-model", "candidate")
            assert first in ("", "compression")
        assert all(h["after"] <= h["before"] for h in data["heldout"].values())
        assert all(e["value"] > 0 for e in data["effects"] if e["law"].startswith("damping"))


def test_the_sweeps_are_too_fast_for_the_crystal():
    found = traced("quartz_vna")
    rates, images = [], {}
    for label, data in found.items():
        assert data["effects"][0]["law"] == "sweep_rate"
        assert not any("second mode" in note for note in data["notes"])
        rates.append(data["effects"][0]["value"])
        assert all(h["after"] < 0.06 * h["before"] for h in data["heldout"].values())
        (where,) = (row["where"] for row in data["left"])  # the rest is above 1.5 floors: it is at the peak
        assert where["near_power"] > 0.6
        assert where["near_rows"] < 0.15
        images[label] = where["images_p"]
    assert [p < 0.05 for _, p in sorted(images.items())] == [True, False], (
        "images at the rate of the steps: 10 MHz alone"
    )
    assert abs(rates[0] / rates[1] - 1) < 0.01  # one analyser, two peaks: the same rate


def test_names_of_files_and_folders_change_nothing(tmp_path):
    _, paths, options = sets_report.jobs(registry.paths("mems_ringdown"))[0]
    copies = [tmp_path / f"recording{k}.bin" for k in range(len(paths))]
    for a, b in zip(paths, copies):
        shutil.copyfile(a, b)
    first, second = (exam.run_staged_search(open_problem(p, options)).json for p in (paths, copies))
    assert json.dumps(first, sort_keys=True) == json.dumps(second, sort_keys=True)


@pytest.mark.parametrize("set_name", ["mems_ringdown", "quartz_vna", "silverbox"])
def test_a_hundred_nulls_name_an_effect_at_most_once(set_name):
    _, paths, options = sets_report.jobs(registry.paths(set_name))[-1 if set_name == "quartz_vna" else 0]
    found = exam.nulls(open_problem(paths, options), 100)
    assert sum(bool(names) for names in found) <= 1

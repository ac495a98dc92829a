"""The frame engine in a campaign gives what a run gives."""

import json

import numba
import numpy as np
import pytest
import xarray

from testbench.campaign import played
from testbench.campaign.plan.measure import Keep, Keeper
from testbench.campaign.store import Store
from testbench.config import from_dict
from testbench.run import simulate
from tests.testbench.campaign.helpers import ROOT, campaign, plan_file, run_json

needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")


def test_numbers_of_a_summary_are_flat():
    summary = {
        "locked": True,
        "phase_deg": {"xe1": 1.5, "ye1": None},
        "paper_deg": {"xe1": 1.0},
        "flags": ["adc", "pll"],
        "lock_time_s": None,
        "wall_s": 3.0,
        "real_time_factor": 2.0,
        "counter_deg": None,
    }
    assert played.flat(summary) == {
        "locked": True,
        "phase_deg.xe1": 1.5,
        "phase_deg.ye1": None,
        "flags": "adc pll",
        "lock_time_s": None,
        "counter_deg": None,
    }


@needs_compiler
def test_points_are_those_of_single_runs(tmp_path):
    plan = plan_file(tmp_path, 1, 1, 2, engine="frame")
    run_json(plan, "--out", tmp_path / "s")
    store = Store.at(tmp_path / "s")
    with xarray.open_dataset(tmp_path / "s" / "results" / "tiny.nc") as data:
        data = data.squeeze(("temperature", "board"))
        for k in (0, 1):
            one = data.isel(seed=k)
            with xarray.open_dataset(store.point(str(one.point.values))) as point:
                tree = json.loads(str(point.identity.values))["config"]
            result = simulate.run(from_dict({**tree, "output": {"decimate": 1}}))
            assert str(one.codes_sha256.values) == result.summary["codes_sha256"]
            word = result.record.streams["rate_word"].data
            np.testing.assert_array_equal(one["rate_word"], word[: len(word) // 4 * 4].reshape(-1, 4).mean(axis=1))
            assert float(one["rate_word.mean"]) == word.mean()
        assert data.codes_sha256[0] != data.codes_sha256[1], "two seeds"
    code, out, err = campaign("rerun", tmp_path / "s", store.addresses()[0])
    assert (code, "identical" in out) == (0, True), err


OTHER_RATES = {
    "24 MHz": ("base = '{boards}/low_cost.toml'\n", "", 125e-6),
    "10 kHz": ("", "design.frame_ticks = 100\nplant.adc_modulator_hz = 640e3\nplant.sid_c_f = 2e-7\n", 100e-6),
}


@needs_compiler
@pytest.mark.parametrize("rate", OTHER_RATES)
@pytest.mark.parametrize("engine", ["frame", "baseband"])
def test_a_campaign_of_another_rate_is_that_of_its_runs(tmp_path, rate, engine):
    """Streams on the time of their own frames, statistics per second; numbers those of `gyro run`."""
    base, more, frame_s = OTHER_RATES[rate]
    text = f'name = "rates"\nengine = "{engine}"\n{base.format(boards=ROOT / "docs" / "boards")}[set]\n{more}'
    text += "scenario.seconds = 0.3\nscenario.rate_dps = 20.0\nscenario.diagnose = false\n"
    text += "[axes.seed]\nnoise.seed = [1, 2]\n"
    text += "[keep]\nframes = 2\nstreams.rate_word = 4\nstatistics.rate_word = ['slope']\n"
    (tmp_path / "plan.toml").write_text(text)
    run_json(tmp_path / "plan.toml", "--out", tmp_path / "s")
    store = Store.at(tmp_path / "s")
    with xarray.open_dataset(tmp_path / "s" / "results" / "rates.nc") as data:
        assert np.allclose(np.diff(data.time_4), 4 * frame_s, rtol=1e-12)
        one = data.isel(seed=1)
        with xarray.open_dataset(store.point(str(one.point.values))) as point:
            tree = json.loads(str(point.identity.values))["config"]
        tree["scenario"]["engine"] = engine
        result = simulate.run(from_dict({**tree, "output": {"decimate": 1}}))
        assert str(one.codes_sha256.values) == result.summary["codes_sha256"]
        word = result.record.streams["rate_word"].data
        scenario = round(0.3 / frame_s)
        np.testing.assert_array_equal(one["rate_word"], word[-scenario:].reshape(-1, 4).mean(axis=1))
        pairs = word[-scenario:].reshape(-1, 2).mean(axis=1)
        slope = np.polyfit(np.arange(len(pairs)) * 2 * frame_s, pairs, 1)[0]
        assert float(one["rate_word.slope"]) == pytest.approx(slope, rel=1e-6)


@needs_compiler
def test_rows_of_the_scenario_alone_reach_a_sink():
    config = from_dict(
        {
            "scenario": {"seconds": 0.002, "origin": "power_on", "diagnose": False, "engine": "frame"},
            "output": {"record": False},
        }
    )
    keeper = Keeper(Keep({"truth_temperature": 1, "rate_word": 1}, {}))
    simulate.run(config, sinks=(keeper,))
    assert len(keeper.variables()["rate_word"].data) == 16

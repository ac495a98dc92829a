"""The frame engine in a campaign gives what a run gives."""

import json

import numba
import numpy as np
import pytest
import xarray

from testbench.campaign import builtin_engines
from testbench.campaign.plan.measure import Keep, Keeper
from testbench.campaign.store import Store
from testbench.config import from_dict, sections
from testbench.engines import engine
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
    assert builtin_engines.flatten_summary(summary) == {
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
    store = Store.open_folder(tmp_path / "s")
    with xarray.open_dataset(tmp_path / "s" / "results" / "tiny.nc") as data:
        data = data.squeeze(("temperature", "board"))
        for k in (0, 1):
            one = data.isel(seed=k)
            with xarray.open_dataset(store.point_path(str(one.point.values))) as point:
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
@pytest.mark.parametrize(
    ("engine", "rate"),
    [
        ("frame", "24 MHz"),
        pytest.param("frame", "10 kHz", marks=pytest.mark.slow),
        pytest.param("baseband", "24 MHz", marks=pytest.mark.slow),
        ("baseband", "10 kHz"),
    ],
)
def test_a_campaign_of_another_rate_is_that_of_its_runs(tmp_path, rate, engine):
    """Streams on the time of their own frames, statistics per second; numbers those of `gyro run`."""
    base, more, frame_s = OTHER_RATES[rate]
    text = f'name = "rates"\nengine = "{engine}"\n{base.format(boards=ROOT / "docs" / "boards")}[set]\n{more}'
    text += "scenario.seconds = 0.3\nscenario.rate_dps = 20.0\nscenario.diagnose = false\n"
    text += "[axes.seed]\nnoise.seed = [1, 2]\n"
    text += "[keep]\nframes = 2\nstreams.rate_word = 4\nstatistics.rate_word = ['slope']\n"
    (tmp_path / "plan.toml").write_text(text)
    run_json(tmp_path / "plan.toml", "--out", tmp_path / "s")
    store = Store.open_folder(tmp_path / "s")
    with xarray.open_dataset(tmp_path / "s" / "results" / "rates.nc") as data:
        assert np.allclose(np.diff(data.time_4), 4 * frame_s, rtol=1e-12)
        one = data.isel(seed=1)
        with xarray.open_dataset(store.point_path(str(one.point.values))) as point:
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


# every key of [design]; the modulator keeps a conversion as long as a frame
DESIGNS = r"""
design.master_hz = 24_000_000\nplant.adc_modulator_hz = 472615.38461538462
design.tick_clocks = 32\nplant.adc_modulator_hz = 416000.0
design.frame_ticks = 100\nplant.adc_modulator_hz = 640000.0
design.dds_bits = 40
design.sine_address_bits = 8
design.sine_fraction_bits = 8
design.sine_bits = 16
design.drive_dac = "generic"\ndesign.drive_dac_bits = 14
design.sense_dac = "generic"\ndesign.sense_dac_bits = 18
design.drive_dac = "generic"\ndesign.drive_dac_bits = 12\ndesign.drive_dac_divider = 2
design.sense_dac = "generic"\ndesign.sense_dac_bits = 12\ndesign.sense_dac_divider = 2
design.adc = "generic"\ndesign.adc_bits = 18\ndesign.adc_tail_clocks = 20
design.adc_divider = 4
design.adc = "generic"\ndesign.adc_bits = 16\ndesign.adc_word_bits = 16\ndesign.adc_channels = 5
design.coefficient_fraction_bits = 18
design.accumulator_fraction_bits = 14
design.cordic_iterations = 10
design.cordic_guard_bits = 2
"""

for role, latch in (("drive", "LDAC"), ("sense", "load"), ("quadrature", "SYNC")):
    keys = {
        "": "'generic'",
        "_frame_bits": 23,
        "_command": 1,
        "_tail_bits": 2,
        "_lead_clocks": 1,
        "_latch": f"'{latch}'",
    }
    keys |= {"quadrature": {"_divider": 2}, "sense": {"_bits": 18}, "drive": {}}[role]
    DESIGNS += "\\n".join(f"design.{role}_dac{key} = {value}" for key, value in keys.items()) + "\n"


def designs_plan(folder, keep):
    cases = [text.replace("\\n", "\n") for text in DESIGNS.strip().splitlines()]
    path = folder / "designs.toml"
    path.write_text(
        "[set]\nscenario.seconds = 1.5\nscenario.origin = 'power_on'\nscenario.diagnose = false\n"
        + "".join(f"[[axes.design.cases]]\nname = 'case {k}'\n{text}\n" for k, text in enumerate(cases))
        + keep
    )
    return path, cases


@pytest.mark.slow
@needs_compiler
def test_every_key_of_a_design_is_swept(tmp_path):
    path, cases = designs_plan(tmp_path, "[keep]\nstatistics.rate_word = ['slope', 'mean']\n")
    swept = {line.split(" = ")[0] for text in cases for line in text.splitlines()}
    assert {name for name in swept if name.startswith("design.")} == {
        f"design.{key}" for key in sections()["design"].model_fields
    }
    assert run_json(path, "--out", tmp_path / "s")["done"] == len(cases)
    with xarray.open_dataset(tmp_path / "s" / "results" / "designs.nc") as data:
        assert len(set(data.codes_sha256.values.tolist())) == len(cases), "each key changes codes"
        rates = {name.split(".")[1]: data[name].values for name in data.coords if name.startswith("design.")}
        tick_s = rates["tick_clocks"] / rates["master_hz"]
        ticks = data.simulated_s.values / tick_s
        np.testing.assert_allclose(ticks, np.round(ticks), rtol=0, atol=1e-6)


def test_frames_of_another_length_have_their_own_time(tmp_path):
    keep = Keep({"rate_word": 4}, {"rate_word": ["slope"]})
    design = from_dict({"design": {"frame_ticks": 250, "dds_bits": 40}}).design_record()
    long, short = Keeper(keep, design), Keeper(keep)
    frames = np.arange(64)[:, None] * np.ones((1, len(engine.FRAME_COLUMNS)), np.int64)
    for keeper in (long, short):
        keeper.add(0, frames, np.zeros((64, len(engine.TRUTH_COLUMNS))))
    assert short.variables()["rate_word.slope"].data == pytest.approx(8000.0)
    assert long.variables()["rate_word.slope"].data == pytest.approx(4000.0)
    assert long.variables()["rate_word"].attrs["step_s"] == 0.001


def test_what_a_plan_of_designs_may_not_ask(tmp_path):
    for keep, said in (
        ("[keep.streams]\nrate_word = 8\n", "frames a second have no common time axis"),
        ("[keep]\ntau_s = [0.000125]\n", "tau_s: 0.000125 s is not a multiple of 1 frames of 135.417 us"),
    ):
        path, _ = designs_plan(tmp_path, keep)
        code, _, err = campaign("check", path)
        assert (code, said in err) == (2, True), err
    path.write_text("[axes.dac]\ndesign.sense_dac_bits = [20, 18]\n")
    code, _, err = campaign("check", path)
    assert (code, 'needs design.sense_dac = "generic" (point 1)' in err) == (2, True), err

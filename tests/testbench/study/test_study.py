"""The study's own arithmetic, and the command on an engine that takes no time; what it takes from a real run."""

import json
import math
from pathlib import Path

import numba
import numpy as np
import pytest

from fpga_model import pi
from testbench import config as configuration
from testbench.campaign.store import Store
from testbench.study import cost, points, prediction, study
from tests.testbench.command import gyro

ROOT = Path(__file__).resolve().parents[3]
PLAN = ROOT / "docs" / "campaigns" / "word_lengths.toml"
needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")

OWN = "--engine", "instant=tests.testbench.study.instant:ENGINE"
SMALL = """
name = "small"
engine = "instant"
[set]
scenario.seconds = 32.0
[axes.seed]
noise.seed = [1, 2]
[[axes.design.cases]]
name = "default"
[[axes.design.cases]]
name = "ADC 18"
design.adc = "generic"
design.adc_bits = 18
[keep]
frames = 80
tau_s = [10.0]
statistics.rate_word = ["adev"]
statistics.adc_sense_cos = ["mean"]
"""


def changed(**design):
    return configuration.changed(configuration.Config(), {f"design.{key}": value for key, value in design.items()})


def test_density_of_white_words_and_of_a_ramp():
    rng = np.random.default_rng(1)
    words = rng.normal(0.0, 100.0, 60 * 8000)
    expected = 2 * 100.0**2 / 8000
    density, line = points.band_density(words, 8000.0)
    assert density == pytest.approx(expected, rel=4 / math.sqrt(270))
    assert line == 0.0
    ramp = np.arange(len(words)) * 0.5
    assert points.band_density(words + ramp, 8000.0)[0] == pytest.approx(density, rel=1e-3)
    tone = 3.0 * np.sin(2 * np.pi * 4.5833 * np.arange(len(words)) / 8000)
    with_tone, line = points.band_density(words + tone, 8000.0)
    assert line == pytest.approx(3.0, rel=0.2)
    assert with_tone == pytest.approx(density, rel=0.01), "a line is no random walk"


@pytest.mark.parametrize("harmonic", [63, 2095])
def test_a_planted_line_is_found_at_its_level(harmonic):
    t, carrier_hz = np.arange(1 << 17) / 1e6, 11002.27
    rng = np.random.default_rng(2)
    codes = 300 * np.sin(2 * np.pi * carrier_hz * t)
    codes += 300 * 10 ** (-75 / 20) * np.cos(2 * np.pi * harmonic * carrier_hz * t)
    records = [codes + rng.uniform(-0.5, 0.5, len(t)) for _ in range(points.CODE_RECORDS)]
    found, dbc = points.largest_line(records, 1e6, carrier_hz)
    assert found == harmonic
    assert dbc == pytest.approx(-75.0, abs=0.6), "white noise is 25 dB below a line in a bin: 0.5 dB in one of records"


def test_spectrum_and_covariance_of_the_word_agree():
    """A first-order low-pass: density 4 s^2 t/(1 + (2 pi f t)^2), covariance s^2 exp(-lag/t)."""
    tau_s, sigma = 0.02, 3.0
    density = 4 * sigma**2 * tau_s / (1 + (2 * np.pi * prediction.GRID_HZ * tau_s) ** 2)
    found = prediction.covariance(density, 400)
    assert found[0] == pytest.approx(sigma**2, rel=0.01)
    lag_s = np.arange(400) * 125e-6
    np.testing.assert_allclose(found, sigma**2 * np.exp(-lag_s / tau_s), atol=0.01 * sigma**2)


@pytest.mark.parametrize("sizes", [(10, 10, 18), (4, 10, 18), (6, 4, 16), (8, 8, 12)])
def test_force_per_word_is_the_fundamental_of_a_table(sizes):
    """The table as its page describes it, in floats: rows, chords, cells, rounding; its Fourier transform."""
    a, f, b = sizes
    cells = 1 << (2 + a + f)
    place = (np.arange(cells) + 0.5) / cells * (4 << a)
    row = np.floor(place)
    full = 2 ** (b - 1) - 1
    low, high = (full * np.sin(2 * np.pi * r / (4 << a)) for r in (row, row + 1))
    wave = np.round(low + (high - low) * (place - row)) / 2 ** (b - 1)
    angle = 2 * np.pi * (np.arange(cells) + 0.5) / cells
    # the DDS passes through a cell: the mean over it is the staircase's own fundamental
    fundamental = 2 * np.mean(wave * np.sin(angle)) * np.sinc(1 / cells)
    config = changed(sine_address_bits=a, sine_fraction_bits=f, sine_bits=b)
    # rounding of a quarter's cells, 3 sigma; a quarter is all that differs
    sigma = 2 * math.sqrt(1 / 6 / cells) / 2 ** (b - 1)
    p = prediction.parameters_with_table_gain(config)
    held = config.device().sense_dac_span_v / 2**23 * np.sinc(p.w_rad_s / (2 * np.pi) / 1e6)
    assert p.volts_per_word / held == pytest.approx(fundamental, abs=3 * sigma + 1e-8)


def test_steps_of_a_converter_are_white_under_the_rule():
    """q^2/12, and not correlated with what is converted, from 0.4 steps of noise on; at 0.1 steps it is otherwise."""
    rng = np.random.default_rng(4)
    offset = rng.uniform(-0.5, 0.5, 200)[:, None]
    for rms, holds in ((prediction.RULE_LSB, True), (0.1, False)):
        x = offset + rng.normal(0.0, rms, (200, 5000))
        error = np.round(x) - x
        means = error.mean(axis=1)
        assert (np.abs(means).max() < 0.08) == holds
        if holds:
            assert error.var() == pytest.approx(1 / 12, rel=0.02)


def test_cost_counts_what_the_design_takes_away():
    base = cost.design_cost(configuration.Config())
    narrow = cost.design_cost(changed(coefficient_fraction_bits=16))
    assert base.registers - narrow.registers == 4 * 2 * 8, "prop and acc of four loops"
    assert base.multipliers - narrow.multipliers == 2 * 8 * 4 * pi.ERR.width
    small = cost.design_cost(changed(sine_address_bits=8))
    assert (base.tables, small.tables) == (1024 * 36, 256 * 38)
    dac = cost.design_cost(changed(sense_dac="generic", sense_dac_bits=16))
    assert base.registers - dac.registers == 3 * 4 + 8, "three codes, and the shift register of 24 bits"
    adc = cost.design_cost(changed(adc="generic", adc_bits=16))
    assert base.registers - adc.registers == 8 * (8 + 2)


def test_the_front_is_what_nothing_beats():
    rng = np.random.default_rng(5)
    price, loss = rng.integers(0, 20, 40).tolist(), rng.integers(0, 20, 40).tolist()
    found = study.front(price, loss)

    def beaten(k):
        return any(
            price[j] <= price[k] and loss[j] <= loss[k] and (price[j], loss[j]) != (price[k], loss[k])
            for j in range(40)
        )

    assert {(price[k], loss[k]) for k in found} == {(price[k], loss[k]) for k in range(40) if not beaten(k)}


def test_the_plan_of_the_repository():
    plan = study.read(PLAN)
    designs = study.designs(plan)
    assert len(designs) >= 30
    assert next(iter(designs.values())).design == configuration.Config().design
    axes = {axis.name: axis for axis in plan.axes}
    bins = 4.5 * plan.tree["scenario"]["seconds"]
    assert 0.5 / math.sqrt(bins * axes["seed"].length) < 0.03, "standard error of the ARW"
    degrees = 360 * 11002.3 / 26e6  # of a clock
    for name, config in designs.items():
        for chip, clocks, key in (("sense", 25, "phase_sense_sine_deg"), ("drive", 17, "phase_drive_sine_deg")):
            if getattr(config.design, f"{chip}_dac") == "generic":
                early = clocks - getattr(config.design, f"{chip}_dac_bits")
                assert getattr(config.firmware, key) == pytest.approx(-degrees * early, abs=1e-5), name


def test_the_line_of_the_default_board():
    f_hz = prediction.parameters_with_table_gain(configuration.Config()).w_rad_s / (2 * np.pi)
    page = " ".join((ROOT / "docs" / "word_lengths.md").read_text().split())
    assert f"8271 times its drive frequency is {8271 * f_hz - 91e6:.2f} Hz beside 91 MHz" in page


@pytest.mark.slow
def test_the_rule_covers_half_of_the_plan():
    designs = study.designs(study.read(PLAN))
    holds = [prediction.predict(config).holds for config in designs.values()]
    assert 2 * sum(holds) >= len(holds)


def test_the_command_writes_predictions_first_and_compares(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    done = gyro("study", path, "--out", tmp_path / "s", *OWN, "--workers", 0, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    (kept,) = (tmp_path / "s" / "predictions").glob("small-*.json")
    assert json.loads(kept.read_text())["sha256"] == found["predictions_sha256"]
    first = min(event.t for event in Store.open_folder(tmp_path / "s").events())
    assert kept.stat().st_mtime <= first
    one = found["designs"]["ADC 18"]
    assert one["simulated"]["scale_ppm"] == pytest.approx(6 / 8794 * 1e6, rel=1e-9)
    rise = math.sqrt(1.06) * 8794 / 8800 - 1
    assert one["simulated"]["arw_rise"] == pytest.approx(rise, rel=1e-9)
    assert one["simulated"]["keeps"] is False, "682 ppm"
    assert found["designs"]["default"]["simulated"]["keeps"] is True
    assert "Word lengths" in (tmp_path / "s" / "results" / "small.html").read_text()
    before = kept.read_bytes()
    again = gyro("study", path, "--out", tmp_path / "s", *OWN, "--workers", 0)
    assert (again.returncode, kept.read_bytes()) == (0, before), again.stderr
    assert "Pareto fronts" in again.stdout


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "[axes.seed]\nnoise.seed = [1, 2]\n",
            "",
            "needs exactly two axes: seed, with noise.seed alone, and design, with cases",
        ),
        ("tau_s = [10.0]", "tau_s = [1.0]", "tau_s = [1.0] lacks 10 s"),
        ("design.adc_bits = 18", "design.adc_bits = 15", "adc_bits = 15 is below"),
    ],
)
def test_what_is_no_study(tmp_path, old, new, said):
    path = tmp_path / "small.toml"
    path.write_text(SMALL.replace(old, new))
    done = gyro("study", path, "--out", tmp_path / "s", *OWN)
    assert (done.returncode, said in done.stderr) == (2, True), done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "s").exists()


@needs_compiler
def test_a_point_of_a_real_run():
    config = configuration.changed(configuration.Config(), {"scenario.seconds": 2.0, "output.record": False})

    class Sink:
        rows = 0

        def add(self, first_frame, frames, truth):
            self.rows += len(frames)

    sink = Sink()
    (found,) = points.run_points([config], [sink])
    assert sink.rows == 16000
    expected = prediction.predict(config)
    assert found["locked"] == 1
    assert found["scale_lsb_per_dps"] == pytest.approx(expected.scale_lsb_per_dps, rel=2e-4)
    assert found["bias_lsb"] / found["scale_lsb_per_dps"] == pytest.approx(expected.bias_dps, abs=0.01)
    assert found["bandwidth_hz"] == pytest.approx(expected.bandwidth_hz, abs=0.1)
    assert found["noise_lsb"] == pytest.approx(expected.noise_lsb, rel=0.15)
    assert found["spur_dbc"] == pytest.approx(expected.spur_dbc, abs=3.0)

"""Estimators on data of known content: counter, detuning, ring, scale factor, Allan deviation, bandwidth."""

import math

import numpy as np
import pytest

from testbench.paper import temperature
from testbench.paper.calibration import calibration_boards
from testbench.paper.calibration.bench import log_cosine_ratio
from testbench.paper.calibration.calibrate_phases import Readings, fit_ringing, fit_step_ringing
from testbench.paper.measure import measure_allan, measure_bandwidth, measure_scale
from tests.testbench.bench_setup import configured

FRAME_S = 125e-6

allantools = pytest.importorskip("allantools")


@pytest.mark.parametrize("psi_deg", [-7.0, -0.001, 0.0, 0.94, 5.0])
@pytest.mark.parametrize("theta_deg", [30.0, 45.0, 60.0])
def test_detuning_gives_the_angle_back(psi_deg, theta_deg):
    psi, theta = math.radians(psi_deg), math.radians(theta_deg)
    ratio = math.log(math.cos(psi + theta) / math.cos(psi - theta))
    assert log_cosine_ratio(theta_deg, ratio) == pytest.approx(psi_deg, abs=1e-9)


def test_ring_gives_split_and_decay_back():
    t = np.arange(40000) * FRAME_S
    rng = np.random.default_rng(1)
    x = 143000 + 3000 * np.exp(-t / 5.8) * np.cos(2 * np.pi * 139.0 * t + 0.3) + 100 * rng.normal(size=len(t))
    split, decay_s = fit_ringing(x, 130.0, FRAME_S)
    assert split / (2 * math.pi) == pytest.approx(139.0, abs=0.002)
    assert decay_s == pytest.approx(5.8, rel=0.01)


@pytest.mark.parametrize("decay_s", [0.02, 0.036, 0.07])
def test_a_ring_that_is_soon_gone_is_read_from_the_step(decay_s):
    """Behind the demodulator's own transient, which is none of it; the drawing is off by 10 % and a factor of 2."""
    t = np.arange(6000) * FRAME_S
    noise = 60 * np.random.default_rng(2).normal(size=len(t))
    line = 1e5 * np.exp(-t / decay_s) * np.cos(2 * np.pi * 53.2 * t - 0.4)
    own = 9e4 * (t / 3.2e-3) ** 2 * np.exp(-t / 3.2e-3)
    split, found_s = fit_step_ringing(-2e5 + line + own + noise, 48.0, 0.036, 3.2e-3, FRAME_S)
    assert split / (2 * math.pi) == pytest.approx(53.2, rel=3e-3)
    assert found_s == pytest.approx(decay_s, rel=0.02)


@pytest.mark.parametrize("other_deg", [0.0, 0.002])
def test_the_uncertainty_covers_readings_of_unequal_worth(other_deg):
    """Eight readings, some of a slow beat, and a scatter that is not announced: 99 % within."""
    rng, inside = np.random.default_rng(5), 0
    for _ in range(600):
        left = 10 ** rng.uniform(-3.7, -1.7, 8)
        one = Readings(1.0 + left * rng.normal(size=8) + other_deg * rng.normal(size=8), left).estimate()
        inside += abs(one.deg - 1.0) <= one.uncertainty_deg
    assert 0.985 <= inside / 600
    alone = Readings(np.array([1.0, 1.001, 1.5]), np.array([0.001, 0.001, 0.5])).estimate()
    assert alone.deg == pytest.approx(1.0005, abs=2e-4)


def test_scale_of_a_bent_line():
    rates = np.array(measure_scale.RATES_DPS)
    words = 8651.0 * rates + 120.0
    straight = measure_scale.fit(rates, words)
    assert straight.lsb_per_dps == pytest.approx(8651.0)
    assert straight.offset_lsb == pytest.approx(120.0)
    assert straight.nonlinearity_ppm < 1e-6 > straight.asymmetry_ppm
    bent = measure_scale.fit(rates, np.where(rates > 0, 1.001, 1.0) * words)
    assert bent.asymmetry_ppm == pytest.approx(1000.0, rel=0.01)
    assert max(abs(r) for r in bent.residual_ppm) == pytest.approx(bent.nonlinearity_ppm)


def test_allan_deviation_equals_allantools():
    rng = np.random.default_rng(2)
    rate = rng.normal(size=6000) + 0.05 * np.cumsum(rng.normal(size=6000)) / 10
    for m in (1, 2, 7, 64, 500):
        (_, want, _, _) = allantools.oadev(rate, rate=1.0, data_type="freq", taus=[m])
        assert measure_allan.overlapping_allan_deviation(rate, m) == pytest.approx(want[0], rel=1e-9)


def test_allan_fit_of_what_is_neither_white_nor_flicker():
    """A record at rest has nothing; a drift or a bounded angle has no negative share, whatever the other is."""
    still = measure_allan.analyse(np.full(3000, 0.3), 0.01)
    assert (still.arw_deg_per_rt_h, still.instability_deg_per_h, still.floor_deg_per_h) == (0.0, 0.0, 0.0)
    drift = measure_allan.analyse(np.linspace(-1, 1, 3000), 0.01)
    assert drift.arw_deg_per_rt_h == 0.0 < drift.instability_deg_per_h
    bounded = measure_allan.analyse(np.diff(np.random.default_rng(1).normal(size=3001)), 0.01)
    assert bounded.instability_deg_per_h == 0.0 < bounded.arw_deg_per_rt_h


def test_allan_fit_finds_white_noise_and_flicker():
    """White noise of one-sided density S gives N = sqrt(S/2); the answer in deg/sqrt(h)."""
    rng = np.random.default_rng(3)
    base_s, n_dps = 0.01, 0.1337 / 60
    rate = n_dps / math.sqrt(base_s) * rng.normal(size=60000)
    found = measure_allan.analyse(rate, base_s)
    assert found.arw_deg_per_rt_h == pytest.approx(0.1337, rel=0.03)
    assert found.instability_deg_per_h < 2.0
    assert found.floor_low_deg_per_h < found.floor_deg_per_h < found.floor_high_deg_per_h


def test_too_short_a_record_is_refused():
    with pytest.raises(ValueError, match="below the limit 4 s"):
        measure_allan.analyse(np.zeros(100), 0.01)


def test_bandwidth_of_a_pole():
    """A pole at 26 Hz behind the multisine: gain and phase, and where it crosses -3.01 dB."""

    class Bench:
        slower, part, frame_s = 1, 1.0, FRAME_S

        def record(self, seconds, rate_dps):
            n = round(seconds / FRAME_S)
            a = math.exp(-2 * math.pi * 26.0 / self.slower * FRAME_S)
            out, y = np.zeros(n), 0.0
            for k in range(n):
                out[k] = y
                y = a * y + (1 - a) * rate_dps[k] * 8651.0
            return {"rate_word": out}

    for measure, accuracy in ((measure_bandwidth.multisine, 0.02), (measure_bandwidth.sweep_response, 0.4)):
        found = measure(Bench(), 8651.0)
        assert found.bandwidth_hz == pytest.approx(26.0, abs=accuracy), measure.__name__
    lines = measure_bandwidth.multisine(Bench(), 8651.0)
    at = lines.frequency_hz.index(22.0)
    assert lines.phase_deg[at] == pytest.approx(-math.degrees(math.atan(22.0 / 26.0)), abs=0.05)


def test_boards_are_the_same_however_many_are_drawn():
    base = configured()
    many = calibration_boards.random_boards(base, 5, 3)
    assert many[2] == calibration_boards.draw(base, 5, 2)
    assert len({c.plant.fx_hz for c in many}) == 3
    for config in many:
        assert 120.0 <= config.plant.fx_hz - config.plant.fy_hz <= 160.0


@pytest.mark.slow
def test_phases_over_temperature_follow_the_parts():
    """Op amps slow down: xe2 and ye2 rise. Registers turn with the frequency: xe1 falls by 27 ppm/K."""
    found = temperature.phases(configured(), (0.0, 50.0))
    assert found["xe2"][1] > found["xe2"][0]
    assert found["ye2"][1] > found["ye2"][0]
    assert found["xe1"][1] / found["xe1"][0] == pytest.approx(1 - 27e-6 * 50, abs=2e-5)
    limits = temperature.drift_limits_k(configured())
    assert limits["ye2"][1] < limits["xe1"][1]

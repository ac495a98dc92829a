"""Phase meters on signals whose phase is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from testbench.run import phase_meter

HZ, RATE = 11031.7183, 1e6


def signal(lag_deg, ticks=20000, offset=0.0, free=0.0, noise=0.0):
    theta = (np.arange(ticks) * HZ / RATE) % 1.0
    values = np.sin(2 * np.pi * theta - np.radians(lag_deg)) + offset
    line = (np.arange(ticks) * 10863.3 / RATE) % 1.0
    values += free * np.exp(-np.arange(ticks) / RATE / 5.8) * np.cos(2 * np.pi * line)
    return theta, values + noise * np.random.default_rng(1).standard_normal(ticks), line


@given(st.floats(-179.9, 179.9), st.floats(-3.0, 3.0))
def test_the_fit_finds_the_lag(lag_deg, offset):
    theta, values, _ = signal(lag_deg, offset=offset)
    assert phase_meter.wrap_deg(phase_meter.fit(theta, values).lag_deg - lag_deg) == pytest.approx(0, abs=1e-9)


def test_a_free_line_biases_the_plain_fit_and_not_the_joint_one():
    theta, values, line = signal(1.5, ticks=18000, free=2.0)
    assert abs(phase_meter.fit(theta, values).lag_deg - 1.5) > 0.1
    assert phase_meter.fit(theta, values, line).lag_deg == pytest.approx(1.5, abs=1e-5)


def white(rng, n):
    return 0.01 * rng.standard_normal(n)


def slow(rng, n):
    """Phase noise whose memory is a fiftieth of the record."""
    pole = np.exp(-50.0 / n)
    wander = lfilter([1.0], [1.0, -pole], rng.standard_normal(n + n // 10))[n // 10 :]
    return 1e-3 * wander * np.cos(2 * np.pi * np.arange(n) * HZ / RATE - np.radians(3.0))


def image(rng, n):
    """What a staircase has besides, at the rate less f: the same in each record, and 100 times the noise."""
    return white(rng, n) * 0.01 + 0.01 * np.sin(2 * np.pi * np.arange(n) * (0.39 * RATE - HZ) / RATE)


@pytest.mark.parametrize("noise", [white, slow, image])
def test_sigma_is_the_spread_of_repeated_readings(noise):
    theta, values, _ = signal(3.0, ticks=4000)
    readings = [phase_meter.fit(theta, values + noise(np.random.default_rng(seed), 4000)) for seed in range(300)]
    spread = np.std([reading.lag_deg for reading in readings])
    # 300 readings give the spread to 4 %, and their mean variance to 3 %: four sigma of both
    assert np.sqrt(np.mean([reading.sigma_deg**2 for reading in readings])) == pytest.approx(spread, rel=0.2)


@given(st.floats(-179.0, 179.0))
def test_the_counter_agrees_within_its_resolution(lag_deg):
    theta, values, _ = signal(lag_deg, noise=0.002)
    reading = phase_meter.count(phase_meter.rising_crossings(theta, values))
    # chord of the sine between samples: (2 pi f h)^2 / 8 of a sample's phase at most
    chord_deg = 360 * HZ / RATE * (2 * np.pi * HZ / RATE) ** 2 / 8
    assert (
        abs(phase_meter.wrap_deg(reading.lag_deg - lag_deg)) < 2 * reading.resolution_deg + chord_deg
    )  # four standard errors
    assert reading.count == pytest.approx(20000 * HZ / RATE, abs=1)


def test_bad_signals_are_refused():
    with pytest.raises(ValueError, match="16 finite samples"):
        phase_meter.fit(np.zeros(4), np.zeros(4))
    with pytest.raises(ValueError, match="finite"):
        phase_meter.fit(np.zeros(40), np.full(40, np.nan))
    with pytest.raises(ValueError, match="2 rising crossings"):
        phase_meter.count([0.1])

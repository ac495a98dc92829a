"""Phase meters on signals whose phase is known."""

import itertools

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


@pytest.mark.parametrize("free", [False, True])
def test_blocks_give_the_fit_of_the_whole_record(free):
    """Pieces of any length agree to rounding with a least-squares solution that holds all samples at once."""
    theta, values, line = signal(3.0, ticks=3 * phase_meter.BLOCK + 321, offset=0.2, free=1.0, noise=0.01)
    nodes, line = [values, 1e-6 * values[::-1]], line if free else None
    columns = [np.cos(2 * np.pi * theta), np.sin(2 * np.pi * theta), np.ones(len(theta))]
    if free:
        columns += [np.cos(2 * np.pi * line), np.sin(2 * np.pi * line)]
        columns += [np.linspace(-1, 1, len(theta)) * column for column in columns[3:]]
    basis, joint = np.stack(columns), phase_meter.Fit(len(theta), 2, free)
    for begin, end in itertools.pairwise((0, 5, 7000, 7001, 20_000, len(theta))):
        joint.add(theta[begin:end], [n[begin:end] for n in nodes], None if line is None else line[begin:end])
    for node, pieces, whole in zip(nodes, joint.readings(), phase_meter.fit_samples(theta, nodes, line)):
        (a, b), rest = (coefficients := np.linalg.lstsq(basis.T, node)[0])[:2], node - coefficients @ basis
        slope = np.linalg.inv(basis @ basis.T)[:2].T @ [-b, a] / (a * a + b * b)
        ends = np.linspace(0, len(theta), phase_meter.SHARES + 1).astype(int)
        shares = [basis[:, begin:end] @ rest[begin:end] @ slope for begin, end in itertools.pairwise(ends)]
        for got in (pieces, whole):
            assert got.lag_deg == pytest.approx(np.degrees(np.arctan2(-a, b)), abs=1e-10)
            assert got.amplitude == pytest.approx(np.hypot(a, b), rel=1e-12)
            np.testing.assert_allclose(got.shares_deg, np.degrees(shares), atol=1e-12)
        assert pieces.sigma_deg == pytest.approx(whole.sigma_deg, rel=1e-9)


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

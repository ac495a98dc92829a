"""Statistics against exact rationals and the textbook; streams against the rows themselves."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbench.campaign.plan.measure import Keep, Keeper, adev, mean, rms, slope, std
from testbench.engines import engine
from testbench.run.simulation import FRAME, TRUTH

FRAME_S = 125e-6

words = st.lists(st.integers(-(1 << 48), 1 << 48), min_size=2, max_size=40)


@given(words)
def test_mean_of_integers_is_exact(values):
    exact = Fraction(sum(values), len(values))
    assert mean(np.array(values, np.int64)) == float(exact)


@given(words)
def test_spread_and_slope_against_rationals(values):
    x, n = np.array(values, np.int64), len(values)
    m = Fraction(sum(values), n)
    variance = sum((v - m) ** 2 for v in values) / (n - 1)
    scale = max(1.0, *map(abs, values))
    assert std(x) == pytest.approx(math.sqrt(variance), rel=1e-12, abs=1e-15 * scale)
    assert rms(x) == pytest.approx(math.sqrt(Fraction(sum(v * v for v in values), n)), rel=1e-12)
    t = [Fraction(2 * k - n + 1, 2) for k in range(n)]
    exact = sum(a * (v - m) for a, v in zip(t, values)) / sum(a * a for a in t)
    assert slope(x, 0.5) == pytest.approx(float(exact) / 0.5, rel=1e-9, abs=1e-12 * scale)


@given(st.lists(st.integers(-(1 << 24), 1 << 24), min_size=4, max_size=40), st.integers(1, 6))
def test_allan_deviation_is_that_of_adjacent_means(values, m):
    n = len(values)
    x = np.array(values, np.int64)
    if n < 2 * m:
        assert math.isnan(adev(x, m))
        return
    means = [Fraction(sum(values[j : j + m]), m) for j in range(n - m + 1)]
    squares = [(means[j + m] - means[j]) ** 2 for j in range(n - 2 * m + 1)]
    assert adev(x, m) == pytest.approx(math.sqrt(sum(squares) / (2 * len(squares))), rel=1e-12)


def test_allan_deviation_of_large_words_does_not_wrap():
    small = np.array([0, 3, -1, 4, 1, -5, 9, 2] * 100, np.int64)
    assert adev(small + (1 << 47), 16) == adev(small, 16)
    long = np.full(1 << 17, (1 << 48) - 1, np.int64)
    long[::2] -= 2
    assert adev(long, 1) == pytest.approx(math.sqrt(2), rel=1e-12)


def test_one_value_has_no_spread():
    one = np.array([5], np.int64)
    assert math.isnan(std(one))
    assert math.isnan(slope(one, 1.0))


def rows(n, seed=3):
    rng = np.random.default_rng(seed)
    frames = rng.integers(-(1 << 20), 1 << 20, (n, len(engine.FRAME_COLUMNS)))
    return frames, rng.standard_normal((n, len(engine.TRUTH_COLUMNS)))


def kept(keep, frames, truth, piece):
    keeper = Keeper(keep)
    for k in range(0, len(frames), piece):
        keeper.add(k, frames[k : k + piece], truth[k : k + piece])
    return keeper.variables()


def test_streams_and_statistics_are_those_of_the_rows():
    frames, truth = rows(1003)
    kinds = ["mean", "std", "rms", "slope", "min", "max", "first", "last", "adev"]
    keep = Keep({"rate_word": 8, "frequency_word": 1, "truth_x": 4}, {"rate_word": kinds}, 2, [0.0005, 0.5])
    found = kept(keep, frames, truth, 77)
    word = frames[:, FRAME["rate_word"]]
    pairs = word[:1002].reshape(-1, 2).mean(axis=1)
    np.testing.assert_array_equal(found["rate_word"].data, word[:1000].reshape(-1, 8).mean(axis=1))
    assert found["rate_word"].dims == ("time_8",)
    np.testing.assert_array_equal(found["frequency_word"].data, frames[:, FRAME["frequency_word"]])
    assert found["frequency_word"].data.dtype == np.int64
    np.testing.assert_array_equal(found["truth_x"].data, truth[:1000:4, TRUTH["x"]])
    expected = {
        "mean": pairs.mean(),
        "std": pairs.std(ddof=1),
        "rms": np.sqrt((pairs**2).mean()),
        "slope": np.polyfit(np.arange(501) * 2 * 125e-6, pairs, 1)[0],
        "min": pairs.min(),
        "max": pairs.max(),
        "first": pairs[0],
        "last": pairs[-1],
    }
    for kind, value in expected.items():
        assert found[f"rate_word.{kind}"].data == pytest.approx(value, rel=1e-9), kind
    m = 2
    means = np.convolve(pairs, np.ones(m) / m, "valid")
    assert found["rate_word.adev"].data[0] == pytest.approx(
        np.sqrt(((means[m:] - means[:-m]) ** 2).mean() / 2), rel=1e-9
    )
    assert math.isnan(found["rate_word.adev"].data[1]), "0.5 s need a second of rows"
    assert found["rate_word.slope"].attrs["units"] == "word/s"


def test_pieces_do_not_matter():
    frames, truth = rows(500)
    keep = Keep({"rate_word": 8}, {"rate_word": ["mean", "std", "adev"]}, 4, [0.0005])
    a, b = kept(keep, frames, truth, 500), kept(keep, frames, truth, 1)
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name].data, b[name].data)


def test_no_rows_are_no_numbers():
    found = Keeper(Keep({"rate_word": 2}, {"rate_word": ["mean", "slope", "adev"]}, 1, [0.001])).variables()
    assert len(found["rate_word"].data) == 0
    assert math.isnan(found["rate_word.mean"].data)
    assert math.isnan(found["rate_word.slope"].data)
    assert np.isnan(found["rate_word.adev"].data).all()

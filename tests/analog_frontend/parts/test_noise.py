"""The noise sources: exact words, exact moments, and statistics that a weak hash would fail.

Seeds are fixed, so nothing here is random: a limit of z sigma is passed or not, for good.
"""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import config
from scipy import stats

from analog_frontend import linear
from analog_frontend.numeric.vector import LANES
from analog_frontend.parts import noise
from fpga_model.jit import kernel
from fpga_model.rates import FRAME_TICKS
from tests import naive

N = 1 << 14 if config.DISABLE_JIT else 1 << 20
Z = 4.5  # 7e-6 two-sided: a few hundred looks are taken

keys = st.integers(0, 2**32 - 1)
corners = st.sampled_from([0, 1, 2**32 - 1, 2**32, 2**48, 2**61, 2**62 - 1])
counters = st.one_of(corners, st.integers(0, 2**62 - 1))


@kernel
def sums(key0, key1, first, out):
    for k in range(out.size):
        out[k] = noise.sum4(key0, key1, first + k)


@kernel
def all_words(key0, key1, first, a, b):
    for k in range(a.size):
        a[k], b[k] = noise.words(key0, key1, first + k)


@kernel
def fine(p, first, out):
    for k in range(out.size):
        out[k] = noise.white_fine(p, first + k)


@kernel
def fill(p, first, out):
    for k in range(out.size):
        out[k] = noise.white_sample(p, first + k)


@kernel
def fill_rows(p, q, counter, stride, out, first, second, n):
    noise.fill_rows(p, q, counter, stride, out, first, second, n)


@kernel
def fill_held(p, q, tick, out, first, second, n):
    noise.fill_hold_rows(p, q, tick, out, first, second, n)


@kernel
def held_blocks(p, q, tick, out, others, n):
    """Rows of any length, in the blocks of a run; returns what single ticks would give otherwise."""
    w = np.zeros(4 * linear.STRIDE)
    wrong = 0
    for begin in range(0, out.size, n):
        count = min(n, out.size - begin)
        noise.fill_hold_rows(p, q, tick + begin, w, linear.STRIDE, 2 * linear.STRIDE, count)
        for t in range(count):
            out[begin + t] = w[linear.STRIDE + t]
            others[begin + t] = w[2 * linear.STRIDE + t]
            wrong += noise.hold_sample(p, tick + begin + t) != out[begin + t]
            wrong += noise.hold_sample(q, tick + begin + t) != others[begin + t]
    return wrong


def stream(seed, name, first=0, n=N):
    out = np.zeros(n)
    fill(noise.source(seed, name, 1.0), first, out)
    return out


# exact --------------------------------------------------------------------------------------------------------------


@given(keys, keys, counters)
def test_words_are_the_documented_rounds_and_a_permutation(key0, key1, counter):
    got = tuple(int(w) for w in noise.words(key0, key1, counter))
    assert got == naive.noise_words(key0, key1, counter)
    assert naive.noise_counter(key0, key1, got) == counter


@given(keys, keys, st.integers(0, 2**60))
def test_numbers_are_scaled_sums(key0, key1, counter):
    for half, word in enumerate(naive.noise_words(key0, key1, counter)):
        total = sum(word.to_bytes(4, "big")) - 510
        assert noise.white_sample(noise.Source(key0, key1, 1.0, 1, half), counter) == float(total) * noise.IH4_SCALE
    s12 = naive.noise_sum(key0, key1, [3 * counter + k for k in range(3)])
    assert noise.ih12(key0, key1, counter) == float(s12) * noise.IH12_SCALE


def test_scales_give_variance_one():
    variance = Fraction(sum((2 * k - 65535) ** 2 for k in range(65536)), 4 * 65536)
    assert variance == Fraction(noise.WORD_VARIANCE_12, 12)
    of_byte = Fraction(sum((2 * k - 255) ** 2 for k in range(256)), 4 * 256)
    assert abs(float(Fraction(noise.IH4_SCALE) ** 2 * 4 * of_byte) - 1) < 4e-16
    for scale, n in ((noise.IH12_SCALE, 12), (noise.UNIFORM_SCALE, 1)):
        assert abs(float(Fraction(scale) ** 2 * n * variance) - 1) < 4e-16


def test_filled_rows_have_the_bits_of_single_samples():
    p, q = noise.source(9, "cv_x", 18.2e-9), noise.source(9, "cv_y", 20e-9)
    first = 2**33 - 60
    for p_now, q_now in ((p, q), (p._replace(on=0), q), (p, q._replace(on=0)), (p._replace(on=0), q._replace(on=0))):
        out = np.full(64, 7.0)
        fill_rows(p_now, q_now, first, 6, out, 5, 35, 24)
        assert out[5:29].tolist() == [noise.white_sample(p_now, first + 6 * k) for k in range(24)]
        assert out[35:59].tolist() == [noise.white_sample(q_now, first + 6 * k) for k in range(24)]
        assert set(out[:5]) | set(out[29:35]) | set(out[59:]) == {7.0}


def sample_of_tick(p, tick):
    word = naive.noise_words(p.key0, p.key1, tick // 5)[p.half]
    return p.sigma * (float(sum(word.to_bytes(4, "big")) - 510) * noise.IH4_SCALE) if p.on else 0.0


@pytest.mark.parametrize("which", range(4))
@given(st.integers(0, 2**40), st.integers(1, linear.BLOCK))
def test_a_held_row_is_one_sample_of_the_hash_for_five_ticks(which, tick, n):
    p, q = noise.source(9, "force_x", 2e-11), noise.source(9, "force_y", 3e-11)
    p, q = p._replace(on=which & 1), q._replace(on=which >> 1)
    row = linear.STRIDE
    out = np.full(4 * row, 7.0)
    fill_held(p, q, tick, out, row, 3 * row, n)
    for source, first in ((p, row), (q, 3 * row)):
        assert out[first : first + n].tolist() == [sample_of_tick(source, tick + t) for t in range(n)]
    lost = noise.HOLD - 1, noise.HOLD * LANES - 1
    kept = [*out[: row - lost[0]], *out[row + n + lost[1] : 3 * row - lost[0]], *out[3 * row + n + lost[1] :]]
    assert set(kept) == {7.0}


def test_where_blocks_end_changes_no_held_sample():
    p, q = noise.source(9, "dac_drive", 1.0), noise.source(9, "dac_sense", 1.0)
    rows = []
    for n in (1, 2, 7, 125, linear.BLOCK):
        x, y = np.zeros(1000), np.zeros(1000)
        assert held_blocks(p, q, 3, x, y, n) == 0
        rows.append((x.tolist(), y.tolist()))
    assert all(pair == rows[0] for pair in rows)


def test_a_frame_is_a_whole_number_of_holds_and_a_row_has_room():
    assert FRAME_TICKS % noise.HOLD == 0
    whole = noise.HOLD * LANES
    ends = [-(-(into + n) // whole) * whole - into for into in range(noise.HOLD) for n in range(1, linear.BLOCK + 1)]
    assert max(ends) <= linear.STRIDE - (noise.HOLD - 1)


def test_off_is_exactly_zero():
    for p in (noise.source(1, "cv_x", 1.0, on=0), noise.source(1, "cv_x", 0.0)):
        assert p.on == 0
        assert (noise.white_sample(p, 3), noise.white_fine(p, 3)) == (0.0, 0.0)
    f = noise.flicker(1, "flicker_0", 37e-9, on=0)
    state = noise.flicker_reset(f)
    assert noise.flicker_step(f, state, 0) == 0.0
    assert (state == 0.0).all()


def test_the_second_of_a_pair_takes_the_other_word_of_the_same_hash():
    for name, other in noise.SECOND.items():
        p, q = noise.source(5, name, 1.0), noise.source(5, other, 1.0)
        assert (p.key0, p.key1, p.half, q.half) == (q.key0, q.key1, 1, 0)


def test_every_source_has_keys_of_its_own():
    pairs = {noise.keys(seed, name) for seed in range(50) for name in noise.SOURCES}
    assert len(pairs) == 50 * len(noise.SOURCES)
    assert len({k for pair in pairs for k in pair}) == 100 * len(noise.SOURCES)


def test_numbers_of_sources_are_frozen():
    assert noise.SOURCES[:5] == ("force_x", "force_y", "cv_x", "cv_y", "edge_jitter")
    assert noise.SOURCES.index("flicker_temp") == 17
    assert noise.keys(1, "cv_y") == tuple(naive.noise_words(1, 0, 3))


def test_impossible_sources_are_refused():
    with pytest.raises(ValueError, match="cv_z"):
        noise.source(1, "cv_z", 1.0)
    with pytest.raises(ValueError, match="seed"):
        noise.source(-1, "cv_x", 1.0)
    with pytest.raises(ValueError, match="sigma"):
        noise.source(1, "cv_x", math.nan)
    with pytest.raises(ValueError, match="flicker"):
        noise.flicker(1, "flicker_0", -1.0)


# statistics ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", [2**32 - 1000, *(pytest.param(n, marks=pytest.mark.slow) for n in (0, 2**40))])
def test_every_bit_is_a_fair_coin_and_halves_are_uniform(first):
    a, b = np.zeros(N, np.int64), np.zeros(N, np.int64)
    all_words(*noise.keys(7, "cv_x"), first, a, b)
    for word in (a, b):
        bits = (word[:, None] >> np.arange(32)) & 1
        assert np.abs(bits.mean(axis=0) - 0.5).max() < Z / 2 / math.sqrt(N)
        for half in (word & 0xFFFF, word >> 16):
            # 4096 cells of 256 counts (16 without the compiler)
            counts = np.bincount(half >> (16 - 12), minlength=4096)
            chi2 = ((counts - N / 4096) ** 2).sum() / (N / 4096)
            assert abs(chi2 - 4095) < Z * math.sqrt(2 * 4095)


@kernel
def neighbours(base, a, b):
    """Words of (key0, key1, counter), then of the 96 triples that differ from it in one bit."""
    for t in range(base.shape[0]):
        a[t, 96], b[t, 96] = noise.words(base[t, 0], base[t, 1], base[t, 2])
        for bit in range(96):
            one = 1 << (bit & 31)
            which = bit >> 5
            key0 = base[t, 0] ^ (one if which == 0 else 0)
            key1 = base[t, 1] ^ (one if which == 1 else 0)
            a[t, bit], b[t, bit] = noise.words(key0, key1, base[t, 2] ^ (one if which == 2 else 0))


def test_one_flipped_bit_flips_half_of_the_words():
    """All 64 key bits and counter bits 0..31, each against each of the 64 output bits."""
    trials = 100 if config.DISABLE_JIT else 4000
    base = np.random.default_rng(11).integers(0, 2**32, (trials, 3))
    a, b = np.zeros((trials, 97), np.int64), np.zeros((trials, 97), np.int64)
    neighbours(base, a, b)
    for word in (a, b):
        changed = word[:, :96] ^ word[:, 96:]
        flips = np.stack([((changed >> k) & 1).sum(axis=0) for k in range(32)])
        z = (flips - trials / 2) / math.sqrt(trials / 4)
        assert np.abs(z).max() < 5.5  # of 3072 looks


@pytest.mark.parametrize(("name", "sampler", "kurtosis"), [("cv_x", "white", 2.7), ("adc_2", "fine", 2.9)])
def test_moments(name, sampler, kurtosis):
    n = N if sampler == "white" else N // 4
    x = np.zeros(n)
    (fill if sampler == "white" else fine)(noise.source(21, name, 1.0), 0, x)
    assert abs(x.mean()) < Z / math.sqrt(n)
    assert abs(x.var() - 1) < Z * math.sqrt((kurtosis - 1) / n)
    assert abs((x**3).mean()) < Z * math.sqrt(10 / n)
    assert abs((x**4).mean() - kurtosis) < Z * math.sqrt(60 / n)
    assert np.abs(x).max() <= math.sqrt(12 if sampler == "white" else 36) + 1e-4


def test_no_correlation_between_sources_seeds_and_neighbours():
    limit = Z / math.sqrt(N)
    rows = [stream(1, name) for name in noise.SOURCES[:8]] + [stream(seed, "cv_x") for seed in (0, 2, 3, 2**40 + 1)]
    rows += [stream(1, "cv_x", first=2**32), stream(1, "cv_x", first=N)]
    assert np.abs(np.corrcoef(rows) - np.eye(len(rows))).max() < limit
    x = rows[2]
    for lag in (*range(1, 33), 125, 256, 1000, 4096):
        assert abs((x[lag:] * x[:-lag]).mean()) < Z / math.sqrt(N - lag), lag
    # squares too: a hash may correlate in magnitude only
    square = [r * r - 1 for r in rows]
    assert np.abs(np.corrcoef(square) - np.eye(len(rows))).max() < limit


# held ---------------------------------------------------------------------------------------------------------------

CARRIER_HZ, TICK_S = 11002.3, 1e-6
HOLD_S = noise.HOLD * TICK_S
ABOUT = " ".join(noise.__doc__.split())


def weighed(share, harmonics=200_001):
    """Sum over the odd harmonics of a sign reference; what is behind the last is below 4/pi^2 divided by it."""
    n = np.arange(1, harmonics, 2)
    return (8 / (np.pi * n) ** 2 * share(n)).sum()


def share_of_density(n, carrier_hz=CARRIER_HZ):
    """Density of a held sequence at harmonic n over that of white noise which demodulates to the same."""
    sigma = noise.sigma_demodulated(1.0, carrier_hz, TICK_S)
    return 2 * HOLD_S * sigma**2 * np.sinc(n * carrier_hz * HOLD_S) ** 2


def test_held_density_falls_as_sinc_and_is_the_stated_one_at_the_carrier():
    density, ticks = 18.2e-9, 8 * N
    x, y = np.zeros(ticks), np.zeros(ticks)
    sigma = noise.sigma_at_carrier(density, CARRIER_HZ, TICK_S)
    assert held_blocks(*(noise.source(4, name, sigma) for name in ("dac_drive", "dac_sense")), 0, x, y, 125) == 0
    length = 2000  # bins of 500 Hz up to the grid's own Nyquist frequency, less the ends
    f = np.fft.rfftfreq(length, TICK_S)[1:200]
    seen = np.zeros(len(f))
    for row in (x, y):
        blocks = row[: ticks // length * length].reshape(-1, length)
        seen += (np.abs(np.fft.rfft(blocks, axis=1)) ** 2).mean(axis=0)[1:200] * TICK_S / length
    # the plant holds a tick: what is between the ticks has a sinc of its own
    seen *= np.sinc(f * TICK_S) ** 2
    ratio = seen / (density * np.sinc(f * HOLD_S) / np.sinc(CARRIER_HZ * HOLD_S)) ** 2
    count = 2 * (ticks // length)
    assert np.abs(ratio - 1).max() < Z / math.sqrt(count)
    assert abs(ratio.mean() - 1) < Z / math.sqrt(count * len(f))


@pytest.mark.parametrize("carrier_hz", [3000.0, CARRIER_HZ, 33333.0])
def test_sigma_demodulated_is_the_sum_over_all_odd_harmonics(carrier_hz):
    assert weighed(lambda n: n**0) == pytest.approx(1.0, abs=4.1e-6), "white noise: all weights"
    assert weighed(lambda n: share_of_density(n, carrier_hz)) == pytest.approx(1.0, rel=1e-5)


def test_a_carrier_that_the_grid_cannot_carry_is_refused():
    for sigma in (noise.sigma_at_carrier, noise.sigma_demodulated):
        assert sigma(1.0, 99999.0, TICK_S) > 0.0
        for bad in (0.0, -11e3, 100001.0, math.nan):
            with pytest.raises(ValueError, match=f"carrier_hz: {bad:g} is not above 0 and at most 100000 Hz"):
                sigma(1.0, bad, TICK_S)


# harmonic of 11 kHz: weight of a sign reference, density of C/V noise and of forces and DACs less the stated one (%)
LEFT_OUT = {
    1: ("81.06", "+6.8", "+0.0"),
    3: ("9.01", "-1.4", "-7.7"),
    5: ("3.24", "-16.4", "-21.8"),
    7: ("1.65", "-35.5", "-39.6"),
    9: ("1.00", "-55.4", "-58.3"),
    11: ("0.67", "-73.3", "-75.0"),
    17: ("0.28", "-99.5", "-99.5"),
    19: ("0.22", "-99.8", "-99.8"),
}


def test_what_the_hold_leaves_out():
    at_carrier = np.sinc(CARRIER_HZ * HOLD_S) ** 2
    for n, wanted in LEFT_OUT.items():
        found = (
            f"{800 / (math.pi * n) ** 2:.2f}",
            f"{100 * (share_of_density(n) - 1):+.1f}",
            f"{100 * (np.sinc(n * CARRIER_HZ * HOLD_S) ** 2 / at_carrier - 1):+.1f}",
        )
        assert found == wanted, n
    beyond = (
        weighed(lambda n: (n * CARRIER_HZ > 1e5) * n**0),
        weighed(lambda n: (n * CARRIER_HZ > 1e5) * share_of_density(n)),
    )
    white, held = 100 * beyond[0], 100 * beyond[1]
    assert f"stands {held:.1f} % of the demodulated power, of white noise {white:.1f} %" in ABOUT
    # volts per rtHz of the C/V output at 11 kHz, and power of forces at f_y
    assert 100 * (math.sqrt(share_of_density(1)) - 1) == pytest.approx(3.4, abs=0.05)
    split = np.sinc(10863.3 * HOLD_S) ** 2 / at_carrier - 1
    assert split * 1e4 == pytest.approx(2.5, abs=0.05)
    # demodulated by sums of samples, one a tick: the triangle in steps
    lags = np.arange(-noise.HOLD, noise.HOLD + 1)
    triangle = (1 - abs(lags) / noise.HOLD) / noise.HOLD
    summed = (triangle * (1 - 4 * CARRIER_HZ * abs(lags) * TICK_S)).sum()
    mean = 1 - 4 * CARRIER_HZ * HOLD_S / 3
    assert 1e4 * (summed / mean - 1) == pytest.approx(32, abs=0.5)


def power(places, carrier_hz):
    """Demodulated power, in units of 2 T sigma^2, if edges stand at these places of a hold (0 .. 1) equally often.

    The sample under an edge counts for its first part less its second: 1 - 2 a.
    """
    return 1 - 2 * carrier_hz * HOLD_S * (1 - ((1 - 2 * np.asarray(places)) ** 2).mean())


def test_what_a_commensurate_carrier_does():
    steps, holds = 1000, 20  # a period of 10 kHz
    for place in (0.0, 0.25, 0.5):
        at = np.arange(holds * steps) + round((1 - place) * steps)
        square = np.where(at // (holds // 2 * steps) % 2, -1.0, 1.0)
        assert (square.reshape(holds, steps).mean(axis=1) ** 2).mean() == pytest.approx(power(place, 1e4), abs=1e-12)
    even = (np.arange(10**4) + 0.5) / 10**4
    mean = 1 - 4 * 1e4 * HOLD_S / 3
    assert power(even, 1e4) == pytest.approx(mean, rel=1e-8)
    middle, border = (100 * (power(place, 1e4) / mean - 1) for place in (0.5, 0.0))
    assert f"power errs by {middle:+.1f} % to {border:+.1f} %" in ABOUT
    mean = 1 - 4 * CARRIER_HZ * HOLD_S / 3
    grids = [1e4 * (power((np.arange(5) + k / 100) / 5, CARRIER_HZ) / mean - 1) for k in range(100)]
    assert (min(grids), max(grids)) == pytest.approx((-16, 32), abs=0.5)


# flicker ------------------------------------------------------------------------------------------------------------


def flicker_density(f, rate=8000.0):
    """Closed form: one-sided density of the sum of sampled first-order processes, for level 1."""
    drive = (noise.GAIN / noise.UNIFORM_SCALE) ** 2
    return math.sqrt(
        sum(2 / rate * g / (1 - 2 * a * math.cos(2 * math.pi * f / rate) + a * a) for a, g in zip(noise.DECAY, drive))
    )


def test_flicker_law_holds_over_six_decades():
    for f in np.logspace(-3, 3, 61):
        error = flicker_density(f) * math.sqrt(f) - 1
        assert abs(error) < (0.006 if 3e-3 <= f <= 200 else 0.035), f


def test_poles_are_spread_over_seven_and_a_half_decades():
    corners_hz = -np.log(noise.DECAY) / (2 * math.pi) * 8000.0
    assert np.diff(np.log10(corners_hz)) == pytest.approx(np.full(15, -0.5), abs=1e-9)
    assert corners_hz[0] == pytest.approx(3185, rel=1e-3)
    assert corners_hz[-1] == pytest.approx(1.007e-4, rel=1e-3)


@kernel
def flicker_run(p, state, out):
    for k in range(out.size):
        out[k] = noise.flicker_step(p, state, k)


def test_flicker_slope_and_level_in_a_run():
    level, rate = 37e-9, 8000.0
    n = 1 << 14 if config.DISABLE_JIT else 1 << 21  # 262 s
    p = noise.flicker(2, "flicker_2", level)
    x = np.zeros(n)
    flicker_run(p, noise.flicker_reset(p), x)
    length = n // 64
    window = np.hanning(length)
    blocks = x.reshape(64, length)
    psd = (np.abs(np.fft.rfft((blocks - blocks.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2).mean(axis=0)
    psd *= 2 / (rate * (window**2).sum())
    f = np.fft.rfftfreq(length, 1 / rate)
    slopes, levels, weights = [], [], []
    for lo in 3 * np.logspace(0, 1.75, 8) if n > 1 << 20 else [30.0, 100.0, 300.0]:
        band = (f >= lo) & (f < lo * 10**0.25)
        ratio = (psd[band] * f[band]).mean() / level**2
        spread = math.sqrt(1.6 / (64 * band.sum()))  # neighbouring bins share the window
        assert abs(ratio - flicker_density(lo * 10**0.125) ** 2 * lo * 10**0.125) < Z * spread + 0.02
        slopes.append(math.log10(lo))
        levels.append(math.log10(ratio))
        weights.append(1 / spread)
    if n > 1 << 20:
        slope = np.polyfit(slopes, levels, 1, w=weights)[0] - 1
        assert slope == pytest.approx(-1.0, abs=0.02)


def test_flicker_starts_old():
    """The first state is drawn from the stationary law: the same spread at once and after 1e5 samples."""
    states = np.array([noise.flicker_reset(noise.flicker(seed, "flicker_0", 1.0)) for seed in range(400)])
    assert states.std(axis=0) == pytest.approx(np.full(16, noise.DEVIATION), rel=Z / math.sqrt(800))
    assert np.abs(np.corrcoef(states.T) - np.eye(16)).max() < Z / math.sqrt(400)
    # the recurrence keeps that variance: a^2 s^2 + g^2 u^2 = s^2
    kept = noise.DECAY**2 * noise.DEVIATION**2 + (noise.GAIN / noise.UNIFORM_SCALE) ** 2
    assert kept == pytest.approx(np.full(16, noise.DEVIATION**2), rel=1e-9)


def test_channels_of_flicker_are_independent():
    runs = []
    for name in ("flicker_0", "flicker_1", "flicker_2"):
        p = noise.flicker(6, name, 1.0)
        x = np.zeros(N // 4)
        flicker_run(p, noise.flicker_reset(p), x)
        runs.append(np.diff(x))
    assert np.abs(np.corrcoef(runs) - np.eye(3)).max() < 1.5 * Z / math.sqrt(N // 4)


# physics ------------------------------------------------------------------------------------------------------------


def test_thermomechanical_force_gives_the_known_angle_random_walk():
    damping = 2.325e-7 * 2 * math.pi * 10863.3 / 2e5
    density = noise.thermomechanical_density(damping, 25.0)
    assert density == pytest.approx(math.sqrt(4 * 1.380649e-23 * 298.15 * damping), rel=1e-14)
    rate = density / (2 * 2.325e-7 * 2 * math.pi * 11002.3 * 5e-6)  # rad/s/rtHz at Ax = 5 um
    assert math.degrees(rate) * 60 / math.sqrt(2) == pytest.approx(5.5e-4, rel=0.02)


def test_quantile_of_ih12_is_close_to_normal():
    x = np.zeros(N // 4)
    fine(noise.source(8, "adc_1", 1.0), 0, x)
    # order 12 differs from the normal law by 0.0023 at most in its distribution function
    assert stats.kstest(x, "norm").statistic < 0.0023 + 1.95 / math.sqrt(len(x))

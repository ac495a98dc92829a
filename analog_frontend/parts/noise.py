"""Noise as a function of (seed, source, counter): no generator state, no libm, the same bits on every machine.

    words   7 Feistel rounds of x, y = (M x >> 31) ^ y ^ (k0 + round W),  M x mod 2^32     two 32-bit words per counter
    ih4     (sum of the 4 bytes of one word - mean) / sigma       200 kHz sources and edges   |ih4| < sqrt 12
    ih12    (sum of 12 uniform 16-bit numbers - mean) / sigma     8 kHz sources              |ih12| < 6
    flicker y = sum of 16 states, x[k]' = a[k] x[k] + b[k] u      u: one uniform 16-bit number, unit variance

    held    forces, C/V and DAC outputs: sample number tick // HOLD stands for HOLD = 5 ticks, a grid of 200 kHz

    counter --[permutation keyed by (seed, source)]--> two words --> sums --> x sigma --> volts, newtons, seconds

Two sources of one kind (drive and sense) share a hash: each takes one of its words.

Moments  mean 0, variance 1, kurtosis 2.7 (ih4) and 2.9 (ih12) to 1e-9: the law of the sum is known exactly
Numbers  every product of the hash is below 2^63 (the multiplier has 31 bits), so Python ints give the same words
Held     one-sided density 2 T sigma^2 sinc^2(f T), T = 5 us; demodulated by a sign reference of frequency f, summed
         over its odd harmonics n with weights 8/(pi n)^2: 2 T sigma^2 (1 - 4 f T/3)
Sigma    forces, DACs: density/(sqrt(2 T) sinc(f T)), right at the carrier; C/V: density/sqrt(2 T (1 - 4 f T/3)), right
         behind a demodulator. Above 100 kHz stands 0.3 % of the demodulated power, of white noise 4.0 %. At 10 kHz,
         commensurate with the grid, power errs by -3.6 % to +7.1 %
Flicker  poles half a decade apart over 7.5 decades; one-sided density level / sqrt(f), within 0.6 % from 3 mHz to
         200 Hz at 8 kHz; stationary at t = 0
Source   docs/plant.md
"""

import math
from typing import NamedTuple

import mpmath
import numpy as np

from analog_frontend.numeric.vector import FIVE, LANES, integers, store, store_fives, store_rows
from fpga_model.jit import inlined, kernel, outlined

ORDER = np.arange(LANES, dtype=np.int64)
MASK = 0xFFFFFFFF
LOW = 0xFFFF
MULTIPLIER = 0x4F1BBCDD  # 2^31 (sqrt 5 - 1) / 2, odd
WEYL = 0x9E3779B9  # 2^32 (sqrt 5 - 1) / 2, odd
ROUNDS = 7
assert MULTIPLIER * MASK < 1 << 63, "a product must stay positive in int64"
assert ROUNDS == 7, "words() is written out for seven rounds"

WORD_MEAN = 65535  # twice the mean of a uniform 16-bit number
HALF = 32767.5  # the mean itself, exact in a double
WORD_VARIANCE_12 = 65536 * 65536 - 1  # twelve times its variance
BYTES, BYTES_MEAN, BYTES_VARIANCE_12 = 0x00FF00FF, 4 * 255 // 2, 4 * (256 * 256 - 1)
IH4_SCALE = 1.0 / math.sqrt(BYTES_VARIANCE_12 / 12)
IH12_SCALE = 1.0 / math.sqrt(12 * WORD_VARIANCE_12 / 12)
UNIFORM_SCALE = 1.0 / math.sqrt(WORD_VARIANCE_12 / 12)
HOLD = 5  # ticks; a frame is 25 samples
assert HOLD == FIVE, "store_fives puts a sample down once for each tick"
FIRST_DRAW = 1 << 60  # counters from here on are for values drawn once, at reset

POLES = 16
POLES_PER_DECADE = 2
BOLTZMANN_J_PER_K = 1.380649e-23
ZERO_DEGC_K = 273.15

# A source's number is its place in this list: append, never reorder, or every seeded run changes
SOURCES = (
    "force_x",
    "force_y",
    "cv_x",
    "cv_y",
    "edge_jitter",
    "dac_drive",
    "dac_sense",
    "dac_quad",
    "adc_0",
    "adc_1",
    "adc_2",
    "adc_3",
    "adc_temp",
    "flicker_0",
    "flicker_1",
    "flicker_2",
    "flicker_3",
    "flicker_temp",
    "rate_walk",
    "effect",
)
# Sources that take the second word of another's hash
SECOND = {"force_y": "force_x", "cv_y": "cv_x", "dac_sense": "dac_drive"}


class Source(NamedTuple):
    """One white source: its two 32-bit keys, the standard deviation of a sample in its own unit, and the switch.

    half  which word of the hash a source of a pair takes
    """

    key0: int
    key1: int
    sigma: float
    on: int
    half: int


class Flicker(NamedTuple):
    """One 1/f source: its keys, the one-sided density at 1 Hz in its own unit per rtHz, and the switch."""

    key0: int
    key1: int
    level: float
    on: int


def _flicker_poles():
    """Decay over a sample, gain of the 16-bit number, and stationary deviation of each pole, for level 1.

    The poles sit at rate 10^-(0.4 + k/2), each with the variance level^2 ln(10)/2: their Lorentzians add to level^2/f.
    None of it depends on the rate.
    """
    with mpmath.workprec(120):
        sigma = mpmath.sqrt(mpmath.log(10) / POLES_PER_DECADE)
        turns = [mpmath.mpf(10) ** -(mpmath.mpf(2) / 5 + mpmath.mpf(k) / POLES_PER_DECADE) for k in range(POLES)]
        decay = [mpmath.exp(-2 * mpmath.pi * t) for t in turns]
        gain = [sigma * mpmath.sqrt(1 - a * a) / mpmath.sqrt(mpmath.mpf(WORD_VARIANCE_12) / 12) for a in decay]
        return np.array([float(a) for a in decay]), np.array([float(g) for g in gain]), float(sigma)


DECAY, GAIN, DEVIATION = _flicker_poles()


@inlined
def _round(x, y, key):
    # only low halves count: with a mask on the factor alone LLVM takes the product of 32 by 32 bits, and drops the mask
    p = (x & MASK) * MULTIPLIER
    return (p >> 31) ^ y ^ key, p


@inlined
def words(key0, key1, counter):
    """Two 32-bit words; for fixed keys a permutation of the 63-bit counter's two halves."""
    x, y = counter & MASK, (counter >> 32) ^ key1
    x, y = _round(x, y, key0)
    x, y = _round(x, y, key0 + WEYL)
    x, y = _round(x, y, key0 + 2 * WEYL)
    x, y = _round(x, y, key0 + 3 * WEYL)
    x, y = _round(x, y, key0 + 4 * WEYL)
    x, y = _round(x, y, key0 + 5 * WEYL)
    x, y = _round(x, y, key0 + 6 * WEYL)
    return x & MASK, y & MASK


@inlined
def words4(keys0, keys1, counters):
    """`words` four times, as (x, y) each: a round waits for the last one, so that four of them go side by side."""
    a = counters[0] & MASK, (counters[0] >> 32) ^ keys1[0]
    b = counters[1] & MASK, (counters[1] >> 32) ^ keys1[1]
    c = counters[2] & MASK, (counters[2] >> 32) ^ keys1[2]
    d = counters[3] & MASK, (counters[3] >> 32) ^ keys1[3]
    for k in range(ROUNDS):
        a = _round(a[0], a[1], keys0[0] + k * WEYL)
        b = _round(b[0], b[1], keys0[1] + k * WEYL)
        c = _round(c[0], c[1], keys0[2] + k * WEYL)
        d = _round(d[0], d[1], keys0[3] + k * WEYL)
    return (
        (a[0] & MASK, a[1] & MASK),
        (b[0] & MASK, b[1] & MASK),
        (c[0] & MASK, c[1] & MASK),
        (d[0] & MASK, d[1] & MASK),
    )


@inlined
def halves(pair):
    """Sum of the four 16-bit halves of two words, minus its mean."""
    x, y = pair
    return (x & LOW) + (x >> 16) + (y & LOW) + (y >> 16) - 2 * WORD_MEAN


@inlined
def sum4(key0, key1, counter):
    """Sum of the four 16-bit halves, minus its mean: an integer of -131070 .. 131070."""
    return halves(words(key0, key1, counter))


@inlined
def ih4(word):
    """Unit-variance number from the four bytes of a 32-bit word (Irwin-Hall of order 4)."""
    pairs = (word & BYTES) + ((word >> 8) & BYTES)
    return ((pairs & LOW) + (pairs >> 16) - BYTES_MEAN) * IH4_SCALE


@inlined
def ih12(key0, key1, counter):
    """Unit-variance number from three hashes (Irwin-Hall of order 12); counters below 2^61."""
    first = 3 * counter
    return (sum4(key0, key1, first) + sum4(key0, key1, first + 1) + sum4(key0, key1, first + 2)) * IH12_SCALE


def number(name):
    """A source's number; ValueError for an unknown name."""
    if name not in SOURCES:
        raise ValueError(f"noise source {name!r} is none of {', '.join(SOURCES)}")
    return SOURCES.index(name)


def keys(seed, name):
    """The two keys of a source under a seed of 0 .. 2^62 - 1: the hash of the source's number under the seed."""
    if not 0 <= seed < 1 << 62:
        raise ValueError(f"noise seed: {seed} is outside 0 .. 2^62 - 1")
    x, y = words(seed & MASK, seed >> 32, number(name))
    return int(x), int(y)


def source(seed, name, sigma, on=1):
    """White source of `sigma` (rms of one sample, in the unit of the source)."""
    if not (math.isfinite(sigma) and sigma >= 0.0):
        raise ValueError(f"noise sigma of {name}: {sigma} is not a finite number >= 0")
    key0, key1 = keys(seed, SECOND.get(name, name))
    return Source(key0, key1, float(sigma), 1 if on and sigma > 0.0 else 0, 1 if name in SECOND else 0)


@inlined
def white_sample(p, counter):
    """Sample number `counter` of a source, or the error of an edge; exactly 0.0 when off."""
    if p.on:
        x, y = words(p.key0, p.key1, counter)
        return p.sigma * ih4(y if p.half else x)
    return 0.0


@inlined
def hold_sample(p, tick):
    """What a held source gives in a tick: one sample for HOLD ticks, from a multiple of HOLD on."""
    return white_sample(p, tick // HOLD)


@inlined
def white_fine(p, counter):
    """One sample of an 8 kHz source; exactly 0.0 when off."""
    if p.on:
        return p.sigma * ih12(p.key0, p.key1, counter)
    return 0.0


@outlined
def fill_rows(p, q, counter, stride, w, first, second, n):
    """w[first + i] = sample of p, w[second + i] = of q at counter + i stride for i below n, a multiple of 8.

    p takes the first word of each hash and q the second: they have the same keys (edge jitter is both). Mutates `w`.
    """
    if p.on and q.on:
        steps = integers(ORDER, 0) * stride
        four = n - n % (4 * LANES)
        for i in range(0, four, 4 * LANES):
            at, eight = counter + i * stride, LANES * stride
            keys0, keys1 = (p.key0, p.key0, p.key0, p.key0), (p.key1, p.key1, p.key1, p.key1)
            counters = (steps + at, steps + (at + eight), steps + (at + 2 * eight), steps + (at + 3 * eight))
            a, b, c, d = words4(keys0, keys1, counters)
            for_p = (p.sigma * ih4(a[0]), p.sigma * ih4(b[0]), p.sigma * ih4(c[0]), p.sigma * ih4(d[0]))
            for_q = (q.sigma * ih4(a[1]), q.sigma * ih4(b[1]), q.sigma * ih4(c[1]), q.sigma * ih4(d[1]))
            store_rows(w, first + i, LANES, for_p)
            store_rows(w, second + i, LANES, for_q)
        for i in range(four, n, LANES):
            x, y = words(p.key0, p.key1, steps + (counter + i * stride))
            store(w, first + i, p.sigma * ih4(x))
            store(w, second + i, q.sigma * ih4(y))
    else:
        for i in range(n):
            w[first + i] = white_sample(p, counter + i * stride)
            w[second + i] = white_sample(q, counter + i * stride)


@outlined
def fill_hold_rows(p, q, tick, w, first, second, n):
    """w[first + i] = hold_sample(p, tick + i), w[second + i] of q alike, for i below n. Mutates `w`.

    p, q  as for `fill_rows`. Whole samples and whole registers of them are put down: up to HOLD - 1 places in front of
    each row are lost, and HOLD LANES - 1 behind it.
    """
    if p.on and q.on:
        into, number = tick % HOLD, tick // HOLD
        for i in range(0, into + n, HOLD * LANES):
            x, y = words(p.key0, p.key1, integers(ORDER, 0) + (number + i // HOLD))
            store_fives(w, first - into + i, p.sigma * ih4(x))
            store_fives(w, second - into + i, q.sigma * ih4(y))
    else:
        for i in range(n):
            w[first + i] = hold_sample(p, tick + i)
            w[second + i] = hold_sample(q, tick + i)


def _hold_s(carrier_hz, tick_s):
    """Length of a hold; ValueError where a half period of the carrier is shorter than it."""
    hold_s = HOLD * tick_s
    if not 0.0 < carrier_hz * hold_s <= 0.5:
        raise ValueError(f"noise carrier_hz: {carrier_hz:g} is not above 0 and at most {0.5 / hold_s:g} Hz")
    return hold_s


def sigma_at_carrier(density_per_rthz, carrier_hz, tick_s):
    """Rms of held samples whose one-sided density at the carrier is this one: density/(sqrt(2 T) sinc(f T))."""
    hold_s = _hold_s(carrier_hz, tick_s)
    with mpmath.workprec(120):
        return float(density_per_rthz / (mpmath.sqrt(2 * hold_s) * mpmath.sincpi(mpmath.mpf(carrier_hz) * hold_s)))


def sigma_demodulated(density_per_rthz, carrier_hz, tick_s):
    """Rms of held samples that, demodulated by a sign reference, give what white noise of this one-sided density gives.

    The reference weighs the density around its harmonic n = 1, 3, 5 ... by 8/(pi n)^2: 1 in all for white noise. The
    sum of 8/(pi n)^2 sinc^2(n f T) is the mean of the square wave's autocorrelation 1 - 4 f |t| over the triangle of a
    held sequence, 1 - 4 f T/3.
    """
    hold_s = _hold_s(carrier_hz, tick_s)
    return density_per_rthz / math.sqrt(2.0 * hold_s * (1.0 - 4.0 * carrier_hz * hold_s / 3.0))


def thermomechanical_density(damping_n_s_per_m, temp_degc):
    """One-sided density (N/rtHz) of the force noise of a damper: sqrt(4 k T d)."""
    return math.sqrt(4.0 * BOLTZMANN_J_PER_K * (temp_degc + ZERO_DEGC_K) * damping_n_s_per_m)


def flicker(seed, name, level_at_1hz, on=1):
    """1/f source with the one-sided density level_at_1hz / sqrt(f) at whatever rate it is stepped."""
    if not (math.isfinite(level_at_1hz) and level_at_1hz >= 0.0):
        raise ValueError(f"flicker level of {name}: {level_at_1hz} is not a finite number >= 0 (unit per rtHz at 1 Hz)")
    return Flicker(*keys(seed, name), float(level_at_1hz), 1 if on and level_at_1hz > 0.0 else 0)


def flicker_reset(p):
    """The 16 states, drawn from their stationary distribution: the noise is as old as the world at t = 0."""
    return np.array([DEVIATION * ih12(p.key0, p.key1, FIRST_DRAW + k) if p.on else 0.0 for k in range(POLES)])


@kernel
def flicker_step(p, state, counter):
    """Advance the 16 poles (of level 1) by one sample and return their sum times the level; mutates `state`.

    Exactly 0.0 when off.
    """
    if not p.on:
        return 0.0
    total = 0.0
    for block in range(POLES // 4):
        x, y = words(p.key0, p.key1, (POLES // 4) * counter + block)
        k = 4 * block
        state[k] = DECAY[k] * state[k] + GAIN[k] * ((x & LOW) - HALF)
        state[k + 1] = DECAY[k + 1] * state[k + 1] + GAIN[k + 1] * ((x >> 16) - HALF)
        state[k + 2] = DECAY[k + 2] * state[k + 2] + GAIN[k + 2] * ((y & LOW) - HALF)
        state[k + 3] = DECAY[k + 3] * state[k + 3] + GAIN[k + 3] * ((y >> 16) - HALF)
        total = total + ((state[k] + state[k + 1]) + (state[k + 2] + state[k + 3]))
    return p.level * total

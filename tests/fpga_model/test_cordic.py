"""The vectoring CORDIC: every register at every clock, and magnitude and phase against their derived bounds.

The bounds, for a vector of length r (input LSB), n rotations and g guard bits:

    E          = sqrt(1/2) * sum over k = 1 .. n-1 of prod over j > k of sqrt(1 + 4**-j)    drift of (x, y), guard LSB
    turned(r)  = sum over k = 1 .. n-1 of asin(sqrt(1/2) / (2**g*r*G[k+1] - E))             angle those steps lose, rad
    phase      = 1/2 + the table + (atan(2**-(n-1)) + turned(r) + asin(E / (2**g*r*K))) in phase LSB
    magnitude  = 1/2 + (E + 2**g*r*K*(1 - cos(atan(2**-(n-1)) + turned(r)))) / 2**g

with G[k] the gain of the first k rotations and K = G[n]. The table is off by half an angle LSB per rotation, and by
half one of 2**-32 turn more where g < 8. The phase bound has the form A + B/r. What to expect of n = 24 and g = 8
follows from errors spread evenly (the result's LSB, the last angle, 23 roundings across the vector) and from the
rotation by the sign of y, which settles y at 0 or -1 guard LSB:

    std(r)**2  = 1/12 + (atan(2**-(n-1)) in LSB)**2 / 3 + 23/12 / (256*r*K)**2 in LSB**2
    mean(r)    = 1/2 / (256*r*K) in LSB
"""

import math
from fractions import Fraction

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import cordic
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from fpga_model.jit import kernel
from tests import naive

FULL = 1 << 23
# numba does not know the defaults of a NamedTuple, so the reset state is made outside the kernels
RESET = cordic.State()
GAIN = [math.prod(math.sqrt(1 + 4.0**-j) for j in range(k)) for k in range(25)]
LSB_PER_RAD = 2**24 / (2 * math.pi)
DESIGNS = [DEFAULT._replace(cordic_iterations=n, cordic_guard_bits=g)
           for n, g in ((8, 8), (24, 0), (8, 0), (17, 3), (12, 1))]  # fmt: skip


def drift(n=24):
    return math.sqrt(0.5) * sum(GAIN[n] / GAIN[k + 1] for k in range(1, n))


def a_lsb(n=24, g=8):
    table = (n - 1) * (0.5 + (2.0 ** (g - 9) if g < 8 else 0.0)) / 2**g
    return 0.5 + table + math.atan(2.0 ** (1 - n)) * LSB_PER_RAD


DRIFT, LAST, A_LSB = drift(), math.atan(2.0**-23), a_lsb()


def turned_rad(r, n=24, g=8):
    return sum(np.arcsin(math.sqrt(0.5) / (2**g * r * GAIN[k + 1] - drift(n))) for k in range(1, n))


def phase_bound_lsb(r, n=24, g=8):
    return a_lsb(n, g) + (turned_rad(r, n, g) + np.arcsin(drift(n) / (2**g * r * GAIN[n]))) * LSB_PER_RAD


def magnitude_bound_lsb(r, n=24, g=8):
    last = math.atan(2.0 ** (1 - n))
    return 0.5 + drift(n) / 2**g + r * GAIN[n] * (1 - np.cos(last + turned_rad(r, n, g)))


def phase_mean_lsb(r):
    return 0.5 * LSB_PER_RAD / (256 * r * GAIN[24])


def phase_std_lsb(r):
    return np.sqrt(1 / 12 + (LAST * LSB_PER_RAD) ** 2 / 3 + 23 / 12 * (LSB_PER_RAD / (256 * r * GAIN[24])) ** 2)


@kernel
def trace(d, s, start, x_in, y_in):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(start) + 1, 8), np.int64)
    for n in range(len(start) + 1):
        for k, value in enumerate(s):
            rows[n, k] = value
        if n < len(start):
            s = cordic.step(d, s, int(start[n]), int(x_in[n]), int(y_in[n]))
    return rows


@kernel
def solve(d, s, x_in, y_in):
    """Magnitude, phase and clocks of each vector, and the smallest and largest value of every register."""
    out = np.empty((len(x_in), 3), np.int64)
    seen = np.zeros((2, 8), np.int64)
    for n in range(len(x_in)):
        s = cordic.step(d, s, 1, int(x_in[n]), int(y_in[n]))
        clocks = 1
        while not s.done and clocks < 100:
            for k, value in enumerate(s):
                seen[0, k] = min(seen[0, k], value)
                seen[1, k] = max(seen[1, k], value)
            s = cordic.step(d, s, 0, 0, 0)
            clocks += 1
        seen[0, 6] = min(seen[0, 6], s.magnitude)
        seen[1, 6] = max(seen[1, 6], s.magnitude)
        seen[0, 7] = min(seen[0, 7], s.phase)
        seen[1, 7] = max(seen[1, 7], s.phase)
        out[n, 0] = s.magnitude
        out[n, 1] = s.phase
        out[n, 2] = clocks
    return out, seen


def vectors():
    """Corners, axes, diagonals, every tiny vector, and random ones even in value and even in the log of the length."""
    rng = np.random.default_rng(1)
    many = 2_000 if numba.config.DISABLE_JIT else 100_000
    tiny = 12 if numba.config.DISABLE_JIT else 48
    ends = [-FULL, -FULL + 1, -1, 0, 1, FULL - 2, FULL - 1]
    powers = [d * (1 << k) + e for k in range(23) for d in (-1, 1) for e in (-1, 0, 1)]
    pairs = [(x, y) for x in ends for y in ends]
    pairs += [(x, y) for x in powers for y in (0, x, -x, 1, -1)] + [(y, x) for x in powers for y in (0, 1, -1)]
    pairs += [(x, y) for x in range(-tiny, tiny + 1) for y in range(-tiny, tiny + 1)]
    length, angle = 2 ** rng.uniform(0, 23, many), rng.uniform(-math.pi, math.pi, many)
    around = np.rint(np.stack([length * np.cos(angle), length * np.sin(angle)], 1)).astype(np.int64)
    xy = np.concatenate([np.array(pairs), around.clip(-FULL, FULL - 1), rng.integers(-FULL, FULL, (many, 2))])
    return xy[np.any(xy != 0, axis=1)]


@pytest.fixture(scope="module")
def solved():
    xy = vectors()
    out, seen = solve(DEFAULT, RESET, xy[:, 0].copy(), xy[:, 1].copy())
    r = np.hypot(xy[:, 0], xy[:, 1])
    turns = np.arctan2(xy[:, 1], xy[:, 0]) / (2 * math.pi)
    error = out[:, 1] - turns * 2**24
    error -= np.rint(error / 2**24) * 2**24
    return xy, out, seen, r, error


# Constants ----------------------------------------------------------------------------------------------------------


def test_table_is_the_rounded_arctangent():
    for i, raw in enumerate(cordic.ATAN):
        lower, upper = naive.arctan_turns_bounds(i)
        assert naive.rounded("half_up", lower * 2**32) == naive.rounded("half_up", upper * 2**32) == raw
    assert len(cordic.ATAN) == cordic.ITERATIONS


def test_gain_is_the_product_of_the_rotations():
    square = math.prod((1 + Fraction(1, 4**i) for i in range(24)), start=Fraction(1))
    assert cordic.gain() ** 2 <= square < (cordic.gain() + Fraction(1, 2**80)) ** 2
    assert f"K = {float(cordic.gain()):.9f}" in cordic.__doc__


@pytest.mark.parametrize("n", [8, 15, 24])
def test_gain_of_fewer_rotations(n):
    assert float(cordic.gain(n)) == pytest.approx(GAIN[n], rel=1e-14)


def test_header_states_formats_and_latency():
    text = " ".join(cordic.__doc__.split())
    for names, fmt in {
        "x_in, y_in": cordic.INPUT, "x": cordic.STATE_FMT.x, "y": cordic.STATE_FMT.y, "angle": cordic.STATE_FMT.angle,
        "magnitude": cordic.STATE_FMT.magnitude, "phase": cordic.STATE_FMT.phase, "i": cordic.STATE_FMT.i,
        "busy, done": cordic.STATE_FMT.done,
    }.items():  # fmt: skip
        assert f"{names} {fmt}" in text
    assert f"Latency {cordic.LATENCY} clocks" in text
    assert sum(fmt.width for fmt in cordic.STATE_FMT) == 154


# Registers ----------------------------------------------------------------------------------------------------------

component = st.one_of(
    st.sampled_from([-FULL, -FULL + 1, -2, -1, 0, 1, 2, FULL - 1]),
    st.integers(-64, 64),
    st.integers(-FULL, FULL - 1),
)
run = st.tuples(component, component, st.sampled_from([1, 2, 13, 25, 26, 27, 30]))


@given(st.lists(run, min_size=1, max_size=5), component, st.sampled_from([DEFAULT, *DESIGNS]))
def test_step_is_the_documented_equation(runs, idle, d):
    """Each run is one start and some clocks, possibly too few; the inputs carry something else in between."""
    inputs = [(1, x, y) if k == 0 else (0, idle, -idle - 1) for x, y, clocks in runs for k in range(clocks)]
    rows = trace(d, RESET, *np.array(inputs, dtype=np.int64).T.copy())
    full = [naive.rounded("half_up", naive.arctan_turns_bounds(i)[0] * 2**32) for i in range(d.cordic_iterations)]
    bits = 24 + d.cordic_guard_bits
    table = [Fraction(naive.rounded("half_up", Fraction(raw, 2 ** (32 - bits))), 2**bits) for raw in full]
    assert [tuple(row) for row in rows.tolist()] == naive.cordic(table, inputs, d.cordic_guard_bits)


def test_done_rises_latency_clocks_after_start_for_one_clock():
    start = np.zeros(60, dtype=np.int64)
    start[7] = 1
    rows = trace(DEFAULT, RESET, start, start * 5, start * 9)
    assert np.flatnonzero(rows[:, 5]).tolist() == [7 + cordic.LATENCY]
    assert np.flatnonzero(rows[:, 4]).tolist() == list(range(8, 7 + cordic.LATENCY))
    assert cordic.LATENCY <= 30
    changed = np.flatnonzero(np.any(np.diff(rows[:, 6:], axis=0), axis=1)) + 1
    assert changed.tolist() == [7 + cordic.LATENCY], "results change with done and at no other clock"


def test_registers_stay_in_their_formats(solved):
    _, _, seen, _, _ = solved
    for fmt, lowest, highest in zip(cordic.STATE_FMT, *seen.tolist(), strict=True):
        assert fmt.lo <= lowest <= highest <= fmt.hi
    assert seen[1, 6] == 19_535_983, "full scale on both axes"


# Results ------------------------------------------------------------------------------------------------------------


def test_magnitude_within_its_bound(solved):
    _, out, _, r, _ = solved
    assert np.all(np.abs(out[:, 0] - r * float(cordic.gain())) <= magnitude_bound_lsb(r))
    assert magnitude_bound_lsb(1.0) < 0.57, "header: Error"


def test_phase_within_its_bound(solved):
    _, out, _, r, error = solved
    assert np.all(np.abs(error) <= phase_bound_lsb(r))
    assert np.all(out[:, 2] == cordic.LATENCY)
    assert A_LSB < 0.87, "header: A of Error"


@pytest.mark.parametrize("d", DESIGNS, ids=lambda d: f"n={d.cordic_iterations}, g={d.cordic_guard_bits}")
def test_fewer_rotations_and_guard_bits_are_within_their_bounds(d):
    """Formats, latency, magnitude and phase; vectors so short that their bound is no angle are left out."""
    n, g = d.cordic_iterations, d.cordic_guard_bits
    xy = vectors()
    xy = xy[np.hypot(*xy.T) > 4 * drift(n) / 2**g]
    out, seen = solve(d, RESET, xy[:, 0].copy(), xy[:, 1].copy())
    for fmt, lowest, highest in zip(formats(cordic.State, d), *seen.tolist(), strict=True):
        assert fmt.lo <= lowest <= highest <= fmt.hi
    r, turns = np.hypot(*xy.T), np.arctan2(xy[:, 1], xy[:, 0]) / (2 * math.pi)
    error = out[:, 1] - turns * 2**24
    error -= np.rint(error / 2**24) * 2**24
    assert np.all(out[:, 2] == cordic.LATENCY)
    assert np.all(np.abs(out[:, 0] - r * GAIN[n]) <= magnitude_bound_lsb(r, n, g))
    assert np.all(np.abs(error) <= phase_bound_lsb(r, n, g))
    if n == 8:
        assert np.abs(error).max() > 0.9 * math.atan(2.0**-7) * LSB_PER_RAD, "the last angle is all but reached"


def test_phase_bound_is_a_plus_b_over_r():
    b_rad = math.sqrt(0.5) * sum(1 / GAIN[k + 1] for k in range(1, 24)) / 256 + DRIFT / (256 * GAIN[24])
    assert (round(b_rad, 3), round(DRIFT, 2)) == (0.077, 16.30), "header: B of Error"
    assert round(b_rad * LSB_PER_RAD, -3) == 207_000, "B in LSB"
    r = 2.0 ** np.arange(1, 24)
    np.testing.assert_allclose(phase_bound_lsb(r), A_LSB + b_rad / r * LSB_PER_RAD, rtol=0.03)
    # guard bits: what the rotations lose stays well below what half an input LSB may turn the vector by
    assert b_rad < 0.5 / 6


def test_phase_error_grows_as_the_vector_shrinks(solved):
    """The errors spread as std(r) says in every octave from 64 LSB on; of shorter vectors many shifts are exact."""
    _, _, _, r, error = solved
    for k in range(6, 23):
        octave = (r >= 2.0**k) & (r < 2.0 ** (k + 1))
        z = ((error - phase_mean_lsb(r)) / phase_std_lsb(r))[octave]
        assert 0.7 < z.std() < 1.1, k
        assert abs(z.mean()) < 0.25, k


def test_magnitude_errors_spread_as_rounding_does(solved):
    _, out, _, r, _ = solved
    error = (out[:, 0] - r * float(cordic.gain()))[r > 1000]
    assert error.std() == pytest.approx(math.sqrt(1 / 12), rel=0.02)
    assert abs(error.mean()) < 0.01


@pytest.mark.parametrize("before", [(0, 0), (-7, 3), (5, -FULL)])
def test_zero_vector_has_magnitude_and_phase_zero(before):
    out, _ = solve(DEFAULT, RESET, np.array([before[0], 0, 0]), np.array([before[1], 0, 0]))
    assert out[1:].tolist() == [[0, 0, cordic.LATENCY]] * 2


@pytest.mark.parametrize(
    ("x", "y", "turns"),
    [(FULL - 1, 0, 0), (0, FULL - 1, 0.25), (-FULL, 0, -0.5), (0, -FULL, -0.25), (-FULL, -FULL, -0.375),
     (FULL - 1, FULL - 1, 0.125), (-FULL, FULL - 1, 0.375), (FULL - 1, -FULL, -0.125)],
)  # fmt: skip
def test_axes_diagonals_and_full_scale(x, y, turns):
    """On the negative x axis the phase is half a turn, which reads as either end of its range."""
    out, _ = solve(DEFAULT, RESET, np.array([x]), np.array([y]))
    off = (out[0, 1] - turns * 2**24 + FULL) % 2**24 - FULL
    assert abs(off) <= 2
    assert abs(out[0, 0] - float(cordic.gain()) * math.hypot(x, y)) < 0.57

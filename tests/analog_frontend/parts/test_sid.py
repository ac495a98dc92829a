"""The six-capacitor demodulator against an event-driven exact solution, and against the laws of its circuit.

The oracle joins the three RC stages with oscillators that make the input, and jumps from reference edge to reference
edge with one matrix exponential; it knows neither ticks nor polynomials.
"""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from analog_frontend.parts import sid
from fpga_model.jit import kernel

H = 1e-6
RC = 10e3 * 159e-9
F = 11002.3
PARAMS = sid.design(RC, H)


class Tones:
    """Sum of amplitude sin(2 pi f t + angle) plus a constant, as an autonomous linear system that drives the stages."""

    def __init__(self, *tones, constant=0.0, rc=RC):
        self.tones, self.constant = tones, constant
        n = 4 + 2 * len(tones)
        a = np.zeros((n, n))
        for k in range(3):
            a[k, k] = -1 / rc
            if k:
                a[k, k - 1] = 1 / rc
        a[0, 3] = 1 / rc
        for k, (f, _, _) in enumerate(tones):
            s, c = 4 + 2 * k, 5 + 2 * k
            a[0, s] = 1 / rc
            a[s, c], a[c, s] = 2 * math.pi * f, -2 * math.pi * f
        self.matrix = a

    def sources(self, t):
        rows = [np.full_like(t, self.constant)]
        for f, amplitude, angle in self.tones:
            rows += [amplitude * np.sin(2 * np.pi * f * t + angle), amplitude * np.cos(2 * np.pi * f * t + angle)]
        return np.array(rows)

    def value(self, t):
        return self.sources(t)[0] + self.sources(t)[1::2].sum(axis=0)

    def slope(self, t):
        return sum((2 * np.pi * f * row for (f, _, _), row in zip(self.tones, self.sources(t)[2::2])), np.zeros_like(t))

    def response(self, t, dt):
        """Zero-state response of the three stages over t .. t + dt."""
        return (expm(self.matrix * dt)[:3, 3:] @ self.sources(t)).T

    def advance(self, w, t, dt):
        return expm(self.matrix * dt)[:3] @ np.concatenate([w, self.sources(np.array(t))])


def event_driven(tones, start, ref, edges_s, inject, until_s):
    """Six capacitors at `until_s`, from edge to edge; (caps, reference)."""
    caps, t = np.array(start, dtype=float), 0.0
    for at in [*edges_s, until_s]:
        g = 0 if ref else 3
        caps[g : g + 3] = tones.advance(caps[g : g + 3], t, at - t)
        t = at
        if at is not until_s:
            caps[g : g + 3] += inject[g : g + 3]
            ref = 1 - ref
    return caps, ref


@kernel
def play(p, caps, ref, response, value, slope, noise, first, taus, out):
    """Run the ticks; taus[first[k] .. first[k+1]-1] are the edges of tick k. Fills out[k] with the six capacitors."""
    for k in range(response.shape[0]):
        count = first[k + 1] - first[k]
        n = noise[k]
        p1, p2, p3 = response[k, 0], response[k, 1], response[k, 2]
        if count == 0:
            sid.step_edgeless_tick(p, caps, 0, ref, n, p1, p2, p3)
        elif count == 1:
            ref = 1 - ref
            tau = taus[first[k]]
            sid.edge(p, caps, 0, ref, tau, n, p1, p2, p3, value[k], slope[k], value[k + 1], slope[k + 1])
        else:
            part = taus[first[k] : first[k + 1]]
            ref = sid.edges(p, caps, 0, ref, part, count, n, p1, p2, p3, value[k], slope[k], value[k + 1], slope[k + 1])
        for i in range(6):
            out[k, i] = caps[0, i]
    return ref


def run(tones, edges_s, ticks, ref=1, p=PARAMS, start=(0.0,) * 6, noise=None):
    """All capacitors at every tick end, for a sorted array of edge instants."""
    edges_s = np.asarray(edges_s, dtype=float)
    at = np.floor(edges_s / H).astype(np.int64)
    first = np.searchsorted(at, np.arange(ticks + 1)).astype(np.int64)
    t = np.arange(ticks + 1) * H
    caps = sid.reset()
    caps[0] = start
    out = np.zeros((ticks, 6))
    noise = np.zeros(ticks) if noise is None else noise
    end = play(
        p, caps, ref, tones.response(t[:-1], H), tones.value(t), tones.slope(t), noise, first, edges_s - at * H, out
    )
    return out, end


def square(f, seconds, late_s=0.0):
    """Edges of sgn(sin(2 pi f t)) after t = 0: falling first; the falling ones `late_s` later."""
    k = np.arange(1, math.floor(2 * f * seconds))
    return k / (2 * f) + late_s * (k % 2)


def settled(tones, seconds=0.15, late_s=0.0, p=PARAMS):
    """Mean output of the last 30 ms."""
    ticks = round(seconds / H)
    out, _ = run(tones, square(F, seconds + 1e-3, late_s), ticks, p=p)
    tail = out[-30000:]
    return (tail[:, 2] - tail[:, 5]).mean()


# exactness ----------------------------------------------------------------------------------------------------------


@given(
    st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4),
    st.floats(0.0, 1.0, exclude_max=True),
    st.sampled_from([RC, 250e-6, 1e-2]),
)
@settings(max_examples=25)
def test_split_is_exact_for_a_cubic_input(v, s, rc):
    """q_j(s) against 30-digit quadrature of the circuit's own kernel u^(j-1) e^-u / (j-1)!."""
    p = sid.design(rc, H)
    v0, dv0, v1, dv1 = v[0], v[1] / H, v[2], v[3] / H
    with mpmath.workdps(30):
        a, b, rise = mpmath.mpf(dv0) * H, mpmath.mpf(dv1) * H, mpmath.mpf(v1) - v0
        c3, c2 = a + b - 2 * rise, 3 * rise - 2 * a - b
        size = mpmath.fsum(map(abs, v)) or 1  # quadrature stops at an absolute error
        r = mpmath.mpf(H) / mpmath.mpf(rc)
        for j, got in enumerate(sid.response(p, v0, dv0, v1, dv1, s), start=1):

            def integrand(y, j=j):
                x = mpmath.mpf(s) * y
                return (((c3 * x + c2) * x + a) * x + v0) * (1 - y) ** (j - 1) * mpmath.exp(-r * s * (1 - y)) / size

            want = mpmath.quad(integrand, [0, 1]) * size * (r * s) ** j / mpmath.factorial(j - 1)
            # rounding of the four inputs' combination and the fifth term, scaled by the largest possible response
            scale = float((r * s) ** j / math.factorial(j)) * float(size)
            assert abs(got - want) <= (30 * 2.0**-53 + float(r * s) ** 4 / 56) * scale + 1e-300


@given(st.data())
@settings(max_examples=12)
def test_any_edges_match_the_event_driven_solution(data):
    ticks = 120
    counts = data.draw(st.lists(st.sampled_from([0, 0, 0, 0, 1, 1, 2, 3, 5]), min_size=ticks, max_size=ticks))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    edges = np.sort(np.concatenate([k + rng.uniform(0.0, 0.999, c) for k, c in enumerate(counts)])) * H
    tones = Tones((F, 2.88, rng.uniform(0, 6.28)), (3 * F, 0.05, 1.0), constant=0.3)
    start = rng.uniform(-3, 3, 6)
    inject = rng.uniform(-1e-5, 1e-5, 6)
    ref = int(rng.integers(2))
    p = sid.design(RC, H, tuple(inject))
    out, end = run(tones, edges, ticks, ref=ref, p=p, start=start)
    want, want_ref = event_driven(tones, start, ref, list(edges), inject, ticks * H)
    assert end == want_ref
    bound = len(edges) * PARAMS.r * sum(a * (2 * math.pi * f * H) ** 4 / 720 for f, a, _ in tones.tones)
    assert np.abs(out[-1] - want).max() <= bound + 4e-15 * ticks


def test_hermite_error_reaches_its_bound_and_no_more():
    bound = PARAMS.r * (2 * math.pi * F * H) ** 4 / 720
    worst = 0.0
    for angle in np.linspace(0.0, math.pi, 33):
        tones = Tones((F, 1.0, angle))
        t = np.array([0.0, H])
        (v0, v1), (d0, d1) = tones.value(t), tones.slope(t)
        for s in np.linspace(0.05, 0.9999, 21):
            got = sid.response(PARAMS, v0, d0, v1, d1, s)[0]
            worst = max(worst, abs(got - tones.response(np.array(0.0), s * H)[0]))
    assert 0.9 * bound < worst <= 1.01 * bound
    assert bound == pytest.approx(2.0e-11, rel=0.01)


def test_one_edge_of_a_list_has_the_bits_of_the_single_edge():
    rng = np.random.default_rng(1)
    p = sid.design(RC, H, (1e-5,) * 6)
    drive = (1e-9, 1e-3, 3e-7, 5e-11, 1.2, 3e4, 1.23, 2.9e4)

    @kernel
    def single(p, caps, tau, drive):
        n, p1, p2, p3, v0, dv0, v1, dv1 = drive
        sid.edge(p, caps, 2, 0, tau, n, p1, p2, p3, v0, dv0, v1, dv1)

    for tau in (0.0, 1e-9, 0.37e-6, 0.9999e-6):
        one, many = sid.reset(), sid.reset()
        one[2] = many[2] = rng.uniform(-1, 1, 6)
        single(p, one, tau, drive)
        assert sid.edges(p, many, 2, 1, np.array([tau]), 1, *drive) == 0
        assert one.tobytes() == many.tobytes()


def test_held_noise_is_the_step_response():
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 1e-3, 200)
    edges = square(F, 200e-6)
    with_noise, _ = run(Tones(), edges, 200, noise=noise)
    # the same through the oracle: a piecewise constant input, tick by tick
    caps, ref = np.zeros(6), 1
    for k in range(200):
        inside = [e - k * H for e in edges if k * H <= e < (k + 1) * H]
        caps, ref = event_driven(Tones(constant=noise[k]), caps, ref, inside, np.zeros(6), H)
        assert np.abs(caps - with_noise[k]).max() < 1e-15


# the laws of the circuit --------------------------------------------------------------------------------------------


def test_gain_is_four_over_pi():
    assert settled(Tones((F, 1.0, 0.0))) == pytest.approx(4 / math.pi, rel=1e-5)


def test_quadrature_does_not_leak():
    assert abs(settled(Tones((F, 1.0, math.pi / 2)))) < 1e-5 * 4 / math.pi


def test_input_offset_cancels():
    assert abs(settled(Tones(constant=1.0))) < 1e-9


@pytest.mark.parametrize("n", [2, 3, 4, 5, 7])
def test_odd_harmonics_come_through_as_one_over_n(n):
    want = 4 / math.pi / n if n % 2 else 0.0
    assert abs(settled(Tones((n * F, 1.0, 0.0))) - want) < 1e-5
    assert abs(settled(Tones((n * F, 1.0, math.pi / 2)))) < 1e-5


@pytest.mark.parametrize("d", [0.001, 0.01])
def test_a_late_edge_turns_the_phase_by_pi_d(d):
    sine, cosine = (settled(Tones((F, 1.0, angle)), late_s=d / F) for angle in (0.0, math.pi / 2))
    assert -math.atan2(cosine, sine) == pytest.approx(math.pi * d, rel=1e-3)
    # on-time means of the two halves of unequal length
    norm = 2 / math.pi / (1 - 4 * d * d)
    assert sine == pytest.approx((1 + math.cos(2 * math.pi * d)) * norm, rel=1e-5)
    assert cosine == pytest.approx(-math.sin(2 * math.pi * d) * norm, abs=1e-5)


def test_poles_are_at_one_over_four_pi_rc():
    """A carrier modulated at 50 Hz comes out through three equal poles."""
    fm, seconds = 50.0, 0.3
    out, _ = run(Tones((F + fm, 0.5, 0.0), (F - fm, 0.5, 0.0)), square(F, seconds + 1e-3), round(seconds / H))
    tail = np.arange(200000, 300000)
    t = (tail + 1) * H
    y = out[tail, 2] - out[tail, 5]
    basis = np.stack([np.cos(2 * np.pi * fm * t), np.sin(2 * np.pi * fm * t)], axis=1)
    c, s = np.linalg.lstsq(basis, y, rcond=None)[0]
    # gain g/(1 + j fm/f3)^3: the phase alone gives f3
    f3 = fm / math.tan(math.atan2(s, c) / 3)
    assert f3 == pytest.approx(sid.corner_hz(RC), rel=1e-4)
    assert sid.corner_hz(RC) == pytest.approx(1 / (4 * math.pi * RC), rel=1e-14)
    assert math.hypot(c, s) * (1 + (fm / f3) ** 2) ** 1.5 == pytest.approx(4 / math.pi, rel=1e-4)


def test_charge_injection_lifts_each_stage_by_two_qrf():
    charge, mismatch = 1e-12, 0.1
    volts = sid.injection_volts(charge, mismatch, 159e-9)
    p = sid.design(RC, H, volts)
    seconds = 0.15
    edges = square(F, seconds + 1e-3)
    out, _ = run(Tones(), edges, round(seconds / H), p=p)
    t = (np.arange(120000, 150000) + 0.5) * H
    on = np.sin(2 * np.pi * F * t) > 0
    unit = 2 * charge * 10e3 * F
    for stage in range(3):
        first = out[120000:, stage][on].mean()
        second = out[120000:, 3 + stage][~on].mean()
        assert first == pytest.approx((stage + 1) * unit, rel=0.01)
        assert second == pytest.approx((stage + 1) * unit * (1 - mismatch), rel=0.01)
    assert (out[120000:, 2] - out[120000:, 5]).mean() == pytest.approx(3 * mismatch * unit, rel=0.02)


def test_leakage_is_a_charge_at_each_edge():
    """A leak that raises the held capacitors steadily, by matrix exponentials of both halves, against the impulse."""
    leak_a, c_f = 1e-9, 159e-9
    half_s, chain = 0.5 / F, (np.diag([-1.0] * 3) + np.diag([1.0] * 2, -1)) / RC
    on, off = np.zeros((7, 7)), np.zeros((7, 7))  # three volts, their integrals, one
    on[:3, :3], off[:3, 6] = chain, leak_a / c_f
    on[3:6, :3] = off[3:6, :3] = np.eye(3)
    on, off = expm(on * half_s), expm(off * half_s)
    turn = off @ on
    start = np.append(np.linalg.solve(np.eye(3) - turn[:3, :3], turn[:3, 6]), [0.0, 0.0, 0.0, 1.0])
    mean_v = (turn @ start)[5] / (2 * half_s)
    jump_v = sid.injection_volts(0.0, 0.0, c_f, leak_a * half_s)
    assert jump_v[3:] == (0.0, 0.0, 0.0)
    # three stages of 2 R C f jumps, and a quarter of one above: what `loop_parameters` takes for both
    assert mean_v == pytest.approx(jump_v[0] * (6 * RC * F + 0.25), rel=0.005)


def test_four_demodulators_are_independent():
    caps = sid.reset()
    caps[:] = 0.5
    before = caps.copy()
    sid.step_edgeless_tick(PARAMS, caps, 1, 1, 0.0, 1e-4, 1e-8, 1e-12)
    sid.edge(PARAMS, caps, 3, 0, 0.4e-6, 0.0, 1e-4, 1e-8, 1e-12, 0.2, 0.0, 0.2, 0.0)
    assert (caps[[0, 2]] == before[[0, 2]]).all()
    assert (caps[1, 3:] == before[1, 3:]).all()
    assert (caps[1, :3] != before[1, :3]).any()
    assert sid.output(caps, 1) == caps[1, 2] - caps[1, 5]


def test_impossible_demodulators_are_refused():
    with pytest.raises(ValueError, match="rc_s"):
        sid.design(100e-6, H)
    with pytest.raises(ValueError, match="inject_v"):
        sid.design(RC, H, (0.0,) * 5)


def test_chord_between_tick_ends_is_good_enough_for_the_converter():
    """The converter takes the chord of a tick: h^2/8 |w3''| off, and w3'' is the ripple of w1, A/(w RC), over RC^2."""
    amplitude, ticks = 2.88, 400
    bound = H**2 / 8 * amplitude / (2 * math.pi * F * RC) / RC**2
    worst = 0.0
    for angle in (0.0, math.pi / 2):
        tones = Tones((F, amplitude, angle))
        # settled capacitors from 0.15 s of the same signal; start a period boundary
        seconds = round(0.15 * F) / F
        edges = square(F, seconds + 3e-3)
        out, _ = run(tones, edges, round(seconds / H) + 1)
        begin = len(out) * H
        caps, ref = out[-1], 1 if math.sin(2 * math.pi * F * begin) > 0 else 0
        later = edges[edges > begin] - begin
        shifted = Tones((F, amplitude, angle + 2 * math.pi * F * begin))
        before = caps[2] - caps[5]
        for k in range(ticks):
            inside = [e for e in later if k * H <= e < (k + 1) * H]
            moved = Tones(*[(f, a, p + 2 * math.pi * f * k * H) for f, a, p in shifted.tones])
            part = [e - k * H for e in inside]
            middle, _ = event_driven(moved, caps, ref, [e for e in part if e < H / 2], np.zeros(6), H / 2)
            caps, ref = event_driven(moved, caps, ref, part, np.zeros(6), H)
            after = caps[2] - caps[5]
            worst = max(worst, abs(middle[2] - middle[5] - (before + after) / 2))
            before = after
    assert bound / 2 < worst < bound
    assert bound == pytest.approx(1.3e-9, rel=0.01)

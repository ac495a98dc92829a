"""The diode ring beyond small signals: half a carrier period integrated, and what follows from it.

    node    C v' = sum of diode currents + motion     A, B: C0 +- dC + stray   C, D: Cref   i = Is (e^(v/nVT) - 1)
            each junction adds its C(v) between its ends; the moving plates' own motion carries dC' (E/2 - v)
    half    from just before an edge of the carrier to just before the next; then (A B C D) -> -(A B D C), because the
            other half is this one with signs changed and C, D exchanged. A steady ring is a fixed point of it
    mean    v(t) = V(dC) - L(dC) dC'        of C - D over half a period, to first order in dC': V odd, L even
    sine    dC = a sin(w t):  gain = 2 <V sin>/a,  delay = 2 <L cos^2>/gain,  third harmonic = 2 <V sin(3 w t)>

The edge is so short that D1 and D3 pass any charge. Behind it they stand at the drop that their tail has START of the
half period later; A with C, and B with D, keep their charge. The tail goes as ln t: steps have equal ratios of t.
Bits      + - * / sqrt and an exponential of our own: every machine has the same
Check     a transient ngspice run of the circuit: gain, delay and third harmonic of sines
Accuracy  1 % of the gain, 2 ns of delay, 10 % of the third harmonic, from -20 to 50 degC to 0.75 pF. At 25 degC and
          0.5 pF, the default's full amplitude, the fundamental loses 12.7 %
Source    analog_frontend/parts/ring_diode.py, docs/plant.md
"""

import functools
import math
from typing import NamedTuple

import mpmath
import numpy as np

from analog_frontend.numeric import small_algebra
from analog_frontend.numeric.exact import MP
from analog_frontend.parts import ring_diode
from fpga_model.jit import inlined, kernel

START = 2.0**-16  # of a half period: what is shorter has no part in the charge
STEPS = 48.0  # least; STIFF for each n VT by which dC would move the smaller plate, or the steps are unstable
STIFF = 2.2
KNEE = 0.5  # of the built-in voltage: beyond, the junction's capacitance is a straight line, as SPICE has it
QUARTER = 16  # points of a quarter wave
RANGE = 0.5  # of a curve, in C0
MOST_ROUNDS, PATIENCE, SETTLE = 100, 20, 200  # of Newton; until the circuit is left to settle, so many half periods
SETTLED_V = 1e-10
STEP_V = 1e-5  # for derivatives by the nodes
STEP_F = 1e-15  # and by dC
STEP_F_PER_S = 1e-8  # and by its slope


class Circuit(NamedTuple):
    """A ring at one temperature as the integration takes it."""

    carrier_v: float
    c0_f: float
    stray_f: float
    cref_f: float
    is_a: float
    nvt_v: float
    cj0_f: float
    vj_v: float
    m: float
    knee_v: float
    knee_c: float  # charge, capacitance and its slope at the knee
    knee_f: float
    knee_f_per_v: float
    half_s: float
    start_v: float  # drop of a conducting diode START of a half period behind the edge
    log_span: float  # from there to the next edge
    steps: float  # least


class Steady(NamedTuple):
    """A ring at rest, or in slow motion."""

    nodes_v: tuple  # A, B, C, D just before a rising edge
    volts: float
    volts_per_f: float
    slope_v_s_per_f: float  # L: what a slope of dC takes off the mean output, per F/s


class Curve(NamedTuple):
    """A ring from dC = 0 to RANGE C0 in equal steps."""

    step_f: float
    volts: np.ndarray
    volts_per_f: np.ndarray
    slope_v_s_per_f: np.ndarray


class Large(NamedTuple):
    """What a sine of dC gives at the output."""

    gain_v_per_f: float  # fundamental over amplitude
    loss: float  # of the gain, against a small signal
    delay_s: float  # of the fundamental
    third: float  # third harmonic over fundamental, in the sense of sin(3 w t)
    demodulated_v_per_f: float  # gain that a square-wave demodulator sees: mean magnitude over that of the sine


def circuit(carrier_v, carrier_hz, c0_f, cp_f, cref_f, diode, temp_degc, temp_ref_degc=25.0):
    """`Circuit` of a ring; arguments and ValueError as `ring_diode.diode_ring`."""
    stray_f = ring_diode.diode_ring(carrier_v, carrier_hz, c0_f, cp_f, cref_f, diode, temp_degc, temp_ref_degc).stray_f
    with mpmath.workprec(ring_diode.PRECISION):
        vj, m, cj0 = ring_diode.built_in_v(diode, temp_degc), mpmath.mpf(diode.m), mpmath.mpf(diode.cj0_f)
        is_a, nvt = ring_diode.saturation_current_a(diode, temp_degc), ring_diode.n_vt_v(diode, temp_degc)
        half, knee = 1 / (2 * mpmath.mpf(carrier_hz)), 1 - mpmath.mpf(KNEE)
        start_v = nvt * mpmath.log(nvt * (mpmath.mpf(c0_f) + mpmath.mpf(stray_f)) / (is_a * START * half))
        numbers = (
            carrier_v, c0_f, stray_f, cref_f, is_a, nvt, cj0, vj, m, KNEE * vj,
            cj0 * vj / (1 - m) * (1 - knee ** (1 - m)), cj0 * knee**-m, cj0 * knee**-m * m / (vj * knee),
            half, start_v, -mpmath.log(START), STEPS,
        )  # fmt: skip
        return Circuit(*map(float, numbers))


@inlined
def exponential(x):
    """e^x to 1e-15; halves and doubles as long as x is far from 0."""
    n = np.floor(x * 1.4426950408889634 + 0.5)
    r = (x - n * 0.6931471803691238) - n * 1.9082149292705877e-10
    e = 1.0 + r * (1.0 / 13)
    for k in range(12, 0, -1):
        e = 1.0 + r * e * RECIPROCALS[k]
    factor = 2.0 if n > 0.0 else 0.5
    binary_exponent = int(abs(n))
    while binary_exponent > 0:
        if binary_exponent & 1:
            e = e * factor
        factor = factor * factor
        binary_exponent >>= 1
    return e


RECIPROCALS = tuple(1.0 / max(k, 1) for k in range(13))


@inlined
def junction(p, v):
    """Capacitance and charge of a junction at a voltage."""
    if v < p.knee_v:
        w = 1.0 - v / p.vj_v
        root = math.sqrt(math.sqrt(w))
        y = (root - 1.0) / (root + 1.0)
        q = y * y
        # ln w by four times the series of its fourth root
        s = 1.0 / 9 + q * (1.0 / 11 + q * (1.0 / 13))
        power = exponential(-8.0 * p.m * y * (1.0 + q * (1.0 / 3 + q * (0.2 + q * (1.0 / 7 + q * s)))))
        return p.cj0_f * power, p.cj0_f * p.vj_v / (1.0 - p.m) * (1.0 - w * power)
    excess_v = v - p.knee_v
    return p.knee_f + p.knee_f_per_v * excess_v, p.knee_c + (p.knee_f + 0.5 * p.knee_f_per_v * excess_v) * excess_v


@inlined
def slopes(p, a, b, c, d, plus_f, minus_f, dc_f_per_s):
    """dv/dt of the nodes A, B, C, D behind a rising edge; plus_f, minus_f: all of A and B but the junctions."""
    c1, _ = junction(p, a - c)
    c2, _ = junction(p, c - b)
    c3, _ = junction(p, b - d)
    c4, _ = junction(p, d - a)
    i1 = p.is_a * (exponential((a - c) / p.nvt_v) - 1.0)
    i2 = p.is_a * (exponential((c - b) / p.nvt_v) - 1.0)
    i3 = p.is_a * (exponential((b - d) / p.nvt_v) - 1.0)
    i4 = p.is_a * (exponential((d - a) / p.nvt_v) - 1.0)
    at_a = i4 - i1 - dc_f_per_s * (a - 0.5 * p.carrier_v)
    at_b = i2 - i3 + dc_f_per_s * (b - 0.5 * p.carrier_v)
    at_c, at_d = i1 - i2, i3 - i4
    # C and D are eliminated: they are joined to A and B only
    cap_c, cap_d = p.cref_f + c1 + c2, p.cref_f + c3 + c4
    cap_a = plus_f + c1 + c4 - c1 * c1 / cap_c - c4 * c4 / cap_d
    cap_b = minus_f + c2 + c3 - c2 * c2 / cap_c - c3 * c3 / cap_d
    shared = c1 * c2 / cap_c + c3 * c4 / cap_d
    at_a = at_a + c1 * at_c / cap_c + c4 * at_d / cap_d
    at_b = at_b + c2 * at_c / cap_c + c3 * at_d / cap_d
    det = cap_a * cap_b - shared * shared
    da, db = (at_a * cap_b + at_b * shared) / det, (at_b * cap_a + at_a * shared) / det
    return da, db, (at_c + c1 * da + c2 * db) / cap_c, (at_d + c3 * db + c4 * da) / cap_d


@inlined
def nodes_after_edge(p, a, b, c, d, dc_f):
    """C and D behind a rising edge from the nodes before it: A with C, and B with D, keep their charge."""
    plus_f, minus_f = p.c0_f + dc_f + p.stray_f, p.c0_f - dc_f + p.stray_f
    _, q2 = junction(p, c - b)
    _, q4 = junction(p, d - a)
    with_c = plus_f * a + (p.c0_f + dc_f) * p.carrier_v + p.cref_f * c + q2 - q4
    with_d = minus_f * b + (p.c0_f - dc_f) * p.carrier_v + p.cref_f * d + q4 - q2
    for _ in range(6):
        a, b = c + p.start_v, d + p.start_v
        c2, q2 = junction(p, c - b)
        c4, q4 = junction(p, d - a)
        error_c = plus_f * a + p.cref_f * c + q2 - q4 - with_c
        error_d = minus_f * b + p.cref_f * d + q4 - q2 - with_d
        bridge = c2 + c4
        cap_c, cap_d = plus_f + p.cref_f + bridge, minus_f + p.cref_f + bridge
        det = cap_c * cap_d - bridge * bridge
        c, d = c - (error_c * cap_d + error_d * bridge) / det, d - (error_d * cap_c + error_c * bridge) / det
    # an edge that opens C -> B or D -> A joins all four nodes
    joined_f, step_v = plus_f + minus_f + 2.0 * p.cref_f, 2.0 * p.start_v
    if c - d > step_v:
        c = (with_c + with_d + (p.cref_f - dc_f) * step_v) / joined_f
        return c, c - step_v
    if d - c > step_v:
        d = (with_c + with_d + (p.cref_f + dc_f) * step_v) / joined_f
        return d - step_v, d
    return c, d


@kernel
def half_period(p, nodes_v, dc_f, dc_f_per_s, out):
    """Half a period from `nodes_v`, dC = dc_f + dc_f_per_s t: out[:4] the nodes behind it, out[4] the mean of C - D."""
    c, d = nodes_after_edge(p, nodes_v[0], nodes_v[1], nodes_v[2], nodes_v[3], dc_f)
    a, b, t = c + p.start_v, d + p.start_v, START * p.half_s
    plus_f, minus_f = p.c0_f + p.stray_f + dc_f, p.c0_f + p.stray_f - dc_f
    area = (c - d) * t
    output_swing_v = abs(dc_f) * p.carrier_v / (p.c0_f + p.stray_f - abs(dc_f))
    steps = int(max(p.steps, STIFF * output_swing_v / p.nvt_v))
    log_step = p.log_span / steps
    ratio = exponential(0.5 * log_step)
    for _ in range(steps):
        # Runge and Kutta's step of fourth order in ln t
        middle = t * ratio
        end = middle * ratio
        h, dc_change_f = log_step * t, dc_f_per_s * t
        a1, b1, c1, d1 = slopes(p, a, b, c, d, plus_f + dc_change_f, minus_f - dc_change_f, dc_f_per_s)
        a1, b1, c1, d1 = h * a1, h * b1, h * c1, h * d1
        s1 = h * (c - d)
        h, dc_change_f = log_step * middle, dc_f_per_s * middle
        an, bn, cn, dn = a + 0.5 * a1, b + 0.5 * b1, c + 0.5 * c1, d + 0.5 * d1
        a2, b2, c2, d2 = slopes(p, an, bn, cn, dn, plus_f + dc_change_f, minus_f - dc_change_f, dc_f_per_s)
        a2, b2, c2, d2 = h * a2, h * b2, h * c2, h * d2
        s2 = h * (cn - dn)
        an, bn, cn, dn = a + 0.5 * a2, b + 0.5 * b2, c + 0.5 * c2, d + 0.5 * d2
        a3, b3, c3, d3 = slopes(p, an, bn, cn, dn, plus_f + dc_change_f, minus_f - dc_change_f, dc_f_per_s)
        a3, b3, c3, d3 = h * a3, h * b3, h * c3, h * d3
        s3 = h * (cn - dn)
        h, dc_change_f = log_step * end, dc_f_per_s * end
        an, bn, cn, dn = a + a3, b + b3, c + c3, d + d3
        a4, b4, c4, d4 = slopes(p, an, bn, cn, dn, plus_f + dc_change_f, minus_f - dc_change_f, dc_f_per_s)
        s4 = h * (cn - dn)
        a = a + (a1 + 2.0 * (a2 + a3) + h * a4) * (1.0 / 6)
        b = b + (b1 + 2.0 * (b2 + b3) + h * b4) * (1.0 / 6)
        c = c + (c1 + 2.0 * (c2 + c3) + h * c4) * (1.0 / 6)
        d = d + (d1 + 2.0 * (d2 + d3) + h * d4) * (1.0 / 6)
        area = area + (s1 + 2.0 * (s2 + s3) + s4) * (1.0 / 6)
        t = end
    out[0], out[1], out[2], out[3], out[4] = -a, -b, -d, -c, area / p.half_s


def _after(p, nodes_v, dc_f, dc_f_per_s=0.0):
    """`half_period` as a list of five numbers."""
    out = np.empty(5)
    half_period(p, np.array(nodes_v), float(dc_f), float(dc_f_per_s), out)
    return out.tolist()


def _per(before, after, step):
    """Central difference of two lists, as a column."""
    return [[(y - x) / (2 * step)] for x, y in zip(before, after)]


def _settle_nodes(p, nodes_v, dc_f):
    """Nodes after SETTLE half periods; the mean of two of them, because what is common to all nodes only turns over."""
    for _ in range(SETTLE):
        nodes_v = [(v + w) / 2 for v, w in zip(nodes_v, _after(p, nodes_v, dc_f))]
    return nodes_v


def steady_state(p, dc_f, nodes_v=(-0.15, -0.15, -0.05, -0.05)):
    """`Steady` at dC, from the nodes of a neighbour. ValueError if there is none to be found."""
    nodes_v = list(nodes_v)
    for n in range(MOST_ROUNDS):
        if n % PATIENCE == PATIENCE - 1:
            nodes_v = _settle_nodes(p, nodes_v, dc_f)
        after = _after(p, nodes_v, dc_f)
        columns = []
        for k in range(4):
            sides = [nodes_v[:k] + [nodes_v[k] + s] + nodes_v[k + 1 :] for s in (-STEP_V, STEP_V)]
            columns.append(_per(*(_after(p, side, dc_f) for side in sides), STEP_V))
        by_node = [[column[i][0] for column in columns] for i in range(5)]
        residual_jacobian = [[float(i == k) - by_node[i][k] for k in range(4)] for i in range(4)]
        move = [
            row[0] for row in small_algebra.solve_linear(residual_jacobian, [[after[i] - nodes_v[i]] for i in range(4)])
        ]
        if not all(map(math.isfinite, move)):
            break
        # a longer step would overshoot the diodes' exponentials
        largest = max(map(abs, move))
        part = min(1.0, p.nvt_v / largest) if largest else 1.0
        nodes_v = [v + part * m for v, m in zip(nodes_v, move)]
        if largest < SETTLED_V:
            return _linearize_fixed_point(p, dc_f, nodes_v, by_node, residual_jacobian)
    raise ValueError(f"ring_cycle dc_f: the ring reaches no steady state at {dc_f:g} F")


def _linearize_fixed_point(p, dc_f, nodes_v, by_node, residual_jacobian):
    """`Steady` from a fixed point, the derivatives there and 1 less those."""
    h = p.half_s
    by_dc = _per(*(_after(p, nodes_v, dc_f + s) for s in (-STEP_F, STEP_F)), STEP_F)
    by_slope = _per(*(_after(p, nodes_v, dc_f, s) for s in (-STEP_F_PER_S, STEP_F_PER_S)), STEP_F_PER_S)

    def output(nodes, direct):
        return sum(j * row[0] for j, row in zip(by_node[4], nodes)) + direct[4][0]

    nodes_v_per_f = small_algebra.solve_linear(residual_jacobian, by_dc[:4])
    volts_per_f = output(nodes_v_per_f, by_dc)
    # S(dC + s h) + s L = half(S + s L, dC, s): what is behind the motion, and the mean counts from the middle
    lag = small_algebra.solve_linear(residual_jacobian, [[y[0] - h * x[0]] for x, y in zip(nodes_v_per_f, by_slope)])
    slope_v_s_per_f = volts_per_f * h / 2 - output(lag, by_slope)
    return Steady(tuple(nodes_v), _after(p, nodes_v, dc_f)[4], volts_per_f, slope_v_s_per_f)


@functools.lru_cache(maxsize=1024)
def curve(p, intervals):
    """`Curve` of a `Circuit`, arrays of `intervals` + 1."""
    step_f, rows = RANGE * p.c0_f / intervals, [steady_state(p, 0.0)]
    for k in range(1, intervals + 1):
        rows.append(steady_state(p, k * step_f, rows[-1].nodes_v))
    return Curve(step_f, *(np.array(column) for column in list(zip(*rows))[1:]))


@functools.cache
def _odd_harmonic_sines():
    """sin((2 k + 1) theta) of as many odd harmonics as there are points in a quarter wave; a row for each point."""
    angles = [(n + MP.mpf(0.5)) * MP.pi / (2 * QUARTER) for n in range(QUARTER)]
    return [[small_algebra.unit((2 * k + 1) * angle).imag for k in range(QUARTER)] for angle in angles]


@functools.lru_cache(maxsize=4096)
def large(p, dc_f):
    """`Large` of a `Circuit` whose dC is a sine of amplitude `dc_f`. ValueError: it is not between 0 and C0."""
    if not 0.0 < dc_f < p.c0_f:
        raise ValueError(f"ring_cycle dc_f: {dc_f} F is not between 0 and c0_f = {p.c0_f} F")
    small = steady_state(p, 0.0)
    nodes, rows, waves = small.nodes_v, [], _odd_harmonic_sines()
    for wave in waves:
        rows.append(steady_state(p, dc_f * wave[0], nodes))
        nodes = rows[-1].nodes_v
    harmonics = [2 / QUARTER * sum(row[k] * at.volts for row, at in zip(waves, rows)) for k in range(len(waves[0]))]
    gain = harmonics[0] / dc_f
    return Large(
        gain_v_per_f=gain,
        loss=1.0 - gain / small.volts_per_f,
        delay_s=2 / QUARTER * sum((1.0 - row[0] ** 2) * at.slope_v_s_per_f for row, at in zip(waves, rows)) / gain,
        third=harmonics[1] / harmonics[0],
        demodulated_v_per_f=sum(v / (2 * k + 1) for k, v in enumerate(harmonics)) / dc_f,
    )

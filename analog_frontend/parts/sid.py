"""Synchronous integral demodulator: three switched RC stages, buffered, two groups of capacitors that take turns.

    ON group    w1' = (v - w1)/RC    w2' = (w1 - w2)/RC    w3' = (w2 - w3)/RC          OFF group: held
    output      V(C5) - V(C6)        C1 C3 C5 (ref = 1) are columns 0..2, C2 C4 C6 (ref = 0) columns 3..5

    v + n --R--o/ --C1|C2--buffer--R--o/ --C3|C4--buffer--R--o/ --C5|C6--(difference)--> ADC
               S1                     S2                      S3          all three switches on one reference

One plant tick of length h, r = h/RC:  w <- E w + P + n S  for the ON group, E = exp(A h), S the step response over h,
P the response to v(t) over the whole tick (from the propagator), n a voltage held over the tick (noise, effects).
A reference edge at s = tau/h splits P: the group that leaves gets q(s), the other P - E(1-s) q(s). q is exact for the
cubic Hermite polynomial through v and v' at both ends of the tick: polynomials times exponentials, as series in r.

Error     |dq1| <= r (2 pi f h)^4/720 per volt, 2.0e-11 at 11 kHz and 50 Hz; the groups err oppositely: the output by
          less than 8 h f (2 pi f h)^4/720 = 2.8e-9 per volt of quadrature, by nothing in phase. v smooth over a tick
Series    four terms: q to (r s)^4/56 relative, 3e-15 at 50 Hz and 5e-12 at the limit r <= 0.004
State     `reset()`: float64 array (4 demodulators, 6 capacitors), mutated in place
Charge    a switch that opens leaves `inject` volts on its capacitor: on-time mean raised by 2 Q R f per stage, C1 once,
          C3 twice, C5 three times. `inject_v` takes six voltages
Behaviour gain 4/pi in phase, 0 in quadrature; odd harmonics n by 1/n, even ones 0; input offset cancels
Duty      plant.sid_fall_s: delay of a falling edge less that of a rising one. The mean edge moves by half of it: xe2'
          and ye2' fall by 0.002 deg per ns. Even harmonics no longer cancel. The averaged plant refuses it
Limits    equal, buffered stages; r <= 0.004, a corner below 318 Hz at 1 us
Source    docs/plant.md, docs/decisions/0004-six-capacitor-sid.md
"""

import functools
from typing import NamedTuple

import mpmath
import numpy as np

from analog_frontend.numeric.vector import four, lane, load4, pair, splat4, store4
from fpga_model.jit import inlined, kernel

DEMODULATORS = 4  # drive sin, drive cos, sense sin, sense cos: the order of the packed references
CAPACITORS = 6
STAGES = 3
TERMS = 4
R_LIMIT = 0.004  # RC of 250 ticks, 318 Hz
MAX_EDGES = 8


class Params(NamedTuple):
    """Constants of one demodulator for one tick length; voltages in V, times in s."""

    h_s: float
    r: float
    e1: float  # exp(-r), and the two lower diagonals of E
    e2: float
    e3: float
    s1: float  # step response over a whole tick
    s2: float
    s3: float
    inject: np.ndarray  # (6,) volts left on each capacitor when its switch opens
    taylor: np.ndarray  # coefficient of s^(k+j+i) in q_j for the input (t/h)^k, j = 1..3: at 4 (k TERMS + i) + j - 1


@functools.lru_cache(maxsize=256)
def design(rc_s, h_s, inject_v=(0.0,) * CAPACITORS):
    """Constants of a demodulator with equal stages of `rc_s` for ticks of `h_s`.

    inject_v  volts left on C1 C3 C5 C2 C4 C6 when the switch opens; see `injection_volts`
    """
    if not (rc_s > 0.0 and h_s > 0.0 and h_s / rc_s <= R_LIMIT):
        raise ValueError(f"sid rc_s: {rc_s} s is below {h_s / R_LIMIT:g} s, the minimum for ticks of {h_s} s")
    if len(inject_v) != CAPACITORS or not all(abs(v) < 1.0 for v in inject_v):
        raise ValueError(f"sid inject_v: {inject_v} is not six voltages between -1 and 1 V")
    with mpmath.workprec(120):
        r = mpmath.mpf(h_s) / mpmath.mpf(rc_s)
        e = mpmath.exp(-r)
        # j goes along the lanes of one register, of which the fourth is empty
        taylor = [
            float(_coefficient(r, j, k, i)) if j <= STAGES else 0.0
            for k in range(4)
            for i in range(TERMS)
            for j in range(1, 5)
        ]
        return Params(
            h_s=float(h_s),
            r=float(r),
            e1=float(e),
            e2=float(e * r),
            e3=float(e * r * r / 2),
            s1=float(1 - e),
            s2=float(1 - e * (1 + r)),
            s3=float(1 - e * (1 + r + r * r / 2)),
            inject=np.array(inject_v, dtype=np.float64),
            taylor=np.array(taylor),
        )


def _coefficient(r, j, k, i):
    """Of s^(k+j+i) in q_j: the kernel u^(j-1) e^-u/(j-1)! expanded in u = r (s - x), against x^k over 0 .. s."""
    m = j - 1 + i
    beta = mpmath.factorial(m) * mpmath.factorial(k) / mpmath.factorial(m + k + 1)
    return (-1) ** i * r ** (j + i) * beta / (mpmath.factorial(j - 1) * mpmath.factorial(i))


def injection_volts(charge_c, mismatch, c_f, leaked_c=0.0):
    """Six voltages of `inject_v` for a charge (C) per switch on `c_f` (F); the ref = 0 half gets 1 - mismatch of it.

    leaked_c  charge that leaks onto the other half while it is held for half a turn; the difference of both halves
    """
    first = charge_c / c_f
    return (first + leaked_c / c_f,) * STAGES + (first * (1.0 - mismatch),) * STAGES


def device_injection_volts(warm):
    """`injection_volts` of a device at its temperature: charge of a switch, leakage over half a turn of f_x."""
    leaked_c = warm.sid_leakage_a / (2.0 * warm.fx_hz)
    return injection_volts(warm.sid_charge_c, warm.sid_charge_mismatch, warm.sid_c_f, leaked_c)


def corner_hz(rc_s):
    """Corner of each of the three poles of the output: every path works half the time, 1/(4 pi RC)."""
    with mpmath.workprec(80):
        return float(1 / (4 * mpmath.pi * mpmath.mpf(rc_s)))


def reset():
    """Empty capacitors."""
    return np.zeros((DEMODULATORS, CAPACITORS))


@inlined
def output(caps, d):
    """V(C5) - V(C6) of demodulator `d`."""
    return caps[d, 2] - caps[d, 5]


@inlined
def step_edgeless_tick(p, caps, d, ref, n, p1, p2, p3):
    """One tick of demodulator `d` without an edge: the group of `ref` follows, the other holds. Mutates `caps`."""
    g = 0 if ref else STAGES
    w1 = caps[d, g]
    w2 = caps[d, g + 1]
    w3 = caps[d, g + 2]
    caps[d, g] = p.e1 * w1 + (p1 + n * p.s1)
    caps[d, g + 1] = p.e1 * w2 + (p.e2 * w1 + (p2 + n * p.s2))
    caps[d, g + 2] = p.e1 * w3 + (p.e2 * w2 + (p.e3 * w1 + (p3 + n * p.s3)))


@inlined
def step_edgeless_ticks(p, caps, refs, w, feed, stride, t0, t1, out):
    """Ticks t0 .. t1 - 1 of all four without an edge: the bits of `step_edgeless_tick`. Mutates `caps` and `out`.

    refs  (4,) references
    w     row feed + k holds p_k + n s_k of the drive channel, feed + 3 + k that of the sense channel
    out   output of demodulator d after tick t at 4 (t + 1) + d
    """
    g0, g1 = 0 if refs[0] else STAGES, 0 if refs[1] else STAGES
    g2, g3 = 0 if refs[2] else STAGES, 0 if refs[3] else STAGES
    w1 = four(caps[0, g0], caps[1, g1], caps[2, g2], caps[3, g3])
    w2 = four(caps[0, g0 + 1], caps[1, g1 + 1], caps[2, g2 + 1], caps[3, g3 + 1])
    w3 = four(caps[0, g0 + 2], caps[1, g1 + 2], caps[2, g2 + 2], caps[3, g3 + 2])
    open_group_v = four(caps[0, 5 - g0], caps[1, 5 - g1], caps[2, 5 - g2], caps[3, 5 - g3])
    sign = four(1.0 if refs[0] else -1.0, 1.0 if refs[1] else -1.0, 1.0 if refs[2] else -1.0, 1.0 if refs[3] else -1.0)
    e1, e2, e3 = splat4(p.e1), splat4(p.e2), splat4(p.e3)
    for t in range(t0, t1):
        f1 = pair(w[feed * stride + t], w[(feed + 3) * stride + t])
        f2 = pair(w[(feed + 1) * stride + t], w[(feed + 4) * stride + t])
        f3 = pair(w[(feed + 2) * stride + t], w[(feed + 5) * stride + t])
        w3 = e1 * w3 + (e2 * w2 + (e3 * w1 + f3))
        w2 = e1 * w2 + (e2 * w1 + f2)
        w1 = e1 * w1 + f1
        store4(out, 4 * (t + 1), sign * (w3 - open_group_v))
    for k in range(DEMODULATORS):
        g = 0 if refs[k] else STAGES
        caps[k, g] = lane(w1, k)
        caps[k, g + 1] = lane(w2, k)
        caps[k, g + 2] = lane(w3, k)


@inlined
def _decay_series(u):
    """exp(-u) for 0 <= u <= R_LIMIT: seven terms of the series, 1e-20."""
    return 1.0 - u * (
        1.0 - u * (1.0 / 2) * (1.0 - u * (1.0 / 3) * (1.0 - u * 0.25 * (1.0 - u * 0.2 * (1.0 - u * (1.0 / 6)))))
    )


@inlined
def _step_responses(u, e):
    """Step responses of the three stages after u = t/RC, without cancellation: e^-u u^j/j! (1 + u/(j+1) + ...)."""
    s1 = e * u * (1.0 + u * 0.5 * (1.0 + u * (1.0 / 3) * (1.0 + u * 0.25 * (1.0 + u * 0.2 * (1.0 + u * (1.0 / 6))))))
    s2 = e * u * u * 0.5 * (1.0 + u * (1.0 / 3) * (1.0 + u * 0.25 * (1.0 + u * 0.2 * (1.0 + u * (1.0 / 6)))))
    s3 = e * u * u * u * (1.0 / 6) * (1.0 + u * 0.25 * (1.0 + u * 0.2 * (1.0 + u * (1.0 / 6) * (1.0 + u * (1.0 / 7)))))
    return s1, s2, s3


@inlined
def response(p, v0, dv0, v1, dv1, s):
    """q(s): the three stages from zero, driven over 0 .. s ticks by the cubic through v (V), v' (V/s) at both ends.

    The three sums stand side by side in the lanes of one register.
    """
    a = dv0 * p.h_s
    b = dv1 * p.h_s
    rise = v1 - v0
    c2 = 3.0 * rise - 2.0 * a - b
    c3 = a + b - 2.0 * rise
    total = splat4(0.0)
    for i in range(TERMS - 1, -1, -1):
        inner = load4(p.taylor, 4 * (2 * TERMS + i)) * c2 + s * (load4(p.taylor, 4 * (3 * TERMS + i)) * c3)
        inner = load4(p.taylor, 4 * (TERMS + i)) * a + s * inner
        total = total * s + (load4(p.taylor, 4 * i) * v0 + s * inner)
    q = total * four(s, s * s, s * s * s, 0.0)
    return lane(q, 0), lane(q, 1), lane(q, 2)


@inlined
def factors(u):
    """Of a piece of u = dt/RC: the three decays, and the three responses to a constant. u may have several lanes."""
    e = _decay_series(u)
    s1, s2, s3 = _step_responses(u, e)
    return e, e * u, e * u * u * 0.5, s1, s2, s3


@inlined
def _advance_segment(caps, d, ref, n, piece, start, end):
    """The group of `ref` over a piece with these `factors`, from response `start` to `end`; mutates `caps`."""
    g = 0 if ref else STAGES
    e, e2, e3, s1, s2, s3 = piece
    w1 = caps[d, g] - start[0]
    w2 = caps[d, g + 1] - start[1]
    w3 = caps[d, g + 2] - start[2]
    caps[d, g] = e * w1 + (end[0] + n * s1)
    caps[d, g + 1] = e * w2 + (e2 * w1 + (end[1] + n * s2))
    caps[d, g + 2] = e * w3 + (e2 * w2 + (e3 * w1 + (end[2] + n * s3)))


@inlined
def _lanes(v, k):
    """Lane `k` of six registers."""
    return lane(v[0], k), lane(v[1], k), lane(v[2], k), lane(v[3], k), lane(v[4], k), lane(v[5], k)


@inlined
def _inject_switch_charge(p, caps, d, ref):
    """The switches of the group of `ref` open; mutates `caps`."""
    g = 0 if ref else STAGES
    for k in range(g, g + STAGES):
        caps[d, k] = caps[d, k] + p.inject[k]


@inlined
def edge(p, caps, d, ref, tau_s, n, p1, p2, p3, v0, dv0, v1, dv1):
    """One tick of demodulator `d` whose reference changes to `ref` at `tau_s` (0 <= tau_s < h). Mutates `caps`."""
    s = tau_s / p.h_s
    q = response(p, v0, dv0, v1, dv1, s)
    # both pieces at once, in the first two lanes
    pieces = factors(four(p.r * s, p.r * (1.0 - s), 0.0, 0.0))
    old = 0 if ref else 1
    _advance_segment(caps, d, old, n, _lanes(pieces, 0), (0.0, 0.0, 0.0), q)
    _inject_switch_charge(p, caps, d, old)
    _advance_segment(caps, d, ref, n, _lanes(pieces, 1), q, (p1, p2, p3))


@kernel
def edges(p, caps, d, ref, taus_s, count, n, p1, p2, p3, v0, dv0, v1, dv1):
    """One tick that starts with reference `ref` and toggles it at taus_s[0 .. count-1], sorted, 0 <= tau < h.

    Returns the reference at the end of the tick. With count = 1 the same bits as `edge`. Mutates `caps`.
    """
    s, q = 0.0, (0.0, 0.0, 0.0)
    for i in range(count):
        t = taus_s[i] / p.h_s
        before, q = q, response(p, v0, dv0, v1, dv1, t)
        _advance_segment(caps, d, ref, n, factors(p.r * (t - s)), before, q)
        _inject_switch_charge(p, caps, d, ref)
        ref = 0 if ref else 1
        s = t
    _advance_segment(caps, d, ref, n, factors(p.r * (1.0 - s)), q, (p1, p2, p3))
    return ref

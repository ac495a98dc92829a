"""Averaged plant, in time: the slow amplitudes of both modes over frames of n ticks.

    retune_tables   to this rate, stiffness and temperature; z is continuous, so that what the slaved parts and the
                    basis do at a jump a must take back: a <- a + 2 e^(-i theta) (T^-1 (z - z of a in the new tables))+
    frame           a' = rotor E (a - conj(e^(2 i theta) s (F_new - F_old))) + J_old F_old + J_new F_new + noise
                    rotor = e^(-i (theta advance - phi0 n)), theta at the instant of the change, where z is continuous
    envelope        V(tau) of both C/V outputs over the frame: the cubic through value and slope at both ends

State       `m`, float64, mutated in place: A (a_x, a_y), F (both DACs, V); complex numbers are pairs (re, im)
Source      docs/plant.md, docs/decisions/0014-baseband.md
"""

import numpy as np

from analog_frontend.averaged.averaged import (
    BACK,
    CROSS,
    DEGREE,
    ETA,
    KQ,
    KXY,
    NEW,
    OLD,
    PICK,
    RATES,
    ROWS,
    SIZE,
    SLAVED,
    TICKS,
    E,
    L,
    S,
)
from analog_frontend.numeric.vector import lane, load4, splat4, store4, turned4
from fpga_model.jit import inlined, inner, outlined

TURN = 1 << 48
RAD_PER_LSB = 6.283185307179586 / TURN
CONJUGATE = np.array((1.0, -1.0, 1.0, -1.0))

# Places in `m`: 2 pairs each
A, F = 0, 4
TWICE = 8  # scratch
M_SIZE = 12
# Places in `now`, behind the interpolated row: matrices at this rate and stiffness, column by column
NOW_E = SIZE
NOW_S = NOW_E + 8
NOW_L = NOW_S + 8
NOW_O = NOW_L + 8  # outputs x, y from a_x, a_y
NOW_D = NOW_O + 8  # outputs x, y from F of both DACs
NOW_OLD = NOW_D + 8  # J of degree 0
NOW_NEW = NOW_OLD + 8
NOW_RATE, NOW_STIFFNESS, NOW_TEMP = range(NOW_NEW + 8, NOW_NEW + 11)
NOW_DIAGONAL = NOW_NEW + 12  # 4: exponentials
NOW_SIZE = NOW_DIAGONAL + 4


@inlined
def times(a, b, c, d):
    """(a + i b)(c + i d)."""
    return a * c - b * d, a * d + b * c


@inlined
def small_turn(x):
    """cos and sin for |x| <= 0.5 rad, to 1e-15 below 0.12 rad and 3e-10 at 0.5."""
    q = x * x
    c = 1.0 - q * (1.0 / 2) * (1.0 - q * (1.0 / 12) * (1.0 - q * (1.0 / 30) * (1.0 - q * (1.0 / 56))))
    s = x * (1.0 - q * (1.0 / 6) * (1.0 - q * (1.0 / 20) * (1.0 - q * (1.0 / 42) * (1.0 - q * (1.0 / 72)))))
    return c, s


@inlined
def unit(phase):
    """cos and sin of a 48-bit phase, to 7e-12: the nearest quarter turn, and the rest within an eighth."""
    quarter = ((phase + (TURN >> 3)) >> 46) & 3
    x = float(((phase + (TURN >> 3)) & ((TURN >> 2) - 1)) - (TURN >> 3)) * RAD_PER_LSB
    q = x * x
    c = 1.0 - q * (1.0 / 2) * (
        1.0
        - q
        * (1.0 / 12)
        * (1.0 - q * (1.0 / 30) * (1.0 - q * (1.0 / 56) * (1.0 - q * (1.0 / 90) * (1.0 - q * (1.0 / 132)))))
    )
    s = x * (
        1.0
        - q
        * (1.0 / 6)
        * (1.0 - q * (1.0 / 20) * (1.0 - q * (1.0 / 42) * (1.0 - q * (1.0 / 72) * (1.0 - q * (1.0 / 110)))))
    )
    # without a branch, which would be wrong three times out of four
    across = (quarter & 1) == 1
    a, b = (s if across else c), (c if across else s)
    return a * float(1 - ((quarter + 1) & 2)), b * float(1 - (quarter & 2))


@inlined
def _exponential(re, im):
    """e^(re + i im) for |re| < 0.1, |im| < 0.9 rad."""
    grow = 1.0
    for k in range(9, 0, -1):
        grow = 1.0 + re * grow / k
    # a quarter of the angle, squared twice
    c, s = small_turn(0.25 * im)
    c, s = times(c, s, c, s)
    c, s = times(c, s, c, s)
    return grow * c, grow * s


@inlined
def product(t, at, ar, ai, br, bi):
    """Matrix at `at` times (a, b): two complex numbers in a register."""
    first, second = load4(t, at), load4(t, at + 4)
    return (first * ar + turned4(first) * ai) + (second * br + turned4(second) * bi)


@inlined
def on(t, at, m, vector_offset):
    """Matrix at `at` times the two complex numbers at `vector_offset` of `m`."""
    return product(t, at, m[vector_offset], m[vector_offset + 1], m[vector_offset + 2], m[vector_offset + 3])


@inlined
def _on_register(t, at, v):
    return product(t, at, lane(v, 0), lane(v, 1), lane(v, 2), lane(v, 3))


@outlined
def _interpolate_knots(knots, lo_degc, step_k, temp_degc, now):
    lower_knot, weight = 0, 0.0
    if knots.shape[0] > 1:
        position = (temp_degc - lo_degc) / step_k
        lower_knot = min(max(int(position), 0), knots.shape[0] - 2)
        weight = position - lower_knot
    after = min(lower_knot + 1, knots.shape[0] - 1)
    for i in range(SIZE):
        now[i] = knots[lower_knot, i] + weight * (knots[after, i] - knots[lower_knot, i])
    for k in range(2):
        re, im = _exponential(now[TICKS] * now[ETA + 2 * k], now[TICKS] * now[ETA + 2 * k + 1])
        now[NOW_DIAGONAL + 2 * k] = re
        now[NOW_DIAGONAL + 2 * k + 1] = im
        at = SLAVED + 4 * k
        store4(now, NOW_D + 4 * k, product(now, PICK + 8, now[at], now[at + 1], now[at + 2], now[at + 3]))


@outlined
def _combine(now, rate, stiffness):
    ok, oo, kk = rate * stiffness, rate * rate, stiffness * stiffness
    for i in range(8):
        small = kk * now[E + 40 + i] + ok * now[E + 32 + i] + oo * now[E + 24 + i]
        now[NOW_E + i] = now[E + i] + (small + (rate * now[E + 8 + i] + stiffness * now[E + 16 + i]))
        now[NOW_S + i] = rate * now[S + i] + stiffness * now[S + 8 + i]
        now[NOW_L + i] = rate * now[L + i] + stiffness * now[L + 8 + i]
    for i in range(16):
        base_index = (OLD if i < 8 else NEW - 8) + i
        now[NOW_OLD + i] = now[base_index] + (rate * now[CROSS + i] + stiffness * now[CROSS + 16 + i])
    for i in range(2):
        # place of the diagonal: the first pair, and the last
        for k in range(2):
            now[NOW_E + 6 * i + k] += now[NOW_DIAGONAL + 2 * i + k] - now[E + 6 * i + k]
            now[NOW_L + 6 * i + k] += now[ETA + 2 * i + k]
    for j in range(2):
        at = NOW_S + 4 * j
        slaved_pickoff = product(now, PICK + 8, now[at], now[at + 1], now[at + 2], now[at + 3])
        store4(now, NOW_O + 4 * j, load4(now, PICK + 4 * j) + slaved_pickoff)


@inlined
def _physical_mode_states(now, m, cos, sin):
    slaved = on(now, NOW_S, m, A) + on(now, SLAVED, m, F)
    total = splat4(0.0)
    for j in range(2):
        r, i = times(m[A + 2 * j], m[A + 2 * j + 1], cos, sin)
        total = total + (load4(now, ROWS + 8 * j) * r - load4(now, ROWS + 8 * j + 4) * i)
    r, i = times(lane(slaved, 0), lane(slaved, 1), cos, sin)
    total = total + (load4(now, ROWS + 16) * r - load4(now, ROWS + 20) * i)
    r, i = times(lane(slaved, 2), lane(slaved, 3), cos, sin)
    return total + (load4(now, ROWS + 24) * r - load4(now, ROWS + 28) * i)


@outlined
def _retune_for_temperature(knots, lo_degc, step_k, now, m, rate_rad_s, volts_squared, temp_degc, cos, sin, z, at):
    """As `retune_tables`, where the temperature moves. Mutates `now` and `m`."""
    _interpolate_knots(knots, lo_degc, step_k, temp_degc, now)
    stiffness = now[KXY] - now[KQ] * volts_squared
    _combine(now, rate_rad_s, stiffness)
    now[NOW_RATE], now[NOW_STIFFNESS], now[NOW_TEMP] = rate_rad_s, stiffness, temp_degc
    off = load4(z, at) - _physical_mode_states(now, m, cos, sin)
    for j in range(2):
        k = BACK + 8 * j
        r = now[k] * lane(off, 0) + now[k + 2] * lane(off, 1) + now[k + 4] * lane(off, 2) + now[k + 6] * lane(off, 3)
        i = (
            now[k + 1] * lane(off, 0)
            + now[k + 3] * lane(off, 1)
            + now[k + 5] * lane(off, 2)
            + now[k + 7] * lane(off, 3)
        )
        r, i = times(r, i, cos, -sin)
        m[A + 2 * j] += 2.0 * r
        m[A + 2 * j + 1] += 2.0 * i


@inner
def retune_tables(knots, lo_degc, step_k, now, m, rate_rad_s, volts_squared, temp_degc, cos, sin, z, at):
    """Tables for a frame; cos, sin of theta and z[at ..], `motion`'s, at its first instant. Mutates `now` and `m`."""
    if now[NOW_TEMP] != temp_degc:
        _retune_for_temperature(knots, lo_degc, step_k, now, m, rate_rad_s, volts_squared, temp_degc, cos, sin, z, at)
        return
    stiffness = now[KXY] - now[KQ] * volts_squared
    if now[NOW_RATE] == rate_rad_s and now[NOW_STIFFNESS] == stiffness:
        return
    before = on(now, NOW_S, m, A)
    _combine(now, rate_rad_s, stiffness)
    now[NOW_RATE] = rate_rad_s
    now[NOW_STIFFNESS] = stiffness
    jump = on(now, NOW_S, m, A) - before
    c, s = times(cos, sin, cos, sin)
    jump = jump * c + turned4(jump) * s
    store4(m, A, load4(m, A) - jump * load4(CONJUGATE, 0))


@inlined
def _growth(now, coefficient_offset, zero, delta, dr, di, sr, si):
    """J F at a distance `delta` from phi0; zero: place of J of degree 0."""
    total = product(now, coefficient_offset + 8 * DEGREE, dr, di, sr, si)
    for k in range(DEGREE - 1, 0, -1):
        total = total * delta + product(now, coefficient_offset + 8 * k, dr, di, sr, si)
    return total * delta + product(now, zero, dr, di, sr, si)


@inner
def frame(now, m, deltas, turn_ticks, force, growth, at, cos, sin, changed, cubic):
    """A frame from its first instant to the next one's, and the cubics of both C/V outputs. Mutates `m` and `cubic`.

    deltas        phase per tick less phi0, before and from `turn_ticks` on (rad)
    force         F of both DACs after their words have changed, four numbers; m holds those before
    growth, at    growth by noise, four numbers; cos, sin of theta at the next frame's first instant
    changed       cos, sin of 2 theta at the change of the drive's word, and of the sense word's
    cubic         (16,) coefficients of tau^0 .. tau^3: x re, x im, y re, y im; tau in frames
    """
    delta_old, delta_new = deltas
    fdr, fdi, fsr, fsi = force
    xr, xi, yr, yi = m[A], m[A + 1], m[A + 2], m[A + 3]
    odr, odi, osr, osi = m[F], m[F + 1], m[F + 2], m[F + 3]
    a = load4(m, A)
    slope = product(now, NOW_L, xr, xi, yr, yi) + product(now, RATES, odr, odi, osr, osi) - turned4(a) * delta_old
    v0 = product(now, NOW_O, xr, xi, yr, yi) + product(now, NOW_D, odr, odi, osr, osi)
    d0 = _on_register(now, NOW_O, slope) * now[TICKS]
    phase_after_turn = delta_new * (now[TICKS] - turn_ticks)
    # a jump of F is one of what follows it; the modes themselves go on
    pr, pi = times(fdr - odr, fdi - odi, changed[0], changed[1])
    qr, qi = times(fsr - osr, fsi - osi, changed[2], changed[3])
    jump = product(now, SLAVED, pr, pi, qr, qi)
    xr, xi, yr, yi = xr - lane(jump, 0), xi + lane(jump, 1), yr - lane(jump, 2), yi + lane(jump, 3)
    c, s = small_turn(phase_after_turn + delta_old * turn_ticks)
    pr, pi = times(xr, xi, c, -s)
    qr, qi = times(yr, yi, c, -s)
    grown = product(now, NOW_E, pr, pi, qr, qi)
    c, s = small_turn(phase_after_turn)
    pr, pi = times(odr, odi, c, -s)
    qr, qi = times(osr, osi, c, -s)
    grown = grown + _growth(now, OLD, NOW_OLD, delta_old, pr, pi, qr, qi)
    grown = grown + _growth(now, NEW, NOW_NEW, delta_new, fdr, fdi, fsr, fsi)
    noise = load4(growth, at)
    a = grown + (noise * cos - turned4(noise) * sin)
    store4(m, A, a)
    m[F], m[F + 1], m[F + 2], m[F + 3] = fdr, fdi, fsr, fsi
    slope = _on_register(now, NOW_L, a) + product(now, RATES, fdr, fdi, fsr, fsi) - turned4(a) * delta_new
    v1 = _on_register(now, NOW_O, a) + product(now, NOW_D, fdr, fdi, fsr, fsi)
    d1 = _on_register(now, NOW_O, slope) * now[TICKS]
    rise = v1 - v0
    store4(cubic, 0, v0)
    store4(cubic, 4, d0)
    store4(cubic, 8, rise * 3.0 - d0 * 2.0 - d1)
    store4(cubic, 12, d0 + d1 - rise * 2.0)


@inlined
def slope_now(now, m, delta):
    """a' per tick at an instant, in the frame of a theta that turns by phi0 + delta."""
    return on(now, NOW_L, m, A) + on(now, RATES, m, F) - turned4(load4(m, A)) * delta


@inlined
def motion(now, m, cos, sin, z, at):
    """x, x'/W, y, y'/W (m) at an instant where theta has this cosine and sine, into z[at ..]. Mutates `z`."""
    store4(z, at, _physical_mode_states(now, m, cos, sin))


@outlined
def compute_frame_tables(knots, lo_degc, step_k, now, rate_rad_s, stiffness, temp_degc):
    """Tables for a rate, a stiffness (N/m) and a temperature, without a jump. Mutates `now`."""
    _interpolate_knots(knots, lo_degc, step_k, temp_degc, now)
    _combine(now, rate_rad_s, stiffness)
    now[NOW_RATE] = rate_rad_s
    now[NOW_STIFFNESS] = stiffness
    now[NOW_TEMP] = temp_degc


@outlined
def project_slow_amplitudes(now, m, cos, sin, x, vx, y, vy):
    """The slow amplitudes of a state of both modes, F given: a e^(i theta) = 2 c+ - conj((S a + s F) e^(i theta))."""
    for j in range(2):
        at = BACK + 8 * j
        m[TWICE + 2 * j] = 2.0 * (now[at] * x + now[at + 2] * vx + now[at + 4] * y + now[at + 6] * vy)
        m[TWICE + 2 * j + 1] = 2.0 * (now[at + 1] * x + now[at + 3] * vx + now[at + 5] * y + now[at + 7] * vy)
    for j in range(4):
        m[A + j] = 0.0
    # the slaved part is below 1e-2 of the whole: each round gains two digits and more
    for _ in range(8):
        v = on(now, NOW_S, m, A) + on(now, SLAVED, m, F)
        v = (v * cos + turned4(v) * sin) * load4(CONJUGATE, 0)
        v = load4(m, TWICE) - v
        store4(m, A, v * cos - turned4(v) * sin)

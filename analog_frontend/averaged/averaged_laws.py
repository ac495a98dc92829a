"""Averaged plant: what laws and effects do in a frame, from their harmonics along the slow motion.

    f(theta_n) from the states at POINTS phases of one turn, or at every FEW-th of them where only products are taken
    force   F = 2/N sum f e^(-i theta), one impulse a tick, turning with theta through a frame: as a DAC's staircase
            a_j' = g a_j + B_j F g e^g / (e^g - 1) a tick, g = eta_j - i delta;  a_j += S_j B_j F after a frame of them
            where a sign or an absolute value is taken, the points begin at that state's crest
    C/V     as a square-wave demodulator sees it: C - i S, C = c1 - c3/3 + c5/5, S = s1 + s3/3 + s5/5, about the
            phase of its references
    u, w    turned on by their leads: the means of staircases (`law.start_state`)

Left out   the change of the motion within a frame; harmonics beyond 30 of sgn and abs (0.2 % of their fundamental)
Source     docs/plant.md, docs/effects.md
"""

import math
from typing import NamedTuple

import numpy as np

from analog_frontend.averaged.averaged import BACK, CHAIN, ETA, LAWS, PICK, TICKS
from analog_frontend.averaged.averaged_modes import (
    NOW_D,
    NOW_L,
    NOW_O,
    A,
    F,
    motion,
    on,
    product,
    small_turn,
    times,
    unit,
)
from analog_frontend.effects import law
from analog_frontend.numeric.shapes import doubles
from analog_frontend.numeric.vector import lane, load4, store4, turned4
from analog_frontend.top import CV_X, CV_Y, STATES, V_DRIVE, V_SENSE, X
from fpga_model.jit import outlined

POINTS, FEW = 32, 4
COS = np.cos(2 * np.pi * (np.arange(POINTS) + 0.5) / POINTS)
SIN = np.sin(2 * np.pi * (np.arange(POINTS) + 0.5) / POINTS)
SLOTS = law.SLOTS + 3
IDENTITY = np.arange(STATES)
TURN_MASK = (1 << 48) - 1


class Params(NamedTuple):
    """As law.Params, with the effects that have kernels of their own behind; arrays are read only."""

    force: int
    cv: int
    temp_ref_degc: float
    table: np.ndarray
    numbers: np.ndarray
    reference_turns: int  # of the demodulators' switches on the phase, 48 bit
    leads: tuple  # of u and w as turns of the phase, 48 bit


class Room(NamedTuple):
    """Scratch."""

    cosines: doubles(STATES)  # states where theta is 0
    sines: doubles(STATES)  # a quarter turn later
    z: doubles(STATES)
    gains: doubles(SLOTS)
    force: doubles(4)  # re, im of F at x and y
    volts: doubles(4)  # re, im at the C/V outputs of x and y
    harmonics: doubles(6)
    push: doubles(4)  # re, im of what F adds to a_x', a_y' (per tick)
    grown: doubles(4)  # to a_x, a_y in a frame
    slope: doubles(4)  # to a_x', a_y' at its end


def design(effects, laws, reference_turns, tick_turns):
    """`Params` of a plant's effects.Params and law.Params.

    tick_turns  phase of a tick, 48 bit
    """
    rows = [(laws.table[k], laws.numbers[k]) for k in range(laws.force + laws.cv)]
    cubes = ((effects.duffing.on, "x", -effects.duffing.kick_per_m2),)
    cubes += ((effects.drive_cubic.on, "u", effects.drive_cubic.kick_m_per_v3),)
    for is_on, state, gain in cubes:
        if is_on:
            rows.append(_encode_law_row(law.PORTS.index("force_x"), [law.STATES[state]] * 3, gain))
    if effects.feedthrough_y.on:
        both = effects.feedthrough_y.start_v_per_v + effects.feedthrough_y.end_v_per_v
        rows.append(_encode_law_row(law.PORTS.index("cv_y"), [law.STATES["u"]], both))
    rows.sort(key=lambda row: row[0][law.AT_PORT] >= 2)
    table, numbers = np.zeros((SLOTS, law.COLUMNS), np.int64), np.zeros((SLOTS, len(law.NUMBERS)))
    for k, row in enumerate(rows):
        table[k], numbers[k] = row
    force = sum(int(row[0][law.AT_PORT] < 2) for row in rows)
    leads = tuple(math.floor(lead * tick_turns + 0.5) for lead in laws.leads)
    return Params(force, len(rows) - force, laws.temp_ref_degc, table, numbers, reference_turns, leads)


def _encode_law_row(port, states, gain):
    row = np.zeros(law.COLUMNS, np.int64)
    row[law.AT_PORT], row[law.COUNT] = port, len(states)
    row[law.FIRST : law.FIRST + len(states)] = states
    return row, np.array([gain, 0.0, law.STRAIGHT])


@outlined
def _add_demodulated_volts(h, volts, at, offset):
    """The sine that a demodulator sees in harmonics 1, 3, 5 about its reference; turned back to theta. Mutates."""
    c = h[0] - h[2] * (1.0 / 3) + h[4] * 0.2
    s = h[1] + h[3] * (1.0 / 3) + h[5] * 0.2
    cos, sin = unit(offset & TURN_MASK)
    re, im = times(c, -s, cos, sin)
    volts[at] += re
    volts[at + 1] += im


@outlined
def _crest(r, state):
    """Phase at which a state is largest: from there its zeros stand midway between points, where its sign changes."""
    size = math.sqrt(r.cosines[state] * r.cosines[state] + r.sines[state] * r.sines[state])
    if size == 0.0:
        return 1.0, 0.0
    return r.cosines[state] / size, r.sines[state] / size


@outlined
def act(p, now, m, r, rate_rad_s, temp_degc, t_s, drive_ref, sense_ref):
    """Forces and volts of a frame from the motion at its first instant: r.force, r.volts. Mutates `r`."""
    law.gains(p.force, p.cv, p.temp_ref_degc, p.table, p.numbers, rate_rad_s, temp_degc, t_s, r.gains)
    outputs = on(now, NOW_O, m, A) + on(now, NOW_D, m, F)
    for quarter in range(2):
        z = r.sines if quarter else r.cosines
        cos, sin = (0.0, 1.0) if quarter else (1.0, 0.0)
        motion(now, m, cos, sin, z, X)
        for d in range(2):
            at = CHAIN + 6 * d + 4
            e, f = times(now[at], now[at + 1], m[F + 2 * d], m[F + 2 * d + 1])
            if p.leads[d]:
                on_c, on_s = unit(p.leads[d] & TURN_MASK)
                e, f = times(e, f, on_c, on_s)
            z[V_SENSE if d else V_DRIVE] = -f if quarter else e
        z[CV_X] = -lane(outputs, 1) if quarter else lane(outputs, 0)
        z[CV_Y] = -lane(outputs, 3) if quarter else lane(outputs, 2)
    for i in range(4):
        r.force[i], r.volts[i] = 0.0, 0.0
    for k in range(p.force + p.cv):
        port, state = p.table[k, law.AT_PORT], p.table[k, law.FIRST]
        if port < 2 and p.table[k, law.COUNT] == 1 and state < law.ABS:
            # linear: its only harmonic is that of the state
            r.force[2 * port] += r.gains[k] * r.cosines[state]
            r.force[2 * port + 1] -= r.gains[k] * r.sines[state]
            continue
        for i in range(6):
            r.harmonics[i] = 0.0
        offset = (sense_ref if port == 3 else drive_ref) - p.reference_turns
        turn_c, turn_s = unit(offset & TURN_MASK)
        # a product of states has no harmonic beyond 6: 8 points find the first, 16 the fifth
        stride = FEW if port < 2 else FEW // 2
        grid_c, grid_s = 1.0, 0.0
        for j in range(law.FIRST, law.FIRST + p.table[k, law.COUNT]):
            if p.table[k, j] >= law.ABS and stride > 1:
                stride = 1
                grid_c, grid_s = _crest(r, p.table[k, j] & 15)
        for n in range(0, POINTS, stride):
            cos, sin = times(COS[n], SIN[n], grid_c, grid_s)
            for j in range(law.FIRST, law.FIRST + p.table[k, law.COUNT]):
                i = p.table[k, j] & 15
                r.z[i] = cos * r.cosines[i] + sin * r.sines[i]
            v = law.value(p.table, r.gains, k, r.z, IDENTITY, 0) * (2.0 * stride / POINTS)
            if port < 2:
                r.harmonics[0] += v * cos
                r.harmonics[1] += v * sin
            else:
                c, s = times(cos, sin, turn_c, turn_s)
                c2, s2 = times(c, s, c, s)
                c3, s3 = times(c, s, c2, s2)
                c5, s5 = times(c3, s3, c2, s2)
                r.harmonics[0] += v * c
                r.harmonics[1] += v * s
                r.harmonics[2] += v * c3
                r.harmonics[3] += v * s3
                r.harmonics[4] += v * c5
                r.harmonics[5] += v * s5
        if port < 2:
            r.force[2 * port] += r.harmonics[0]
            r.force[2 * port + 1] -= r.harmonics[1]
        else:
            _add_demodulated_volts(r.harmonics, r.volts, 2 * (port - 2), offset)


@outlined
def grow(now, m, r, delta, cubic):
    """What r.force does in a frame whose phase per tick is phi0 + delta, behind `frame`. Mutates `m` and `cubic`."""
    push, grown, ticks = r.push, r.grown, now[TICKS]
    for j in range(2):
        re, im = now[ETA + 2 * j], now[ETA + 2 * j + 1] - delta
        c, s = small_turn(0.5 * (ticks + 1.0) * im)
        size = ticks * (1.0 + 0.5 * (ticks + 1.0) * re - (ticks * im) * (ticks * im) * (1.0 / 24))
        at = BACK + 8 * j
        kr, ki = times(now[at + 2], now[at + 3], r.force[0], r.force[1])
        hr, hi = times(now[at + 6], now[at + 7], r.force[2], r.force[3])
        push[2 * j], push[2 * j + 1] = times(kr + hr, ki + hi, 1.0 + 0.5 * re, 0.5 * im)
        grown[2 * j], grown[2 * j + 1] = times(kr + hr, ki + hi, size * c, size * s)
    slaved = product(now, LAWS, r.force[0], r.force[1], r.force[2], r.force[3])
    slaved_cv_volts = product(now, PICK + 8, lane(slaved, 0), lane(slaved, 1), lane(slaved, 2), lane(slaved, 3))
    rise = on(now, NOW_O, grown, 0)
    begins = on(now, NOW_O, push, 0) * ticks
    store4(r.slope, 0, load4(push, 0) + on(now, NOW_L, grown, 0) - turned4(load4(grown, 0)) * delta)
    ends = on(now, NOW_O, r.slope, 0) * ticks
    store4(cubic, 0, load4(cubic, 0) + slaved_cv_volts + load4(r.volts, 0))
    store4(cubic, 4, load4(cubic, 4) + begins)
    store4(cubic, 8, load4(cubic, 8) + (rise * 3.0 - begins * 2.0 - ends))
    store4(cubic, 12, load4(cubic, 12) + (begins + ends - rise * 2.0))
    store4(m, A, load4(m, A) + load4(grown, 0))


def reference_turns(clocks, word0):
    """Phase (48 bit) by which switches that act `clocks` after their edge lag."""
    return math.floor(clocks * word0 + 0.5) & TURN_MASK

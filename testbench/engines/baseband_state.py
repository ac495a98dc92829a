"""Baseband engine, ways in and out: from the plant's state of the frame engine to the slow one, and back.

    take_state   modes projected on slow amplitudes, capacitors less the particular solution, switches on their way
    give_state   all states at a frame's first instant, codes of the last ticks, block state

Neither is exact: the averaged plant knows neither the rounding of the DAC codes nor the ripple of the chains.
Source    docs/plant.md
"""

import math
from typing import NamedTuple

import numpy as np

from analog_frontend import top as plant
from analog_frontend.averaged import (
    averaged,
    averaged_codes,
    averaged_laws,
    averaged_modes,
    averaged_noise,
    averaged_sid,
)
from analog_frontend.averaged.averaged_modes import (
    NOW_D,
    NOW_O,
    NOW_TEMP,
    A,
    F,
    motion,
    on,
    product,
    slope_now,
    times,
    unit,
)
from analog_frontend.averaged.averaged_sid import (
    AREA,
    BEGAN,
    CLOSED_AT,
    CURVE,
    EDGE_SLOPE,
    H1,
    HALF,
    HALF_MASK,
    NOISE,
    PAST,
    R1,
    R2,
    R3,
    SIGN,
    SLOPE,
    UNTIL,
    WAITING,
    S,
)
from analog_frontend.numeric.shapes import doubles, zeros
from analog_frontend.numeric.vector import lane, splat4, turned4
from analog_frontend.parts import adc, dac
from fpga_model import control, watchdog
from fpga_model.jit import inner, outlined
from testbench.engines import pins
from testbench.engines.block_state import BlockState
from testbench.engines.turn import phase_at, widen_word
from testbench.engines.window import HISTORY, Window, valid_clocks

ZERO, ONE = np.int64(0), np.int64(1)
RECENT = 8  # ticks whose codes the blocks are given back


class Slow(NamedTuple):
    """State of the averaged plant; arrays, mutated in place."""

    now: doubles(averaged_modes.NOW_SIZE)
    m: doubles(averaged_modes.M_SIZE)
    q: doubles(4 * averaged_sid.Q_ROWS)
    cubic: doubles(24)
    z: doubles(plant.STATES)
    base: doubles(8)
    drawn: averaged_noise.Drawn
    laws: averaged_laws.Room


def slow():
    """Room for a run."""
    b = zeros(Slow, drawn=zeros(averaged_noise.Drawn), laws=zeros(averaged_laws.Room))
    b.now[:] = np.inf
    return b


@inner
def poles_at(u, word):
    """p, p^2, p^3 and 2 p^3/(i w RC) at a frequency word."""
    s = word * u.rad_per_word * u.rc_ticks
    # one division for both
    square = 1.0 + s * s
    inverse = 1.0 / (s * square)
    r, inverse = s * inverse, 2.0 * square * inverse
    i = -s * r
    r2, i2 = times(r, i, r, i)
    r3, i3 = times(r2, i2, r, i)
    return r, i, r2, i2, r3, i3, i3 * inverse, -r3 * inverse


@inner
def rate_volts(u, c):
    """Amplitude (V) of what the sense DAC puts out, with the sign of the rate word; control.State."""
    volts = c.rate_loop.loop.y * u.sense_volts
    if u.sense_lsb_v > 0.0:
        volts = math.copysign(averaged_codes.rounded_sine_fundamental(abs(volts), u.sense_lsb_v), volts)
    return volts


@inner
def turned_force(volts, word_offset):
    """F of a DAC whose sine has this phase word."""
    if word_offset == 0:
        return volts, 0.0
    c, s = unit(word_offset)
    return volts * c, volts * s


@outlined
def take_state(p, u, b, g, a, tick):
    """The slow state at a frame's first instant, from the plant's own; no edge may be on its way. Mutates `b`."""
    now, m, q = b.now, b.m, b.q
    # the tables of the frame that has just ended
    stiffness = a.now[plant.NOW_STIFFNESS]
    now[NOW_TEMP] = np.inf
    for k in range(8):
        m[k] = 0.0
    averaged_modes.compute_frame_tables(
        u.knots, p.plant.temp_lo_degc, p.plant.temp_step_k, now, a.now[plant.NOW_RATE], stiffness, a.now[plant.NOW_TEMP]
    )
    bank, design = g.s.bank, p.fpga.design
    ref_drive, ref_sense = widen_word(design, bank.phase_drive_ref), widen_word(design, bank.phase_sense_ref)
    averaged_sid.bases(ref_drive, ref_sense, b.base)
    amplitude = control.amplitude(p.fpga.control, g.s.control)
    volts = averaged_codes.rounded_sine_fundamental(amplitude * u.drive_volts, u.drive_lsb_v)
    m[F], m[F + 1] = turned_force(volts, widen_word(design, bank.phase_drive_sine))
    sense_volts = rate_volts(u, g.s.control)
    m[F + 2], m[F + 3] = turned_force(sense_volts, widen_word(design, bank.phase_sense_sine))
    phase = widen_word(design, phase_at(g.s.turn, design.tick_clocks * tick))
    cos, sin = unit(phase)
    averaged_modes.project_slow_amplitudes(now, m, cos, sin, a.z[6], a.z[7], a.z[8], a.z[9])
    word = widen_word(design, g.s.turn.word)
    delta = (word - u.word0) * u.rad_per_word
    poles = poles_at(u, word)
    outputs = _outputs(u, now, m, delta, poles[0], poles[1], cos, sin)
    for d in range(4):
        c = d >> 1
        wr, wi = (outputs[2], outputs[3]) if c else (outputs[0], outputs[1])
        ref = a.switch[d]
        on, off = (0, 3) if ref else (3, 0)
        for k in range(3):
            w = poles[2 * k] * wr - poles[2 * k + 1] * wi
            q[4 * (R1 + k) + d] = a.caps[d, on + k] - w
            q[4 * (H1 + k) + d] = a.caps[d, off + k]
        q[4 * CLOSED_AT + d] = 0.0
        # as if the output had been what it is for a half period
        q[4 * BEGAN + d] = -float(HALF // word)
        q[4 * S + d] = (1.0 if ref else -1.0) * (a.caps[d, on + 2] - a.caps[d, off + 2])
        q[4 * AREA + d] = q[4 * S + d] * -q[4 * BEGAN + d] * u.sid.inverse_rc
        slope = (a.caps[d, on + 1] - a.caps[d, on + 2]) - (a.caps[d, off + 1] - a.caps[d, off + 2])
        q[4 * SLOPE + d] = (1.0 if ref else -1.0) * slope * 0.5 * u.sid.inverse_rc
        q[4 * EDGE_SLOPE + d] = q[4 * SLOPE + d]
        q[4 * CURVE + d] = 0.0
        q[4 * UNTIL + d] = u.sid.middle - u.sid.frame_clocks
        q[4 * NOISE + d] = 0.0
        q[4 * SIGN + d] = 1.0 if ref else -1.0
        # an edge that the phase has made but the switch has not followed yet
        offset = (ref_sense if c else ref_drive) + ((HALF >> 1) if d & 1 else 0)
        phase_past_edge = (phase + offset) & HALF_MASK
        t = lane(averaged_sid.switch_edge_clock(u.sid, splat4(-float(phase_past_edge // word))), 0)
        q[4 * WAITING + d] = t if t >= 0.0 else -1.0
        q[4 * PAST + d] = t * word + phase_past_edge


@outlined
def give_state(p, u, b, g, a, c, bank, turn, quadrature, old, new, tick, w):
    """Back to the plant's own state and to what the blocks carry, at a frame's first instant. Mutates `a` and `w`."""
    now, m, q = b.now, b.m, b.q
    design = p.fpga.design
    phase, word = widen_word(design, phase_at(turn, design.tick_clocks * tick)), widen_word(design, turn.word)
    cos, sin = unit(phase)
    motion(now, m, cos, sin, a.z, plant.X)
    for k in range(3):
        for d in range(2):
            at = averaged.CHAIN + 6 * d + 2 * k
            e, f = times(now[at], now[at + 1], m[F + 2 * d], m[F + 2 * d + 1])
            a.z[3 * d + k] = e * cos - f * sin
            at = averaged.CV + 6 * d + 2 * k
            a.z[10 + 3 * d + k] = now[at] * a.z[6 + 2 * d] + now[at + 1] * a.z[7 + 2 * d]
    delta = (word - u.word0) * u.rad_per_word
    poles = poles_at(u, word)
    outputs = _outputs(u, now, m, delta, poles[0], poles[1], cos, sin)
    refs = 0
    for d in range(4):
        wr, wi = (outputs[2], outputs[3]) if d > 1 else (outputs[0], outputs[1])
        v, n = -q[4 * CLOSED_AT + d] * u.sid.inverse_rc, -q[4 * NOISE + d] * u.sid.noise_gain
        decay = averaged_sid.decay(v)
        r1, r2, r3 = q[4 * R1 + d], q[4 * R2 + d], q[4 * R3 + d]
        ref = 1 if q[4 * SIGN + d] > 0.0 else 0
        on, off = (0, 3) if ref else (3, 0)
        a.caps[d, on] = decay * r1 + poles[0] * wr - poles[1] * wi + n * (1.0 - 0.5 * v)
        a.caps[d, on + 1] = decay * (r2 + v * r1) + poles[2] * wr - poles[3] * wi + n * v * 0.5
        w3 = decay * (r3 + v * (r2 + 0.5 * v * r1)) + poles[4] * wr - poles[5] * wi
        a.caps[d, on + 2] = w3 + n * v * v * (1.0 / 6)
        for k in range(3):
            a.caps[d, off + k] = q[4 * (H1 + k) + d]
        a.switch[d] = ref
        a.late_count[d] = 0
        # a switch that follows an edge of the frame that has ended; one whose edge is still to come is found again
        if 0.0 <= q[4 * WAITING + d] < u.sid.switch - 0.5:
            a.late_tau_s[d, 0] = q[4 * WAITING + d] * u.clock_s
            a.late_count[d] = 1
            ref = 1 - ref
        refs = refs | (ref << d)
    # the codes of the last ticks
    amplitude, rate = control.amplitude(p.fpga.control, c), c.rate_loop.loop.y
    for k in range(RECENT):
        w.amplitude[k] = amplitude
        w.rate[k] = rate
    for k in range(RECENT + HISTORY):
        w.control_load[k] = 0
    pins.dac_codes(p.fpga, p.rom, bank, turn, tick - RECENT, RECENT, w)
    drive, sense = a.work.drive_codes, a.work.sense_codes
    enabled, staged = pins.words_of_ticks(p.fpga, drive, sense, RECENT, g.enabled, g.staged, False, w)
    _set_dac_output(a, plant.DRIVE, p.plant.drive_dac, p.plant.tables.drive_carry[0, a.cycles[plant.DRIVE]], drive)
    _set_dac_output(a, plant.SENSE, p.plant.sense_dac, p.plant.tables.sense_carry[0, a.cycles[plant.SENSE]], sense)
    a.adc.clock[adc.DUE], a.adc.clock[adc.SAMPLE], a.adc.clock[adc.PENDING] = 0, 0, adc.NOT_PENDING
    for k in range(adc.CHANNELS):
        a.adc.sums[k, 0] = 0.0
    at = design.tick_clocks * tick
    age = design.frame_ticks - 1 - u.valid // design.tick_clocks
    s = Window(c, bank, watchdog.State(age, ZERO), turn, ZERO, quadrature)
    return BlockState(
        g.sid,
        s,
        refs,
        enabled,
        staged,
        drive[RECENT - 1],
        sense[RECENT - 1],
        ONE,
        ONE,
        old,
        new,
        at + u.valid - valid_clocks(design),
        at + u.valid,
        ONE,
        -ONE,
    )


@inner
def _set_dac_output(a, which, part, carry, codes):
    """What a DAC holds after its last codes. Mutates `a`."""
    last = dac.volts(part, codes[RECENT - 1])
    a.codes[which] = codes[RECENT - 1]
    a.coming_v[which] = last
    a.volts[which] = dac.volts(part, codes[RECENT - 2]) if carry else last
    a.late_area[which] = 0.0


@inner
def _outputs(u, now, m, delta, pr, pi, cos, sin):
    """V~ e^(i theta) of both C/V outputs at an instant, four numbers."""
    v = on(now, NOW_O, m, A) + on(now, NOW_D, m, F)
    d = slope_now(now, m, delta) * u.rc_ticks
    d = product(now, NOW_O, lane(d, 0), lane(d, 1), lane(d, 2), lane(d, 3))
    v = v - (d * pr + turned4(d) * pi)
    v = v * cos + turned4(v) * sin
    return lane(v, 0), lane(v, 1), lane(v, 2), lane(v, 3)

"""Baseband engine, frame by frame: the firmware's own 8 kHz window, and the averaged plant in between.

    first instant   tables for rate, V_q, temperature; one row
    window          codes of the last conversion in, words out: window.run_window, bit for bit
    its ticks       modes, demodulators, converter: averaged_modes, averaged_sid

Source    docs/plant.md, docs/decisions/0014-baseband.md
"""

from __future__ import annotations  # a field may bear the name of its module

import math

import numpy as np

from analog_frontend import top as plant
from analog_frontend.averaged import (
    averaged_codes,
    averaged_laws,
    averaged_modes,
    averaged_noise,
    averaged_ring,
    averaged_sid,
)
from analog_frontend.averaged.averaged_modes import A, motion, unit
from analog_frontend.averaged.averaged_noise import BATCH, ROW
from analog_frontend.averaged.averaged_sid import NOISE, SLOPE, S
from analog_frontend.numeric.vector import load4, store4, turned4
from analog_frontend.parts import adc
from analog_frontend.parts.noise import HOLD
from fpga_model import control, modulator, registers, sine
from fpga_model.control import SLOT_PI
from fpga_model.fixed import wrap_unsigned
from fpga_model.jit import hot, inlined, inner
from testbench.engines import engine
from testbench.engines.baseband_state import poles_at, rate_volts, turned_force
from testbench.engines.turn import TURN_MASK, narrow_word, still, widen_word
from testbench.engines.window import SLOT_WORD, run_window

ZERO, ONE = np.int64(0), np.int64(1)
RECENT = 8  # ticks whose codes the blocks are given back


@inlined
def _by(v, re, im):
    """Two complex numbers times another."""
    return v * re + turned4(v) * im


@inner
def _tilde(u, cubic, poles):
    """The cubic of V~, V~ + RC p V~' = V, in place of V's; behind it what stages 2 and 3 have less. Mutates `cubic`."""
    gr, gi = u.rc_frames * poles[0], u.rc_frames * poles[1]
    v1, v2, v3 = load4(cubic, 4), load4(cubic, 8), load4(cubic, 12)
    # RC p V' in the mean of the frame
    mean_slope = _by((v1 + v2) + v3, gr, gi)
    store4(cubic, 16, _by(mean_slope, poles[2], poles[3]))
    store4(cubic, 20, _by(mean_slope, 2.0 * poles[4], 2.0 * poles[5]))
    v2 = v2 - _by(v3 * 3.0, gr, gi)
    v1 = v1 - _by(v2 * 2.0, gr, gi)
    store4(cubic, 0, load4(cubic, 0) - _by(v1, gr, gi))
    store4(cubic, 4, v1)
    store4(cubic, 8, v2)


@inner
def _record_row(p, rom, u, c, bank, phase, word, codes, quadrature, z, temp_degc, rate_rad_s, frames, truth, row):
    """One row of both streams; the DAC codes are those that words and phase have made in the last ticks."""
    if row >= frames.shape[0]:
        return
    d = p.design
    dac_phase = narrow_word(d, phase - u.drive_delay_clocks * word)
    amplitude = control.amplitude(p.control, c)
    y = sine.phase_sine(d, rom, wrap_unsigned(dac_phase + bank.phase_drive_sine, d.dds_bits))
    drive = modulator.dac_code(p.drive_modulator, amplitude, y)
    dac_phase = narrow_word(d, phase - u.sense_delay_clocks * word)
    y = sine.phase_sine(d, rom, wrap_unsigned(dac_phase + bank.phase_sense_sine, d.dds_bits))
    sense = modulator.dac_code(p.sense_modulator, c.rate_loop.loop.y, y)
    engine.record_frame(frames[row], truth[row], c, codes, drive, sense, quadrature, z, temp_degc, rate_rad_s)


@inner
def _draw_noise_batch(p, u, b, tick, end, count, clock, sums):
    """The noise of the next batch of frames, `count` at most, behind that up to place `end`. Mutates `b`."""
    d, count = b.drawn, min(u.batch_mask + 1, count)
    averaged_noise.integrate(b.q, 4 * NOISE, d, end, -1.0)
    averaged_noise.draw(p.plant.noise, u.force, d, tick, count, p.fpga.design.frame_ticks, u.batch_samples)
    averaged_noise.convert(p.plant.adc, d, sums, clock[adc.COUNT], count)
    d.begin[0] = tick % HOLD / HOLD
    averaged_noise.integrate(b.q, 4 * NOISE, d, d.begin[0], 1.0)


@inner
def _advance_modes(p, u, b, c, bank, tick, batch, rate, temp, words, turn_phase, cos, sin):
    """Both modes through a frame; `words` of the DDS before and after its turn. Mutates `b`."""
    word_old, word = words
    volts = averaged_codes.rounded_sine_fundamental(control.amplitude(p.fpga.control, c) * u.drive_volts, u.drive_lsb_v)
    d = p.fpga.design
    drive = turned_force(volts, widen_word(d, bank.phase_drive_sine))
    sense = turned_force(rate_volts(u, c), widen_word(d, bank.phase_sense_sine))
    ring = p.plant.ring
    lawful = u.laws.force + u.laws.cv + ring.on > 0
    if lawful:
        refs = widen_word(d, bank.phase_drive_ref), widen_word(d, bank.phase_sense_ref)
        averaged_laws.act(u.laws, b.now, b.m, b.laws, rate, temp, tick * p.plant.sid.h_s, refs[0], refs[1])
        if ring.on:
            averaged_ring.act(ring, b.laws, temp, word * u.rad_per_word, u.laws.reference_turns, refs[0], refs[1])
    changed_cos, changed_sin = unit((turn_phase + u.drive_change * word) << 1 & TURN_MASK)
    later_cos, later_sin = averaged_modes.times(changed_cos, changed_sin, u.sense_later[0], u.sense_later[1])
    changed = changed_cos, changed_sin, later_cos, later_sin
    deltas = (word_old - u.word0) * u.rad_per_word, (word - u.word0) * u.rad_per_word
    turn, growth = u.turn_ticks, b.drawn.growth
    averaged_modes.frame(b.now, b.m, deltas, turn, drive + sense, growth, 4 * batch, cos, sin, changed, b.cubic)
    if lawful:
        averaged_laws.grow(b.now, b.m, b.laws, deltas[1], b.cubic)


@hot
def frames(p, u, b, c, bank, phase, word, quadrature, old, new, chunk, tick, count, clock, sums):
    """`count` frames from the one that begins at `tick`. Mutates `b`, the converter's arrays and the streams.

    old, new  the converter's frame before the last, and the last, which is being read
    phase, word  in turns / 2^48
    Returns control, register bank, turn, V_q's code, both frames, and the tick, earlier than asked for where the
    frequency word has left the range of the tables.
    """
    now, m, q, drawn, d = b.now, b.m, b.q, b.drawn, p.fpga.design
    cos, sin = unit(phase)
    top, batch = 0.0, 0
    turn_clock = u.turn_clock
    between = SLOT_WORD - SLOT_PI  # clocks in which a new centre shows before the loop does
    first = tick // d.frame_ticks - chunk.begin // d.frame_ticks
    first_row = first - (1 if chunk.begin % d.frame_ticks else 0)
    for n in range(count):
        batch = n & u.batch_mask
        if batch == 0:
            end = drawn.begin[0] + u.frame_samples * (u.batch_mask + 1) if n > 0 else 0.0
            _draw_noise_batch(p, u, b, tick, end, count - n, clock, sums)
        rate, temp = chunk.rate_rad_s[first + n], chunk.temp_degc[first + n]
        v_q = quadrature * p.plant.quad_lsb_v
        motion(now, m, cos, sin, b.z, plant.X)
        averaged_modes.retune_tables(
            u.knots, p.plant.temp_lo_degc, p.plant.temp_step_k, now, m, rate, v_q * v_q, temp, cos, sin, b.z, plant.X
        )
        o = chunk.o
        _record_row(
            p.fpga, p.rom, u, c, bank, phase, word, old, quadrature, b.z, temp, rate, o.frames, o.truth, first_row + n
        )
        # the window
        word_old = word
        i = control.Inputs(new[0], new[1], new[2], new[3], new[4], ONE, ZERO)
        c, word_between = run_window(d, p.fpga.control, c, i, bank)
        quadrature = c.quadrature_loop.root.y
        word, word_between = widen_word(d, c.frequency_tracker.word), widen_word(d, word_between)
        turn_phase = (phase + (turn_clock - between) * word_old + between * word_between) & TURN_MASK
        after = (turn_phase + (u.frame_clocks - turn_clock) * word) & TURN_MASK
        # the plant
        cos, sin = unit(after)
        _advance_modes(p, u, b, c, bank, tick, batch, rate, temp, (word_old, word), turn_phase, cos, sin)
        poles = poles_at(u, word)
        _tilde(u, b.cubic, poles)
        before, after_turn = (phase, word_old), (turn_clock, turn_phase, word)
        offsets = widen_word(d, bank.phase_drive_ref), widen_word(d, bank.phase_sense_ref)
        noise = (drawn.volts, drawn.sums, ROW)
        begin = drawn.begin[0] + u.frame_samples * batch
        averaged_sid.demodulate(u.sid, q, before, after_turn, offsets, b.base, b.cubic, poles, noise, begin)
        old = new
        new = _convert(p.plant.adc, u, q, clock, sums, drawn.converter, batch, temp)
        tick += d.frame_ticks
        phase = after
        bank = registers.step(d, bank, ZERO, ZERO, ZERO, ONE)
        top = max(top, m[A] * m[A] + m[A + 1] * m[A + 1])
        if not abs(word - u.word0) <= u.limit:
            break
    averaged_noise.integrate(q, 4 * NOISE, drawn, drawn.begin[0] + u.frame_samples * (batch + 1), -1.0)
    chunk.o.peak_x[0] = max(chunk.o.peak_x[0], math.sqrt(top))
    turn = still(d.tick_clocks * tick, narrow_word(d, phase), narrow_word(d, word), d.dds_bits)
    return c, bank, turn, quadrature, old, new, tick


@inner
def _convert(p, u, q, clock, sums, added, batch, temp_degc):
    """A conversion ends: as adc._convert, its samples summed by their moments. Mutates `clock` and `sums`."""
    number = clock[adc.COUNT]
    sensor = adc.temperature_volts(temp_degc)
    for c in range(adc.CHANNELS):
        s, slope = (q[4 * S + c], q[4 * SLOPE + c]) if c < 4 else (sensor, 0.0)
        k = u.moments
        volts = (sums[c, 2] + k[2, 0] * s + k[2, 1] * slope) * p.normal
        volts = volts + added[c * BATCH + batch]
        clock[adc.CODES + c] = adc.code(p, c, volts)
        sums[c, 2] = sums[c, 1] + k[1, 0] * s + k[1, 1] * slope
        sums[c, 1] = k[0, 0] * s + k[0, 1] * slope
    clock[adc.COUNT] = number + 1
    at = adc.CODES
    return clock[at], clock[at + 1], clock[at + 2], clock[at + 3], clock[at + 4], ZERO, ZERO, ZERO

"""State of one gyroscope between two blocks, and the firmware's work before and after the plant's ticks.

    ticks_to_event   ticks until the next event
    before_ticks     words, DAC codes and reference edges of these ticks (`advance_control`, then `words_of_ticks`)
    after_ticks      frames that the converter has completed, and the one that it begins

    8 kHz window (a valid ADC frame, or stale at ce_8k), frame boundary, DRDY: the events; ticks in between are blocks

The frame engine goes through them with one gyroscope, the lanes engine with many side by side: there is no other text
of what the firmware does between two events.
Source    docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

import numpy as np

from analog_frontend import linear
from analog_frontend.parts import adc
from fpga_model import control, digital_sid, rates, references, sequencer, spi_adc, watchdog
from fpga_model.jit import inlined, inner, outlined
from fpga_model.rates import SLOTS
from testbench.engines import engine, pins, window
from testbench.engines.flush import CHANNEL_MASK, FLUSH
from testbench.engines.turn import drop_history, still
from testbench.engines.window import HISTORY, Window, last_load_tick, valid_clocks

DUMP_CLOCKS = digital_sid.LATENCY
# typed: Numba compiles a function anew for every constant that it is called with
FAR, ZERO, ONE = np.int64(1 << 62), np.int64(0), np.int64(1)


class BlockState(NamedTuple):
    """Integers only, so that a row of int64 holds it. Clocks count from power-on; FAR where nothing comes."""

    sid: digital_sid.State
    s: Window
    refs: int  # reference pins
    enabled: int  # the sense DAC's output switch, and its data register
    staged: int
    drive_code: int
    sense_code: int
    read: int  # a frame has been read in these blocks
    ok: int
    channels: tuple
    coming: tuple  # of the frame being read
    falls: int  # its DRDY
    valid: int
    new_ok: int
    drdy_cycle: int  # of the present tick, or -1


@inner
def load_block_state(p, f, chips, tick, drdy_cycle):
    """What a quiet firmware carries."""
    d = p.design
    quadrature = chips.quadrature.code if tick % d.frame_ticks == 0 else f.control.quadrature_loop.root.y
    s = Window(
        f.control,
        f.registers,
        f.watchdog,
        still(d.tick_clocks * tick, f.dds.phase, f.control.frequency_tracker.word, d.dds_bits),
        ZERO,
        quadrature,
    )
    return BlockState(
        f.sid,
        s,
        references.pins(p.references, f.references),
        chips.sense.enabled,
        chips.sense.staged,
        chips.drive.code,
        chips.sense.code,
        ZERO,
        f.adc.ok,
        f.adc.channels,
        f.adc.channels,
        FAR,
        FAR,
        ZERO,
        drdy_cycle,
    )


@inner
def history(f, b):
    """The last codes and control words of a quiet firmware, in front of a block's buffers. Mutates `b`."""
    b.drive[0], b.drive[1], b.drive[2] = f.drive_modulator.held2, f.drive_modulator.held1, f.drive_modulator.code
    b.sense[0], b.sense[1], b.sense[2] = f.sense_modulator.held2, f.sense_modulator.held1, f.sense_modulator.code
    b.control_load[HISTORY - 1] = sequencer.outputs(f.control.sequencer).dac_init


@inner
def ready_clock(d, converter, clock, silent, drdy_cycle, tick):
    """Clock at which DRDY falls next, from a quiet tick on; FAR if it never does."""
    if silent:
        return FAR
    return d.tick_clocks * tick + (drdy_cycle if drdy_cycle >= 0 else adc.clocks_to_ready(converter, clock, ZERO))


@inner
def busy_ticks(d):
    """Ticks to a quiet one, flushed: from DRDY, by read, tail and window; from a window at a frame boundary."""
    busy = valid_clocks(d) + max(SLOTS, d.adc_tail_clocks)
    return busy // d.tick_clocks + FLUSH + 3, SLOTS // d.tick_clocks + FLUSH + 2


@inlined
def quiet_margin_clocks(d):
    """`last_quiet` is never earlier than this before an end: twice the longer of `busy_ticks`, and the tick begun."""
    return 2 * (valid_clocks(d) + max(SLOTS, d.adc_tail_clocks) + d.tick_clocks * (FLUSH + 4))


@inner
def last_quiet(d, end, ready):
    """The last tick before `end` at which the firmware is quiet and has been for FLUSH ticks; DRDY falls at `ready`."""
    read_ticks, window_busy_ticks = busy_ticks(d)
    for _ in range(2):
        if d.tick_clocks * (end - read_ticks + 1) <= ready < d.tick_clocks * end:
            end = ready // d.tick_clocks
        if 0 < end % d.frame_ticks < window_busy_ticks:
            end = end - end % d.frame_ticks
    return end


@inner
def ticks_to_event(d, converter, clock, silent, g, tick, end):
    """The tick up to which a block from `tick` on may go; `tick` itself when it is the last quiet one before `end`.

    converter, clock  of the ADC; silent  its DRDY never falls
    """
    ready = ready_clock(d, converter, clock, silent, g.drdy_cycle, tick)
    clocks, frame_ticks = d.tick_clocks, d.frame_ticks
    until = tick + min(frame_ticks - tick % frame_ticks, linear.BLOCK)
    # divisions only where an event may come first: one by a number that is not known when this is compiled is slow
    if clocks * (end - until) < quiet_margin_clocks(d):
        stop = last_quiet(d, end, ready)
        if tick >= stop:
            return tick
        until = min(until, stop)
    if clocks * (tick + 1) <= g.valid < clocks * until:
        until = g.valid // clocks
    if not silent and ready + valid_clocks(d) < clocks * until:
        until = (ready + valid_clocks(d)) // clocks
    following = adc.clocks_to_ready(converter, clock, ONE)
    return tick + following // clocks if following < clocks * (until - tick) else until


@inner
def codes_at(p, g, tick):
    """The five codes that the firmware holds at the first clock of a tick."""
    clock = p.design.tick_clocks * tick
    return engine.frame_codes(p, g.sid.codes, window.receive(p.design, g.channels, g.coming, g.falls, clock))


@inner
def _end_quadrature(p, s, tick, window_ticks, n):
    """Code of V_q's DAC at the frame's end, after ticks `window_ticks` .. `n` - 1 of a block outside of a window."""
    first = tick % p.design.frame_ticks  # a block ends with the frame
    # the low bits of a tick in which V_q is sent are all ones
    due = (first + window_ticks) | rates.quadrature_mask(p.design, p.quadrature_fast)
    return s.control.quadrature_loop.root.y if due < first + n and due <= last_load_tick(p) else s.quadrature


@outlined
def demodulate(p, sid, tick, first, end, b):
    """The FPGA's own demodulator over ticks `first` .. `end` - 1 of a block that begins at `tick`.

    One edge a tick, and at a dump those until its codes are out.
    """
    frame_tick = tick % p.design.frame_ticks
    for k in range(first, end):
        dump = 1 if frame_tick + k == 0 else 0
        sid = digital_sid.step(p.sid, sid, 1, dump, b.refs[k], b.sar[0, k], b.sar[1, k])
        if dump:
            for _ in range(DUMP_CLOCKS):
                sid = digital_sid.step(p.sid, sid, 0, 0, 0, 0, 0)
    return sid


@inner
def _age_watchdog(p, dog, ticks):
    """The watchdog after `ticks` without a frame."""
    age = min(dog.age + ticks, watchdog.AGE_TOP)
    return watchdog.State(age, 1 if ticks > 0 and age > p.limit else dog.stale)


@inner
def await_frame(p, g, tick):
    """Whether a window begins, or goes on, in the block that begins at `tick`."""
    d = p.design
    starts = tick % d.frame_ticks == 0 and (p.digital or g.s.dog.stale)
    return g.s.slot != 0 or starts or (not p.digital and g.valid < d.tick_clocks * (tick + 1))


@inner
def advance_control(p, g, tick, n, sar, b):
    """The 8 kHz side over the window of a block, the FPGA's own demodulator, and the ticks in which words are known.

    sar  the two samples of the demodulator. Mutates `b`
    """
    at = p.design.tick_clocks * tick
    s, sid = g.s, g.sid
    window_at = FAR
    if p.digital:
        if tick % p.design.frame_ticks == 0:
            b.sar[0, 0], b.sar[1, 0] = sar[0], sar[1]
            b.refs[0] = g.refs
            sid = demodulate(p, sid, tick, 0, 1, b)
            window_at = at + DUMP_CLOCKS
    elif g.valid < at + p.design.tick_clocks:
        window_at = g.valid
    s, ticks = window.advance_window(p, s, sid, g.channels, g.coming, g.falls, g.ok, g.new_ok, window_at, tick, n, b)
    return s, sid, ticks


@inner
def before_ticks(p, rom, g, faults, tick, n, sar, drive_codes, sense_codes, b):
    """`n` ticks from `tick` on, up to the plant: what is carried, and the number of reference edges.

    sar  as for `advance_control`. Mutates both codes (those at the end of each tick) and `b`
    """
    s, sid, window_ticks = g.s, g.sid, 0
    if await_frame(p, g, tick):
        s, sid, window_ticks = advance_control(p, g, tick, n, sar, b)
    return words_of_ticks(p, rom, g, s, sid, window_ticks, faults, tick, n, drive_codes, sense_codes, b)


@inner
def words_of_ticks(p, rom, g, s, sid, window_ticks, faults, tick, n, drive_codes, sense_codes, b):
    """The second half of `before_ticks`: what the pins show of the 8 kHz side `s`; `b` has its `window_ticks`."""
    amplitude, rate = control.amplitude(p.control, s.control), s.control.rate_loop.loop.y
    init = sequencer.outputs(s.control.sequencer).dac_init
    for k in range(n):
        # a test instead of a shorter range, which would keep LLVM from writing eight at a time
        if k >= window_ticks:
            b.amplitude[k] = amplitude
            b.rate[k] = rate
            b.control_load[HISTORY + k] = init
    s = s._replace(
        dog=_age_watchdog(p.watchdog, s.dog, n - window_ticks), quadrature=_end_quadrature(p, s, tick, window_ticks, n)
    )
    pins.dac_codes(p, rom, s.bank, s.turn, tick, n, b)
    mixed = window_ticks > 0 or init == 1
    enabled, staged = pins.words_of_ticks(p, drive_codes, sense_codes, n, g.enabled, g.staged, mixed, b)
    drive_code, sense_code = drive_codes[n - 1], sense_codes[n - 1]
    if faults.dac[0] or faults.dac[1]:
        for k in range(n):
            drive_codes[k] = faults.dac_code[0] if faults.dac[0] else drive_codes[k]
            sense_codes[k] = faults.dac_code[1] if faults.dac[1] else sense_codes[k]
    count, refs = pins.reference_edges(p.design, p.references, s.turn, s.bank, tick, tick + n, g.refs, b)
    pins_now = g._replace(refs=refs, enabled=enabled, staged=staged, drive_code=drive_code, sense_code=sense_code)
    return pins_now._replace(sid=sid, s=s), count


@inner
def after_ticks(d, g, faults, clock, tick, until, fell, sid):
    """After the plant's ticks up to `until`: the frame that was read, DRDY of this block, and of the tick after it.

    clock  of the ADC; fell  what the plant's block returned; sid  the FPGA's own demodulator by now
    """
    at, span = d.tick_clocks * tick, d.tick_clocks * (until - tick)
    if g.valid < at + span:
        g = g._replace(channels=g.coming, ok=g.new_ok, read=1, falls=FAR, valid=FAR)
    fallen = g.drdy_cycle >= 0
    fell_at = at + g.drdy_cycle
    drdy_cycle = -1
    if fell >= span:
        drdy_cycle = fell - span
    elif fell >= 0:
        fallen = True
        fell_at = at + fell
    if fallen and not faults.silent:
        new_ok = 1 if (faults.status & CHANNEL_MASK) >> spi_adc.HEAD_SHIFT == spi_adc.HEAD else 0
        coming = engine.sent_codes(d.adc_word_bits, faults, clock, g.coming[:5])
        g = g._replace(falls=fell_at, valid=fell_at + valid_clocks(d), coming=coming, new_ok=new_ok)
    turn = g.s.turn
    if at + span - turn.clock > 64:
        turn = drop_history(turn, at + span)
    return g._replace(sid=sid, s=g.s._replace(turn=turn), drdy_cycle=drdy_cycle)

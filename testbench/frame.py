"""Frame engine: from event to event; every register and code to the last bit that of the clocked engine, but faster.

    quiet tick     no ADC read, no 8 kHz window and no late register in flight: the firmware is its phase, its words and
                   a few codes, and everything until the next event is a closed form of them
    events         8 kHz window (a valid ADC frame, or stale at ce_8k), frame boundary, DRDY; blocks of ticks in between

    for each block:  words of its ticks        the window's slots one by one, or constant
                     DAC codes                 sine.at and modulator.at of phase(26 k - pipeline), one per tick
                     reference edges           one division per quarter turn
                     plant.block               the same step that the clocked engine calls with one tick
    chunk          clocked ticks to a quiet one | blocks | FLUSH clocked ticks without plant | clocked ticks to the end

What the blocks do not carry along (shift registers, counters, pipelines) has a memory of less than FLUSH ticks: running
the clocked firmware that long from the words alone restores every register, and the phase, codes and pins that it
arrives at must be those of the blocks, or the run stops with an error.
Source    docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

from __future__ import annotations  # a field may bear the name of its module

import numpy as np

from analog_frontend import adc, linear
from analog_frontend import top as plant
from fpga_model import (
    control,
    digital_sid,
    references,
    sequencer,
    spi_adc,
    spi_dac,
    watchdog,
)
from fpga_model.jit import hot, inner, outlined
from fpga_model.rates import FRAME_TICKS, TICK_CYCLES
from testbench import engine, pins, window
from testbench.flush import CHANNEL_MASK, FLUSH, Arrived, arrived, completed, rebuilt
from testbench.pins import buffers
from testbench.turn import WORD_LIMIT, Turn, phase_at, steady, word_at
from testbench.window import HISTORY, LAST_ODD_TICK, VALID_CLOCKS, Window

SETTLED_TICKS = 8  # before this tick after power-on the DACs have not had two frames
READ_TICKS = 30  # from DRDY to a quiet tick: read, window, flush
WINDOW_TICKS = 12  # from a window at a frame boundary to a quiet tick
SHORTEST = 3 * FLUSH
# typed: Numba compiles a function anew for every constant that it is called with
FAR, ZERO, ONE = np.int64(1 << 62), np.int64(0), np.int64(1)
DRIVE_CLOCK = np.int64(spi_dac.LOAD_TICK + spi_dac.latch_cycles(spi_dac.DAC8811))
SENSE_CLOCK = np.int64(spi_dac.LOAD_TICK + spi_dac.latch_cycles(spi_dac.AD5791) - TICK_CYCLES)
DUMP_CLOCKS = digital_sid.LATENCY
assert 0 < DRIVE_CLOCK < TICK_CYCLES, "the drive DAC follows in the tick of its load"
assert 0 <= SENSE_CLOCK < TICK_CYCLES, "the sense DAC follows in the tick after its load"


@inner
def _quiet(f, chips, tick):
    """1 when nothing is in flight that the blocks do not know."""
    word = f.control.frequency_tracker.word
    calm = f.rates.slot == 0 and f.adc.busy == 0 and f.adc.valid == 0 and f.adc.meta == 1 and f.adc.sync == 1
    calm = calm and f.adc.seen == 1 and chips.adc.drdy_n == 1 and chips.adc.pulse == 0
    # V_q's last load of a frame may have gone out before the root was done, if a window has just ended
    calm = calm and f.sid.stage == 0 and f.sid.valid == 0 and tick % FRAME_TICKS != LAST_ODD_TICK + 1
    return calm and tick >= SETTLED_TICKS and 0 < word < WORD_LIMIT


@inner
def _stop(end, ready):
    """The last tick before `end` at which the firmware is quiet and has been for FLUSH ticks; DRDY falls at `ready`."""
    for _ in range(2):
        if ready // TICK_CYCLES < end < ready // TICK_CYCLES + READ_TICKS:
            end = ready // TICK_CYCLES
        if 0 < end % FRAME_TICKS < WINDOW_TICKS:
            end = end - end % FRAME_TICKS
    return end


@inner
def _loaded(p, s, tick, known, n):
    """Code of V_q's DAC at the frame's end, after ticks `known` .. `n` - 1 of a block outside of a window."""
    for k in range(known, n):
        frame_tick = (tick + k) % FRAME_TICKS
        if frame_tick <= LAST_ODD_TICK and (p.quadrature_fast == 1 or frame_tick & 1 == 1):
            return s.control.quadrature_loop.root.y
    return s.quadrature


@inner
def _frame(p, a, chunk, tick, c, codes, drive_code, sense_code, quadrature):
    """A frame begins: the plant's matrix for it, and a row of both streams. Mutates `a` and the streams."""
    n = tick // FRAME_TICKS - chunk.begin // FRAME_TICKS
    row = n if chunk.begin % FRAME_TICKS == 0 else n - 1
    rate_rad_s, temp_degc = chunk.rate_rad_s[n], chunk.temp_degc[n]
    v_q = chunk.faults.dac_code[2] if chunk.faults.dac[2] else quadrature
    plant.retune(p.plant, a, rate_rad_s, v_q, temp_degc)
    frames, truth = chunk.o.frames, chunk.o.truth
    if row < frames.shape[0]:
        engine.record_frame(
            frames[row], truth[row], c, codes, drive_code, sense_code, quadrature, a.z, temp_degc, rate_rad_s
        )


@outlined
def _demodulated(p, sid, tick, first, end, b):
    """The FPGA's own demodulator over ticks `first` .. `end` - 1 of a block that begins at `tick`.

    One edge a tick, and at a dump those until its codes are out.
    """
    for k in range(first, end):
        dump = 1 if (tick + k) % FRAME_TICKS == 0 else 0
        sid = digital_sid.step(p.sid, sid, 1, dump, b.refs[k], b.sar[0, k], b.sar[1, k])
        if dump:
            for _ in range(DUMP_CLOCKS):
                sid = digital_sid.step(p.sid, sid, 0, 0, 0, 0, 0)
    return sid


@outlined
def _sampled(p, a, count, n, refs, b):
    """Samples and reference pins of the block's ticks, for the FPGA's own demodulator. Mutates `a` and `b`."""
    w = a.work.w
    x, y, drive = linear.CX3 * linear.STRIDE, linear.CY3 * linear.STRIDE, linear.D3 * linear.STRIDE
    b.sar[0, 0], b.sar[1, 0] = a.sar[0], a.sar[1]
    k = 0
    for t in range(n):
        while k < count and b.edges[k, 0] < TICK_CYCLES * t:
            refs = refs ^ (1 << b.edges[k, 1])
            k += 1
        b.refs[t] = refs
        v = w[drive + t]
        noise_x, noise_y = plant.aperture_noise(p, a.work, t, v)
        b.sar[0, t + 1] = plant.sampled(p, w[x + t] + noise_x)
        b.sar[1, t + 1] = plant.sampled(p, w[y + t] + noise_y)
    a.sar[0], a.sar[1] = b.sar[0, n], b.sar[1, n]


@inner
def _aged(p, dog, ticks):
    """The watchdog after `ticks` without a frame."""
    age = min(dog.age + ticks, watchdog.AGE_TOP)
    return watchdog.State(age, 1 if ticks > 0 and age > p.limit else dog.stale)


@outlined
def _probe(o, first, n, turn, a, tick, b, count, refs):
    """Rows of the phase meter for a block whose first tick is row `first`."""
    w, stride = a.work.w, linear.STRIDE
    for t in range(n):
        if first + t >= o.probe_ints.shape[0]:
            break
        ints, values = o.probe_ints[first + t], o.probe_floats[first + t]
        ints[0] = phase_at(turn, TICK_CYCLES * (tick + t))
        ints[1] = word_at(turn, TICK_CYCLES * (tick + t))
        ints[2] = a.work.drive_codes[t]
        ints[3] = a.work.sense_codes[t]
        for k in range(6):
            values[k] = w[k * stride + t]
        values[6] = w[linear.X * stride + t]
        values[7] = w[linear.Y * stride + t]
        values[8] = w[linear.CX3 * stride + t]
        values[9] = w[linear.CY3 * stride + t]
        values[10] = w[linear.LEVEL_DRIVE * stride + t]
        values[11] = w[linear.LEVEL_DRIVE * stride + t + 1] - values[10]
        values[12] = w[linear.LEVEL_SENSE * stride + t]
        values[13] = w[linear.LEVEL_SENSE * stride + t + 1] - values[12]
    for k in range(count):
        clock, which = b.edges[k, 0], b.edges[k, 1]
        refs = refs ^ (1 << which)
        inside = first + clock // TICK_CYCLES < o.probe_ints.shape[0]
        if inside and o.edge_count[0] < o.edges.shape[0]:
            row = o.edges[o.edge_count[0]]
            row[0] = phase_at(turn, TICK_CYCLES * tick + clock)
            row[1] = which
            row[2] = (refs >> which) & 1
            o.edge_count[0] += 1


@hot
def blocks(p, f, chips, a, chunk, tick, end, drdy_cycle, b):
    """From a quiet `tick` to the last quiet one before `end`. Mutates `a` and the streams."""
    g, faults, o = p.fpga, chunk.faults, chunk.o
    word = f.control.frequency_tracker.word
    quadrature = chips.quadrature.code if tick % FRAME_TICKS == 0 else f.control.quadrature_loop.root.y
    s = Window(
        f.control,
        f.registers,
        f.watchdog,
        Turn(TICK_CYCLES * tick, f.dds.phase, word, word, TICK_CYCLES * tick, word),
        ZERO,
        ZERO,
        quadrature,
    )
    sid = f.sid
    refs = references.pins(g.references, f.references)
    enabled, staged = chips.sense.enabled, chips.sense.staged
    drive_code, sense_code = chips.drive.code, chips.sense.code
    b.drive[0], b.drive[1], b.drive[2] = f.drive_modulator.held2, f.drive_modulator.held1, f.drive_modulator.code
    b.sense[0], b.sense[1], b.sense[2] = f.sense_modulator.held2, f.sense_modulator.held1, f.sense_modulator.code
    b.control_load[HISTORY - 1] = sequencer.outputs(s.control.sequencer).dac_init
    read, ok = ZERO, f.adc.ok
    channels, coming = f.adc.channels, f.adc.channels
    falls, valid, new_ok = FAR, FAR, ZERO  # of the frame being read
    status = faults.status & CHANNEL_MASK
    if faults.nan[0]:
        a.z[plant.X] = np.nan
    if faults.nan[1]:
        a.z[plant.Y] = np.nan
    while True:
        at = TICK_CYCLES * tick
        ready = FAR
        if not faults.silent:
            ready = at + (drdy_cycle if drdy_cycle >= 0 else adc.clocks_to_ready(p.plant.adc, a.adc.clock, 0))
        stop = _stop(end, ready)
        if tick >= stop:
            break
        if tick % FRAME_TICKS == 0:
            codes = engine.frame_codes(g, sid.codes, window.received(channels, coming, falls, at))
            _frame(p, a, chunk, tick, s.control, codes, drive_code, sense_code, s.quadrature)
        # how far nothing new can happen
        until = min(stop, (tick // FRAME_TICKS + 1) * FRAME_TICKS, tick + linear.BLOCK)
        if valid // TICK_CYCLES > tick:
            until = min(until, valid // TICK_CYCLES)
        if not faults.silent:
            until = min(until, (ready + VALID_CLOCKS) // TICK_CYCLES)
        until = min(until, tick + adc.clocks_to_ready(p.plant.adc, a.adc.clock, 1) // TICK_CYCLES)
        n = until - tick
        # words
        window_at = FAR
        if g.digital:
            if tick % FRAME_TICKS == 0:
                b.sar[0, 0], b.sar[1, 0] = a.sar[0], a.sar[1]
                b.refs[0] = refs
                sid = _demodulated(g, sid, tick, 0, 1, b)
                window_at = at + DUMP_CLOCKS
        elif valid < at + TICK_CYCLES:
            window_at = valid
        known = 0
        if s.slot != 0 or window_at != FAR or (tick % FRAME_TICKS == 0 and s.dog.stale):
            s, known = window.play(g, s, sid.codes, channels, coming, falls, ok, new_ok, window_at, tick, n, b)
        amplitude, rate = control.amplitude(g.control, s.control), s.control.rate_loop.loop.y
        init = sequencer.outputs(s.control.sequencer).dac_init
        for k in range(n):
            # a test instead of a shorter range, which would keep LLVM from writing eight at a time
            if k >= known:
                b.amplitude[k] = amplitude
                b.rate[k] = rate
                b.control_load[HISTORY + k] = init
        s = Window(
            s.control,
            s.bank,
            _aged(g.watchdog, s.dog, n - known),
            s.turn,
            s.slot,
            s.restarted,
            _loaded(g, s, tick, known, n),
        )
        # codes and edges
        pins.dac_codes(g, s.bank, s.turn, tick, n, b)
        enabled, staged = pins.told(g, a.work, n, enabled, staged, known > 0 or init == 1, b)
        drive_code, sense_code = a.work.drive_codes[n - 1], a.work.sense_codes[n - 1]
        if faults.dac[0] or faults.dac[1]:
            for k in range(n):
                a.work.drive_codes[k] = faults.dac_code[0] if faults.dac[0] else a.work.drive_codes[k]
                a.work.sense_codes[k] = faults.dac_code[1] if faults.dac[1] else a.work.sense_codes[k]
        count, refs_after = pins.reference_edges(g.references, s.turn, s.bank, tick, until, refs, b)
        fell = plant.block(p.plant, a, tick, n, DRIVE_CLOCK, SENSE_CLOCK, count, b.edges)
        # streams
        row = tick - chunk.begin
        if row < o.probe_ints.shape[0]:
            _probe(o, row, n, s.turn, a, tick, b, count, refs)
        for k in range(n):
            if row + k < o.drive_code.shape[0]:
                o.drive_code[row + k] = a.work.drive_codes[k]
                o.sense_code[row + k] = a.work.sense_codes[k]
        o.peak_x[0] = max(o.peak_x[0], linear.largest(a.work.w, n, linear.X))
        if g.digital:
            _sampled(p.plant, a, count, n, refs, b)
            sid = _demodulated(g, sid, tick, 1 if tick % FRAME_TICKS == 0 else 0, n, b)
        # the frame that was read, DRDY of this block, and of the tick after it
        if valid < TICK_CYCLES * until:
            channels, ok, read, falls, valid = coming, new_ok, ONE, FAR, FAR
        fallen = drdy_cycle >= 0
        fell_at = at + drdy_cycle
        drdy_cycle = -1
        if fell >= TICK_CYCLES * n:
            drdy_cycle = fell - TICK_CYCLES * n
        elif fell >= 0:
            fallen = True
            fell_at = at + fell
        if fallen and not faults.silent:
            falls = fell_at
            valid = falls + VALID_CLOCKS
            coming = engine.sent_codes(faults, a.adc.clock)
            new_ok = 1 if status >> spi_adc.HEAD_SHIFT == spi_adc.HEAD else 0
        refs = refs_after
        tick = until
        turn = s.turn
        if TICK_CYCLES * tick - turn.clock > 64:
            turn = steady(turn, TICK_CYCLES * tick)
        s = Window(s.control, s.bank, s.dog, turn, s.slot, s.restarted, s.quadrature)
    phase = phase_at(s.turn, TICK_CYCLES * tick)
    f, chips = rebuilt(f, chips, s, sid, enabled, staged, tick - FLUSH, read, channels, status)
    return Arrived(tick, drdy_cycle, f, chips, sid, s.dog, phase, refs, drive_code, sense_code)


@hot
def _run(p, f, chips, a, chunk, end, drdy_cycle, b):
    """A chunk; returns firmware, chips, clock of DRDY, and 0, or the tick at which the flush met other registers."""
    first, until, closed = chunk.begin, chunk.begin, ONE
    if chunk.o.registers.shape[0] > 0:
        until = end
    x = Arrived(
        ZERO,
        drdy_cycle,
        f,
        chips,
        f.sid,
        f.watchdog,
        f.dds.phase,
        f.references.signs,
        chips.drive.code,
        chips.sense.code,
    )
    while True:
        f, chips, drdy_cycle = engine.run_ticks(p, f, chips, a, chunk, first, until, drdy_cycle, closed)
        if not closed:
            f = completed(f, x.sid, x.dog)
            if not arrived(p.fpga, f, chips, x):
                return f, chips, x.drdy_cycle, x.tick
            first, until, closed, drdy_cycle = x.tick, end, ONE, x.drdy_cycle
        elif until == end:
            return f, chips, drdy_cycle, ZERO
        elif until < chunk.begin + 2 or not _quiet(f, chips, until):
            # two ticks at least: what a window did in the tick before the chunk has then been seen by the DACs
            first, until = until, until + 1
        else:
            ready = adc.clocks_to_ready(p.plant.adc, a.adc.clock, ZERO) if drdy_cycle < 0 else drdy_cycle
            ready = FAR if chunk.faults.silent else TICK_CYCLES * until + ready
            if _stop(end, ready) - until < SHORTEST:
                first, until = until, end
            else:
                x = blocks(p, f, chips, a, chunk, until, end, drdy_cycle, b)
                f, chips, first, until, closed, drdy_cycle = x.fpga, x.chips, x.tick - FLUSH, x.tick, ZERO, -ONE


def run(p, s, ticks, rate_rad_s, temp_degc, write, address, data, faults, o):
    """As `engine.run`, with the same result to the last bit.

    Raises RuntimeError if a register is not what it must be.
    """
    end = s.tick + ticks
    edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
    chunk = engine.Chunk(s.tick, rate_rad_s, temp_degc, write, address, data, faults, o, edges)
    f, chips, drdy_cycle, failed = _run(p, s.fpga, s.chips, s.plant, chunk, end, s.drdy_cycle, buffers())
    if failed:
        raise RuntimeError(f"frame engine: the registers of tick {failed} are not those of the clocked engine")
    return engine.State(f, chips, s.plant, end, drdy_cycle)

"""Frame engine: from event to event; every register and code to the last bit that of the clocked engine, but faster.

    quiet tick     no ADC read, no 8 kHz window and no late register in flight: the firmware is its phase, its words and
                   a few codes, and everything until the next event is a closed form of them
    events         8 kHz window (a valid ADC frame, or stale at ce_8k), frame boundary, DRDY; blocks of ticks in between

    for each block:  block_state.before_ticks  words of its ticks, DAC codes, reference edges
                     plant.advance_ticks       the same step that the clocked engine calls with one tick
                     block_state.after_ticks   frames that the converter has completed
    chunk          clocked ticks to a quiet one | blocks | FLUSH clocked ticks without plant | clocked ticks to the end

What the blocks do not carry along (shift registers, counters, pipelines) has a memory of less than FLUSH ticks: running
the clocked firmware that long from the words alone restores every register, and the phase, codes and pins that it
arrives at must be those of the blocks, or the run stops with an error.
Source    docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

from __future__ import annotations  # a field may bear the name of its module

import numpy as np

from analog_frontend import linear
from analog_frontend import top as plant
from fpga_model import path_clocks
from fpga_model.jit import hot, inner, outlined, unit
from testbench.engines import engine
from testbench.engines.block_state import (
    after_ticks,
    before_ticks,
    codes_at,
    demodulate,
    history,
    last_quiet,
    load_block_state,
    ready_clock,
    ticks_to_event,
)
from testbench.engines.flush import CHANNEL_MASK, FLUSH, Arrival, arrive, complete, rebuilt
from testbench.engines.pins import buffers
from testbench.engines.turn import phase_at, word_at, word_limit
from testbench.engines.window import last_load_tick

SETTLED_TICKS = 8  # before this tick after power-on the DACs have not had two frames
SHORTEST = 3 * FLUSH
# typed: Numba compiles a function anew for every constant that it is called with
ZERO, ONE = np.int64(0), np.int64(1)


@inner
def _quiet(p, f, chips, tick):
    """1 when nothing is in flight that the blocks do not know."""
    d, word = p.design, f.control.frequency_tracker.word
    calm = f.rates.slot == 0 and f.adc.busy == 0 and f.adc.valid == 0 and f.adc.meta == 1 and f.adc.sync == 1
    calm = calm and f.adc.seen == 1 and chips.adc.drdy_n == 1 and chips.adc.pulse == 0
    # V_q's last load of a frame may have gone out before the root was done, if a window has just ended
    calm = calm and f.sid.stage == 0 and f.sid.valid == 0 and tick % d.frame_ticks <= last_load_tick(p)
    return calm and tick >= SETTLED_TICKS and 0 < word < word_limit(d.dds_bits)


@inner
def _frame(p, a, chunk, tick, g):
    """A frame begins: the plant's matrix for it, and a row of both streams. Mutates `a` and the streams."""
    frame_ticks = p.fpga.design.frame_ticks
    n = tick // frame_ticks - chunk.begin // frame_ticks
    row = n if chunk.begin % frame_ticks == 0 else n - 1
    rate_rad_s, temp_degc = chunk.rate_rad_s[n], chunk.temp_degc[n]
    v_q = chunk.faults.dac_code[2] if chunk.faults.dac[2] else g.s.quadrature
    plant.retune(p.plant, a, rate_rad_s, v_q, temp_degc)
    frames, truth = chunk.o.frames, chunk.o.truth
    if row < frames.shape[0]:
        codes = codes_at(p.fpga, g, tick)
        engine.record_frame(
            frames[row],
            truth[row],
            g.s.control,
            codes,
            g.drive_code,
            g.sense_code,
            g.s.quadrature,
            a.z,
            temp_degc,
            rate_rad_s,
        )


@outlined
def _sample_demodulator_inputs(d, p, a, faults, count, n, refs, b):
    """Samples and reference pins of the block's ticks, for the FPGA's own demodulator. Mutates `a` and `b`."""
    w = a.work.w
    x, y, drive = linear.CX3 * linear.STRIDE, linear.CY3 * linear.STRIDE, linear.D3 * linear.STRIDE
    b.sar[0, 0], b.sar[1, 0] = a.sar[0], a.sar[1]
    k = 0
    for t in range(n):
        while k < count and b.edges[k, 0] < d.tick_clocks * t:
            refs = refs ^ (1 << b.edges[k, 1])
            k += 1
        b.refs[t] = refs
        v = w[drive + t]
        noise_x, noise_y = plant.aperture_noise(p, a.work, t, v)
        b.sar[0, t + 1] = engine.faulted_sample(faults, 0, plant.quantize_sar(p, w[x + t] + noise_x), b.sar[0, t])
        b.sar[1, t + 1] = engine.faulted_sample(faults, 1, plant.quantize_sar(p, w[y + t] + noise_y), b.sar[1, t])
    a.sar[0], a.sar[1] = b.sar[0, n], b.sar[1, n]


@outlined
def _probe(d, o, first, n, turn, a, tick, b, count, refs):
    """Rows of the phase meter for a block whose first tick is row `first`."""
    w, stride = a.work.w, linear.STRIDE
    for t in range(n):
        if first + t >= o.probe_ints.shape[0]:
            break
        ints, values = o.probe_ints[first + t], o.probe_floats[first + t]
        ints[0] = phase_at(turn, d.tick_clocks * (tick + t))
        ints[1] = word_at(turn, d.tick_clocks * (tick + t))
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
        inside = first + clock // d.tick_clocks < o.probe_ints.shape[0]
        if inside and o.edge_count[0] < o.edges.shape[0]:
            row = o.edges[o.edge_count[0]]
            row[0] = phase_at(turn, d.tick_clocks * tick + clock)
            row[1] = which
            row[2] = (refs >> which) & 1
            o.edge_count[0] += 1


@unit
def advance_blocks(p, a, chunk, g, tick, end, limit, b):
    """Blocks from `tick` on, to the last quiet tick before `end` or to `limit`: what is carried then, and the tick.

    Mutates `a`, `b` and the streams.
    """
    faults, o, d = chunk.faults, chunk.o, p.fpga.design
    drive_clock, sense_clock = path_clocks.dac_clocks(p.fpga)
    while tick < limit:
        until = min(ticks_to_event(d, p.plant.adc, a.adc.clock, faults.silent, g, tick, end), limit)
        if until == tick:
            break
        n = until - tick
        if tick % d.frame_ticks == 0:
            _frame(p, a, chunk, tick, g)
        refs = g.refs
        g, count = before_ticks(p.fpga, p.rom, g, faults, tick, n, a.sar, a.work.drive_codes, a.work.sense_codes, b)
        fell = plant.advance_ticks(p.plant, a, tick, n, drive_clock, sense_clock, count, b.edges)
        # streams
        row = tick - chunk.begin
        if row < o.probe_ints.shape[0]:
            _probe(d, o, row, n, g.s.turn, a, tick, b, count, refs)
        for k in range(n):
            if row + k < o.drive_code.shape[0]:
                o.drive_code[row + k] = a.work.drive_codes[k]
                o.sense_code[row + k] = a.work.sense_codes[k]
        o.peak_x[0] = max(o.peak_x[0], linear.largest(a.work.w, n, linear.X))
        sid = g.sid
        if p.fpga.digital:
            _sample_demodulator_inputs(d, p.plant, a, faults, count, n, refs, b)
            sid = demodulate(p.fpga, sid, tick, 1 if tick % d.frame_ticks == 0 else 0, n, b)
        g = after_ticks(d, g, faults, a.adc.clock, tick, until, fell, sid)
        tick = until
    return g, tick


@inner
def begin_blocks(p, f, chips, a, faults, tick, drdy_cycle, b):
    """What blocks from a quiet `tick` on carry. Mutates `a` and `b`."""
    history(f, b)
    if faults.nan[0]:
        a.z[plant.X] = np.nan
    if faults.nan[1]:
        a.z[plant.Y] = np.nan
    return load_block_state(p.fpga, f, chips, tick, drdy_cycle)


@hot
def run_blocks(p, f, chips, a, chunk, tick, end, drdy_cycle, b):
    """From a quiet `tick` to the last quiet one before `end`. Mutates `a` and the streams."""
    g = begin_blocks(p, f, chips, a, chunk.faults, tick, drdy_cycle, b)
    g, tick = advance_blocks(p, a, chunk, g, tick, end, end, b)
    return build_arrival(p.fpga.design, f, chips, g, tick, chunk.faults.status)


@inner
def build_arrival(d, f, chips, g, tick, status):
    """Where blocks end: firmware and chips FLUSH ticks before `tick`, and what they must have come to by then."""
    status = status & CHANNEL_MASK
    phase = phase_at(g.s.turn, d.tick_clocks * tick)
    f, chips = rebuilt(d, f, chips, g.s, g.sid, g.enabled, g.staged, tick - FLUSH, g.read, g.channels, status)
    return Arrival(tick, g.drdy_cycle, f, chips, g.sid, g.s.dog, phase, g.refs, g.drive_code, g.sense_code)


@unit
def enter_block_mode(p, f, chips, a, chunk, end, drdy_cycle):
    """Clocked ticks of a chunk up to the first quiet one with room for blocks behind it, or to `end`.

    Returns firmware, chips, clock of DRDY, and that tick.
    """
    d, first, until = p.fpga.design, chunk.begin, chunk.begin
    if chunk.o.registers.shape[0] > 0:
        until = end
    while True:
        f, chips, drdy_cycle = engine.run_ticks(p, f, chips, a, chunk, first, until, drdy_cycle, ONE)
        if until == end:
            return f, chips, drdy_cycle, until
        # two ticks at least: what a window did in the tick before the chunk has then been seen by the DACs
        if until >= chunk.begin + 2 and _quiet(p.fpga, f, chips, until):
            ready = ready_clock(d, p.plant.adc, a.adc.clock, chunk.faults.silent, drdy_cycle, until)
            if last_quiet(d, end, ready) - until >= SHORTEST:
                return f, chips, drdy_cycle, until
            first, until = until, end
        else:
            first, until = until, until + 1


@unit
def exit_block_mode(p, x, a, chunk, end):
    """From the end of the blocks to that of the chunk: the flush of the registers, then clocked ticks.

    Returns firmware, chips, clock of DRDY, and 0, or the tick at which the flush met other registers.
    """
    f, chips, _ = engine.run_ticks(p, x.fpga, x.chips, a, chunk, x.tick - FLUSH, x.tick, -ONE, ZERO)
    f = complete(f, x.sid, x.dog)
    if not arrive(p.fpga, f, chips, x):
        return f, chips, x.drdy_cycle, x.tick
    f, chips, drdy_cycle = engine.run_ticks(p, f, chips, a, chunk, x.tick, end, x.drdy_cycle, ONE)
    return f, chips, drdy_cycle, ZERO


@hot
def _run(p, f, chips, a, chunk, end, drdy_cycle, b):
    """A chunk; returns firmware, chips, clock of DRDY, and 0, or the tick at which the flush met other registers."""
    f, chips, drdy_cycle, tick = enter_block_mode(p, f, chips, a, chunk, end, drdy_cycle)
    if tick == end:
        return f, chips, drdy_cycle, ZERO
    return exit_block_mode(p, run_blocks(p, f, chips, a, chunk, tick, end, drdy_cycle, b), a, chunk, end)


def run(p, s, ticks, rate_rad_s, temp_degc, host, faults, o):
    """As `engine.run`, with the same result to the last bit.

    Raises RuntimeError if a register is not what it must be.
    """
    end = s.tick + ticks
    edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
    chunk = engine.Chunk(s.tick, rate_rad_s, temp_degc, *host, faults, o, edges)
    f, chips, drdy_cycle, failed = _run(p, s.fpga, s.chips, s.plant, chunk, end, s.drdy_cycle, buffers())
    if failed:
        raise RuntimeError(f"frame engine: the registers of tick {failed} are not those of the clocked engine")
    return engine.State(f, chips, s.plant, end, drdy_cycle)

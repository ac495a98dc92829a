"""Clocked engine: every register at every edge of 26 MHz, closed around the plant. The reference for everything else.

    for each tick:  host writes and faults of the tick
                    26 edges of the firmware, with the pins of the three DACs and of the ADC stepped at each edge
                    one plant step, told the clock of every pin event
                    once a frame (125 ticks): rate, V_q and temperature make the plant's matrix; one row is recorded

The firmware of tick k sees conversions of plant ticks before k only: DRDY falls a tick or more after the last sample.
Arrays of State are mutated in place; everything else is a record of integers.
Source    docs/architecture.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

import numpy as np

from analog_frontend import tick as plant_tick
from analog_frontend import top as plant
from analog_frontend.parts import adc, adc_serial, dac_serial
from fpga_model import block, dds, references
from fpga_model import top as fpga
from fpga_model.fixed import bits, clamp, signed_bits, wrap
from fpga_model.jit import hot, inner, outlined
from testbench.engines import chips as board
from testbench.flatten import store

MAX_EDGES = plant.MAX_EDGES
CODES = adc.CODES
WORD_BITS = 24
CODE_LO, CODE_HI = signed_bits(WORD_BITS).lo, signed_bits(WORD_BITS).hi
# typed: Numba compiles a function anew for every constant that it is called with
ZERO = np.int64(0)


class Chips(NamedTuple):
    """The digital sides of the converters."""

    drive: dac_serial.State
    sense: dac_serial.State
    quadrature: dac_serial.State
    adc: adc_serial.State


class Params(NamedTuple):
    """Firmware, plant and the firmware's table of the sine; the DACs' own parameters."""

    fpga: fpga.Params
    plant: plant.Params
    rom: np.ndarray
    chips: board.Chips


class State(NamedTuple):
    """Everything that a run continues from."""

    fpga: fpga.State
    chips: Chips
    plant: plant.State
    tick: int = 0
    drdy_cycle: int = -1


class Faults(NamedTuple):
    """Faults in force: what is wrong with the ADC's frames, the DAC outputs and the plant."""

    silent: int = 0  # DRDY_N never falls
    status: int = adc_serial.status_word()
    channel: tuple = (0, 0, 0, 0, 0)  # what is wrong with each channel of the ADC: 0, or one of WRONG from 1 on
    value: tuple = (0, 0, 0, 0, 0)  # of what is wrong
    lost_bit: int = 0  # the bits of a frame behind this one come one early; 0: all bits come
    dac: tuple = (0, 0, 0)  # 1: the output keeps `dac_code`
    dac_code: tuple = (0, 0, 0)
    nan: tuple = (0, 0)  # 1: x or y is not a number
    sample: tuple = (0, 0)  # of C/V x and y: 1: it is `sample_code`, 2: that of the tick before
    sample_code: tuple = (0, 0)


# What a faulty channel of the ADC sends: a code, its last one, its own plus a value, times value / 2^16, or another's
WRONG = ("stuck", "frozen", "offset", "gain", "swapped")
STUCK, FROZEN, OFFSET, GAIN, SWAPPED = range(1, len(WRONG) + 1)


# One row per frame, in this order. Codes and words are raw; widths as in the blocks' formats.
FRAME_COLUMNS = (
    ("adc_drive_sin", "code", signed_bits(24)),
    ("adc_drive_cos", "code", signed_bits(24)),
    ("adc_sense_sin", "code", signed_bits(24)),
    ("adc_sense_cos", "code", signed_bits(24)),
    ("adc_temperature", "code", signed_bits(24)),
    ("frequency_word", "turn/2^{dds_bits}", dds.PHASE),
    ("amplitude_word", "10 V/2^23", signed_bits(24)),
    ("rate_word", "10 V/2^23", signed_bits(24)),
    ("quadrature_code", "5.5 V/2^16", bits(16)),
    ("magnitude", "code", bits(25)),
    ("phase", "turn/2^24", signed_bits(24)),
    ("state", "", bits(4)),
    ("lock", "", bits(4)),
    ("flags", "", bits(16)),
    ("rate_output", "deg/s/2^20", signed_bits(32)),
    ("drive_dac_code", "code", signed_bits(16)),
    ("sense_dac_code", "code", signed_bits(20)),
    ("quadrature_dac_code", "code", bits(16)),
)
# The plant's own truth at the frame's first instant; nobody on a real bench has it.
TRUTH_COLUMNS = (("x", "m"), ("vx", "m"), ("y", "m"), ("vy", "m"), ("temperature", "degC"), ("rate", "rad/s"))
# What a phase meter needs of a tick: reference phase, and nodes at its first instant.
PROBE_INTS = ("theta", "word", "drive_code", "sense_code")
PROBE_FLOATS = (
    "d1",
    "d2",
    "d3",
    "s1",
    "s2",
    "s3",
    "x",
    "y",
    "cv_x",
    "cv_y",
    "u_drive",
    "du_drive",
    "u_sense",
    "du_sense",
)


class Streams(NamedTuple):
    """Where a chunk writes; arrays of length zero switch a stream off."""

    drive_code: np.ndarray  # int32 per tick, the DAC's output code at its end
    sense_code: np.ndarray
    frames: np.ndarray  # int64 (frames, len(FRAME_COLUMNS))
    truth: np.ndarray  # float64 (frames, len(TRUTH_COLUMNS))
    registers: np.ndarray  # int64 (edges, registers): every register before each edge
    pins: np.ndarray  # int64 (edges, len(PIN_COLUMNS))
    probe_ints: np.ndarray  # int64 (ticks, len(PROBE_INTS))
    probe_floats: np.ndarray  # float64 (ticks, len(PROBE_FLOATS))
    edges: np.ndarray  # int64 (n, 3): theta at the edge, reference number, new level
    edge_count: np.ndarray  # int64 (1,)
    peak_x: np.ndarray  # float64 (1,) largest |x| seen


NO_WRITE = (0, 0, 0)


class Chunk(NamedTuple):
    """What a chunk of ticks is told: stimulus per frame begun, one host write at its first edge, faults, streams."""

    begin: int  # its first tick
    rate_rad_s: np.ndarray  # the first value is for the frame in progress
    temp_degc: np.ndarray
    write: int
    address: int
    data: int
    faults: Faults
    o: Streams
    edges: np.ndarray  # scratch


CODE_COLUMNS = ("drive_code", "sense_code", "quadrature_code")
PIN_COLUMNS = ("drdy_n", "dout", *fpga.Pins._fields, *CODE_COLUMNS)


def streams(ticks=0, frames=0, edges=0, probe_ticks=0, register_count=0):
    """Buffers for a chunk of `ticks`; `edges` clocks of registers, `probe_ticks` ticks of the phase meter."""
    return Streams(
        np.zeros(ticks, np.int32),
        np.zeros(ticks, np.int32),
        np.zeros((frames, len(FRAME_COLUMNS)), np.int64),
        np.zeros((frames, len(TRUTH_COLUMNS))),
        np.zeros((edges, register_count), np.int64),
        np.zeros((edges, len(PIN_COLUMNS)), np.int64),
        np.zeros((probe_ticks, len(PROBE_INTS)), np.int64),
        np.zeros((probe_ticks, len(PROBE_FLOATS))),
        np.zeros((probe_ticks // 4 + 8 if probe_ticks else 0, 3), np.int64),
        np.zeros(1, np.int64),
        np.zeros(1),
    )


def reset(params, temp_degc):
    """Power-on."""
    chips = Chips(
        *map(dac_serial.reset, params.chips),
        adc_serial.State(),
    )
    firmware = block.reset(fpga.reset(params.fpga.design), params.fpga)
    plant_state = plant.reset(params.plant, chips.drive.code, chips.sense.code, temp_degc)
    return State(firmware, chips, plant_state, 0, -1)


@inner
def chips_after(parts, word_bits, chips, pins, ldacs, loaded, status, codes):
    """The converters' digital sides after an edge that left these `fpga.Pins` and `fpga.other_ldacs`.

    parts, word_bits  of the DACs, and of a word of the ADC
    """
    q = pins.quadrature_sync_n, pins.quadrature_sclk_en, pins.quadrature_sdin
    d = pins.drive_sync_n, pins.drive_sclk_en, pins.drive_sdin
    s = pins.sense_sync_n, pins.sense_sclk_en, pins.sense_sdin
    return Chips(
        dac_serial.step(parts.drive, chips.drive, d[0], d[1], d[2], ldacs[0]),
        dac_serial.step(parts.sense, chips.sense, s[0], s[1], s[2], pins.sense_ldac_n),
        dac_serial.step(parts.quadrature, chips.quadrature, q[0], q[1], q[2], ldacs[1]),
        adc_serial.step(word_bits, chips.adc, pins.adc_cs_n, pins.adc_sclk, loaded, status, codes),
    )


@inner
def _sent(faults, k, clock, before):
    """Code of channel `k`; `before` are those of the frame before."""
    wrong, value, code = faults.channel[k], faults.value[k], clock[CODES + k]
    if wrong == STUCK:
        return value
    if wrong == FROZEN:
        return before[k]
    if wrong == OFFSET:
        return clamp(code + value, CODE_LO, CODE_HI)
    if wrong == GAIN:
        return (code * value) >> 16
    return clock[CODES + value] if wrong == SWAPPED else code


@inner
def _lost_bit_code(word_bits, lost_bit, k, code, following):
    """Code of channel `k` if the frame has lost a bit: those behind it come one early, then one of `following`."""
    unshifted_bits, spare = min(word_bits * (k + 2) - lost_bit, word_bits), WORD_BITS - word_bits
    if lost_bit == 0 or unshifted_bits <= 0:
        return code
    word = code >> spare
    shifted_low_bits = ((word << 1) | ((following >> (WORD_BITS - 1)) & 1)) & ((1 << unshifted_bits) - 1)
    return wrap((((word >> unshifted_bits) << unshifted_bits) | shifted_low_bits) << spare, WORD_BITS)


@outlined
def sent_codes(word_bits, faults, clock, before):
    """What the ADC sends on its eight channels: its last conversion, or what a fault puts in its place.

    word_bits  of a word on the line: so many bits of a code are sent
    before     the codes that it sent in the frame before
    """
    top = -1 << (WORD_BITS - word_bits)
    c0, c1 = _sent(faults, 0, clock, before) & top, _sent(faults, 1, clock, before) & top
    c2, c3 = _sent(faults, 2, clock, before) & top, _sent(faults, 3, clock, before) & top
    c4, lost = _sent(faults, 4, clock, before) & top, faults.lost_bit
    return (
        _lost_bit_code(word_bits, lost, 0, c0, c1),
        _lost_bit_code(word_bits, lost, 1, c1, c2),
        _lost_bit_code(word_bits, lost, 2, c2, c3),
        _lost_bit_code(word_bits, lost, 3, c3, c4),
        _lost_bit_code(word_bits, lost, 4, c4, ZERO),
        ZERO,
        ZERO,
        ZERO,
    )


@inner
def codes_before(chips):
    """The codes that the ADC sent last."""
    w = chips.adc.result
    return (
        wrap(w[1], WORD_BITS),
        wrap(w[2], WORD_BITS),
        wrap(w[3], WORD_BITS),
        wrap(w[4], WORD_BITS),
        wrap(w[5], WORD_BITS),
    )


@inner
def faulted_sample(faults, k, sample, before):
    """Sample of a C/V output, x or y, or what a fault puts in its place; `before` is that of the tick before."""
    if faults.sample[k] == 1:
        return faults.sample_code[k]
    return before if faults.sample[k] else sample


@outlined
def _record_pins(row, p, s, chips):
    codes = chips.drive.code, chips.sense.code, chips.quadrature.code
    store(row, (chips.adc.drdy_n, adc_serial.dout(chips.adc), fpga.pins(p, s), codes))


@inner
def frame_codes(p, sid_codes, channels):
    """The five codes of a frame: of the demodulator in the FPGA, or of the converter."""
    if p.digital:
        return sid_codes[0], sid_codes[1], sid_codes[2], sid_codes[3], channels[4]
    return channels[0], channels[1], channels[2], channels[3], channels[4]


@outlined
def record_frame(row, truth, c, codes, drive_code, sense_code, quadrature_code, z, temp_degc, rate_rad_s):
    """One row of both streams: control `c`, the first five of `codes`, the chips' codes, the plant's state `z`."""
    words = c.frequency_tracker.word, c.agc.loop.y, c.rate_loop.loop.y, c.quadrature_loop.root.y
    state = c.sequencer.state, c.sequencer.lock.locked, c.sequencer.faults.flags
    dacs = drive_code, sense_code, quadrature_code
    store(row, (codes[:5], words, c.cordic.magnitude, c.cordic.phase, state, c.rate_output.y, dacs))
    truth[0] = z[plant.X]
    truth[1] = z[plant.VX]
    truth[2] = z[plant.Y]
    truth[3] = z[plant.VY]
    truth[4] = temp_degc
    truth[5] = rate_rad_s


def run(p, s, ticks, rate_rad_s, temp_degc, host, faults, o):
    """Advance by `ticks`; returns the new State, whose arrays are those of `s`, moved on.

    rate_rad_s, temp_degc  per frame begun in this chunk, the first for the frame in progress
    host                   one write at the first edge of the chunk: (1, address, data); NO_WRITE for none
    faults                 in force during the whole chunk
    o                      Streams
    """
    edges = np.zeros((MAX_EDGES, 2), np.int64)
    chunk = Chunk(s.tick, rate_rad_s, temp_degc, *host, faults, o, edges)
    end = s.tick + ticks
    f, chips, drdy_cycle = run_ticks(p, s.fpga, s.chips, s.plant, chunk, s.tick, end, s.drdy_cycle, 1)
    return State(f, chips, s.plant, end, drdy_cycle)


@inner
def begin_frame(p, f, chips, a, chunk, tick):
    """A frame begins: the plant's matrix for it, and a row of both streams. Mutates `a` and the streams."""
    frame_ticks = p.fpga.design.frame_ticks
    n = tick // frame_ticks - chunk.begin // frame_ticks
    row = n if chunk.begin % frame_ticks == 0 else n - 1
    rate_rad_s, temp_degc, o = chunk.rate_rad_s[n], chunk.temp_degc[n], chunk.o
    v_q = chunk.faults.dac_code[2] if chunk.faults.dac[2] else chips.quadrature.code
    plant_tick.retune(p.plant, a, rate_rad_s, v_q, temp_degc)
    if row < o.frames.shape[0]:
        record_frame(
            o.frames[row],
            o.truth[row],
            f.control,
            frame_codes(p.fpga, f.sid.codes, f.adc.channels),
            chips.drive.code,
            chips.sense.code,
            chips.quadrature.code,
            a.z,
            temp_degc,
            rate_rad_s,
        )


@inner
def _probe(o, k, f, a):
    """Row `k` of the phase meter, what it shows before the tick."""
    ints, values, z = o.probe_ints[k], o.probe_floats[k], a.z
    ints[0] = f.dds.phase
    ints[1] = f.control.frequency_tracker.word
    for i in range(6):
        values[i] = z[i]
    values[6] = z[plant.X]
    values[7] = z[plant.Y]
    values[8] = z[plant.CV_X]
    values[9] = z[plant.CV_Y]
    values[10] = a.volts[0]
    values[12] = a.volts[1]


@inner
def changed_references(edges, count, o, probed, c, theta, refs, now):
    """Edges of the reference pins at clock `c` of a tick; returns how many the tick has had."""
    for d in range(4):
        if ((now ^ refs) >> d) & 1 and count < MAX_EDGES:
            edges[count, 0] = c
            edges[count, 1] = d
            count += 1
            if probed and o.edge_count[0] < o.edges.shape[0]:
                e = o.edges[o.edge_count[0]]
                e[0] = theta
                e[1] = d
                e[2] = (now >> d) & 1
                o.edge_count[0] += 1
    return count


@inner
def end_tick(p, chips, a, chunk, tick, drive_cycle, sense_cycle, edge_count):
    """The plant's tick, with what the chips put out or a fault holds: clock of DRDY, codes of drive and sense.

    Mutates `a`, the codes' streams and the peak.
    """
    faults, o, k = chunk.faults, chunk.o, tick - chunk.begin
    drive_code = faults.dac_code[0] if faults.dac[0] else chips.drive.code
    sense_code = faults.dac_code[1] if faults.dac[1] else chips.sense.code
    if faults.dac[0] and drive_code != a.codes[0]:
        drive_cycle = max(drive_cycle, 0)
    if faults.dac[1] and sense_code != a.codes[1]:
        sense_cycle = max(sense_cycle, 0)
    if faults.nan[0]:
        a.z[plant.X] = np.nan
    if faults.nan[1]:
        a.z[plant.Y] = np.nan
    pins = plant.Pins(drive_code, drive_cycle, sense_code, sense_cycle, edge_count)
    drdy_cycle = plant_tick.step(p.plant, a, tick, pins, chunk.edges)
    if k < o.drive_code.shape[0]:
        o.drive_code[k] = drive_code
        o.sense_code[k] = sense_code
    x = abs(a.z[plant.X])
    if x > o.peak_x[0]:
        o.peak_x[0] = x
    return drdy_cycle, drive_code, sense_code


@hot
def run_ticks(p, f, chips, a, chunk, first, end, drdy_cycle, closed):
    """Ticks `first` .. `end` - 1 of a chunk; returns firmware, chips, clock of DRDY.

    closed  0: firmware and chips alone, nothing recorded, no plant
    """
    begin, faults, o, edges = chunk.begin, chunk.faults, chunk.o, chunk.edges
    clocks, frame_ticks = p.fpga.design.tick_clocks, p.fpga.design.frame_ticks
    word_bits = p.fpga.design.adc_word_bits
    refs = references.pins(p.fpga.references, f.references)
    for tick in range(first, end):
        k = tick - begin
        if tick % frame_ticks == 0 and closed:
            begin_frame(p, f, chips, a, chunk, tick)
        # the aperture is the tick's first instant; the codes arrive a tick later
        sample_x, sample_y = a.sar[0], a.sar[1]
        if p.fpga.digital and closed:
            a.sar[0] = faulted_sample(faults, 0, plant_tick.sar_code(p.plant, a, tick, 0), sample_x)
            a.sar[1] = faulted_sample(faults, 1, plant_tick.sar_code(p.plant, a, tick, 1), sample_y)
        probed = closed and k < o.probe_ints.shape[0]
        if probed:
            _probe(o, k, f, a)
        codes = sent_codes(word_bits, faults, a.adc.clock, codes_before(chips))
        drive_cycle, sense_cycle, edge_count = -1, -1, 0
        for c in range(clocks):
            at = k * clocks + c
            if at < o.registers.shape[0] and closed:
                store(o.registers[at], f)
                _record_pins(o.pins[at], p.fpga, f, chips)
            host = chunk.write if at == 0 else 0
            theta = f.dds.phase
            f = fpga.step(
                p.fpga,
                p.rom,
                f,
                fpga.Inputs(
                    chips.adc.drdy_n, adc_serial.dout(chips.adc), sample_x, sample_y, host, chunk.address, chunk.data
                ),
            )
            loaded = 1 if c == drdy_cycle and faults.silent == 0 else 0
            pins, ldacs = fpga.pins(p.fpga, f), fpga.other_ldacs(f)
            chips = chips_after(p.chips, word_bits, chips, pins, ldacs, loaded, faults.status, codes)
            if chips.drive.updated:
                drive_cycle = c
            if chips.sense.updated:
                sense_cycle = c
            now = references.pins(p.fpga.references, f.references)
            if now != refs:
                edge_count = changed_references(edges, edge_count, o, probed, c, theta, refs, now)
                refs = now
        if not closed:
            continue
        before_drive, before_sense = a.volts[0], a.volts[1]
        tick_outputs = end_tick(p, chips, a, chunk, tick, drive_cycle, sense_cycle, edge_count)
        drdy_cycle = tick_outputs[0]
        if probed:
            o.probe_ints[k, 2] = tick_outputs[1]
            o.probe_ints[k, 3] = tick_outputs[2]
            o.probe_floats[k, 11] = a.volts[0] - before_drive
            o.probe_floats[k, 13] = a.volts[1] - before_sense
    return f, chips, drdy_cycle

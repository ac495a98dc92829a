"""RTL and model clock by clock, the plant on the RTL's pins: no pin of the model reaches the plant.

    before edge n   every register and output pin of the RTL is compared with the model's: 226 values
    edge n          both get the same DRDY_N, DOUT, samples and host write
    after edge n    the converters see the RTL's pins; DAC codes and reference edges act on the plant at their clocks

Ticks and streams are those of the clocked engine. The first difference ends the run, before the
edge whose row it stands in. That is COMPARE_MODE; in the others nothing is compared:

    RTL_ONLY_MODE  the RTL drives the plant, and no model is stepped
    MODEL_MODE     the model drives the plant

Then the rows of frames have the codes that the ADC sent, and the streams every reference edge: clock, pin, level.
Source  docs/rtl.md
"""

import ctypes
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, register_jitable

from analog_frontend import top as plant
from analog_frontend.parts import adc_serial
from fpga_model import top as fpga
from fpga_model.jit import DISABLED, hot, inlined
from testbench.engines import engine
from testbench.flatten import store
from testbench.golden.loop.library import INPUTS, LDACS_AT, NAMES, REFS_AT, REGISTERS

BUFFER_ROWS = 8  # rows that stay, for a report: a power of two
COMPARE_MODE, RTL_ONLY_MODE, MODEL_MODE = range(3)
COUNT, SIGNAL_COUNT = len(REGISTERS), len(NAMES)
INPUT_COUNT = len(INPUTS)
REFS_MASK = 15
CONVERSION = 2 + adc_serial.CHANNELS


class Rtl(NamedTuple):
    """What a kernel needs of a `library.Design`, and where it writes."""

    handle: int
    edge: int
    differs: int
    edge_inputs: np.ndarray  # int64 (INPUT_COUNT,): inputs of an edge
    rows: np.ndarray  # int64 (BUFFER_ROWS, SIGNAL_COUNT): the model's last rows, row n at n % BUFFER_ROWS
    comparison_state: np.ndarray  # int64 (4,): row and place of the first difference, pins now, rows compared
    latched: np.ndarray  # int64 (2,): clock of a tick at which drive and sense DAC changed last
    mode: int
    conversions: np.ndarray  # int64 (n, CONVERSION): of a chunk; clock of the end, status, eight codes
    samples: np.ndarray  # int64 (ticks, 2): of a chunk; none without a demodulator in the FPGA
    count: np.ndarray  # int64 (1,): conversions


def connect_rtl(design, mode=COMPARE_MODE):
    """`Rtl` of a design that has just been reset; None for MODEL_MODE."""
    edge_inputs, rows = np.zeros(INPUT_COUNT, np.int64), np.zeros((BUFFER_ROWS, SIGNAL_COUNT), np.int64)
    design_handles = (0, 0, 0) if design is None else (design.handle, design.edge, design.differs)
    pins = 0 if design is None else design.pins
    comparison_state = np.array([-1, -1, pins, 0], np.int64)
    none = np.zeros((0, CONVERSION), np.int64), np.zeros((0, 2), np.int64), np.zeros(1, np.int64)
    return Rtl(*design_handles, edge_inputs, rows, comparison_state, np.full(2, -1, np.int64), mode, *none)


def _call_python(address, handle, array):
    return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p)(address)(handle, array.ctypes.data)


@intrinsic
def _call_native(typingctx, address, handle, array):
    def codegen(context, builder, signature, args):
        data = context.make_array(signature.args[2])(context, builder, args[2]).data
        kind = ir.FunctionType(ir.IntType(64), [ir.IntType(64), data.type])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1], data])

    return types.int64(types.int64, types.int64, array), codegen


if DISABLED:
    call = _call_python
else:

    @register_jitable
    def call(address, handle, array):
        """int64 of the C function at `address`, given `handle` and the data of an array of int64."""
        return _call_native(address, handle, array)


@inlined
def _unpack(word):
    """`fpga.Pins` of the word that `gyro_edge` returns: a bit for each pin at its place, the four of refs behind."""
    return fpga.Pins(
        word & 1,
        (word >> 1) & 1,
        (word >> REFS_AT) & REFS_MASK,
        (word >> 3) & 1,
        (word >> 4) & 1,
        (word >> 5) & 1,
        (word >> 6) & 1,
        (word >> 7) & 1,
        (word >> 8) & 1,
        (word >> 9) & 1,
        (word >> 10) & 1,
        (word >> 11) & 1,
        (word >> 12) & 1,
    )


@inlined
def _pack_pins(pins, ldacs):
    """The word that `gyro_edge` would return for `fpga.Pins` and both LDACS."""
    return (
        pins.adc_cs_n
        | (pins.adc_sclk << 1)
        | (pins.refs << REFS_AT)
        | (pins.drive_sync_n << 3)
        | (pins.drive_sclk_en << 4)
        | (pins.drive_sdin << 5)
        | (pins.sense_sync_n << 6)
        | (pins.sense_sclk_en << 7)
        | (pins.sense_sdin << 8)
        | (pins.sense_ldac_n << 9)
        | (pins.quadrature_sync_n << 10)
        | (pins.quadrature_sclk_en << 11)
        | (pins.quadrature_sdin << 12)
        | (ldacs[0] << LDACS_AT)
        | (ldacs[1] << (LDACS_AT + 1))
    )


@hot
def ticks(p, f, chips, a, chunk, end, drdy_cycle, rtl):
    """Ticks chunk.begin .. end - 1; returns the model's registers, the chips, the clock of DRDY.

    Ends early, with rtl.found, at the first row in which the RTL differs.
    """
    begin, faults = chunk.begin, chunk.faults
    clocks, frame_ticks = p.fpga.design.tick_clocks, p.fpga.design.frame_ticks
    word_bits = p.fpga.design.adc_word_bits
    pins = rtl.comparison_state[2]
    refs = (pins >> REFS_AT) & REFS_MASK
    for tick in range(begin, end):
        if tick % frame_ticks == 0:
            engine.begin_frame(p, f, chips, a, chunk, tick)
            n = tick // frame_ticks - (begin + frame_ticks - 1) // frame_ticks
            if rtl.mode != COMPARE_MODE and n < chunk.o.frames.shape[0]:
                store(chunk.o.frames[n], engine.codes_before(chips))
        # the aperture is the tick's first instant; the codes arrive a tick later
        sample_x, sample_y = a.sar[0], a.sar[1]
        if tick - begin < rtl.samples.shape[0]:
            store(rtl.samples[tick - begin], (sample_x, sample_y))
        if p.fpga.digital:
            a.sar[0] = engine.faulted_sample(faults, 0, plant.sar_code(p.plant, a, tick, 0), sample_x)
            a.sar[1] = engine.faulted_sample(faults, 1, plant.sar_code(p.plant, a, tick, 1), sample_y)
        codes = engine.sent_codes(word_bits, faults, a.adc.clock, engine.codes_before(chips))
        drive_cycle, sense_cycle, edge_count = -1, -1, 0
        for c in range(clocks):
            at = tick * clocks + c
            if rtl.mode == COMPARE_MODE:
                row = rtl.rows[at & (BUFFER_ROWS - 1)]
                store(row, f)
                store(row[COUNT:], fpga.pins(p.fpga, f))
                difference_index = call(rtl.differs, rtl.handle, row)
                if difference_index >= 0:
                    rtl.comparison_state[0], rtl.comparison_state[1] = at, difference_index
                    return f, chips, drdy_cycle
            write = chunk.write if at == begin * clocks else 0
            i = fpga.Inputs(
                chips.adc.drdy_n, adc_serial.dout(chips.adc), sample_x, sample_y, write, chunk.address, chunk.data
            )
            if rtl.mode != RTL_ONLY_MODE:
                f = fpga.step(p.fpga, p.rom, f, i)
            if rtl.mode == MODEL_MODE:
                pins = _pack_pins(fpga.pins(p.fpga, f), fpga.other_ldacs(f))
            else:
                store(rtl.edge_inputs[1:], i)
                rtl.edge_inputs[0] = 0
                pins = call(rtl.edge, rtl.handle, rtl.edge_inputs)
            loaded = 1 if c == drdy_cycle and faults.silent == 0 else 0
            if loaded and rtl.count[0] < rtl.conversions.shape[0]:
                store(rtl.conversions[rtl.count[0]], (at, faults.status, codes))
                rtl.count[0] += 1
            ldacs = (pins >> LDACS_AT) & 1, (pins >> (LDACS_AT + 1)) & 1
            chips = engine.chips_after(p.chips, word_bits, chips, _unpack(pins), ldacs, loaded, faults.status, codes)
            if chips.drive.updated:
                drive_cycle = c
                rtl.latched[0] = c
            if chips.sense.updated:
                sense_cycle = c
                rtl.latched[1] = c
            now = (pins >> REFS_AT) & REFS_MASK
            if now != refs:
                probed = rtl.mode != COMPARE_MODE
                edge_count = engine.changed_references(chunk.edges, edge_count, chunk.o, probed, c, at, refs, now)
                refs = now
        drdy_cycle = engine.end_tick(p, chips, a, chunk, tick, drive_cycle, sense_cycle, edge_count)[0]
    rtl.comparison_state[2] = pins
    rtl.comparison_state[3] += (end - begin) * clocks
    return f, chips, drdy_cycle

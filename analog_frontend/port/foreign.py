"""A plant behind the port: the ticks of a block are computed by a shared library, called from compiled code.

    DAC codes, edges, V_q, rate, temperature --> mailbox `pins` --> step() of the library --> `adc`, `motion` --> codes

The library is called by its address, which is a number in Params. No kernel knows which library it runs, so machine
code in the cache serves all of them. What it returns is checked here. A failure is kept in `failed`, and the library is
not called again.
DRDY   the two instants that the library promises stand in the converter's own state as its pending conversion and the
       next one, so `adc.clocks_to_ready` foretells them and the engines need not know whose converter it is
Source docs/plant_port.md, gyro_plant.h
"""

import ctypes
from typing import NamedTuple

import numpy as np

from analog_frontend.parts import adc
from fpga_model.jit import DISABLED, inlined, outlined

ABI = 1
MOST_TICKS, MOST_EDGES = 128, 1024
# words of gyro_pins
TICK, TICKS, DRIVE_CLOCK, SENSE_CLOCK, QUADRATURE_CODE, EDGE_COUNT, DRIVE_CODE = range(7)
SENSE_CODE = DRIVE_CODE + MOST_TICKS
EDGE = SENSE_CODE + MOST_TICKS
WORDS = EDGE + 2 * MOST_EDGES
DRDY = adc.CHANNELS  # of gyro_adc: codes, then two instants
MOTIONS = 4
LEAST_DRDY_INTERVAL = 800  # clocks between two falls of DRDY
# words of `failed`: what, the block's first tick, which, the value
KIND, AT_TICK, WHICH, VALUE = range(4)
NOTHING, RETURNED, CODE, PROMISE, SHORT_DRDY_INTERVAL, NOT_FINITE = range(6)


class Params(NamedTuple):
    """Address of the library's `step` (0: the plant is our own) and of its plant; mailboxes, which blocks write."""

    step: int
    plant: int
    pins: np.ndarray
    adc: np.ndarray
    motion: np.ndarray
    failed: np.ndarray


def mailboxes(step=0, plant=0):
    """`Params` with mailboxes of their own."""
    used = 1 if step else 0
    return Params(
        step,
        plant,
        np.zeros(used * WORDS, np.int64),
        np.zeros(used * (DRDY + 2), np.int64),
        np.zeros(used * MOTIONS),
        np.zeros(used * (VALUE + 1), np.int64),
    )


NONE = mailboxes()

if DISABLED:
    _STEP = ctypes.CFUNCTYPE(ctypes.c_int32, *[ctypes.c_void_p] * 2, *[ctypes.c_double] * 2, *[ctypes.c_void_p] * 2)

    def _call_library(step, plant, pins, rate_rad_s, temp_degc, codes, motion):
        """`gyro_plant_step` at an address."""
        return _STEP(step)(plant, pins.ctypes.data, rate_rad_s, temp_degc, codes.ctypes.data, motion.ctypes.data)

else:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def _call_library(typingctx, step, plant, pins, rate_rad_s, temp_degc, codes, motion):
        """`gyro_plant_step` at an address."""
        number, void = ir.DoubleType(), ir.IntType(8).as_pointer()

        def codegen(context, builder, signature, args):
            def data(k):
                array = context.make_array(signature.args[k])(context, builder, args[k])
                return builder.bitcast(array.data, void)

            kind = ir.FunctionType(ir.IntType(32), (void, void, number, number, void, void))
            function = builder.inttoptr(args[0], kind.as_pointer())
            values = builder.inttoptr(args[1], void), data(2), args[3], args[4], data(5), data(6)
            return builder.call(function, values)

        arguments = types.int64, types.int64, pins, types.float64, types.float64, codes, motion
        return types.int32(*arguments), codegen


@inlined
def promise(p, clock, first, second):
    """Keep the next two falls of DRDY (clocks from here) where `adc.clocks_to_ready` finds them. Mutates `clock`."""
    clock[adc.PENDING] = first << adc.UNIT_BITS
    clock[adc.DUE] = (second << adc.UNIT_BITS) - p.delay
    clock[adc.SAMPLE] = p.decimation - 1


@outlined
def _fail(failed, kind, tick, which, value):
    failed[KIND] = kind
    failed[AT_TICK] = tick
    failed[WHICH] = which
    failed[VALUE] = value


@outlined
def _check_reply(port, tick, first, second):
    """Check what the library has returned; `first`, `second`: what DRDY was promised to be, -1 for not yet promised."""
    codes, failed = port.adc, port.failed
    for k in range(adc.CHANNELS):
        if not adc.CODE_LO <= codes[k] <= adc.CODE_HI:
            _fail(failed, CODE, tick, k, codes[k])
    for k in range(2):
        promised_clock = second if k else first
        if codes[DRDY + k] < 0 or (promised_clock >= 0 and codes[DRDY + k] != promised_clock):
            _fail(failed, PROMISE, tick, promised_clock, codes[DRDY + k])
    if codes[DRDY + 1] - codes[DRDY] < LEAST_DRDY_INTERVAL:
        _fail(failed, SHORT_DRDY_INTERVAL, tick, codes[DRDY], codes[DRDY + 1])
    for k in range(MOTIONS):
        if not abs(port.motion[k]) < np.inf:
            _fail(failed, NOT_FINITE, tick, k, 0)


@outlined
def _write_mailbox(port, tick, n, work, edge_count, edges):
    """Codes and edges of a block, into the mailbox. Mutates it."""
    pins = port.pins
    pins[TICK], pins[TICKS], pins[EDGE_COUNT] = tick, n, edge_count
    for t in range(n):
        pins[DRIVE_CODE + t] = work.drive_codes[t]
        pins[SENSE_CODE + t] = work.sense_codes[t]
    for k in range(edge_count):
        pins[EDGE + 2 * k] = edges[k, 0]
        pins[EDGE + 2 * k + 1] = edges[k, 1]


@outlined
def run_library(port, p, clock, tick, n, drive_cycle, sense_cycle, work, edge_count, edges, rate_rad_s, temp_degc):
    """`n` ticks of the library's plant; as `top.advance_ticks`. Mutates the mailboxes and `clock`, the converter's.

    p  adc.Params, for the clocks of a tick
    """
    first, second = clock[adc.PENDING] >> adc.UNIT_BITS, (clock[adc.DUE] + p.delay) >> adc.UNIT_BITS
    passed = n * p.tick_clocks
    fell = first if first >= p.tick_clocks else second
    if fell >= passed + p.tick_clocks:
        fell = np.int64(-1)
    if first >= passed:
        first, second = first - passed, second - passed
    else:
        first, second = second - passed, np.int64(-1)
    if port.failed[KIND] == NOTHING:
        _write_mailbox(port, tick, n, work, edge_count, edges)
        port.pins[DRIVE_CLOCK], port.pins[SENSE_CLOCK] = drive_cycle, sense_cycle
        status = _call_library(port.step, port.plant, port.pins, rate_rad_s, temp_degc, port.adc, port.motion)
        if status != 0:
            _fail(port.failed, RETURNED, tick, 0, status)
        else:
            _check_reply(port, tick, first, second)
    if port.failed[KIND] == NOTHING:
        for k in range(adc.CHANNELS):
            clock[adc.CODES + k] = port.adc[k]
        second = port.adc[DRDY + 1]
    elif second < 0:  # the chunk goes on to its end without the library, whatever it said
        second = first + passed + LEAST_DRDY_INTERVAL
    promise(p, clock, first, second)
    return fell

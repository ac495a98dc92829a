"""The whole firmware on recorded inputs, clock by clock, in integers only: what its golden vectors are made of.

    before edge n   a listed host event drives rst, or write, for one clock; address and data stay afterwards
                    the samples of the SAR converters are those of the tick of n
                    registers and pins make row n, and every row goes into the signature of its frame
    edge n          the firmware, or its reset
    after edge n    the ADS1298 sees CS_N and SCLK as they are then; a conversion listed at n ends: DRDY_N, DOUT

Frames count from row 0, also behind a reset. There is no plant: the codes are those that a closed loop once gave.
Source  docs/golden.md, analog_frontend/parts/adc_serial.py
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.parts import adc_serial
from fpga_model import sine, spi_adc, top
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from fpga_model.jit import hot
from testbench.flatten import format_leaves, leaves, store
from testbench.golden.recording import signature

REGISTER_FMT = tuple(fmt for _, fmt in format_leaves(top.STATE_FMT))
ROW_WIDTH = sum(fmt.width for fmt in (*REGISTER_FMT, *top.PINS_FMT))
REGISTERS = len(REGISTER_FMT)
INPUTS = 1 + len(top.Inputs._fields)  # rst first

WORDS = signature.WORDS
ROW_WORDS = signature.padded_width(ROW_WIDTH) // signature.DEGREE
BUFFER = 64 * ROW_WORDS + WORDS  # a remainder moves down by a row at each clock, and is moved up again when it cannot
RESET_CS_N, RESET_SCLK = spi_adc.State().cs_n, spi_adc.State().sclk

# compiled for the rows of the default design; those of others are signed by `signature.rows_signature`
_append = signature.appender([fmt.width for fmt in (*REGISTER_FMT, *top.PINS_FMT)])


class Stimulus(NamedTuple):
    """Recorded inputs, int64, sorted by clock.

    adc   one row per conversion: clock of its end, status word, eight codes
    host  one row per event: clock, 1 for a reset (0 for a write), address, data
    sar   one row per tick: sample x, sample y; no row: both stay 0
    """

    adc: np.ndarray
    host: np.ndarray
    sar: np.ndarray


class Rows(NamedTuple):
    """What a replay gives; the first four belong to the clocks asked for, the others to frames."""

    at: np.ndarray  # clocks, rising
    inputs: np.ndarray
    registers: np.ndarray
    pins: np.ndarray
    remainders: np.ndarray  # (frames, signature.WORDS) of all rows of a frame
    window_at: np.ndarray  # clock at which the 8 kHz window opens in a frame, or -1
    every: np.ndarray  # pins of every clock of the frames that are run at once; none if nobody asks for them
    board: np.ndarray  # the rows of pins as a board reads them
    board_signatures: np.ndarray  # uint64, of all these of a frame


BATCH_FRAMES = 64  # whose pins of every clock are kept


class ReplayPosition(NamedTuple):
    """Where a replay is: the next clock, how much of each list is done, what the bus holds, where the remainder is."""

    clock: int = 0
    conversion: int = 0
    event: int = 0
    row: int = 0
    address: int = 0
    data: int = 0
    base: int = BUFFER - signature.WORDS


@hot
def _replay_clocks(p, rom, s, chip, position, first, end, stimulus, o, buffer):
    """Clocks up to `end`, or up to and with one whose reset is active; then the State returned is void.

    first   clock of the first row of `o.every`
    buffer  of the remainder; empty: no signature
    """
    adc, host, sar = stimulus.adc, stimulus.host, stimulus.sar
    n, conversion, event, row, address, data, base = position
    tick_clocks, word_bits = p.design.tick_clocks, p.design.adc_word_bits
    frame_clocks = tick_clocks * p.design.frame_ticks
    frame, remaining_clocks, cycle = n // frame_clocks, frame_clocks - n % frame_clocks, n % tick_clocks
    k, signed = n // tick_clocks, buffer.shape[0] > 0
    sample_x, sample_y, rst = 0, 0, 0
    while n < end and rst == 0:
        if k < sar.shape[0]:
            sample_x, sample_y = sar[k, 0], sar[k, 1]
        write = 0
        if event < host.shape[0] and host[event, 0] == n:
            if host[event, 1] == 1:
                rst = 1
            else:
                write, address, data = 1, host[event, 2], host[event, 3]
            event += 1
        out = top.pins(p, s)
        if signed:
            if base < ROW_WORDS:
                for j in range(WORDS - 1, -1, -1):
                    buffer[BUFFER - WORDS + j] = buffer[base + j]
                base = BUFFER - WORDS
            _append(buffer, base, (s, out))
            base -= ROW_WORDS
        if n - first < o.every.shape[0]:
            store(o.every[n - first], out)
        if s.rates.slot == 1:
            o.window_at[frame] = n
        drdy_n, dout = chip.drdy_n, adc_serial.dout(chip)
        if row < o.at.shape[0] and o.at[row] == n:
            i = o.inputs[row]
            i[0], i[1], i[2], i[3], i[4] = rst, drdy_n, dout, sample_x, sample_y
            i[5], i[6], i[7] = write, address, data
            store(o.registers[row], s)
            store(o.pins[row], out)
            row += 1
        s = top.step(p, rom, s, top.Inputs(drdy_n, dout, sample_x, sample_y, write, address, data))
        loaded, status = 0, 0
        codes = (0, 0, 0, 0, 0, 0, 0, 0)
        if conversion < adc.shape[0] and adc[conversion, 0] == n:
            c = adc[conversion]
            loaded, status = 1, c[1]
            codes = (c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9])
            conversion += 1
        cs_n, sclk = s.adc.cs_n, s.adc.sclk
        if rst == 1:
            cs_n, sclk = RESET_CS_N, RESET_SCLK
        chip = adc_serial.step(word_bits, chip, cs_n, sclk, loaded, status, codes)
        n += 1
        cycle += 1
        if cycle == tick_clocks:
            cycle = 0
            k += 1
        remaining_clocks -= 1
        if remaining_clocks == 0:
            if signed:
                for j in range(WORDS):
                    o.remainders[frame, j] = buffer[base + j]
                    buffer[base + j] = 0
            remaining_clocks = frame_clocks
            frame += 1
    return s, chip, ReplayPosition(n, conversion, event, row, address, data, base), rst


def _allocate_rows(at, frames, every=0):
    """Empty `Rows`."""
    count, pins = len(at), len(top.Pins._fields)
    return Rows(
        at,
        np.zeros((count, INPUTS), np.int64),
        np.zeros((count, REGISTERS), np.int64),
        np.zeros((count, pins), np.int64),
        np.zeros((frames, signature.WORDS), np.int64),
        np.full(frames, -1, np.int64),
        np.zeros((every, pins), np.int64),
        np.zeros((count, pins), np.int64),
        np.zeros(frames, np.uint64),
    )


def run(params, stimulus, frames, at, board=None, registers=True):
    """Replay `frames` frames from power-on; `Rows` at the clocks `at`.

    board      `board_pins.Board`: its rows and signatures are given besides
    registers  whether every clock of registers and pins is signed; of a design that is not the default one this takes
               some ten times as long
    """
    d = params.design
    at, end = np.ascontiguousarray(at, np.int64), frames * d.frame_clocks
    if len(at) and (at[0] < 0 or at[-1] >= end or (np.diff(at) <= 0).any()):
        raise ValueError(f"clocks of rows do not strictly increase within 0 .. {end - 1}")
    by_frame = registers and d != DEFAULT
    frames_per_batch = 1 if by_frame else BATCH_FRAMES
    o = _allocate_rows(at, frames, 0 if board is None else frames_per_batch * d.frame_clocks)
    rom, fresh = sine.table(d), top.reset(d)
    s, chip, position = fresh, adc_serial.State(), ReplayPosition()
    buffer = np.zeros(BUFFER if registers and not by_frame else 0, np.int64)
    for frame in range(0, frames, frames_per_batch):
        first, last = frame * d.frame_clocks, min(frame + frames_per_batch, frames) * d.frame_clocks
        part, row_slice = o, slice(*np.searchsorted(at, (first, last)))
        if by_frame:
            part, position = _allocate_rows(np.arange(first, last), frames, len(o.every)), position._replace(row=0)
        while position.clock < last:
            s, chip, position, rst = _replay_clocks(params, rom, s, chip, position, first, last, stimulus, part, buffer)
            s = fresh if rst else s
        if by_frame:
            _sign(part, o, d, frame)
            for name in ("inputs", "registers", "pins"):
                getattr(o, name)[row_slice] = getattr(part, name)[at[row_slice] - first]
        if board is not None:
            board_rows = board.read(part.every[: last - first], first, stimulus.host)
            o.board[row_slice] = board_rows[at[row_slice] - first]
            o.board_signatures[frame : last // d.frame_clocks] = board.signatures(board_rows, d.frame_clocks)
    return o


def _sign(part, o, design, frame):
    """Signature of every row of a frame, of any design."""
    widths = [fmt.width for _, fmt in format_leaves(formats(top.State, design))] + [f.width for f in top.PINS_FMT]
    sig = signature.rows_signature(np.column_stack([part.registers, part.pins]), widths)
    o.remainders[frame, 0] = sig - (1 << signature.DEGREE) if sig >> (signature.DEGREE - 1) else sig
    o.window_at[frame] = part.window_at[frame]


assert len(list(leaves(top.State()))) == REGISTERS, "registers and formats must be one list"

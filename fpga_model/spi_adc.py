"""SPI master for the ADS1298: one 216-bit frame per conversion, status and eight channels.

    meta = DRDY_N, sync = meta, seen = sync; a fall (seen = 1, sync = 0) starts a frame: CS_N low
    SCLK 13 MHz: rises at the first, third ... clock after that; DOUT is taken at every fall, MSB first
    after each 24 bits: status, then channels[0] .. channels[7] (two's complement)
    after the last: valid = 1 for one clock, ok = (status[23:20] == 1100); CS_N rises TAIL_CYCLES later

    DRDY_N --[meta]--[sync]--[seen]      DOUT --[shift]--+--[status]
                 '--(fall)--> frame                      '--[channels 0..7]

Formats   shift, status [0,24,0]   channels [1,23,0]   count [0,6,0]   word [0,4,0]   flags [0,1,0]
Latency   READ_CYCLES = 435 clocks from the first edge that sees DRDY_N low to the one that sees valid = 1
Rounding  none
Overflow  none; a DRDY_N fall during a frame is not seen, so the frame must be shorter than the conversion
Source    docs/blocks/spi_adc.md, docs/parts/adc_serial.md

Channels change one by one while a frame is read: all are of one conversion from valid until 96 clocks into the next.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import Fmt, bits, formats, wrap
from fpga_model.jit import inlined

CHANNELS = 8
WORD_BITS = 24
WORDS = 1 + CHANNELS
WORD = bits(WORD_BITS)
WORD_MASK = WORD.hi
CODE = Fmt(1, WORD_BITS - 1, 0)
FRAME_BITS = WORDS * WORD_BITS
# The part wants CS low for four periods of its own clock (514 ns at most) after the last SCLK fall
TAIL_CYCLES = 54
FRAME_CYCLES = 2 * FRAME_BITS
READ_CYCLES = 3 + FRAME_CYCLES
HEAD = 0b1100
HEAD_SHIFT = WORD_BITS - 4


class State(NamedTuple):
    """The registers: formats and reset values."""

    meta: bits(1) = 0
    sync: bits(1) = 0
    seen: bits(1) = 0
    busy: bits(1) = 0
    count: bits(6) = 0
    cs_n: bits(1) = 1
    sclk: bits(1) = 0
    shift: WORD = 0
    word: bits(4) = 0
    status: WORD = 0
    channels: [CODE] * CHANNELS = (0,) * CHANNELS
    valid: bits(1) = 0
    ok: bits(1) = 0


STATE_FMT = formats(State)
assert STATE_FMT.count.holds(max(TAIL_CYCLES, WORD_BITS)), "count serves the bits and the tail"


@inlined
def stored(c, k, x):
    """The eight channels with channel k replaced."""
    return (
        x if k == 0 else c[0],
        x if k == 1 else c[1],
        x if k == 2 else c[2],
        x if k == 3 else c[3],
        x if k == 4 else c[4],
        x if k == 5 else c[5],
        x if k == 6 else c[6],
        x if k == 7 else c[7],
    )


@inlined
def step(s, drdy_n, dout):
    """One clock edge: every right-hand side reads the old registers."""
    busy, count, cs_n, sclk, shift, word = s.busy, s.count, s.cs_n, s.sclk, s.shift, s.word
    status, channels, ok = s.status, s.channels, s.ok
    valid = 0
    if s.busy == 1:
        if s.word == WORDS:
            count = s.count + 1
            if s.count == TAIL_CYCLES - 1:
                busy = 0
                count = 0
                cs_n = 1
                word = 0
        elif s.sclk == 0:
            sclk = 1
        else:
            sclk = 0
            shift = ((s.shift << 1) & WORD_MASK) | dout
            count = s.count + 1
            if count == WORD_BITS:
                count = 0
                word = s.word + 1
                if s.word == 0:
                    status = shift
                else:
                    channels = stored(s.channels, s.word - 1, wrap(shift, WORD_BITS))
                if s.word == CHANNELS:
                    valid = 1
                    ok = 1 if s.status >> HEAD_SHIFT == HEAD else 0
    elif s.seen == 1 and s.sync == 0:
        busy = 1
        cs_n = 0
    return State(
        meta=drdy_n,
        sync=s.meta,
        seen=s.sync,
        busy=busy,
        count=count,
        cs_n=cs_n,
        sclk=sclk,
        shift=shift,
        word=word,
        status=status,
        channels=channels,
        valid=valid,
        ok=ok,
    )


BLOCK = Block(
    place=80,
    inputs={"drdy_n": BIT, "dout": BIT},
    latency={"valid": READ_CYCLES},
    rules={"shift": (None, "wrap")},
    idle={"drdy_n": 1},
    wait=READ_CYCLES + TAIL_CYCLES,
    split=("word",),
    stops=(WORD_BITS, TAIL_CYCLES),
)

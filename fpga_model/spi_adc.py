"""SPI master for the ADC: one frame per conversion, a status word and the channels behind it, MSB first.

    meta = DRDY_N, sync = meta, seen = sync; a fall (seen = 1, sync = 0) starts a frame

    clock after it     default    D = adc_divider, W = adc_word_bits, N = adc_channels, T = adc_tail_clocks
    0                  0          CS_N low, SCLK low
    D k + D/2          1, 3 ..    SCLK rises: the ADC changes DOUT
    D k + D            2, 4 ..    SCLK falls: DOUT is taken
    D W j              48, 96 ..  a word is complete: status, then channels[0] .. (two's complement), left justified
    D W (1 + N)        432        valid = 1 for one clock, ok = (status[23:20] == 1100), which stays until the next
    D W (1 + N) + T    486        CS_N rises

    count: D/2 times the bit of the word, and the clocks of the half period below it; in the tail its clocks

    DRDY_N --[meta]--[sync]--[seen]      DOUT --[shift]--+--[status]
                 '--(fall)--> frame                      '--[channels 0..7]

Formats   shift, status [0,24,0]   channels [1,23,0]   count [0,6,0]   word [0,4,0]   flags [0,1,0]
Latency   `read_clocks`: 435 clocks from the first edge that sees DRDY_N low to the one that sees valid = 1
Rounding  none
Overflow  none; a DRDY_N fall during a frame is not seen, so the frame must be shorter than the conversion
Cost      258 register bits
Source    analog_frontend/parts/adc_serial.py

D is 2, 4 or 8 for every ADC; W = 16 .. 24, N = 5 .. 8 and T need `design.adc` = "generic". T is 2.056 us of ADS1298
unless a key says otherwise. Channel 5 is the temperature, so N is 5 or more; channels that are not read stay 0. All
channels are of one conversion from valid until the second word of the next frame.
By default SCLK has 76.9 ns (least 50), and DOUT is taken 38.5 ns after the rise (valid after 17).
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block, python_function
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, Term, Width, bits, formats, wrap
from fpga_model.jit import inlined

CHANNELS = 8  # registers; the design may read fewer
WORD_BITS = 24  # of a register, and at most of a word on the line
WORD = bits(WORD_BITS)
WORD_MASK = WORD.hi
CODE = Fmt(1, WORD_BITS - 1, 0)
DRDY_TO_CS_CLOCKS = 3  # from the edge that sees DRDY_N low to the one after which CS_N is
HEAD = 0b1100
HEAD_SHIFT = WORD_BITS - 4
TAIL_NS = 4 * 514  # ADS1298: CS low behind the last SCLK fall, four periods of its own clock


def _count_bits(d):
    """Bits that hold the clocks of the tail, and bits of a word times half periods."""
    return ((d.adc_divider // 2 * d.adc_word_bits | d.adc_tail_clocks) - 1).bit_length()


COUNT = Width(0, {Term("$clog2(ADC_DIVIDER/2*ADC_WORD_BITS|ADC_TAIL_CLOCKS)", _count_bits(DEFAULT), _count_bits): 1})


class State(NamedTuple):
    """The registers."""

    meta: bits(1) = 0
    sync: bits(1) = 0
    seen: bits(1) = 0
    busy: bits(1) = 0
    count: bits(COUNT) = 0
    cs_n: bits(1) = 1
    sclk: bits(1) = 0
    shift: WORD = 0
    word: bits(4) = 0
    status: WORD = 0
    channels: [CODE] * CHANNELS = (0,) * CHANNELS
    valid: bits(1) = 0
    ok: bits(1) = 0


STATE_FMT = formats(State)


def tail_clocks(master_hz):
    """Clocks of the ADS1298's tail."""
    return -(-master_hz * TAIL_NS // 10**9)


@inlined
def word_clocks(d):
    """Clocks of a word."""
    return d.adc_divider * d.adc_word_bits


@inlined
def read_clocks(d):
    """Clocks from the first edge that sees DRDY_N low to the one that sees valid = 1."""
    return DRDY_TO_CS_CLOCKS + (1 + d.adc_channels) * d.adc_divider * d.adc_word_bits


@inlined
def replace_channel(c, k, x):
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
def step(d, s, drdy_n, dout):
    """One clock edge."""
    busy, count, cs_n, sclk, shift, word = s.busy, s.count, s.cs_n, s.sclk, s.shift, s.word
    status, channels, ok = s.status, s.channels, s.ok
    valid = 0
    if s.busy == 1:
        half_bits = d.adc_divider >> 2  # of count, for the clocks of a half period
        if s.word > d.adc_channels:
            count = s.count + 1
            if count == d.adc_tail_clocks:
                busy = 0
                count = 0
                cs_n = 1
                word = 0
        elif s.sclk == 0:
            half_count = (s.count + 1) & ((1 << half_bits) - 1)
            count = ((s.count >> half_bits) << half_bits) + half_count
            sclk = 1 if half_count == 0 else 0
        else:
            count = s.count + 1
            if count == d.adc_word_bits << half_bits:
                count = 0
            if count & ((1 << half_bits) - 1) == 0:
                sclk = 0
                shift = ((s.shift << 1) & WORD_MASK) | (dout << (WORD_BITS - d.adc_word_bits))
                if count == 0:
                    word = s.word + 1
                    if s.word == 0:
                        status = shift
                    else:
                        channels = replace_channel(s.channels, s.word - 1, wrap(shift, WORD_BITS))
                    if s.word == d.adc_channels:
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


def _latency(d):
    return {"valid": python_function(read_clocks)(d)}


def _stops(d):
    """Values where a widened bound of count may stop: the ends of word and tail."""
    return (d.adc_word_bits * d.adc_divider // 2, d.adc_tail_clocks)


BLOCK = Block(
    place=80,
    inputs={"drdy_n": BIT, "dout": BIT},
    latency=_latency,
    rules={"shift": (None, "wrap")},
    idle={"drdy_n": 1},
    wait=lambda d: python_function(read_clocks)(d) + d.adc_tail_clocks,
    split=("word",),
    stops=_stops,
)

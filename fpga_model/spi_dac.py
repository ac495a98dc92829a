"""SPI master for the three DACs: one bit per `gap` + 1 clocks, and the pin edge at which the code takes effect.

    load:        shift = word, left = bits, SYNC low; the first bit comes after `lead` clocks
    bit:         SCLK for one clock, shift <<= 1, left -= 1, then `gap` clocks without; after the last SYNC rises
    ldac = 1:    LDAC is low for one clock, one clock after SYNC has risen
    strobe = 1:  LDAC is low for one clock, the first after a load, and puts out the code of the load before

    clock     0     1     2    ...  bits-1  bits  bits+1  bits+2     (lead 0, ldac 1; clock 0 follows the load edge)
    SYNC_N  __low_____________________________|-high--------------
    SDIN     MSB   ...               LSB
    LDAC_N  ----------------------------------------|_low__|------

    part       role         frame                       output changes with    latch_cycles   period
    DAC8811    drive        16 bits offset binary       SYNC rise (lead 1)     17             26
    AD5791     sense        0001, 20 two's complement   LDAC fall              25             26
    DAC82002   quadrature   08h, 16 straight binary     SYNC rise              24             52

Formats   word, shift, header, control [0,24,0]   flip, data_mask [0,20,0]   left [0,5,0]   tail [0,4,0]
          lead, gap [0,2,0]   pins, ldac, strobe [0,1,0]
Latency   `latch_cycles`: lead + bits (gap + 1) + ldac clocks from the load edge to the edge that changes the output;
          with strobe those to the next load
Rounding  none
Overflow  none: the period between loads must be at least `period_cycles`; a load restarts a frame in progress
Cost      35 register bits for each DAC
Source    analog_frontend/parts/dac_serial.py

SCLK is the clock gated by sclk_en, so the DAC samples SDIN in the middle of the clock; SDIN is the MSB of shift. SCLK
is high for half a clock whatever its rate. The register lead counts the clocks before the first bit and between bits.
A load cancels an LDAC pulse that the frame before has announced.

`generic` in `[design]` is a DAC of any frame. Its keys give the parameters: bits data_mask, frame_bits bits, command
header, tail_bits tail, lead_clocks lead, divider gap + 1, latch ldac ("LDAC") or strobe ("load").
V_q runs at 500 kHz: at 1 MHz SYNC would be high for 76.9 ns of the 160 ns that DAC82002 needs.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats, signed_bits
from fpga_model.jit import inlined

PRODUCT_TICK, CODE_TICK, LOAD_TICK = 0, 1, 2
WORD = bits(24)


class Params(NamedTuple):
    """One DAC's frame; use DAC8811, AD5791 or DAC82002.

    The code stands `tail` bits above the frame's end. What has a default came later: lists leave it out at its default.
    """

    bits: bits(5)
    lead: bits(2)
    ldac: bits(1)
    flip: bits(20)
    header: WORD
    control: WORD
    data_mask: bits(20)
    tail: bits(4) = 0
    gap: bits(2) = 0
    strobe: bits(1) = 0


class State(NamedTuple):
    """The registers."""

    shift: WORD = 0
    left: bits(5) = 0
    lead: bits(2) = 0
    sync_n: bits(1) = 1
    sclk_en: bits(1) = 0
    ldac_n: bits(1) = 1
    ldac_wait: bits(1) = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)

# AD5791 control register; OPGND (bit 2), DACTRI (bit 3) and BIN/2sC (bit 4) are 0: output on, two's complement
AD5791_RBUF = 1 << 1
AD5791_LINCOMP_20V = 0b1100 << 6
# DAC82002: write bit 0, then register 08h = DAC-A
DAC82002_DAC_A = 0x08

DAC8811 = Params(bits=16, lead=1, ldac=0, flip=0x8000, header=0, control=0, data_mask=0xFFFF)
AD5791 = Params(
    bits=24,
    lead=0,
    ldac=1,
    flip=0,
    header=0b0001 << 20,
    control=0b0010 << 20 | AD5791_LINCOMP_20V | AD5791_RBUF,
    data_mask=0xFFFFF,
)
DAC82002 = Params(bits=24, lead=0, ldac=0, flip=0, header=DAC82002_DAC_A << 16, control=0, data_mask=0xFFFF)

# No parts: two and three clocks to a bit, the code within command and tail
DIVIDED = Params(bits=10, lead=3, ldac=1, flip=0, header=0x280, control=0, data_mask=0x7F, gap=1)
STROBED = Params(bits=8, lead=0, ldac=0, flip=0x10, header=0x80, control=0, data_mask=0x1F, tail=1, gap=2, strobe=1)


@inlined
def frame(p, code, init):
    """The word of a frame: the control word if `init` (and the part has one), else header and code."""
    word = p.header | (((code ^ p.flip) & p.data_mask) << p.tail)
    if init == 1 and p.control != 0:
        word = p.control
    return word


@inlined
def step(p, s, load, word):
    """One clock edge."""
    if load == 1:
        return State(
            shift=word,
            left=p.bits,
            lead=p.lead,
            sync_n=0,
            sclk_en=1 if p.lead == 0 else 0,
            ldac_n=p.strobe ^ 1,
            ldac_wait=0,
        )
    shift, left, lead, sync_n, sclk_en = s.shift, s.left, s.lead, s.sync_n, s.sclk_en
    ldac_wait = 0
    if s.sclk_en == 1:
        shift = (s.shift << 1) & ((1 << p.bits) - 1)
        left = s.left - 1
        lead = p.gap
        if p.gap != 0:
            sclk_en = 0
        elif s.left == 1:
            sync_n = 1
            sclk_en = 0
            ldac_wait = p.ldac
    elif s.lead != 0:
        lead = s.lead - 1
        if s.lead == 1:
            if s.left == 0:
                sync_n = 1
                ldac_wait = p.ldac
            else:
                sclk_en = 1
    return State(
        shift=shift,
        left=left,
        lead=lead,
        sync_n=sync_n,
        sclk_en=sclk_en,
        ldac_n=s.ldac_wait ^ 1,
        ldac_wait=ldac_wait,
    )


@inlined
def sdin(p, s):
    """Serial data pin: the MSB of the shift register."""
    return (s.shift >> (p.bits - 1)) & 1


@inlined
def frame_cycles(p):
    """Clocks from the load edge to the edge that ends the frame, and with it LDAC's way behind it."""
    return p.lead + p.bits * (p.gap + 1) + p.ldac


@inlined
def latch_cycles(p, period):
    """Clocks from the load edge to the edge after which the DAC is told to change; `period` clocks between loads."""
    return period if p.strobe == 1 else frame_cycles(p)


@inlined
def update_delay_ticks(d, p, load, every=1):
    """Ticks of a design `d` from a load to the one in which the output is told to change; a load `every` ticks.

    load  tick count of the load
    """
    if p.strobe == 1:
        return every
    clock, delay_ticks = load + frame_cycles(p), 0
    while clock >= d.tick_clocks:
        clock -= d.tick_clocks
        delay_ticks += 1
    return delay_ticks


def period_cycles(p):
    """Least clocks between loads: SYNC and LDAC must be high for one clock or more."""
    return frame_cycles(p) + 1


CODE = signed_bits(20)

BLOCK = Block(
    place=70,
    inputs={"load": BIT, "word": WORD},
    outputs={"sdin": BIT},
    functions={"frame": ({"code": CODE, "init": BIT}, WORD)},
    latency={"sdin": "lead + 1 .. lead + bits (gap + 1)", "ldac_n": "lead + bits (gap + 1) + ldac; with strobe 1"},
    cases={"dac8811": DAC8811, "ad5791": AD5791, "dac82002": DAC82002, "divided": DIVIDED, "strobed": STROBED},
    rules={"shift": (None, "wrap")},
    strobes=("load",),
    wait=27,
    split=("sclk_en", "lead"),
    stops=(1,),
)

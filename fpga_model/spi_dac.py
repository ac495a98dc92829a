"""SPI master for the three DACs: one bit per 26 MHz clock, and the pin edge at which the code takes effect.

    load:      shift = word, left = bits, SYNC low; SCLK runs after `lead` clocks
    SCLK on:   shift <<= 1, left -= 1 each clock; after the last bit SYNC rises and SCLK stops
    ldac = 1:  LDAC is low for one clock, one clock after SYNC has risen

    clock     0     1     2    ...  bits-1  bits  bits+1  bits+2     (lead 0, ldac 1; clock 0 follows the load edge)
    SYNC_N  __low_____________________________|-high--------------
    SDIN     MSB   ...               LSB
    LDAC_N  ----------------------------------------|_low__|------

Formats   word, shift, header, control [0,24,0]   flip, data_mask [0,20,0]   left [0,5,0]   lead [0,2,0]   pins [0,1,0]
Latency   `latch_cycles`: lead + bits + ldac clocks from the load edge to the edge that changes the output
Rounding  none
Overflow  none: the period between loads must be at least `period_cycles`; a load restarts a frame in progress
Source    docs/blocks/spi_dac.md, docs/parts/dac_serial.md

SCLK is the 26 MHz clock gated by sclk_en, so the DAC samples SDIN in the middle of the clock; SDIN is the MSB of shift.
The code is signed for the drive and sense DACs and unsigned for the quadrature DAC.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats, signed
from fpga_model.jit import inlined

PRODUCT_TICK, CODE_TICK, LOAD_TICK = 0, 1, 2
WORD = bits(24)


class Params(NamedTuple):
    """One DAC's frame; use DAC8811, AD5791 or DAC82002."""

    bits: bits(5)
    lead: bits(2)
    ldac: bits(1)
    flip: bits(20)
    header: WORD
    control: WORD
    data_mask: bits(20)


class State(NamedTuple):
    """The registers: formats and reset values."""

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


@inlined
def frame(p, code, init):
    """The word of a frame: the control word if `init` (and the part has one), else header and code."""
    word = p.header | ((code ^ p.flip) & p.data_mask)
    if init == 1 and p.control != 0:
        word = p.control
    return word


@inlined
def step(p, s, load, word):
    """One clock edge: every right-hand side reads the old registers."""
    if load == 1:
        return State(
            shift=word,
            left=p.bits,
            lead=p.lead,
            sync_n=0,
            sclk_en=1 if p.lead == 0 else 0,
            ldac_n=1,
            ldac_wait=0,
        )
    shift, left, lead, sync_n, sclk_en = s.shift, s.left, s.lead, s.sync_n, s.sclk_en
    ldac_wait = 0
    if s.sclk_en == 1:
        shift = (s.shift << 1) & ((1 << p.bits) - 1)
        left = s.left - 1
        if s.left == 1:
            sync_n = 1
            sclk_en = 0
            ldac_wait = p.ldac
    elif s.lead != 0:
        lead = s.lead - 1
        sclk_en = 1 if s.lead == 1 else 0
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
def latch_cycles(p):
    """Clocks from the load edge to the edge after which the DAC is told to change its output."""
    return p.lead + p.bits + p.ldac


@inlined
def late_ticks(d, p):
    """Ticks of a design `d` from that of the load to that in which the output is told to change: 0 or 1."""
    return 1 if LOAD_TICK + latch_cycles(p) >= d.tick_clocks else 0


def period_cycles(p):
    """Least clocks between loads: SYNC and LDAC must be high for one clock or more."""
    return latch_cycles(p) + 1


CODE = signed(20)

BLOCK = Block(
    place=70,
    inputs={"load": BIT, "word": WORD},
    outputs={"sdin": BIT},
    functions={"frame": ({"code": CODE, "init": BIT}, WORD)},
    latency={"sdin": "lead + 1 .. lead + bits", "ldac_n": "lead + bits + ldac"},
    cases={"dac8811": DAC8811, "ad5791": AD5791, "dac82002": DAC82002},
    rules={"shift": (None, "wrap")},
    strobes=("load",),
    wait=27,
    split=("sclk_en", "lead"),
    stops=(1,),
)

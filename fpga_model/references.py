"""The four reference pins sgn(sin), sgn(cos) of drive and sense, optionally held on the 1 MHz grid.

    sgn(sin) = 1 in [0, 1/2) turn     sgn(cos) = 1 in [0, 1/4) and [3/4, 1) turn
    signs[n+1] = packed signs     aligned[n+1] = (signs[n], aligned0[n], aligned1[n])
    retimed[n+1] = picked[n] at ce_1m, else held     picked = signs if align == 0 else aligned(align-1)

    drive_ref, sense_ref --(signs)--[signs]--[aligned0]--[aligned1]--[aligned2]
                                       '---------'-----------'-----------'--(align)--+--[retimed]--(retimed)-- pins
                                                                                     '------------------'

Formats   drive_ref, sense_ref as in dds.py   signs, aligned, retimed, pins [0,4,0]   align [0,2,0]   retimed [0,1,0]
Latency   1 + align clocks from a phase to its pin; with retimed, 1 more clock and up to 25 of waiting for ce_1m
Rounding  none
Overflow  none
Cost      20 register bits

Packed words: bit 0 drive sgn(sin), bit 1 drive sgn(cos), bit 2 sense sgn(sin), bit 3 sense sgn(cos).
An edge is late by up to one clock, 0.152 deg at 11 kHz; retimed by up to one tick, 3.96 deg. Retimed is the default:
its mean wait, half a tick, cancels the mean hold of the DAC. `align` meets the latency of the sine path.
"""

from typing import NamedTuple

from fpga_model import dds
from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats, quantize
from fpga_model.jit import inlined

PHASE = dds.PHASE
MAX_ALIGN = 3
LATENCY = 1


class Params(NamedTuple):
    """Machine units; build with `design`."""

    align: bits(2)
    retimed: bits(1)


class State(NamedTuple):
    """The registers."""

    signs: bits(4) = 0
    aligned: [bits(4)] * MAX_ALIGN = (0,) * MAX_ALIGN
    retimed: bits(4) = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(align_clocks=0, retimed=True):
    """Alignment of `align_clocks` (26 MHz clocks, 0 .. 3), and whether the pins leave on the 1 MHz grid."""
    align = quantize(align_clocks, PARAMS_FMT.align, "align_clocks (26 MHz clocks)")
    if align != align_clocks:
        raise ValueError(f"align_clocks: {align_clocks} is not a whole number of 26 MHz clocks")
    return Params(align=align, retimed=quantize(retimed, PARAMS_FMT.retimed, "retimed (0 or 1)"))


@inlined
def signs_of(d, phase):
    """Bit 0 sgn(sin), bit 1 sgn(cos) of a phase."""
    half = (phase >> (d.dds_bits - 1)) & 1
    quarter = (phase >> (d.dds_bits - 2)) & 1
    return (half ^ 1) | ((half ^ quarter ^ 1) << 1)


@inlined
def picked(p, s):
    """The sign word after `align` further registers."""
    word = s.signs
    if p.align != 0:
        word = s.aligned[p.align - 1]
    return word


@inlined
def step(d, p, s, drive_ref, sense_ref, ce_1m):
    """One clock edge."""
    retimed = s.retimed
    if ce_1m == 1:
        retimed = picked(p, s)
    return State(
        signs=signs_of(d, drive_ref) | (signs_of(d, sense_ref) << 2),
        aligned=(s.signs,) + s.aligned[:-1],
        retimed=retimed,
    )


@inlined
def pins(p, s):
    """The packed word on the four pins."""
    return s.retimed if p.retimed == 1 else picked(p, s)


BLOCK = Block(
    place=40,
    inputs={"drive_ref": PHASE, "sense_ref": PHASE, "ce_1m": BIT},
    outputs={"pins": bits(4)},
    latency={"signs": LATENCY, "pins": "1 + align, and 1 .. 26 more when retimed"},
    cases={
        f"align{k}_{'retimed' if retimed else 'direct'}": design(k, retimed)
        for k, retimed in ((0, True), (0, False), (1, False), (2, True), (3, False))
    },
    strobes=("ce_1m",),
)

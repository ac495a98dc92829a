"""Notch at the output of the rate loop: a second-order filter of the force word, before rate_output takes it.

    en    y' = clamp(round(g*(x + x2) + c*(x1 - y1) - (2*g - 1)*y2)),   x1' = x,  x2' = x1,  y1' = y',  y2' = y1
    out   round(y1)                                                     y1 is the value of y after the last en
    g = 1 / (1 + tan(pi width / 8 kHz))     c = -2 g cos(2 pi centre / 8 kHz)

    x --+--[x1]--[x2]     x, x1, x2, y1, y2 --(x g, c)--(+, round, clamp)--[y1]--+--(round)-- out
                                                                                  '--[y2]          [..] register

Formats   x, x1, x2, out [1,0,23] of 10 V   y1, y2 [1,0,33]   g, c [1,1,22]
Latency   1 clock from en to out
Rounding  ties toward +inf in y and in out
Overflow  y saturates at the limits of the word, so that out cannot overflow
Cost      116 register bits, three multipliers
Source    docs/loop.md (why it stands behind the loop)

The gain is 0 at the centre, -3 dB at both ends of the width, and 1 at 0 Hz for any g and c: a constant rate keeps its
word. Ten fraction bits keep the dead band below 1 LSB. y saturates at -2^33 and (2^23 - 1)*2^10 LSB, the limits of
`out`. The force does not pass it, so it changes no margin of the loop; in front of the PI it would take away the
feedback that damps the ring at the split.

A design without it (`firmware.notch_hz` = 0) has None in place of its parameters and registers (`block.reset`). Lanes
engine, Verilog of the whole design and replay of measured records refuse it.
"""

from math import cos, tan
from math import pi as PI
from typing import NamedTuple

from fpga_model import rate_loop
from fpga_model.block import BIT, Block
from fpga_model.fixed import Fmt, add_fmt, clamp, formats, half_up, mul_fmt, quantize, sub_fmt
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ

WORD = rate_loop.WORD
Y = Fmt(1, WORD.i, WORD.f + 10)
COEF = Fmt(1, 1, 22)
SHIFT = Y.f - WORD.f
COEF_BITS = COEF.f
ONE = 1 << COEF.f
Y_LO, Y_HI = WORD.lo << SHIFT, WORD.hi << SHIFT
LATENCY = 1
DIFFERENCE = sub_fmt(Y, Y)
assert add_fmt(mul_fmt(COEF, DIFFERENCE), mul_fmt(COEF, DIFFERENCE)).width + 2 <= 63, "the sum must fit int64"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    g: COEF
    c: COEF


class State(NamedTuple):
    """The registers."""

    x1: WORD = 0
    x2: WORD = 0
    y1: Y = 0
    y2: Y = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(centre_hz, width_hz=20.0, frame_hz=FRAME_HZ):
    """Coefficients of a notch with its zeros on the unit circle.

    centre_hz  frequency of the zero (Hz)
    width_hz   between the two frequencies of -3 dB (Hz), less than the centre
    frame_hz   rate of the enables (Hz)
    """
    if not 0 < centre_hz < frame_hz / 4:
        raise ValueError(f"notch_hz: {centre_hz:g} Hz is outside 0 .. {frame_hz / 4:g} Hz")
    if not 0 < width_hz < centre_hz:
        raise ValueError(f"notch_width_hz: {width_hz:g} Hz is outside 0 .. notch_hz, {centre_hz:g} Hz")
    g = 1 / (1 + tan(PI * width_hz / frame_hz))
    return Params(g=quantize(g, COEF, "g"), c=quantize(-2 * g * cos(2 * PI * centre_hz / frame_hz), COEF, "c"))


@inlined
def step(p, s, en, x):
    """One clock edge."""
    if not en:
        return s
    total = p.g * ((x + s.x2) << SHIFT) + p.c * ((s.x1 << SHIFT) - s.y1) - (2 * p.g - ONE) * s.y2
    return State(x1=x, x2=s.x1, y1=clamp(half_up(total, COEF_BITS), Y_LO, Y_HI), y2=s.y1)


@inlined
def out(s):
    """The word that the rate output takes."""
    return half_up(s.y1, SHIFT)


BLOCK = Block(
    place=185,
    inputs={"en": BIT, "x": WORD},
    outputs={"out": WORD},
    latency={"y1": LATENCY, "out": LATENCY},
    cases={"split": design(139.0), "narrow": design(25.0, 2.0), "wide": design(1500.0, 900.0)},
    rules={"y1": ("half_up", "saturate")},
    strobes=("en",),
)

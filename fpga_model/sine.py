"""Sine from a quarter-wave table with linear interpolation, three registers deep.

    phase[47:26] = quadrant (2) : address a (10) : fraction f (10)     the lower 26 bits are cut
    odd quadrant:  a, f are complemented (mirror)     quadrant 2, 3:  the sign is negative
    y = +-round(BASE[a] + SLOPE[a] * (f + 1/2) / 1024)

    phase --(cut, fold)--(table)--[sign, base, slope, fraction]--(x)--[sign2, base2, product]--(+, round, +-)--[y]

Formats   phase [0,0,48]   base [0,17,6]   slope [0,8,5]   fraction [0,0,10]   product [0,8,16]   y [1,0,17]
Latency   3 clocks from phase to y
Rounding  phase is cut and the sine taken at the middle of the cut cell; y: magnitude, ties up, so that sine is odd
Overflow  none: BASE + SLOPE never exceeds 2**17 - 1, which is full scale; y is never -2**17
Source    docs/blocks/sine.md (error and spur bounds)

The half in (f + 1/2) does two things: it makes the mirror a plain complement (no case for a quarter turn), and it takes
away the mean delay that cutting the phase would add. Full scale is 2**17 - 1. Tables are pure integer arithmetic.
"""

from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fpga_model.block import Block, Rom
from fpga_model.fixed import Fmt, add_fmt, bits, formats, half_up, mul_fmt
from fpga_model.jit import inlined

PHASE = Fmt(0, 0, 48)
ADDRESS_BITS = 10
FRACTION_BITS = 10
CUT = PHASE.width - 2 - ADDRESS_BITS - FRACTION_BITS
BASE = Fmt(0, 17, 6)
SLOPE = Fmt(0, 8, 5)
MIDDLE = Fmt(0, 0, FRACTION_BITS + 1)
PRODUCT = mul_fmt(SLOPE, MIDDLE)
ALIGN = PRODUCT.f - BASE.f
SIGN_BIT = PHASE.width - 1
SLOPE_BITS, SLOPE_MASK = SLOPE.width, SLOPE.hi
PRODUCT_BITS = PRODUCT.f
OUT = Fmt(1, 0, 17)
FULL_SCALE = OUT.hi
LATENCY = 3
ROWS = 1 << ADDRESS_BITS
assert add_fmt(BASE, PRODUCT).width + 1 <= 63, "base + product and the rounding constant must fit int64"
assert BASE.width + SLOPE.width == 36, "one table row is one 36-bit memory word"

# Derived in docs/blocks/sine.md, in LSB of y: what each stage may be wrong by at most. 355/113 is just above pi.
PI_ABOVE = Fraction(355, 113)
INTERPOLATION_LSB = FULL_SCALE * (PI_ABOVE / 2 / ROWS) ** 2 / 8
TABLE_LSB = Fraction(1, 2 << BASE.f) + Fraction(1, 2 << SLOPE.f)
ROUNDING_LSB = Fraction(1, 2)
MAX_ERROR_LSB = INTERPOLATION_LSB + TABLE_LSB + ROUNDING_LSB
PHASE_CUT_LSB = FULL_SCALE * PI_ABOVE / (1 << (PHASE.width - CUT))


class State(NamedTuple):
    """The registers: formats and reset values."""

    sign: bits(1) = 0
    base: BASE = 0
    slope: SLOPE = 0
    fraction: Fmt(0, 0, FRACTION_BITS) = 0
    sign2: bits(1) = 0
    base2: BASE = 0
    product: PRODUCT = 0
    y: OUT = 0


STATE_FMT = formats(State)


def quarter_wave(rows, guard_bits=128):
    """sin(pi/2 * k/rows) for k = 0 .. rows as integers of weight 2**-guard_bits, good to some ten units."""

    def arctan_of_inverse(x):
        power = total = (1 << guard_bits) // x
        n, sign = 3, -1
        while power:
            power //= x * x
            total += sign * (power // n)
            n, sign = n + 2, -sign
        return total

    def sine(angle):
        square = angle * angle >> guard_bits
        term = total = angle
        n = 2
        while term:
            term = (term * square >> guard_bits) // (n * (n + 1))
            total += -term if n & 2 else term
            n += 2
        return total

    half_pi = 2 * (4 * arctan_of_inverse(5) - arctan_of_inverse(239))
    return [sine(half_pi * k // rows) for k in range(rows + 1)]


def _tables(guard_bits=128):
    """BASE and SLOPE: the sine at the start of each step, and the chord to the next."""
    exact = [FULL_SCALE * x for x in quarter_wave(ROWS, guard_bits)]

    def rounded(x, fmt):
        dropped = guard_bits - fmt.f
        return (x + (1 << (dropped - 1))) >> dropped

    base = tuple(rounded(x, BASE) for x in exact[:-1])
    slope = tuple(rounded(after - x, SLOPE) for x, after in pairwise(exact))
    return base, slope


TABLE_BASE, TABLE_SLOPE = _tables()
# One row is one 36-bit memory word: base above slope
ROM = np.array([b << SLOPE_BITS | s for b, s in zip(TABLE_BASE, TABLE_SLOPE)], np.int64)
ROM.flags.writeable = False


@inlined
def step(s, phase):
    """One clock edge: every right-hand side reads the old registers."""
    place = phase >> CUT
    if place & (1 << (ADDRESS_BITS + FRACTION_BITS)):
        place = ~place
    row = int(ROM[(place >> FRACTION_BITS) & (ROWS - 1)])
    magnitude = half_up((s.base2 << ALIGN) + s.product, PRODUCT.f)
    return State(
        sign=(phase >> SIGN_BIT) & 1,
        base=row >> SLOPE_BITS,
        slope=row & SLOPE_MASK,
        fraction=place & ((1 << FRACTION_BITS) - 1),
        sign2=s.sign,
        base2=s.base,
        product=s.slope * (2 * s.fraction + 1),
        y=-magnitude if s.sign2 == 1 else magnitude,
    )


@inlined
def at(phase):
    """y of a phase: what `step` gives LATENCY clocks later."""
    place = phase >> CUT
    if place & (1 << (ADDRESS_BITS + FRACTION_BITS)):
        place = ~place
    row = ROM[(place >> FRACTION_BITS) & (ROWS - 1)]
    fraction = place & ((1 << FRACTION_BITS) - 1)
    product = (row & SLOPE_MASK) * (2 * fraction + 1)
    magnitude = half_up(((row >> SLOPE_BITS) << ALIGN) + product, PRODUCT_BITS)
    return -magnitude if (phase >> SIGN_BIT) & 1 else magnitude


BLOCK = Block(
    place=20,
    inputs={"phase": PHASE},
    latency={"y": LATENCY},
    rules={"y": ("half_away", None), "fraction": ("floor", None)},
    roms=(Rom("sine", BASE.width + SLOPE.width, tuple(ROM.tolist())),),
    relations=({"base": 1 << ALIGN, "slope": MIDDLE.hi}, {"base2": 1 << ALIGN, "product": 1}),
)

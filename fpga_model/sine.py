"""Sine from a quarter-wave table with linear interpolation, three registers deep.

    phase[47:26] = quadrant (2) : address a (10) : fraction f (10)     the lower 26 bits are cut
    odd quadrant:  a, f are complemented (mirror)     quadrant 2, 3:  the sign is negative
    y = +-round(BASE[a] + SLOPE[a] * (f + 1/2) / 1024)

    phase --(cut, fold)--(table)--[sign, base, slope, fraction]--(x)--[sign2, base2, product]--(+, round, +-)--[y]

Formats   phase [0,0,48]   base [0,17,6]   slope [0,8,5]   fraction [0,0,10]   product [0,8,16]   y [1,0,17]
Latency   3 clocks from phase to y
Rounding  phase is cut and the sine taken at the middle of the cut cell; y: magnitude, ties up, so that sine is odd
Overflow  none: BASE + SLOPE never exceeds 2**17 - 1, which is full scale; y is never -2**17
Cost      113 register bits, one 13 x 11 bit multiplier, a table of 1024 x 36 bits (four M9K)
Error     at most 0.562 LSB of y from the sine at the middle of the cell (`MAX_ERROR_LSB`), and 0.098 for the cut
          (`PHASE_CUT_LSB`); so every spur is below -103.8 dBc for any frequency word

The half in (f + 1/2) makes the mirror a plain complement, and takes away the mean delay that cutting would add.
Tables are pure integer arithmetic.
"""

from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fpga_model import dds
from fpga_model.block import Block, Rom
from fpga_model.design_record import DEFAULT, width
from fpga_model.fixed import Fmt, add_fmt, bits, formats, half_up, mul_fmt
from fpga_model.jit import inlined

PHASE = dds.PHASE
ADDRESS_BITS, FRACTION_BITS, BITS = width("sine_address_bits"), width("sine_fraction_bits"), width("sine_bits")
BASE_GUARD, SLOPE_GUARD = 6, 5  # bits of the table below an LSB of y
BASE = Fmt(0, BITS - 1, BASE_GUARD)
SLOPE = Fmt(0, BITS - ADDRESS_BITS, SLOPE_GUARD)
MIDDLE = Fmt(0, 0, FRACTION_BITS + 1)
PRODUCT = mul_fmt(SLOPE, MIDDLE)
CUT = PHASE.width - 2 - ADDRESS_BITS - FRACTION_BITS
ALIGN = PRODUCT.f - BASE.f
PRODUCT_GUARD = SLOPE_GUARD + 1  # bits of the product below an LSB of y, beside those of the fraction
OUT = Fmt(1, 0, BITS - 1)
FULL_SCALE = OUT.hi
LATENCY = 3
ROWS = 1 << ADDRESS_BITS
assert add_fmt(BASE, PRODUCT).width + 1 <= 63, "base + product and the rounding constant must fit int64"

# In LSB of y: what each stage may be wrong by at most; a chord by A h**2/8. 355/113 is just above pi.
PI_UPPER_BOUND = Fraction(355, 113)
INTERPOLATION_LSB = FULL_SCALE * (PI_UPPER_BOUND / 2 / ROWS) ** 2 / 8
TABLE_LSB = Fraction(1, 2 << BASE.f) + Fraction(1, 2 << SLOPE.f)
ROUNDING_LSB = Fraction(1, 2)
MAX_ERROR_LSB = INTERPOLATION_LSB + TABLE_LSB + ROUNDING_LSB
PHASE_CUT_LSB = FULL_SCALE * PI_UPPER_BOUND / (1 << (2 + ADDRESS_BITS + FRACTION_BITS))


class State(NamedTuple):
    """The registers."""

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


@cache
def tables(d=DEFAULT, guard_bits=128):
    """BASE and SLOPE of a design: the sine at the start of each step, and the chord to the next."""
    exact = [OUT.for_design(d).hi * x for x in quarter_wave(1 << d.sine_address_bits, guard_bits)]

    def round_to_format(x, fmt):
        dropped = guard_bits - fmt.f
        return (x + (1 << (dropped - 1))) >> dropped

    base = tuple(round_to_format(x, BASE) for x in exact[:-1])
    slope = tuple(round_to_format(after - x, SLOPE) for x, after in pairwise(exact))
    return base, slope


@cache
def table(d=DEFAULT):
    """The table of a design as one row to a memory word, base above slope; int64, read only."""
    words = np.array([b << SLOPE.for_design(d).width | s for b, s in zip(*tables(d))], np.int64)
    words.flags.writeable = False
    return words


ROM = table()


@inlined
def standard(d):
    """Whether a design has the sizes of the default one, and so the table ROM."""
    sizes = d.sine_address_bits == ADDRESS_BITS and d.sine_fraction_bits == FRACTION_BITS and d.sine_bits == BITS
    return sizes and d.dds_bits == DEFAULT.dds_bits


@inlined
def step(d, rom, s, phase):
    """One clock edge of a design `d` with its `rom`."""
    quarter_position = phase >> (d.dds_bits - 2 - d.sine_address_bits - d.sine_fraction_bits)
    if quarter_position & (1 << (d.sine_address_bits + d.sine_fraction_bits)):
        quarter_position = ~quarter_position
    row = int(rom[(quarter_position >> d.sine_fraction_bits) & ((1 << d.sine_address_bits) - 1)])
    slope_bits = d.sine_bits - d.sine_address_bits + SLOPE_GUARD
    magnitude = half_up((s.base2 << d.sine_fraction_bits) + s.product, d.sine_fraction_bits + PRODUCT_GUARD)
    return State(
        sign=(phase >> (d.dds_bits - 1)) & 1,
        base=row >> slope_bits,
        slope=row & ((1 << slope_bits) - 1),
        fraction=quarter_position & ((1 << d.sine_fraction_bits) - 1),
        sign2=s.sign,
        base2=s.base,
        product=s.slope * (2 * s.fraction + 1),
        y=-magnitude if s.sign2 == 1 else magnitude,
    )


@inlined
def phase_sine(d, rom, phase):
    """y of a phase: what `step` gives LATENCY clocks later."""
    fraction_bits = d.sine_fraction_bits
    quarter_position = phase >> (d.dds_bits - 2 - d.sine_address_bits - fraction_bits)
    if quarter_position & (1 << (d.sine_address_bits + fraction_bits)):
        quarter_position = ~quarter_position
    row = rom[(quarter_position >> fraction_bits) & ((1 << d.sine_address_bits) - 1)]
    fraction = quarter_position & ((1 << fraction_bits) - 1)
    slope_bits = d.sine_bits - d.sine_address_bits + SLOPE_GUARD
    product = (row & ((1 << slope_bits) - 1)) * (2 * fraction + 1)
    magnitude = half_up(((row >> slope_bits) << fraction_bits) + product, fraction_bits + PRODUCT_GUARD)
    return -magnitude if (phase >> (d.dds_bits - 1)) & 1 else magnitude


BLOCK = Block(
    place=20,
    inputs={"phase": PHASE},
    latency={"y": LATENCY},
    rules={"y": ("half_away", None), "fraction": ("floor", None)},
    roms=(Rom("sine", BASE.width + SLOPE.width, table),),
    relations=lambda d: (
        {"base": 1 << d.sine_fraction_bits, "slope": MIDDLE.for_design(d).hi},
        {"base2": 1 << d.sine_fraction_bits, "product": 1},
    ),
)

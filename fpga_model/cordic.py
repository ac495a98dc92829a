"""Vectoring CORDIC: amplitude and angle of (x_in, y_in), one micro-rotation per clock, no multiplier.

    load      x[0] = abs(x_in),  y[0] = y_in or -y_in,  angle[0] = 0 or half a turn      (half a turn when x_in < 0)
    rotate    d = 1 if y[i] >= 0 else -1,   i = 0 .. n - 1              n = 24: `cordic_iterations` of the design
              x[i+1]     = x[i] + d*round(y[i] * 2**-i)
              y[i+1]     = y[i] - d*round(x[i] * 2**-i)
              angle[i+1] = angle[i] + d*ATAN[i]  mod 1 turn
    hold      x, y, angle,   i = n .. 23
    finish    magnitude = round(x[n]) = K*sqrt(x_in**2 + y_in**2),  K = 1.646760258 where n = 24
              phase     = round(angle[n]) = atan2(y_in, x_in) in turns;  0 when x_in = y_in = 0

    x_in --(abs)--[x]<-->(shift, +-)                (round)--[magnitude]-->     [..] register
    y_in --(+-)---[y]<-->(shift, +-) sign of y = d
                  [angle]<--(+- ATAN[i])            (round)--[phase]-->

Formats   x_in, y_in [1,23,0]   x [0,25,8]   y [1,24,8]   angle [1,-1,32] turn   magnitude [0,25,0]
          phase [1,-1,24] turn   i [0,5,0]   busy, done [0,1,0]
Latency   26 clocks from start to done (load, 24 rotations or holds, finish); done lasts one clock, the results stay
Rounding  ties toward +inf at every shift and at both results; 8 guard bits (`cordic_guard_bits`)
Overflow  x, y and magnitude cannot overflow; angle and phase wrap at one turn (plus half a turn reads as minus half)
Cost      154 register bits, 3 less for each guard bit less; three adders of 33 bits, two shifters
Error     magnitude: at most 0.57 LSB, for a vector of 1 LSB or more
          phase: at most 0.87 LSB + 0.077 rad / r, r the length of the input in LSB

A start while busy abandons the running vector and loads the new one. On the negative x axis the phase reads -2**23 or
2**23 - 1: take differences of phases modulo one turn. The phase error doubles when the vector halves; below 3 % of full
scale its second part is the larger. With 8 guard bits the rotations stay below the quantisation of the input.

A design has 8 to 24 rotations and 0 to 8 guard bits: tests/fpga_model/test_cordic.py has the bounds. With n = 8 the
phase is off by up to 0.45 degree, and the frequency loop moves between two of its 2**n values.
"""

from fractions import Fraction
from functools import cache
from math import isqrt, prod
from typing import NamedTuple

from fpga_model.block import BIT, Block, Rom
from fpga_model.design_record import DEFAULT, width
from fpga_model.fixed import Fmt, bits, clamp, formats, half_up, signed_bits, wrap
from fpga_model.jit import inlined

INPUT = signed_bits(24)
INPUT_LO, INPUT_HI = INPUT.lo, INPUT.hi
GUARD = width("cordic_guard_bits")  # fraction bits of x and y, and bits of angle below the LSB of phase
ITERATIONS = DEFAULT.cordic_iterations  # and clocks from load to finish, whatever the design
LATENCY = ITERATIONS + 2
PHASE = Fmt(1, -1, 24)
ANGLE = Fmt(1, -1, 24 + GUARD)
X = Fmt(0, 25, GUARD)
Y = Fmt(1, 24, GUARD)
MAGNITUDE = Fmt(0, 25, 0)
# numba knows no properties of a format: widths used in kernels are module constants
PHASE_BITS = PHASE.width
HALF_TURN = PHASE.lo  # in LSB of phase
assert max(X.width, Y.width, ANGLE.width) + 2 <= 63, "a sum and its rounding constant must fit int64"


def _atan_of_inverse(n, one):
    """atan(1/n) * one by its series in integers, n >= 2; each term is cut, so the error stays below the term count."""
    total, power, k = 0, one // n, 0
    while power:
        total += (-power if k % 2 else power) // (2 * k + 1)
        power //= n * n
        k += 1
    return total


def _atan_table():
    """atan(2**-i) in turns, rounded to the LSB of `angle`; 96 bits inside, and pi by Machin's formula."""
    one = 1 << 96
    two_pi = 8 * (4 * _atan_of_inverse(5, one) - _atan_of_inverse(239, one))
    turns = [(_atan_of_inverse(1 << i, one) << ANGLE.f, two_pi) for i in range(1, ITERATIONS)]
    return ((1 << ANGLE.f) // 8, *((2 * up + down) // (2 * down) for up, down in turns))


ATAN = _atan_table()


def table(d=DEFAULT):
    """The angles of a design in LSB of its `angle`, 0 where it holds."""
    used = ATAN[: d.cordic_iterations]
    return tuple(half_up(turn, GUARD - d.cordic_guard_bits) for turn in used) + (0,) * (ITERATIONS - len(used))


@cache
def gain(iterations=ITERATIONS):
    """K of so many rotations: K**2 is a rational number; its root is cut at 80 bits."""
    square = prod((Fraction(4**i + 1, 4**i) for i in range(iterations)), start=Fraction(1))
    return Fraction(isqrt((square.numerator << 160) // square.denominator), 1 << 80)


class State(NamedTuple):
    """The registers."""

    x: X = 0
    y: Y = 0
    angle: ANGLE = 0
    i: bits(5) = 0
    busy: bits(1) = 0
    done: bits(1) = 0
    magnitude: MAGNITUDE = 0
    phase: PHASE = 0


STATE_FMT = formats(State)


@inlined
def negated(x):
    """-x, saturating: the code of minus full scale has no opposite."""
    return clamp(-x, INPUT_LO, INPUT_HI)


@inlined
def step(d, s, start, x_in, y_in):
    """One clock edge."""
    if start:
        return State(
            x=(-x_in if x_in < 0 else x_in) << d.cordic_guard_bits,
            y=(-y_in if x_in < 0 else y_in) << d.cordic_guard_bits,
            angle=HALF_TURN << d.cordic_guard_bits if x_in < 0 else 0,
            i=0,
            busy=1,
            done=0,
            magnitude=s.magnitude,
            phase=s.phase,
        )
    if s.busy == 0:
        return State(s.x, s.y, s.angle, s.i, 0, 0, s.magnitude, s.phase)
    if s.i < ITERATIONS:
        if s.i >= d.cordic_iterations:
            return State(s.x, s.y, s.angle, s.i + 1, 1, 0, s.magnitude, s.phase)
        across = half_up(s.y, s.i)
        down = half_up(s.x, s.i)
        turn = half_up(ATAN[s.i], GUARD - d.cordic_guard_bits)
        return State(
            x=s.x + across if s.y >= 0 else s.x - across,
            y=s.y - down if s.y >= 0 else s.y + down,
            angle=wrap(s.angle + turn if s.y >= 0 else s.angle - turn, PHASE_BITS + d.cordic_guard_bits),
            i=s.i + 1,
            busy=1,
            done=0,
            magnitude=s.magnitude,
            phase=s.phase,
        )
    return State(
        x=s.x,
        y=s.y,
        angle=s.angle,
        i=s.i,
        busy=0,
        done=1,
        magnitude=half_up(s.x, d.cordic_guard_bits),
        # only the zero vector leaves x at 0, and then the angle register holds the sum of the table
        phase=0 if s.x == 0 else wrap(half_up(s.angle, d.cordic_guard_bits), PHASE_BITS),
    )


BLOCK = Block(
    place=100,
    inputs={"start": BIT, "x_in": INPUT, "y_in": INPUT},
    functions={"negated": ({"x": INPUT}, INPUT)},
    latency={"magnitude": LATENCY, "phase": LATENCY, "done": LATENCY},
    rules={
        "x": ("half_up", None),
        "y": ("half_up", None),
        "angle": (None, "wrap"),
        "magnitude": ("half_up", None),
        "phase": ("half_up", "wrap"),
    },
    strobes=("start",),
    wait=LATENCY,
    roms=(Rom("cordic_atan", ANGLE.width, table),),
    split=("busy", "i"),
)

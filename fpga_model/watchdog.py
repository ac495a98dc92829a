"""Watchdog of the ADC: counts the time since the last frame and says when frames have stopped coming.

    frame = 1    age' = 0                       stale' = 0
    ce_1m = 1    age' = min(age + 1, all ones)  stale' = 1 if age + 1 > limit else stale

    ce_1m --(+1)--[age]--(> limit)--[stale]-->     [..] register; frame clears both

Formats   age, limit [0,10,0] us   stale [0,1,0]
Latency   1 clock from a frame to stale = 0; limit + 1 ticks of 1 us without a frame to stale = 1
Rounding  none
Overflow  age saturates at the top of its format
Source    docs/blocks/watchdog.md

`frame` is the strobe of a completed ADC frame, with a good or a bad status word: a bad one starts its own 8 kHz
window. The limit of 2.4 frame periods is the debounce on the way in; the first frame ends stale at once.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, clamp, formats, quantize
from fpga_model.jit import inlined

AGE = bits(10)
AGE_TOP = AGE.hi
LATENCY = 1


class Params(NamedTuple):
    """Machine units in their formats; build with `design`."""

    limit: AGE


class State(NamedTuple):
    """The registers: formats and reset values."""

    age: AGE = 0
    stale: bits(1) = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(limit_us=300):
    """Quantise the longest gap between two frames that is still healthy.

    limit_us  (us), below the top of `age`, or stale could never rise; at least two periods of 125 us
    """
    limit = quantize(limit_us, AGE, "limit_us (us)")
    if not 250 <= limit < AGE.hi:
        raise ValueError(f"limit_us: {limit_us} us is outside 250 .. {AGE.hi - 1} us")
    return Params(limit)


@inlined
def step(p, s, ce_1m, frame):
    """One clock edge: every right-hand side reads the old registers."""
    if frame:
        return State(age=0, stale=0)
    if ce_1m:
        age = clamp(s.age + 1, 0, AGE_TOP)
        return State(age=age, stale=1 if age > p.limit else s.stale)
    return State(age=s.age, stale=s.stale)


BLOCK = Block(
    place=210,
    inputs={"ce_1m": BIT, "frame": BIT},
    latency={"stale": "1 after frame; limit + 1 ticks without one"},
    cases={"default": design(), "limit250": design(250)},
    rules={"age": (None, "saturate")},
)

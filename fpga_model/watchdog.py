"""Watchdog of the ADC: counts the time since the last frame and says when frames have stopped coming.

    frame = 1    age' = 0                       stale' = 0
    ce_1m = 1    age' = min(age + 1, all ones)  stale' = 1 if age + 1 > limit else stale

    ce_1m --(+1)--[age]--(> limit)--[stale]-->     [..] register; frame clears both

Formats   age, limit [0,10,0] ticks   stale [0,1,0]
Latency   1 clock from a frame to stale = 0; limit + 1 ticks without a frame to stale = 1
Rounding  none
Overflow  age saturates at the top of its format
Cost      11 register bits, one comparison

Without frames no 8 kHz window begins. So while `stale` is 1 ce_8k starts it, and the sequencer can stop the drive.
`frame` is the strobe of a completed ADC frame, with a good or a bad status word. The limit is 2.4 frames: one lost
frame is not stale.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits, clamp, formats, quantize
from fpga_model.jit import inlined

AGE = bits(10)
AGE_TOP = AGE.hi
LATENCY = 1


class Params(NamedTuple):
    """Machine units; build with `design`."""

    limit: AGE


class State(NamedTuple):
    """The registers."""

    age: AGE = 0
    stale: bits(1) = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(d=DEFAULT, limit_frames=2.4):
    """Quantise the longest gap between two frames of a design that is still healthy.

    limit_frames  (frames), two at least: one lost frame is not stale. In ticks it must stay below the top of `age`,
                  or stale could never rise
    """
    limit = round(limit_frames * d.frame_ticks)
    if not 2 * d.frame_ticks <= limit < AGE.hi:
        room = f"{2 * d.frame_ticks} .. {AGE.hi - 1} ticks"
        raise ValueError(f"watchdog: a gap of {limit_frames:g} frames of {d.frame_ticks} ticks is outside {room}")
    return Params(quantize(limit, AGE, "limit (ticks)"))


@inlined
def step(p, s, ce_1m, frame):
    """One clock edge."""
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
    cases={"default": design(), "limit250": design(limit_frames=2)},
    rules={"age": (None, "saturate")},
)

"""Pipeline delay of 0 to 8 clocks: the registers that a design adds or saves, as a parameter.

    tap0[n+1] = x[n]     tapk[n+1] = tap(k-1)[n]     out = x if depth == 0 else tap(depth-1)

    x --+--[tap0]--[tap1]--  ...  --[tap7]        out picks x or one tap
        '------------------------> out

Formats   x, taps and out [1,0,17] (`state_fmt` for another); depth [0,4,0]
Latency   depth clocks from x to out
Rounding  none
Overflow  none
Cost      18 register bits per clock of depth

A clock is 0.152 deg at 11 kHz. With depth 0 there is no register and the taps stay at reset. Otherwise all eight shift;
those above `depth` are not connected, and a synthesiser removes them.
"""

from typing import NamedTuple

from fpga_model import sine
from fpga_model.block import Block
from fpga_model.fixed import bits, formats, quantize
from fpga_model.jit import inlined

MAX_DEPTH = 8
X = sine.OUT


class Params(NamedTuple):
    """Machine units; build with `design`."""

    depth: bits(4)


class State(NamedTuple):
    """The registers."""

    taps: [X] * MAX_DEPTH = (0,) * MAX_DEPTH


PARAMS_FMT = formats(Params)


def state_fmt(fmt):
    """Formats of the registers of a delay line for words of format `fmt`."""
    return State(taps=(fmt,) * MAX_DEPTH)


STATE_FMT = formats(State)


def design(depth_clocks):
    """Delay of `depth_clocks` (26 MHz clocks), 0 .. 8; raises ValueError otherwise."""
    depth = quantize(depth_clocks, PARAMS_FMT.depth, "depth_clocks (26 MHz clocks)")
    if depth > MAX_DEPTH or depth != depth_clocks:
        raise ValueError(f"depth_clocks: {depth_clocks} is not a whole number of clocks from 0 to {MAX_DEPTH}")
    return Params(depth=depth)


def latency(p):
    """Clocks from x to out."""
    return p.depth


@inlined
def step(p, s, x):
    """One clock edge."""
    taps = s.taps
    if p.depth != 0:
        taps = (x,) + s.taps[:-1]
    return State(taps=taps)


@inlined
def out(p, s, x):
    """Output pin: the chosen tap, or the input itself."""
    y = x
    if p.depth != 0:
        y = s.taps[p.depth - 1]
    return y


BLOCK = Block(
    place=30,
    inputs={"x": X},
    outputs={"out": X},
    latency={"out": "depth"},
    cases={f"depth{k}": design(k) for k in (0, 1, 3, MAX_DEPTH)},
)

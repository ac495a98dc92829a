"""Integer square root, one result bit per clock: root = floor(sqrt(u)), remainder = u - root**2.

    load      radicand = u,  root = remainder = i = 0,  busy = 1,  done = 0
    iterate   pair  = 4*remainder + (two top bits of radicand)
              trial = 4*root + 1
              fits  = pair >= trial                           16 times
              remainder = pair - trial if fits else pair
              root      = 2*root + fits
              radicand  = 4*radicand mod 2**32,  i = i + 1 mod 16,  done = 0
    finish    the 16th iteration (i = 15) also loads y = root:  i = 0,  busy = 0,  done = 1
    idle      done = 0 while busy = 0, so done lasts one clock

    u --[radicand]--(top 2)--(- trial)--[remainder]        [..] register
                               sign --> [root] --> [y]

Formats   u, radicand [0,32,0]   root, y [0,16,0]   remainder [0,17,0]   i [0,4,0]   busy, done [0,1,0]
Latency   17 clocks from start to done; y stays until the next result
Rounding  toward zero (the floor of the root), exact: root**2 <= u < (root + 1)**2
Overflow  none possible: remainder never exceeds 2*root; radicand drops the bits already used
Cost      87 register bits, one subtractor of 19 bits

A start while busy abandons the running value and loads the new one. After k iterations root and remainder are those of
the top 2k bits of u.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats, wrap_unsigned
from fpga_model.jit import inlined

RADICAND = bits(32)
ROOT = bits(16)
REMAINDER = bits(17)
ITERATIONS = ROOT.width
LATENCY = ITERATIONS + 1
# numba knows no properties of a format: widths used in kernels are module constants
RADICAND_BITS, COUNT_BITS = RADICAND.width, 4
TOP = RADICAND_BITS - 2
assert max(REMAINDER.width, RADICAND.width) + 2 <= 63, "four times a register must fit int64"


class State(NamedTuple):
    """The registers."""

    radicand: RADICAND = 0
    root: ROOT = 0
    remainder: REMAINDER = 0
    i: bits(COUNT_BITS) = 0
    busy: bits(1) = 0
    done: bits(1) = 0
    y: ROOT = 0


STATE_FMT = formats(State)


@inlined
def step(s, start, u):
    """One clock edge."""
    if start:
        return State(radicand=u, root=0, remainder=0, i=0, busy=1, done=0, y=s.y)
    if s.busy == 0:
        return State(s.radicand, s.root, s.remainder, s.i, 0, 0, s.y)
    pair = (s.remainder << 2) + (s.radicand >> TOP)
    trial = (s.root << 2) + 1
    fits = 1 if pair >= trial else 0
    root = (s.root << 1) + fits
    last = 1 if s.i == ITERATIONS - 1 else 0
    return State(
        radicand=wrap_unsigned(s.radicand << 2, RADICAND_BITS),
        root=root,
        remainder=pair - trial if fits else pair,
        i=wrap_unsigned(s.i + 1, COUNT_BITS),
        busy=1 - last,
        done=last,
        y=root if last else s.y,
    )


BLOCK = Block(
    place=110,
    inputs={"start": BIT, "u": RADICAND},
    latency={"y": LATENCY, "done": LATENCY},
    rules={"y": ("floor", None), "radicand": (None, "wrap")},
    strobes=("start",),
    wait=LATENCY,
    split=("busy", "i"),
    relations=({"remainder": 1, "root": -2},),
    separate_paths=True,
)

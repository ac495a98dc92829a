"""Clock enables of the one clock domain: 26 MHz, 1 MHz ticks, 8 kHz frames, and the slots of the 8 kHz work.

    tick[n+1]  = tick[n] + 1 mod 26                                   26: `tick_clocks` of the design
    frame[n+1] = frame[n] + 1 mod 125 when tick wraps, else held     125: `frame_ticks`
    slot[n+1]  = 1 if go, else slot[n] + 1 while 1 <= slot[n] < SLOTS, else 0     SLOTS = 60

    [tick] --(== 25)--> en [frame]        go --> [slot]        ce_1m = (tick == 0), ce_8k = ce_1m and (frame == 0)

Formats   tick [0,5,0]   frame [0,7,0]   slot [0,6,0]
Latency   1 clock from go to slot = 1; the enables are decoded from the registers
Rounding  none
Overflow  tick wraps at 26, frame at 125; slot returns to 0 after SLOTS, a new go restarts it
Cost      18 register bits

Slots count from `go`, a valid frame, and not from ce_8k: so the ADC may have a clock of its own. V_q is sent in the
last of every 1, 2, 4 .. ticks (`quadrature_due`): the least power of two for at most 500 kHz, or 1 MHz if `fast`.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT, count_width
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

# those of the default design
MASTER_HZ = DEFAULT.master_hz
TICK_CYCLES = DEFAULT.tick_clocks
TICK_HZ = MASTER_HZ // TICK_CYCLES
FRAME_TICKS = DEFAULT.frame_ticks
FRAME_CYCLES = FRAME_TICKS * TICK_CYCLES
FRAME_HZ = MASTER_HZ // FRAME_CYCLES
LATENCY = 1

# The 8 kHz work in clocks after a valid ADC frame: each slot is the first clock at which its block is enabled.
SLOT_CORDIC = 1
SLOT_SEQUENCER = 31
SLOT_LOOPS = 32
SLOT_ROOT = 36
SLOTS = 60
QUADRATURE_HZ = 500_000  # most frames of V_q in a second, or twice as many


class State(NamedTuple):
    """The registers."""

    tick: bits(count_width("tick_clocks")) = 0
    frame: bits(count_width("frame_ticks")) = 0
    slot: bits(6) = 0


STATE_FMT = formats(State)
assert STATE_FMT.slot.holds(SLOTS)
assert SLOT_CORDIC < SLOT_SEQUENCER < SLOT_LOOPS < SLOT_ROOT < SLOTS < FRAME_CYCLES


@inlined
def step(d, s, go):
    """One clock edge."""
    tick = s.tick + 1
    frame = s.frame
    if tick == d.tick_clocks:
        tick = 0
        frame = s.frame + 1 if s.frame != d.frame_ticks - 1 else 0
    slot = 0
    if go == 1:
        slot = 1
    elif s.slot != 0 and s.slot != SLOTS:
        slot = s.slot + 1
    return State(tick=tick, frame=frame, slot=slot)


@inlined
def tick_enable(s, tick):
    """1 in the clock whose edge is number `tick` of the 1 us tick."""
    return 1 if s.tick == tick else 0


@inlined
def ce_1m(s):
    """1 MHz enable: the first edge of a tick."""
    return 1 if s.tick == 0 else 0


@inlined
def ce_8k(s):
    """8 kHz enable: the first edge of a frame."""
    return 1 if s.tick == 0 and s.frame == 0 else 0


@inlined
def quadrature_mask(d, fast):
    """Ticks from one frame of V_q to the next, less 1: the least power of two for at most 500 kHz (`fast`: 1 MHz)."""
    clocks = d.tick_clocks * (2 * QUADRATURE_HZ if fast else QUADRATURE_HZ)
    mask = 1 if clocks < d.master_hz else 0
    mask = 3 if 2 * clocks < d.master_hz else mask
    mask = 7 if 4 * clocks < d.master_hz else mask
    mask = 15 if 8 * clocks < d.master_hz else mask
    return 31 if 16 * clocks < d.master_hz else mask  # for ticks up to 16 MHz


@inlined
def quadrature_due(d, frame, fast):
    """1 in the ticks of a frame in which V_q is sent: the last of every 1, 2, 4 ..."""
    mask = quadrature_mask(d, fast)
    return 1 if frame & mask == mask else 0


SLOT, FRAME = State.__annotations__["slot"], State.__annotations__["frame"]

BLOCK = Block(
    place=220,
    inputs={"go": BIT},
    outputs={"ce_1m": BIT, "ce_8k": BIT},
    functions={"tick_enable": ({}, BIT), "quadrature_due": ({"frame": FRAME, "fast": BIT}, BIT)},
    latency={"slot": LATENCY},
    rules={"tick": (None, "wrap"), "frame": (None, "wrap")},
    strobes=("go",),
    wait=SLOTS,
    stops=lambda d: (d.tick_clocks, d.frame_ticks, SLOTS),
)

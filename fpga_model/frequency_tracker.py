"""Drive frequency loop: a PI on the CORDIC phase moves the DDS word around a centre that the search corrects.

    en            error' = phase;  centre' = preset if load, centre + correction if adjust
    en_pi         the PI of pi.py acts on error, in its mode (preset 0)
    every edge    word' = centre + loop.y  mod 2**48

    phase --[error]--(pi)--[loop.y]--(+)--[word]-->     [..] register
    preset, correction --[centre]---^

Formats   phase, error [1,-1,24] turn   correction [1,-1,48]   preset, centre, word [0,0,48] turns per clock
Latency   4 clocks from en to word when en_pi follows en by one clock
Rounding  as pi.py
Overflow  loop.y saturates at its limits (+-100 Hz); centre and word are modulo one turn per clock, out of reach
Source    docs/blocks/frequency_tracker.md

The phase is the lead of x on the DDS: it rises while the resonator is faster than the word, so the gains are positive.
"""

from math import pi as PI
from typing import NamedTuple

from fpga_model import cordic, dds, pi
from fpga_model.block import BIT, Block
from fpga_model.fixed import Fmt, formats, wrap_unsigned
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ, MASTER_HZ

WORD = dds.PHASE
WORD_BITS = WORD.width
CORRECTION = Fmt(1, -1, WORD.f)
ERROR = cordic.PHASE
WORD_PER_HZ = 2.0**WORD.f / MASTER_HZ
LATENCY = 4
assert pi.ERR.width >= ERROR.width, "the phase must fit the input of the PI"

NOMINAL_HZ = 11_000.0
NOMINAL_WORD = dds.word_of_hz(NOMINAL_HZ)


class Params(NamedTuple):
    """Machine units in their formats; build with `design`."""

    loop: pi.Params


class State(NamedTuple):
    """The registers: formats and reset values."""

    error: ERROR = 0
    centre: WORD = NOMINAL_WORD
    word: WORD = NOMINAL_WORD
    loop: pi.State = pi.State()


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(crossover_hz=3.0, zero_hz=0.6, limit_hz=100.0, frame_hz=FRAME_HZ):
    """Gains from the plant d(phase)/dt = fx - f (turns per second and Hz).

    crossover_hz  frequency of unit gain of the proportional part (Hz)
    zero_hz       PI zero (Hz)
    limit_hz      largest distance of the word from its centre (Hz)
    frame_hz      rate of the enables (Hz)
    """
    if not 0 < limit_hz < MASTER_HZ / 4:
        raise ValueError(f"limit_hz: {limit_hz} Hz is outside 0 .. {MASTER_HZ / 4:g} Hz")
    kp = 2 * PI * crossover_hz * WORD_PER_HZ * 2.0**-ERROR.f
    limit = round(limit_hz * WORD_PER_HZ)
    return Params(loop=pi.design(kp, kp * 2 * PI * zero_hz, frame_hz, -limit, limit))


@inlined
def step(p, s, en, en_pi, mode, phase, load, adjust, correction, preset):
    """One clock edge: every right-hand side reads the old registers."""
    centre = s.centre
    if en and load:
        centre = preset
    elif en and adjust:
        centre = wrap_unsigned(s.centre + correction, WORD_BITS)
    return State(
        error=phase if en else s.error,
        centre=centre,
        word=wrap_unsigned(s.centre + s.loop.y, WORD_BITS),
        loop=pi.step(p.loop, s.loop, en_pi, mode, s.error, 0),
    )


BLOCK = Block(
    place=130,
    inputs={
        "en": BIT,
        "en_pi": BIT,
        "mode": pi.MODE,
        "phase": ERROR,
        "load": BIT,
        "adjust": BIT,
        "correction": CORRECTION,
        "preset": WORD,
    },
    latency={"error": 1, "word": LATENCY},
    # the limits of the design are 22,000 frames away: those of the second case are near
    cases={"default": design(), "narrow": design(limit_hz=0.05)},
    rules={"centre": (None, "wrap"), "word": (None, "wrap")},
    strobes=("en", "en_pi"),
)

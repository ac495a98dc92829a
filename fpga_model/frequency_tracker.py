"""Drive frequency loop: a PI on the CORDIC phase moves the DDS word around a centre that the search corrects.

    en            error' = phase;  centre' = preset if load, centre + correction if adjust
    en_pi         the PI of pi.py acts on error, in its mode (preset 0)
    every edge    word' = centre + loop.y  mod 2**48     48: `dds_bits`

    phase --[error]--(pi)--[loop.y]--(+)--[word]-->     [..] register
    preset, correction --[centre]---^

Formats   phase, error [1,-1,24] turn   correction [1,-1,48]   preset, centre, word [0,0,48] turns per clock
Latency   4 clocks from en to word when en_pi follows en by one clock
Rounding  as pi.py
Overflow  loop.y saturates at its limits (+-100 Hz); centre and word are modulo one turn per clock, out of reach
Cost      276 register bits, the multipliers of pi.py

The phase is the lead of x on the DDS: it rises while the resonator is faster than the word, so the gains are positive.
The gain does not depend on the amplitude, and the error needs no clamp: half a turn asks for 9.4 Hz. `load` keeps
FREQUENCY_FIXED in the centre until the search; `adjust` adds once what it found.
"""

from math import pi as PI
from typing import NamedTuple

from fpga_model import cordic, dds, pi
from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, formats, wrap_unsigned
from fpga_model.jit import inlined

WORD = dds.PHASE
CORRECTION = Fmt(1, -1, WORD.f)
ERROR = cordic.PHASE
LATENCY = 4
assert pi.ERR.width >= ERROR.width, "the phase must fit the input of the PI"

NOMINAL_HZ = 11_000.0
NOMINAL_WORD = dds.word_of_hz(NOMINAL_HZ)


class Params(NamedTuple):
    """Machine units; build with `design`."""

    loop: pi.Params


class State(NamedTuple):
    """The registers."""

    error: ERROR = 0
    centre: WORD = NOMINAL_WORD
    word: WORD = NOMINAL_WORD
    loop: pi.State = pi.State()


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def reset(d=DEFAULT):
    """The registers of a design at power-on: the nominal frequency in its words."""
    word = dds.word_of_hz(NOMINAL_HZ, d)
    return State(centre=word, word=word)


def word_per_hz(d=DEFAULT):
    """Frequency words of a design to one Hz, as a float."""
    return 2.0**d.dds_bits / d.master_hz


def design(crossover_hz=3.0, zero_hz=0.6, limit_hz=100.0, d=DEFAULT):
    """Gains from the plant d(phase)/dt = fx - f (turns per second and Hz).

    crossover_hz  frequency of unit gain of the proportional part (Hz)
    zero_hz       PI zero (Hz)
    limit_hz      largest distance of the word from its centre (Hz)
    d             the design record
    """
    if not 0 < limit_hz < d.master_hz / 4:
        raise ValueError(f"limit_hz: {limit_hz} Hz is outside 0 .. {d.master_hz / 4:g} Hz")
    kp = 2 * PI * crossover_hz * word_per_hz(d) * 2.0**-ERROR.f
    limit = round(limit_hz * word_per_hz(d))
    try:
        return Params(loop=pi.design(kp, kp * 2 * PI * zero_hz, d.frame_hz, -limit, limit))
    except ValueError as problem:
        raise ValueError(f"frequency loop with dds_bits = {d.dds_bits} bits: {problem}") from None


@inlined
def step(d, p, s, en, en_pi, mode, phase, load, adjust, correction, preset):
    """One clock edge."""
    centre = s.centre
    if en and load:
        centre = preset
    elif en and adjust:
        centre = wrap_unsigned(s.centre + correction, d.dds_bits)
    return State(
        error=phase if en else s.error,
        centre=centre,
        word=wrap_unsigned(s.centre + s.loop.y, d.dds_bits),
        loop=pi.step(d, p.loop, s.loop, en_pi, mode, s.error, 0),
    )


def _limited_loop_params(d, limit_hz):
    """The default loop with limits in words of a design: its own gains may be below an LSB."""
    limit = max(round(limit_hz * word_per_hz(d)), 1)
    return Params(loop=design().loop._replace(lo=-limit, hi=limit))


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
    cases=lambda d: {"default": _limited_loop_params(d, 100.0), "narrow": _limited_loop_params(d, 0.05)},
    rules={"centre": (None, "wrap"), "word": (None, "wrap")},
    strobes=("en", "en_pi"),
)

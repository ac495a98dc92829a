"""Direct digital synthesis: one phase accumulator and four outputs with a phase offset each.

    phase[n+1]  = phase[n] + word     mod 1 turn
    output[n+1] = phase[n] + offset   mod 1 turn      for drive_sine, sense_sine, drive_ref, sense_ref

    word --(+)--[phase]--+--(+ offset)--[drive_sine]
            ^-----------'+--(+ offset)--[sense_sine]
                         +--(+ offset)--[drive_ref]
                         '--(+ offset)--[sense_ref]          [..] register

Formats   word, offsets, phase and outputs [0,0,48] (`dds_bits`), unsigned turns
Latency   1 clock from phase to an output, from an offset to its output, and from word to phase
Rounding  none
Overflow  every sum wraps at one turn: phase arithmetic is modular
Cost      240 register bits, five 48-bit adders

A positive offset advances its output. The offsets, 0 at reset, are the firmware's only means against phase errors.
Frequency = word * 26 MHz / 2**48: the LSB of word is 92.4 nHz (32 bits: 6 mHz, a fifth of the half-bandwidth).
"""

from fractions import Fraction
from typing import NamedTuple

from fpga_model.block import Block
from fpga_model.design_record import DEFAULT, width
from fpga_model.fixed import Fmt, add_fmt, formats, quantize, wrap_unsigned
from fpga_model.jit import inlined

PHASE = Fmt(0, 0, width("dds_bits"))
LATENCY = 1
assert add_fmt(PHASE, PHASE).width <= 63, "the sum must fit int64 before it wraps"


class State(NamedTuple):
    """The registers."""

    phase: PHASE = 0
    drive_sine: PHASE = 0
    sense_sine: PHASE = 0
    drive_ref: PHASE = 0
    sense_ref: PHASE = 0


STATE_FMT = formats(State)


def word_of_hz(frequency_hz, d=DEFAULT):
    """Frequency word of a design nearest to `frequency_hz`; raises ValueError outside 0 .. its master clock."""
    if not 0 <= frequency_hz < d.master_hz:
        raise ValueError(f"frequency_hz: {frequency_hz} Hz is not from 0 to below {d.master_hz} Hz")
    name = f"frequency_hz / {d.master_hz / 1e6:g} MHz (turns per clock)"
    return quantize(Fraction(frequency_hz) / d.master_hz, PHASE.for_design(d), name)


def hz_of_word(word, d=DEFAULT):
    """Exact frequency of a word, as a Fraction (Hz)."""
    return Fraction(word * d.master_hz, 1 << d.dds_bits)


def offset_of_deg(offset_deg, d=DEFAULT):
    """Offset word nearest to `offset_deg`, taken modulo one turn; a positive offset advances the output."""
    if not abs(offset_deg) < float("inf"):
        raise ValueError(f"offset_deg: {offset_deg} deg is not a finite number")
    return round(Fraction(offset_deg) / 360 * (1 << d.dds_bits)) % (1 << d.dds_bits)


@inlined
def step(d, s, word, off_drive_sine, off_sense_sine, off_drive_ref, off_sense_ref):
    """One clock edge."""
    n = d.dds_bits
    return State(
        phase=wrap_unsigned(s.phase + word, n),
        drive_sine=wrap_unsigned(s.phase + off_drive_sine, n),
        sense_sine=wrap_unsigned(s.phase + off_sense_sine, n),
        drive_ref=wrap_unsigned(s.phase + off_drive_ref, n),
        sense_ref=wrap_unsigned(s.phase + off_sense_ref, n),
    )


BLOCK = Block(
    place=10,
    inputs={"word": PHASE} | {f"off_{name}": PHASE for name in ("drive_sine", "sense_sine", "drive_ref", "sense_ref")},
    latency=dict.fromkeys(State._fields, LATENCY),
    rules=dict.fromkeys(State._fields, (None, "wrap")),
)

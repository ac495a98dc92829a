"""The DDS phase between events: a line with at most two bends, and the clocks at which it enters a quarter turn.

    phase(t) = phase(t0) + (t - t0) word  mod 1 turn     exact in integers at any clock near t0

Source    docs/architecture.md, fpga_model/dds.py
"""

from typing import NamedTuple

from fpga_model.fixed import wrap_unsigned
from fpga_model.jit import inner

WIDEST = 48  # bits of a turn in the averaged plant
TURN_MASK = (1 << WIDEST) - 1


class Turn(NamedTuple):
    """The phase before clock `clock`, and its words: `word` from then on, `old` from `since` on, before that `oldest`.

    A window can change the word twice within two clocks; what is taken of the phase lies at most 40 clocks back.
    """

    clock: int
    phase: int
    word: int
    old: int
    since: int
    oldest: int
    bits: int  # of a turn


@inner
def phase_at(turn, clock):
    """The phase before `clock`."""
    if clock >= turn.clock:
        phase_advance = (clock - turn.clock) * turn.word
    elif clock >= turn.since:
        phase_advance = (clock - turn.clock) * turn.old
    else:
        phase_advance = (turn.since - turn.clock) * turn.old + (clock - turn.since) * turn.oldest
    return wrap_unsigned(turn.phase + phase_advance, turn.bits)


@inner
def word_at(turn, clock):
    """The word register before `clock`."""
    return turn.word if clock >= turn.clock else (turn.old if clock >= turn.since else turn.oldest)


@inner
def widen_word(d, word):
    """A phase or frequency word of a design in turns / 2^48."""
    return word << (WIDEST - d.dds_bits)


@inner
def narrow_word(d, word):
    """The word of a design that a number of turns / 2^48 stands for."""
    return word >> (WIDEST - d.dds_bits)


@inner
def word_limit(bits):
    """Words from here on turn by more than a quarter in 64 clocks."""
    return 1 << (bits - 8)


@inner
def still(clock, phase, word, bits):
    """A turn without a past, at `clock`."""
    return Turn(clock, phase, word, word, clock, word, bits)


@inner
def drop_history(turn, clock):
    """The turn from `clock` on, its past forgotten."""
    return still(clock, phase_at(turn, clock), turn.word, turn.bits)


@inner
def change_word(turn, clock, word):
    """The word has another value from `clock` on, if it has."""
    if word == turn.word:
        return turn
    return Turn(clock, phase_at(turn, clock), word, turn.word, turn.clock, turn.old, turn.bits)


@inner
def _crossing(turn, offset, clock, word):
    """First clock after `clock` that would see another quarter turn at this word."""
    remaining_phase = (1 << (turn.bits - 2)) - wrap_unsigned(phase_at(turn, clock) + offset, turn.bits - 2)
    return clock + (remaining_phase + word - 1) // word


@inner
def next_quarter(turn, offset, clock):
    """First clock after `clock` before which the phase plus `offset` has entered another quarter turn."""
    if clock < turn.since:
        crossing_clock = _crossing(turn, offset, clock, turn.oldest)
        if crossing_clock <= turn.since:
            return crossing_clock
        clock = turn.since
    if clock < turn.clock:
        crossing_clock = _crossing(turn, offset, clock, turn.old)
        if crossing_clock <= turn.clock:
            return crossing_clock
        clock = turn.clock
    return _crossing(turn, offset, clock, turn.word)

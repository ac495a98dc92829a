"""The DDS phase between events: a line with at most two bends, and the clocks at which it enters a quarter turn.

    phase(t) = phase(t0) + (t - t0) word  mod 1 turn     exact in integers at any clock near t0

Source    docs/architecture.md, docs/blocks/dds.md
"""

from typing import NamedTuple

from fpga_model import dds
from fpga_model.jit import inner

TURN_MASK = (1 << dds.WIDTH) - 1
QUARTER_BITS = dds.WIDTH - 2
QUARTER_MASK = (1 << QUARTER_BITS) - 1
WORD_LIMIT = 1 << (QUARTER_BITS - 6)  # at most one quarter turn in 64 clocks


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


@inner
def phase_at(turn, clock):
    """The phase before `clock`."""
    if clock >= turn.clock:
        moved = (clock - turn.clock) * turn.word
    elif clock >= turn.since:
        moved = (clock - turn.clock) * turn.old
    else:
        moved = (turn.since - turn.clock) * turn.old + (clock - turn.since) * turn.oldest
    return (turn.phase + moved) & TURN_MASK


@inner
def word_at(turn, clock):
    """The word register before `clock`."""
    return turn.word if clock >= turn.clock else (turn.old if clock >= turn.since else turn.oldest)


@inner
def steady(turn, clock):
    """A turn without a past, at `clock`."""
    return Turn(clock, phase_at(turn, clock), turn.word, turn.word, clock, turn.word)


@inner
def turn_of(turn, clock, word):
    """The word has another value from `clock` on, if it has."""
    if word == turn.word:
        return turn
    return Turn(clock, phase_at(turn, clock), word, turn.word, turn.clock, turn.old)


@inner
def _crossing(turn, offset, clock, word):
    """First clock after `clock` that would see another quarter turn at this word."""
    left = QUARTER_MASK + 1 - ((phase_at(turn, clock) + offset) & QUARTER_MASK)
    return clock + (left + word - 1) // word


@inner
def next_quarter(turn, offset, clock):
    """First clock after `clock` before which the phase plus `offset` has entered another quarter turn."""
    if clock < turn.since:
        found = _crossing(turn, offset, clock, turn.oldest)
        if found <= turn.since:
            return found
        clock = turn.since
    if clock < turn.clock:
        found = _crossing(turn, offset, clock, turn.old)
        if found <= turn.clock:
            return found
        clock = turn.clock
    return _crossing(turn, offset, clock, turn.word)

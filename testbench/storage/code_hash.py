"""Hash of all codes of a run: the same however the run is cut into chunks, interrupted or continued.

    h(0) = 32 zero bytes
    h(n+1) = sha256(h(n) | sha256(drive codes) | sha256(sense codes) | sha256(ADC codes and words))   of block n
    result = the same formula on the block that has begun

A block is the ticks between two multiples of `BLOCK_TICKS` from power-on. Codes of the DACs are little-endian int16 and
int32 of every tick, the others int64 of every frame begun in the block, row by row. Blocks, because a SHA-256 in
progress cannot be saved: a checkpoint keeps h(n) and the codes of the block that has begun. A second chain has the
frames alone: with it the rows of a record are compared with what was hashed, before the record is sealed.
Source  docs/record.md
"""

import hashlib

import numpy as np

from fpga_model.design_record import DEFAULT

BLOCK_TICKS = 125_000
WORDS = 9  # columns of a frame: ADC codes and words of the loops
KINDS = ("<i2", "<i4", "<i8")  # drive, sense, frames
NO_CODES, NO_WORDS = np.zeros(0, np.int64), np.zeros((0, WORDS), np.int64)


def frames_begun(tick, ticks, frame_ticks=DEFAULT.frame_ticks):
    """Number of frames whose first tick lies in `ticks` ticks from `tick` on."""
    return (tick + ticks - 1) // frame_ticks - (tick - 1) // frame_ticks


class CodeHash:
    """The chain, and the codes of the block that has begun."""

    def __init__(self, frame_ticks=DEFAULT.frame_ticks):
        self.frame_ticks = frame_ticks
        self._chain, self._words = bytes(32), bytes(32)
        self.begin_tick = self.end_tick = -1
        self.complete = True  # False behind a checkpoint of version 0.1.0, which lacks the second chain
        self._begin_block()

    def _begin_block(self):
        self._digests = [hashlib.sha256() for _ in KINDS]
        self._open = []  # the codes themselves, for a checkpoint; arrays of the engine, not copies

    def add(self, tick, ticks, drive, sense, words):
        """Codes of `ticks` ticks from `tick` on, and one row of `words` for each frame begun in them.

        drive, sense  empty from an engine that knows no codes of single ticks
        """
        if self.begin_tick < 0:
            self.begin_tick = tick
        self.end_tick = tick + ticks
        while ticks:
            take = min(ticks, BLOCK_TICKS - tick % BLOCK_TICKS)
            rows = frames_begun(tick, take, self.frame_ticks)
            self._feed(drive[:take], sense[:take], words[:rows])
            drive, sense, words, tick, ticks = drive[take:], sense[take:], words[rows:], tick + take, ticks - take
            if tick % BLOCK_TICKS == 0:
                self._chain, self._words = self._chain_digest(), self._digest_of_words()
                self._begin_block()

    def _feed(self, *columns):
        pieces = [np.ascontiguousarray(column, kind) for column, kind in zip(columns, KINDS)]
        for digest, piece in zip(self._digests, pieces):
            digest.update(piece.data)
        self._open.append(pieces)

    def _chain_digest(self):
        return hashlib.sha256(self._chain + b"".join(d.digest() for d in self._digests)).digest()

    def _digest_of_words(self):
        return hashlib.sha256(self._words + self._digests[2].digest()).digest()

    def hexdigest(self):
        """Hash of everything so far."""
        return self._chain_digest().hex()

    def has_words(self, blocks):
        """True if these are all the rows of words that were added, in arrays of any length."""
        again, tick = CodeHash(self.frame_ticks), self.begin_tick
        for rows in filter(len, blocks):
            until = self.frame_ticks * ((tick - 1) // self.frame_ticks + len(rows)) + 1
            again.add(tick, until - tick, NO_CODES, NO_CODES, rows)
            tick = until
        if tick > self.end_tick:
            return False
        again.add(tick, self.end_tick - tick, NO_CODES, NO_CODES, NO_WORDS)
        return again._digest_of_words() == self._digest_of_words()

    def dump(self):
        """What a checkpoint keeps."""
        columns = [np.concatenate(pieces) for pieces in zip(*self._open)] if self._open else [np.zeros(0)] * 3
        names = ("drive", "sense", "words")
        chains = {"chain": np.frombuffer(self._chain, np.uint8), "words_chain": np.frombuffer(self._words, np.uint8)}
        ticks = {"begin_tick": self.begin_tick, "end_tick": self.end_tick}
        return {**chains, **ticks, **dict(zip(names, columns))}

    def restore(self, values):
        """Continue where `dump` was."""
        self._chain = values["chain"].tobytes()
        self.complete = "words_chain" in values
        if self.complete:
            self._words = values["words_chain"].tobytes()
            self.begin_tick, self.end_tick = values["begin_tick"], values["end_tick"]
        self._begin_block()
        if len(values["drive"]) or len(values["words"]):
            self._feed(values["drive"], values["sense"], values["words"])

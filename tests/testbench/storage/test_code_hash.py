"""Hash of all codes: the formula of its header, whatever the chunks, whatever the interruptions."""

import hashlib

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from testbench.storage import code_hash
from testbench.storage.code_hash import BLOCK_TICKS, CodeHash, frames_begun


def codes(tick, ticks, seed=1):
    """Codes of `ticks` ticks from `tick` on, and the rows of the frames begun in them."""
    rng = np.random.default_rng(seed)
    drive = rng.integers(-(1 << 15), 1 << 15, ticks, dtype=np.int32)
    sense = rng.integers(-(1 << 19), 1 << 19, ticks, dtype=np.int32)
    return drive, sense, rng.integers(-(1 << 47), 1 << 47, (frames_begun(tick, ticks), 9))


def by_the_formula(tick, drive, sense, words):
    chain, row = bytes(32), 0
    while True:
        take = min(len(drive), BLOCK_TICKS - tick % BLOCK_TICKS)
        begun = sum(1 for k in range(tick, tick + take) if k % 125 == 0)
        parts = (
            drive[:take].astype("<i2").tobytes(),
            sense[:take].astype("<i4").tobytes(),
            words[row : row + begun].astype("<i8").tobytes(),
        )
        chain = hashlib.sha256(chain + b"".join(hashlib.sha256(part).digest() for part in parts)).digest()
        drive, sense, row, tick = drive[take:], sense[take:], row + begun, tick + take
        if tick % BLOCK_TICKS:
            return chain.hex()
        if not len(drive):
            empty = hashlib.sha256(b"").digest() * 3
            return hashlib.sha256(chain + empty).hexdigest()


def hashed(tick, columns, cuts, restart=()):
    """Hash of columns given in pieces that end at `cuts`; dumped and restored before the pieces in `restart`."""
    drive, sense, words = columns
    whole, begin, row = CodeHash(), 0, 0
    for k, end in enumerate([*sorted(cuts), len(drive)]):
        if k in restart:
            values, whole = whole.dump(), CodeHash()
            whole.restore(values)
        rows = frames_begun(tick + begin, end - begin)
        whole.add(tick + begin, end - begin, drive[begin:end], sense[begin:end], words[row : row + rows])
        begin, row = end, row + rows
    return whole.hexdigest()


@settings(max_examples=20)
@given(
    st.sampled_from([0, 1, 124, 125, BLOCK_TICKS - 1, BLOCK_TICKS, 3 * BLOCK_TICKS + 77]),
    st.sampled_from([1, 125, BLOCK_TICKS, 2 * BLOCK_TICKS, 2 * BLOCK_TICKS + 4321]),
    st.lists(st.floats(0, 1), max_size=5),
    st.sets(st.integers(0, 5)),
)
def test_it_is_the_formula_however_it_is_cut(tick, ticks, cuts, restart):
    columns = codes(tick, ticks)
    assert hashed(tick, columns, [int(ticks * cut) for cut in cuts], restart) == by_the_formula(tick, *columns)


def test_every_code_and_every_word_counts():
    ticks = BLOCK_TICKS + 300
    plain = codes(5, ticks)
    seen = {hashed(5, plain, [])}
    for column in range(3):
        for place in (0, -1):
            changed = [np.copy(values) for values in plain]
            changed[column].reshape(-1)[place] ^= 1
            seen.add(hashed(5, changed, []))
    assert len(seen) == 7


def test_nothing_yet_is_a_hash_too():
    assert CodeHash().hexdigest() == hashlib.sha256(bytes(32) + hashlib.sha256(b"").digest() * 3).hexdigest()
    again = CodeHash()
    again.restore(CodeHash().dump())
    assert again.hexdigest() == CodeHash().hexdigest()


def test_what_is_kept_of_a_run_does_not_grow():
    whole = CodeHash()
    for k in range(30):
        whole.add(k * 100_000, 100_000, *codes(k * 100_000, 100_000))
        kept = sum(np.asarray(values).nbytes for values in whole.dump().values())
        assert kept <= BLOCK_TICKS * 6 + BLOCK_TICKS // 125 * 72 + 2 * 32 + 2 * 8


@settings(max_examples=20)
@given(
    st.integers(0, 300_000), st.integers(1, 300_000), st.lists(st.integers(0, 2400), max_size=4), st.integers(0, 10**6)
)
def test_rows_are_those_that_were_hashed_or_not(tick, ticks, cuts, place):
    """However they are cut; one changed bit, one row less and one more are seen."""
    drive, sense, words = codes(tick, ticks)
    whole = CodeHash()
    whole.add(tick, ticks, drive, sense, words)
    assert whole.has_words(np.split(words, sorted(min(cut, len(words)) for cut in cuts)))
    if len(words):
        other = words.copy()
        other.ravel()[place % other.size] ^= 1 << place % 48
        assert not whole.has_words([other])
        assert not whole.has_words([words[:-1]])
    assert not whole.has_words([np.concatenate([words, np.zeros((1, 9), np.int64)])])


def test_frames_begun():
    assert [frames_begun(tick, ticks) for tick, ticks in ((0, 1), (1, 124), (1, 125), (125, 125), (124, 2))] == [
        1,
        0,
        1,
        1,
        1,
    ]
    assert code_hash.BLOCK_TICKS % 125 == 0

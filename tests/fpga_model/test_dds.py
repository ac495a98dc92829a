"""The phase accumulator: exact turns, wraps, offsets, latency, and the converters' units."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import dds
from fpga_model.design_record import DEFAULT
from fpga_model.jit import DISABLED, kernel
from testbench.flatten import store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows

TURN = 1 << 48


@kernel
def trace(s, words, offsets):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(words) + 1, 5), np.int64)
    for n in range(len(words)):
        store(rows[n], s)
        a, b, c, d = int(offsets[n, 0]), int(offsets[n, 1]), int(offsets[n, 2]), int(offsets[n, 3])
        s = dds.step(DEFAULT, s, int(words[n]), a, b, c, d)
    store(rows[len(words)], s)
    return rows


def run(words, offsets):
    return trace(dds.State(), np.array(words, np.int64), np.array(offsets, np.int64).reshape(-1, 4))


turns = st.one_of(
    st.sampled_from([0, 1, 2, TURN // 2 - 1, TURN // 2, TURN // 2 + 1, TURN - 2, TURN - 1]), st.integers(0, TURN - 1)
)


@given(st.lists(st.tuples(turns, st.tuples(turns, turns, turns, turns)), max_size=30))
def test_step_is_the_documented_equation(inputs):
    words, offsets = [w for w, _ in inputs], [o for _, o in inputs]
    rows = run(words, offsets)
    assert_same_rows(dds.State(), rows, naive.dds(words, offsets))
    assert_in_formats(dds.STATE_FMT, rows)


def test_many_edges_end_on_the_exact_phase():
    word, edges = dds.word_of_hz(Fraction("11002.3")), 2_000 if DISABLED else 1_000_000
    rows = run([word] * edges, [[0, 1, TURN - 1, TURN // 4]] * edges)
    assert rows[-1, 0] == word * edges % TURN
    before = word * (edges - 1)
    assert rows[-1, 1:].tolist() == [(before + x) % TURN for x in (0, 1, -1, TURN // 4)]


def test_latency_from_phase_word_and_offset_to_their_registers():
    step = [0] * 3 + [5] * 3
    rows = run(step, [[0, 0, 0, 0]] * 6)
    assert np.flatnonzero(rows[:, 0])[0] == 3 + 1
    assert np.flatnonzero(rows[:, 1])[0] == np.flatnonzero(rows[:, 0])[0] + dds.LATENCY
    for k in range(4):
        offsets = np.zeros((6, 4), np.int64)
        offsets[3:, k] = 7
        rows = run([0] * 6, offsets)
        assert [np.flatnonzero(column)[0] if column.any() else None for column in rows.T] == [
            4 if j == k + 1 else None for j in range(5)
        ]


def test_one_lsb_of_word_is_92_nanohertz():
    lsb = dds.hz_of_word(1)
    assert lsb == Fraction(26_000_000, TURN)
    assert abs(lsb - Fraction("92.37e-9")) < Fraction("0.01e-9")
    word = dds.word_of_hz(Fraction("11002.3"))
    assert abs(dds.hz_of_word(word) - Fraction("11002.3")) <= lsb / 2


@pytest.mark.parametrize(("deg", "turns"), [(0, 0), (90, 1 / 4), (-90, 3 / 4), (360, 0), (450, 1 / 4), (-720, 0)])
def test_offsets_are_modulo_one_turn(deg, turns):
    assert dds.offset_of_deg(deg) == int(turns * TURN)


@pytest.mark.parametrize("hz", [-1, 26_000_000, float("nan"), float("inf")])
def test_a_frequency_out_of_range_is_refused(hz):
    with pytest.raises(ValueError, match="frequency_hz"):
        dds.word_of_hz(hz)


@pytest.mark.parametrize("deg", [float("nan"), float("inf"), -float("inf")])
def test_an_offset_that_is_no_number_is_refused(deg):
    with pytest.raises(ValueError, match="offset_deg"):
        dds.offset_of_deg(deg)

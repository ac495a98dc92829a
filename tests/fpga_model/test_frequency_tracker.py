"""The frequency loop: every register at every clock, the sign, and the gains that its physical design promises."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import dds, frequency_tracker, pi
from fpga_model.design_record import DEFAULT
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

P = frequency_tracker.design()
ONE = 1 << pi.COEF.f
bit = st.sampled_from([0, 1])
edge = st.tuples(
    bit,
    bit,
    st.integers(0, 4),
    raws(frequency_tracker.ERROR),
    bit,
    bit,
    raws(frequency_tracker.CORRECTION),
    raws(frequency_tracker.WORD, [frequency_tracker.NOMINAL_WORD]),
)


def run(inputs):
    return rows(lambda s, *i: frequency_tracker.step(DEFAULT, P, s, *i), frequency_tracker.State(), inputs)


@given(st.lists(edge, max_size=40))
def test_step_is_the_documented_equation(inputs):
    gains = Fraction(P.loop.kp, ONE), Fraction(P.loop.ki, ONE), P.loop.lo, P.loop.hi
    loop = naive.loop(gains, [i[3] for i in inputs], [(i[0], i[1], i[2], 0) for i in inputs])
    centre = naive.centre(frequency_tracker.NOMINAL_WORD, [(i[0], *i[4:]) for i in inputs])
    word = [frequency_tracker.NOMINAL_WORD]
    word += [(c + y) % 2**48 for c, (_, (_, _, y)) in zip(centre[:-1], loop[:-1], strict=True)]
    expected = [(e, c, w, controller) for (e, controller), c, w in zip(loop, centre, word, strict=True)]
    assert_rows(run(inputs), expected, frequency_tracker.STATE_FMT)


def test_latency_and_sign():
    quiet = (0, 0, pi.RUN, 0, 0, 0, 0, 0)
    lead = (1, 0, pi.RUN, 1000, 0, 0, 0, 0)
    words = [s.word for s in run([lead, (0, 1, *quiet[2:]), quiet, quiet, quiet])]
    moved = next(n for n, w in enumerate(words) if w != words[0])
    assert moved == frequency_tracker.LATENCY
    assert words[moved] > words[0], "a leading resonator is faster than the word"


def test_gains_give_the_crossover_the_zero_and_the_limits():
    hz = 26e6 / 2**48
    kp, ki = P.loop.kp / ONE, P.loop.ki / ONE * 8000
    # d(phase)/dt = -delta f, so a gain of 2 pi 3 Hz per turn crosses at 3 Hz
    assert kp * 2**24 * hz == pytest.approx(2 * math.pi * 3.0, rel=0.5 / P.loop.kp)
    assert ki / kp == pytest.approx(2 * math.pi * 0.6, rel=0.5 / P.loop.ki)
    assert -P.loop.lo == P.loop.hi == round(Fraction(100 * 2**48, 26_000_000))
    assert float(dds.hz_of_word(frequency_tracker.NOMINAL_WORD)) == pytest.approx(11_000, abs=hz)


@pytest.mark.parametrize("limit_hz", [0, -1, 6.5e6])
def test_design_refuses(limit_hz):
    with pytest.raises(ValueError, match=r"limit_hz.*Hz"):
        frequency_tracker.design(limit_hz=limit_hz)

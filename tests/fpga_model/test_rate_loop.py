"""The rate loop: every register at every clock, the saturation flag, and the gains that its design promises."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import pi, rate_loop
from fpga_model.design_record import DEFAULT
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

P = rate_loop.design()
ONE = 1 << pi.COEF.f
bit = st.sampled_from([0, 1])
edge = st.tuples(bit, bit, st.integers(0, 4), raws(rate_loop.CODE), raws(rate_loop.WORD, [P.loop.lo, P.loop.hi]))


@given(st.sampled_from([P, rate_loop.design(limit=0.1)]), st.lists(edge, max_size=40))
def test_step_is_the_documented_equation(p, inputs):
    found = rows(lambda s, *i: rate_loop.step(DEFAULT, p, s, *i), rate_loop.State(), inputs)
    gains = Fraction(p.loop.kp, ONE), Fraction(p.loop.ki, ONE), p.loop.lo, p.loop.hi
    expected = naive.loop(gains, [i[3] for i in inputs], [(*i[:3], i[4]) for i in inputs])
    assert_rows(found, expected, rate_loop.STATE_FMT)
    for s in found:
        assert rate_loop.saturated(p, s) == (abs(s.loop.y) == p.loop.hi)


def test_latency():
    quiet = (0, 0, pi.RUN, 0, 0)
    found = rows(
        lambda s, *i: rate_loop.step(DEFAULT, P, s, *i),
        rate_loop.State(),
        [(1, 0, pi.RUN, 100, 0), (0, 1, pi.RUN, 0, 0), quiet, quiet],
    )
    assert next(n for n, s in enumerate(found) if s.loop.y) == rate_loop.LATENCY
    assert found[-1].loop.y > 0, "a positive code asks for a positive rate"


def test_gains_give_the_crossover_and_the_zero():
    kp, ki = P.loop.kp / ONE, P.loop.ki / ONE * 8000
    code_per_deg_s = 57.9e-6 / (4 / 12) * 2**23
    word_per_deg_s = 10.31e-3 / 10 * 2**23
    assert ki * code_per_deg_s / word_per_deg_s == pytest.approx(2 * math.pi * 15, rel=0.5 / P.loop.ki)
    assert ki / kp == pytest.approx(2 * math.pi * 100, rel=1 / P.loop.ki)
    assert (P.loop.lo, P.loop.hi) == (-(2**23) + 1, 2**23 - 1)
    assert 500 * word_per_deg_s / 2**23 == pytest.approx(0.516, abs=1e-3), "500 deg/s needs half of the range"


@pytest.mark.parametrize("limit", [0, -0.5, 1.01])
def test_design_refuses(limit):
    with pytest.raises(ValueError, match=r"limit.*full scale"):
        rate_loop.design(limit=limit)

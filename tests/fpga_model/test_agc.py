"""The amplitude loop: every register at every clock, the kick, and the gains that its physical design promises."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import agc, cordic, pi
from fpga_model.design_record import DEFAULT
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

P = agc.design()
ONE = 1 << pi.COEF.f
bit = st.sampled_from([0, 1])
edge = st.tuples(
    bit, bit, st.integers(0, 5), raws(cordic.MAGNITUDE), raws(agc.SETPOINT), raws(agc.AMPLITUDE, [P.loop.hi])
)


def gains(p):
    return Fraction(p.loop.kp, ONE), Fraction(p.loop.ki, ONE), p.loop.lo, p.loop.hi


@given(st.sampled_from([P, agc.design(ceiling_v=1.0, kick_v=3.0)]), st.lists(edge, max_size=40))
def test_step_is_the_documented_equation(p, inputs):
    found = rows(lambda s, *i: agc.step(DEFAULT, p, s, *i), agc.State(), inputs)
    errors = [setpoint - magnitude for _, _, _, magnitude, setpoint, _ in inputs]
    given_to_pi = [(en, en_pi, mode % 4, 0 if mode == 4 else preset) for en, en_pi, mode, _, _, preset in inputs]
    # modes of pi.py as they are, KICK as OFF; 5 is no mode, and holds
    given_to_pi = [(*g[:2], 3 if i[2] == 5 else g[2], g[3]) for g, i in zip(given_to_pi, inputs, strict=True)]
    assert_rows(found, naive.loop(gains(p), errors, given_to_pi), agc.STATE_FMT)
    for s, (_, _, mode, *_) in zip(found[:-1], inputs, strict=True):
        assert agc.amplitude(p, s, mode) == (p.kick if mode == agc.KICK else s.loop.y)
        assert agc.saturated(p, s) == (s.loop.y == p.loop.hi)


def test_latency():
    steady = (0, 0, pi.RUN, 0, 0, 0)
    inputs = [(1, 0, pi.RUN, 0, 100_000, 0), (0, 1, *steady[2:]), steady, steady]
    found = rows(lambda s, *i: agc.step(DEFAULT, P, s, *i), agc.State(), inputs)
    assert next(n for n, s in enumerate(found) if s.loop.y) == agc.LATENCY


def test_gains_give_the_crossover_and_the_zero():
    kp, ki = P.loop.kp / ONE, P.loop.ki / ONE * 8000
    # d(magnitude)/dt = 12.18 * 1.64676 * word; at 3 Hz the proportional loop gain is one
    assert kp * 12.18 * 1.646760258 / (2 * math.pi * 3.0) == pytest.approx(1, rel=0.5 / P.loop.kp + 1e-9)
    assert ki / kp == pytest.approx(2 * math.pi * 0.6, rel=0.5 / P.loop.ki)


def test_setpoint_is_5_um():
    assert agc.setpoint() == round(0.72 * 2**23 * 1.646760258)
    assert agc.setpoint(2.5) == pytest.approx(agc.setpoint() / 2, abs=1)


@pytest.mark.parametrize("wrong", [{"ceiling_v": 10.1}, {"kick_v": -0.1}, {"crossover_hz": 3e5}])
def test_design_refuses(wrong):
    with pytest.raises(ValueError, match=r"ceiling_v|kick_v|kp"):
        agc.design(**wrong)

"""The quadrature loop: every register at every clock, the root, the rail, and the gain that its design promises."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import isqrt, pi, quadrature_loop
from fpga_model.design_record import DEFAULT
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

P = quadrature_loop.design()
ONE = 1 << pi.COEF.f
bit = st.sampled_from([0, 1])
edge = st.tuples(
    bit,
    bit,
    st.sampled_from([0] * 20 + [1]),
    st.integers(0, 4),
    raws(quadrature_loop.CODE),
    raws(isqrt.RADICAND),
)


def run(p, inputs):
    return rows(lambda s, *i: quadrature_loop.step(DEFAULT, p, s, *i), quadrature_loop.State(), inputs)


@given(st.sampled_from([P, quadrature_loop.design(rail_v=5.0)]), st.lists(edge, max_size=50))
def test_step_is_the_documented_equation(p, inputs):
    found = run(p, inputs)
    gains = Fraction(p.loop.kp, ONE), Fraction(p.loop.ki, ONE), p.loop.lo, p.loop.hi
    loop = naive.loop(gains, [-i[4] for i in inputs], [(i[0], i[1], i[3], i[5]) for i in inputs])
    root = naive.isqrt([(i[2], controller[2]) for i, (_, controller) in zip(inputs, loop[:-1], strict=True)])
    expected = [(error, controller, r) for (error, controller), r in zip(loop, root, strict=True)]
    assert_rows(found, expected, quadrature_loop.STATE_FMT)
    for s in found:
        assert quadrature_loop.railed(p, s) == (s.loop.y in (0, p.loop.hi))


def test_latency_sign_and_root():
    quiet = (0, 0, 0, pi.RUN, 0, 0)
    start = [(1, 0, 0, pi.RUN, -(2**23), 0), (0, 1, *quiet[2:]), quiet]
    found = run(P, [*start, (0, 0, 1, *quiet[3:]), *[quiet] * isqrt.LATENCY])
    u = [s.loop.y for s in found]
    assert next(n for n, value in enumerate(u) if value) == quadrature_loop.LATENCY
    assert u[-1] == round(P.loop.ki * 2**23 / ONE) > 0, "a negative code raises u"
    assert [s.root.y for s in found[-2:]] == [math.isqrt(u[-1])] * 2
    assert found[3 + isqrt.LATENCY].root.done == 1


def test_gain_gives_the_crossover_and_u_the_voltage():
    code_per_deg_s = 57.9e-6 / (4 / 12) * 2**23
    deg_s_per_u = 100 / 4.52**2 * 5.5**2 / 2**32
    ki = P.loop.ki / ONE * 8000
    assert ki * code_per_deg_s * deg_s_per_u == pytest.approx(2 * math.pi * 1.0, rel=0.5 / P.loop.ki + 1e-12)
    assert P.loop.kp == 0
    assert (P.loop.lo, P.loop.hi) == (0, 2**32 - 1)
    u = quadrature_loop.u_of_volts(4.52)
    assert math.isqrt(u) * 5.5 / 2**16 == pytest.approx(4.52, abs=5.5 / 2**16)
    assert math.isqrt(quadrature_loop.u_of_volts(5.5)) == 2**16 - 1


@pytest.mark.parametrize("wrong", [{"rail_v": 5.51}, {"rail_v": -0.1}, {"crossover_hz": 100.0}])
def test_design_refuses(wrong):
    with pytest.raises(ValueError, match=r"V_q.*V|ki_per_s"):
        quadrature_loop.design(**wrong)

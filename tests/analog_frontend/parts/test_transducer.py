"""Electrostatics against the energy they come from, in exact rationals."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.effects import acceleration
from analog_frontend.parts import device
from tests.analog_frontend import transducer

EPS0 = Fraction("8.8541878128e-12")


def energy(comb, volts, x, y):
    """Co-energy of the combs: n parallel plates of overlap l0 + x, gaps d - y and lambda d + y."""
    n, height, gap, overlap, ratio = (Fraction(v) for v in comb)
    capacitance = n * EPS0 * height * (overlap + x) * (1 / (gap - y) + 1 / (ratio * gap + y))
    return volts**2 * capacitance / 2


combs = st.builds(
    transducer.Comb,
    st.integers(1, 500),
    st.floats(1e-6, 2e-4),
    st.floats(1e-6, 1e-5),
    st.floats(1e-6, 1e-4),
    st.floats(1.0, 10.0),
)


@given(combs)
def test_comb_formulas_are_second_derivatives_of_the_energy(comb):
    d = Fraction(comb.gap_m) / 10**9

    def at(x, y):
        return energy(comb, Fraction(1), x * d, y * d)

    mixed = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / (4 * d * d)
    along_y = (at(0, 1) - 2 * at(0, 0) + at(0, -1)) / (d * d)
    # differences over 1e-9 of the gap err by about 1e-18; 1 - 1/lambda^2 cancels near lambda = 1
    kq = transducer.comb_kq_n_per_m_per_v2(comb)
    scale = comb.fingers * float(EPS0) * comb.height_m / comb.gap_m**2
    assert kq == pytest.approx(float(mixed), rel=1e-14, abs=1e-15 * scale)
    assert transducer.comb_softening_n_per_m_per_v2(comb) == pytest.approx(float(along_y), rel=1e-14)


def test_the_published_geometry():
    """2.68e-4 N/m/V^2; the paper's 0.0561 N/m at 4.52 V needs 10.2 times that, or 300 fingers."""
    kq = transducer.comb_kq_n_per_m_per_v2(transducer.Comb())
    assert kq == pytest.approx(2.68e-4, rel=2e-3)
    assert device.make().kq_n_per_m_per_v2 / kq == pytest.approx(10.25, abs=0.02)
    assert transducer.comb_kq_n_per_m_per_v2(transducer.Comb(fingers=300)) * 4.52**2 == pytest.approx(0.055, abs=5e-4)
    assert transducer.comb_kq_n_per_m_per_v2(transducer.Comb(gap_ratio=1.0)) == 0.0


@pytest.mark.parametrize("change", [{"gap_m": 0.0}, {"gap_ratio": 0.9}, {"fingers": 0}, {"height_m": float("nan")}])
def test_impossible_combs_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        transducer.comb_kq_n_per_m_per_v2(transducer.Comb()._replace(**change))


def test_carrier_softening():
    """-0.68 N/m at 3.3 V and -1.56 at 5 V with 2 pF and 4 um."""
    assert acceleration.carrier_softening_n_per_m(3.3, 2e-12, 4e-6) == pytest.approx(-0.68, abs=5e-3)
    assert acceleration.carrier_softening_n_per_m(5.0, 2e-12, 4e-6) == pytest.approx(-1.5625)


@given(st.floats(-1e-6, 1e-6), st.floats(-20, 20), st.floats(-0.5, 0.5), st.floats(-20, 20))
def test_push_pull_force_is_the_difference_of_two_plates(dcdx, bias, mismatch, v):
    c, b, e, u = (Fraction(z) for z in (dcdx, bias, mismatch, v))
    exact = c / 2 * (b + u) ** 2 - c / 2 * (1 - e) * (b - u) ** 2
    limit = 10 * abs(c) * (abs(b) + abs(u)) ** 2 * Fraction(2) ** -53 + Fraction(1e-300)
    assert abs(Fraction(transducer.push_pull_n(dcdx, bias, mismatch, v)) - exact) <= limit


def test_matched_pair_is_linear_and_gives_the_default_coefficient():
    dev = device.make()
    k = transducer.k_vf_n_per_v(2.72e-8, dev.bias_v)
    assert k == pytest.approx(dev.k_vf_sense_n_per_v)
    for v in (-10.0, 0.25, 10.0):
        assert transducer.push_pull_n(2.72e-8, dev.bias_v, 0.0, v) == pytest.approx(k * v, rel=1e-13)


def test_mismatch_adds_a_constant_and_the_second_harmonic():
    """e C'/2 (Vdc - v)^2: mean e C'/2 (Vdc^2 + A^2/2), second harmonic e C'/4 A^2."""
    c, bias, e, a, n = 2.72e-8, 5.0, 0.01, 2.0, 64
    angles = [2 * math.pi * k / n for k in range(n)]
    force = [transducer.push_pull_n(c, bias, e, a * math.sin(t)) for t in angles]
    assert sum(force) / n == pytest.approx(e * c / 2 * (bias**2 + a**2 / 2), rel=1e-9)
    second = 2 / n * sum(f * math.cos(2 * t) for f, t in zip(force, angles))
    assert second == pytest.approx(-e * c / 4 * a**2, rel=1e-9)


def test_quadrature_law():
    dev = device.make()
    vq = transducer.null_v(dev.kxy_n_per_m, dev.kq_n_per_m_per_v2)
    assert vq == pytest.approx(4.52, abs=1e-12)
    assert abs(transducer.coupling_n_per_m(dev.kxy_n_per_m, dev.kq_n_per_m_per_v2, vq)) < 4 * 2.0**-52 * dev.kxy_n_per_m
    assert transducer.coupling_n_per_m(0.0561, dev.kq_n_per_m_per_v2, 0.0) == 0.0561
    # 100 deg/s of quadrature, 0.044 deg/s per mV at the null
    assert transducer.quadrature_deg_per_s(0.0561, 2.325e-7, 11000.0) == pytest.approx(100.0, abs=0.05)
    per_mv = transducer.coupling_n_per_m(0.0561, dev.kq_n_per_m_per_v2, vq - 0.5e-3) - transducer.coupling_n_per_m(
        0.0561, dev.kq_n_per_m_per_v2, vq + 0.5e-3
    )
    assert transducer.quadrature_deg_per_s(per_mv, 2.325e-7, 11000.0) == pytest.approx(0.0442, abs=1e-4)


@pytest.mark.parametrize(("kxy", "kq"), [(-0.01, 1e-3), (0.01, 0.0), (float("nan"), 1e-3)])
def test_no_voltage_nulls_the_wrong_sign(kxy, kq):
    with pytest.raises(ValueError, match="no null"):
        transducer.null_v(kxy, kq)

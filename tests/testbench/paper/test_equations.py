"""Equations of the paper (docs/loop.md) against their derivation: motion, demodulation, and misprints."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from testbench.paper.loop import equations as eq

MASS = 2.325e-7
X = eq.Mode(MASS, 2 * math.pi * 11002.3, 2e5)
Y = eq.Mode(MASS, 2 * math.pi * 10863.3, 2e5)
W = X.w
modes = st.builds(
    eq.Mode,
    st.floats(1e-8, 1e-6),
    st.floats(2 * math.pi * 5e3, 2 * math.pi * 2e4),
    st.floats(50.0, 1e6),
)
slow = st.builds(complex, st.floats(-100.0, 100.0), st.floats(-2000.0, 2000.0))


def generator(y, x=X, m_c=0.0, omega_z=0.0, k_xy=0.0):
    """First-order form of equation (1): columns from unit states."""
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    for k in range(4):
        q = np.eye(4)[k]
        a[2:, k] = eq.equation_of_motion(q[:2], q[2:], (0, 0), x, y, eq.Coupling(m_c, omega_z, k_xy))
    return a


def test_coriolis_does_no_work_and_coupling_is_symmetric():
    a = generator(Y, m_c=MASS, omega_z=3.0, k_xy=0.05)
    assert a[2, 3] == -a[3, 2] == pytest.approx(6.0)
    assert a[2, 1] == a[3, 0] == pytest.approx(-0.05 / MASS)


def test_drive_and_sense_response_are_the_motion_at_rest():
    """(1) solved for a tone by its frequency response, against (2) to (5)."""
    t = np.linspace(0, 1e-3, 50)
    jw = 1j * W
    solve = np.linalg.solve(jw * np.eye(4) - generator(Y), np.array([0, 0, 1 / MASS, 0]) * 2e-8)
    np.testing.assert_allclose(
        eq.drive_response(t, 2e-8, X, W), (solve[0] * np.exp(jw * t)).imag, rtol=1e-9, atol=1e-15
    )
    amplitude, rate, k_xy = 5e-6, 1.7, 0.01
    # x = -A cos: its Coriolis and coupling force on y, through y alone
    force = -2 * MASS * rate * 1j * W * -amplitude - k_xy * -amplitude
    found = force / MASS / (Y.w**2 - W**2 + 1j * W * Y.w / Y.q)
    np.testing.assert_allclose(
        eq.sense_response(t, amplitude, Y, W, eq.Coupling(MASS, rate, k_xy)),
        (found * np.exp(jw * t)).real,
        rtol=1e-9,
        atol=1e-18,
    )


def test_phases_at_lock_and_beyond_resonance():
    assert eq.phase_drive(X, X.w) == pytest.approx(-math.pi / 2)
    assert math.degrees(eq.phase_sense(Y, W)) == pytest.approx(-180, abs=0.02)
    assert math.degrees(eq.phase_sense(X._replace(w=W * 1.01), W)) == pytest.approx(0, abs=0.02)


@given(st.floats(-0.3, 0.3), st.floats(0.1, 5.0))
def test_parts_of_the_feedback_force_are_those_of_equation_6(phi, v_c):
    t = np.linspace(0, 2 * math.pi / W, 64, endpoint=False)
    force = eq.sense_force(t, v_c, phi, 2.7e-7, 0.0, W, eq.Coupling(MASS))
    in_phase, quadrature = 2 * np.mean(force * np.sin(W * t)), 2 * np.mean(force * np.cos(W * t))
    assert (in_phase, quadrature) == pytest.approx(eq.feedback_parts(v_c, phi, 2.7e-7), abs=1e-18)
    assert eq.feedback_parts_as_printed(v_c, phi, 2.7e-7) == pytest.approx((quadrature, in_phase), abs=1e-18)


@given(modes, st.floats(0.9, 1.1), slow)
def test_products_of_the_polynomials_agree_only_with_the_right_root(y, ratio, s):
    w_d = y.w * ratio
    want = eq.n1(s, y, w_d) ** 2 + eq.n2(s, y, w_d) ** 2
    scale = w_d**4
    assert abs(eq.d1(s, y, w_d) * eq.d2(s, y, w_d) - want) <= 1e-13 * scale
    printed = eq.d1_as_printed(s, y, w_d) * eq.d2_as_printed(s, y, w_d)
    # what the printed root leaves over, in closed form
    left = w_d**2 * y.w**2 * (y.q**4 + 12 * y.q**2 - 4) / (4 * y.q**2)
    assert abs(printed - want - left * (1 + 0j)) <= 1e-9 * abs(left) + 1e-12 * scale


def test_the_root_is_neither_the_printed_one_nor_its_inverse_ratio():
    assert eq.root_as_printed(2e5).imag == pytest.approx(1e5, rel=1e-6)
    half = eq._factor(0.0, Y, W, math.sqrt(1 - 1 / (4 * Y.q**2)))
    assert math.sqrt(half) / (2 * math.pi) == pytest.approx(10.93e3, rel=1e-3)
    assert math.sqrt(eq.d1(0.0, Y, W)) / (2 * math.pi) == pytest.approx(139.0, abs=1e-3)


@pytest.mark.parametrize("f_hz", [0.0, 20.0, 100.0, 138.0])
@pytest.mark.parametrize("phi", [0.0, 0.15, -1.0])
def test_baseband_is_what_a_multiplier_sees(f_hz, phi):
    """(7) against the two sidebands through the mode's own transfer function."""
    s = 2j * math.pi * f_hz

    def mode(p):
        return 1 / (Y.m * (p * p + Y.w / Y.q * p + Y.w**2))

    # u(t) sin(w t) makes sidebands s + jw and s - jw; times sin(w t + phi), its part at s
    upper, lower = mode(s + 1j * W), mode(s - 1j * W)
    want = (upper * np.exp(-1j * phi) + lower * np.exp(1j * phi)) / 4
    assert eq.baseband(s, phi, Y, W) == pytest.approx(want, rel=1e-9)
    assert eq.baseband(s, phi, Y, W, eq.BRIDGE) == pytest.approx(want * 8 / math.pi, rel=1e-9)
    printed = eq.baseband_as_printed(s, phi, Y, W, MASS)
    assert abs(printed / want) < 1e-3


def test_scale_factor_is_where_the_forces_cancel():
    a_x, rate, k_vf, phi = 5e-6, 1.2, 2.72e-7, math.radians(8.8814)
    v_c = -eq.scale_factor(a_x, W, MASS, k_vf, phi) * rate
    t = np.linspace(0, 2 * math.pi / W, 64, endpoint=False)
    force = eq.sense_force(t, v_c, phi, k_vf, a_x, W, eq.Coupling(MASS, rate))
    assert abs(np.mean(force * np.sin(W * t))) < 1e-12 * abs(v_c * k_vf)
    drive = math.radians(1.2459)
    ratio = eq.scale_factor_with_drive(a_x, W, MASS, k_vf, phi, drive) / eq.scale_factor(a_x, W, MASS, k_vf, 0)
    assert 100 * (ratio - 1) == pytest.approx(1.583, abs=5e-4)
    assert 100 * (1 / math.cos(phi) - 1) == pytest.approx(1.2135, abs=5e-4)


def test_held_signal_has_the_angle_of_equation_14():
    t = np.linspace(0, 2 * math.pi / W, 64, endpoint=False)
    signal = eq.open_loop_signal(t, 1.0, 8000.0, W, 0.027)
    a_i, a_q = 2 * np.mean(signal * np.sin(W * t + 0.027)), 2 * np.mean(signal * np.cos(W * t + 0.027))
    assert eq.phi_iq(a_i, a_q) == pytest.approx(eq.phi_iq(1.0, 8000.0))
    assert 90 - math.degrees(eq.phi_iq(1.0, 8000.0)) == pytest.approx(0.00716, abs=1e-5)


def test_the_misprints_are_shown_with_numbers():
    shown = {m.where: m.example for m in eq.misprints(Y, W, MASS, math.radians(8.8814))}
    assert shown["text under (6)"][1:] == pytest.approx((math.sin(0.15501), math.cos(0.15501)), rel=1e-4)
    _, printed, right = shown["(10), (11)"]
    assert right == pytest.approx(139.0, abs=1e-3)
    assert printed > 1e6
    _, printed, right = shown["(10) times (11)"]
    assert printed > 1e3
    assert right < 1e-9
    _, printed, right = shown["(7)"]
    assert right == pytest.approx(0.5 / (MASS * (Y.w**2 - W**2)), rel=1e-4)
    assert printed < 1e-6 * abs(right)


def test_a_mode_rings_as_its_generator_says():
    """The oracle above is the motion itself: ring-down of y over 1000 periods by the exponential of (1)."""
    t = 1000 * 2 * math.pi / Y.w
    state = expm(generator(Y) * t) @ np.array([0, 1.0, 0, 0])
    assert state[1] == pytest.approx(math.exp(-math.pi * 1000 / Y.q), rel=1e-4)

"""Laws of one first harmonic: against the Fourier integral of the product over a cycle."""

import itertools

import numpy as np
import pytest

from analog_frontend.effects import law
from analog_frontend.parts.device import Device
from testbench.measured.closed_loop.loop_laws import harmonic

TEXTS = ("x", "vx", "x^2", "x vx", "vx^2", "x^3", "x^2 vx", "x vx^2", "vx^3", "x^5", "x^3 vx^2", "x^4 vx", "x^2 vx^3")
TURN = 2 * np.pi * np.arange(720) / 720


def fourier(text, amplitude):
    """First harmonic (cos, sin) of a product at an amplitude, by sums over a cycle."""
    x, vx = amplitude * np.cos(TURN), -amplitude * np.sin(TURN)
    value = eval(text.replace("^", "**").replace(" ", " * "), {"x": x, "vx": vx})
    return np.array([np.mean(value * np.cos(TURN)), np.mean(value * np.sin(TURN))])


@pytest.mark.parametrize(("a", "b"), list(itertools.combinations(TEXTS, 2)))
def test_laws_are_the_same_if_their_first_harmonics_are_at_every_amplitude(a, b):
    curves = [np.concatenate([fourier(text, size) for size in (0.5, 1.0, 1.7)]) for text in (a, b)]
    one, two = (harmonic(law.parse(f"force_x = 1.0 {text}")) for text in (a, b))
    if min(np.linalg.norm(c) for c in curves) < 1e-9:
        assert one == "" or two == ""
        return
    cosine = curves[0] @ curves[1] / np.prod([np.linalg.norm(c) for c in curves])
    assert (abs(cosine) > 1 - 1e-9) == (one == two)


def test_ports_slow_factors_and_other_states_part_laws():
    texts = ("force_x = 1 vx^3", "force_y = 1 vx^3", "force_x = 1 rate vx^3", "force_x = 1 temp vx^3", "cv_x = 1 cx^3")
    found = [harmonic(law.parse(text)) for text in (*texts, "force_x = 1 abs(x) x", "force_x = 1 u vx^2")]
    assert len(set(found[:4])) == 4
    assert found[4:] == ["", "", ""]


def test_a_product_with_v_q_squared_is_a_pair_of_laws_with_and_without_temperature():
    """V_q^2 of the quadrature loop is k_xy / k_q; the default k_xy has another slope below its reference than above."""
    d, degc = Device(), np.linspace(-20, 65, 200)
    above = degc - d.temp_ref_degc
    k_xy = 1 + np.where(above < 0, d.kxy_tc_below_per_k, d.kxy_tc_above_per_k) * above
    left = k_xy - np.polyval(np.polyfit(above, k_xy, 1), above)
    assert np.ptp(k_xy) > 0.3
    assert np.abs(left).max() < 0.015
    assert np.sqrt(np.mean(left**2)) < 0.01 * k_xy.mean()

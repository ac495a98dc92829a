"""Laws of one first harmonic: against the Fourier integral of the product over a cycle."""

import itertools

import numpy as np
import pytest

from analog_frontend.effects import law
from testbench.measured.closed_loop.loop_same import harmonic

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

"""Clock periods as exact rationals, jitter as one number per edge."""

from fractions import Fraction

import numpy as np
import pytest

from analog_frontend.parts import noise
from fpga_model.jit import kernel
from tests.analog_frontend import oscillator


def test_nominal_clocks():
    p = oscillator.design(carrier_ppm=0.0)
    assert p.tc_s == 1 / 26e6
    assert p.h_s == 1e-6
    assert p.carrier_hz == 8e6
    assert oscillator.image_beat_hz(p) == 0.0


@pytest.mark.parametrize("ppm", [-0.1, 0.5, 1.7, 1000.0])
def test_ppm_are_exact_to_the_last_bit(ppm):
    p = oscillator.design(ppm=ppm)
    rate = 26 * (10**6 + Fraction(repr(ppm)))
    assert p.tc_s == float(1 / rate)
    assert p.h_s == float(26 / rate)


def test_beat_is_eight_hertz_per_ppm():
    assert oscillator.image_beat_hz(oscillator.design(carrier_ppm=20.0)) == pytest.approx(160.0, abs=1e-6)
    assert oscillator.image_beat_hz(oscillator.design(ppm=20.0, carrier_ppm=20.0)) == pytest.approx(0.0, abs=1e-6)


@kernel
def errors(p, first, out):
    for k in range(out.size):
        out[k] = oscillator.edge_error_s(p, first + k)


def test_jitter_is_white_bounded_and_a_function_of_the_edge():
    p = oscillator.design(seed=3, jitter_rms_s=1e-12)
    a, b = np.zeros(20000), np.zeros(10000)
    errors(p, 0, a)
    errors(p, 10000, b)
    assert (a[10000:] == b).all()
    assert a.std() == pytest.approx(1e-12, rel=0.03)
    assert np.abs(a).max() < 3.47e-12
    assert abs(np.corrcoef(a[1:], a[:-1])[0, 1]) < 4.5 / np.sqrt(len(a))
    assert p.jitter.key0 == noise.source(3, "edge_jitter", 1.0).key0


def test_no_jitter_is_exactly_zero():
    p = oscillator.design()
    assert p.jitter.on == 0
    assert oscillator.edge_error_s(p, 12345) == 0.0


def test_floor_of_a_picosecond():
    # (2 pi 26e6 1e-12)^2 / 26e6
    assert oscillator.phase_noise_dbc(1e-12, 26e6) == pytest.approx(-149.9, abs=0.1)


def test_impossible_clocks_are_refused():
    for bad, word in (
        ({"ppm": 2000.0}, "ppm"),
        ({"carrier_ppm": float("nan")}, "carrier_ppm"),
        ({"jitter_rms_s": 2e-9}, "jitter"),
    ):
        with pytest.raises(ValueError, match=word):
            oscillator.design(**bad)

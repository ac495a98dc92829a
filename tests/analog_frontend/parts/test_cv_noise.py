"""Noise of the C/V by source: a Monte Carlo of shot noise through the diodes, bipolar transistors, Johnson."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.parts import cv_noise, propagator
from analog_frontend.parts.device import Device

K, Q, ZERO = 1.380649e-23, 1.602176634e-19, 273.15
OWN = Device().cv_noise_v_per_rthz
OFF = {"cv_noise_v_per_rthz": 0.0}
temps = st.floats(-40.0, 85.0)


@given(temps)
def test_the_default_is_one_density_at_every_temperature(temp):
    assert cv_noise.cv_density(Device(), temp) == OWN
    assert cv_noise.cv_density(Device(), temp, "drive") == OWN


def test_noise_of_the_carrier_comes_out_as_a_smaller_carrier_does():
    """Half a volt more and less of carrier across an imbalance, by the ring diode's own law."""
    d = Device(carrier_noise_v_per_rthz=1e-6, c0_imbalance_f=50e-15)
    gains = [
        propagator.cv_chain(d._replace(carrier_v=d.carrier_v + dv), "sense", 25.0)[0] / d.dcdy_f_per_m
        for dv in (-0.5, 0.5)
    ]
    through = (gains[1] - gains[0]) * d.c0_imbalance_f * d.carrier_noise_v_per_rthz
    assert cv_noise.cv_density(d, 25.0) == pytest.approx(math.hypot(OWN, through), rel=0.02)
    assert cv_noise.cv_density(d._replace(**OFF), 25.0) == pytest.approx(1e-8)


def halves_of_a_node(u_end, trials, halves, step, seed):
    """Charge (units of n VT Ct) that a node adds to the difference in each half period: electrons one by one in law.

    The node falls by the carrier, then both its diodes pass shot noise of Is (e^x) and Is each way until the next edge.
    Units: x = v/(n VT), time t with dx/dt = -2 sinh x; shot noise of one electron per `electron` of charge.
    """
    rng = np.random.default_rng(seed)
    electron, fall = 1e-6, 14.0
    x = np.full(trials, -math.log(math.tanh(u_end)))
    out = np.empty((halves, trials))
    for n in range(halves):
        x = fall - x
        passed = np.zeros(trials)
        t = math.exp(-fall)
        while t < u_end:
            dt = min(step * t, u_end - t) if u_end - t > 1e-12 * u_end else u_end - t
            up, down = np.exp(x), np.exp(-x)
            one = (up - 1.0) * dt + np.sqrt((up + 1.0) * dt * electron) * rng.standard_normal(trials)
            four = (down - 1.0) * dt + np.sqrt((down + 1.0) * dt * electron) * rng.standard_normal(trials)
            x = x - one + four
            passed += 0.5 * (one + four)
            t += dt
        out[n] = passed
    # the first half has no residue of another before it
    return out[1:] / math.sqrt(electron)


@pytest.mark.parametrize("u_end", [0.01, 0.07, 1.0])
def test_charge_of_the_diodes_is_that_of_simulated_shot_noise(u_end):
    """Variance of a half period and twice its covariance with the next: what counts at low frequency."""
    q = halves_of_a_node(u_end, 2500, 7, 0.02, 3)
    q = q - q.mean(axis=1, keepdims=True)
    variance, next_one = (q * q).mean(), (q[1:] * q[:-1]).mean()
    # 15000 products; the covariance doubles the error
    assert variance + 2 * next_one == pytest.approx(cv_noise.diode_charge(u_end), rel=0.06)


def test_a_tail_leaves_half_of_ktc_and_a_long_one_all_of_it():
    assert cv_noise.diode_charge(1e-4) == pytest.approx(0.5 + 2e-4 / 3, rel=1e-6)
    # at rest both diodes are resistors of together 2 Is/(n VT): 4 kT g over half the period, two sided, a quarter each
    assert cv_noise.diode_charge(60.0) / 60.0 == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("temp", [-20.0, 25.0, 50.0])
def test_ring_and_current_of_the_amplifiers(temp):
    """Within what the blocking diodes add: n kT/(fc Ct), and i_n through half of 1/(2 fc Ct) twice."""
    d = Device(
        **OFF, ring_noise_on=1, ina_current_noise_a_per_rthz=1.9e-12, ina_bias_exponent=0.0, ina_beta_exponent=0.0
    )
    shares = cv_noise.cv_noise_shares(d, temp)
    fc, ct = d.carrier_hz * (1 + 1e-6 * d.carrier_ppm), d.c0_f + d.cp_f
    assert shares["ring"] == pytest.approx(math.sqrt(d.diode_n * K * (temp + ZERO) / (fc * ct)), rel=0.05)
    assert shares["current"] == pytest.approx(math.sqrt(2) * 1.9e-12 / (4 * fc * ct), rel=0.02)
    assert cv_noise.cv_density(d, temp) == pytest.approx(math.hypot(shares["ring"], shares["current"]))


@given(temps, st.floats(-1.0, 2.0), st.floats(-2.0, 3.0))
def test_a_bipolar_input_is_shot_noise_of_its_two_currents(temp, bias, beta):
    """Collector sqrt(2 q Ic) kT/(q Ic) and base sqrt(2 q Ic/beta), from transistors of 1 mA and 150 at 25 degC."""
    ratio = (temp + ZERO) / (25.0 + ZERO)

    def transistor(t, ic, gain):
        return math.sqrt(2 * Q * ic) * K * (t + ZERO) / (Q * ic), math.sqrt(2 * Q * ic / gain)

    en, i_n = transistor(25.0, 1e-3, 150.0)
    d = Device(
        **OFF,
        ina_voltage_noise_v_per_rthz=en,
        ina_current_noise_a_per_rthz=i_n,
        ina_bias_exponent=bias,
        ina_beta_exponent=beta,
    )
    found = cv_noise.cv_noise_shares(d, temp)
    want_v, want_i = transistor(temp, 1e-3 * ratio**bias, 150.0 * ratio**beta)
    steady = cv_noise.cv_noise_shares(d._replace(ina_bias_exponent=0.0, ina_beta_exponent=0.0), temp)
    assert found["voltage"] == pytest.approx(math.sqrt(2) * want_v, rel=1e-12)
    assert found["current"] / steady["current"] == pytest.approx(want_i / i_n, rel=1e-12)


@given(temps)
def test_resistors_have_johnson_noise(temp):
    shares = cv_noise.cv_noise_shares(Device(**OFF, cv_resistor_ohm=1e4), temp)
    assert shares["resistors"] == pytest.approx(math.sqrt(4 * K * (temp + ZERO) * 1e4), rel=1e-12)
    assert set(shares.values()) == {0.0, shares["resistors"]}

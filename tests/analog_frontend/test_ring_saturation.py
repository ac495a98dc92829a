"""What a saturating ring adds to a C/V output: against the integrated ring itself, for constants and sines."""

import itertools
import math

import numpy as np
import pytest

from analog_frontend import ring_saturation, ring_tables
from analog_frontend.parts import propagator, ring_cycle
from analog_frontend.parts.device import Device

DEVICE = Device(ring_saturation_on=1)
TICK_S = 1e-6
W = 2 * math.pi * 11002.3


def linear(channel, temp_degc):
    """Gain (V/F, at the SID) and pole (s) of the plant's chain."""
    gain, tau_s = propagator.cv_chain(DEVICE, channel, temp_degc)
    return gain / DEVICE.dcdx_f_per_m * DEVICE.signal_gain, tau_s


@pytest.mark.parametrize(("channel", "temp_degc"), [("drive", 25.0), ("drive", 50.0), ("sense", -20.0)])
def test_a_constant_is_that_of_the_ring(channel, temp_degc):
    p = ring_tables.design(DEVICE, temp_degc, temp_degc, TICK_S)
    gain, _ = linear(channel, temp_degc)
    circuit = ring_tables.circuit(DEVICE, channel, temp_degc)
    for dc_f in np.linspace(-0.93e-12, 0.93e-12, 8):
        u = np.full(5, gain * dc_f)
        got = ring_saturation.saturated_output(p, temp_degc, ("drive", "sense").index(channel), u)
        want = DEVICE.signal_gain * ring_cycle.steady_state(circuit, dc_f).volts
        assert got == pytest.approx(want, abs=5e-5)
        assert abs(dc_f) < 0.7e-12 or abs(want) < 0.9 * abs(u[0])


def test_a_sine_has_gain_delay_and_third_harmonic_of_the_ring():
    """Ticks of a sine: held over each tick as the demodulator gets it, and as a probe samples it."""
    p = ring_tables.design(DEVICE, 25.0, 25.0, TICK_S)
    gain, tau_s = linear("drive", 25.0)
    for dc_f in (0.1e-12, 0.5e-12, 0.75e-12):
        t = np.arange(20_000) * TICK_S
        u = gain * dc_f * np.sin(W * (t - tau_s))
        held = [ring_saturation.volts(p, 0, 0.0, 0, a, b) for a, b in itertools.pairwise(u)]
        middle = gain * dc_f * np.sin(W * (t[:-1] + TICK_S / 2 - tau_s))
        want = ring_cycle.large(ring_tables.circuit(DEVICE, "drive", 25.0), dc_f)
        lost = want.loss / (1 - want.loss)
        sampled = ring_saturation.saturated_output(p, 25.0, 0, u)[1:-1]
        for times, out in ((t[1:-1], sampled), (t[:-1] + TICK_S / 2, middle + held)):
            waves = [f(k * W * times) for k in (1, 3, 5, 7, 9) for f in (np.sin, np.cos)]
            sines = np.linalg.lstsq(np.array(waves).T, out, rcond=None)[0]
            size = math.hypot(sines[0], sines[1])
            # the mean of both ends of a tick is (w h)^2/8 short of its middle: of the part that is lost
            assert size / dc_f / DEVICE.signal_gain == pytest.approx(want.gain_v_per_f, rel=1e-5 + 7e-4 * lost)
            assert -math.atan2(sines[1], sines[0]) / W == pytest.approx(want.delay_s, abs=0.1e-9)
            assert math.hypot(sines[2], sines[3]) / size == pytest.approx(abs(want.third), rel=0.01)


def test_temperatures_between_the_tables_are_met():
    p = ring_tables.design(DEVICE, 21.0, 30.0, TICK_S)
    assert (p.temp_lo_degc, p.temp_count) == (20.0, 5)
    u = np.linspace(-3.5, 3.5, 40)
    for temp_degc in (21.3, 26.25, 30.0):
        own = ring_tables.design(DEVICE, temp_degc, temp_degc, TICK_S)
        got, want = (ring_saturation.saturated_output(q, temp_degc, 0, u) for q in (p, own))
        assert got == pytest.approx(want, abs=4e-4)
    # beyond the tables the line goes on
    steep = np.diff([ring_saturation.saturated_output(own, 30.0, 0, np.full(3, u))[1] for u in (50.0, 60.0, 70.0)])
    assert 0 < steep[0] == pytest.approx(steep[1])


def test_off_is_off_and_not_a_number_stays_one():
    assert ring_tables.design(Device(), -20.0, 50.0, TICK_S) is ring_saturation.OFF
    p = ring_tables.design(DEVICE, 25.0, 25.0, TICK_S)
    assert math.isnan(ring_saturation.volts(p, 0, 0.0, 0, math.nan, 0.1))
    assert ring_saturation.volts(p, 0, 0.0, 0, 0.0, 0.0) == 0.0

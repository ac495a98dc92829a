"""The frequency plan against edges, tones and samples counted one by one."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from analog_frontend.parts.device import Device
from fpga_model.design_record import DEFAULT
from testbench.design import frequency_plan


def lateness_deg(f_hz, seconds, start=0.0):
    """Mean lateness (deg, less half a tick) of edges of both slopes that leave at the next tick."""
    at = (np.arange(int(2 * f_hz * seconds)) + start) / (2 * f_hz) * DEFAULT.tick_hz
    return float(np.mean(np.ceil(at) - at) - 0.5) * 360 * f_hz / DEFAULT.tick_hz


@given(st.floats(3000, 20000), st.floats(0, 1))
@example(11750.0, 0.0)
def test_no_mean_of_edges_is_further_off(f_hz, start):
    # a ratio of more places than the plan looks at wanders by half of one such place at most
    beyond = 180 * f_hz / DEFAULT.tick_hz / (frequency_plan.MOST_PLACES + 1)
    assert abs(lateness_deg(f_hz, 0.25, start)) <= frequency_plan.slide_deg(f_hz, 0.25) + beyond


@pytest.mark.parametrize(("f_hz", "places"), [(11000.0, 11), (12500.0, 1), (10000.0, 1), (15000.0, 3)])
def test_at_an_exact_ratio_edges_stand_still(f_hz, places):
    slow = frequency_plan.slides(f_hz)[0]
    assert (slow.places, slow.beat_hz) == (places, 0.0)
    seen = [lateness_deg(f_hz, 0.1, s) for s in np.linspace(0, 1, 400)]
    assert np.ptp(seen) == pytest.approx(slow.wander_deg, rel=0.03)


def test_near_a_ratio_a_coarse_word_takes_them_there():
    """Words of 32 bits on either side of f: one of them is nearer to the exact ratio than the other is to f."""
    d = DEFAULT._replace(dds_bits=32)
    step_hz = d.master_hz / 2**32
    assert frequency_plan.slides(12500.0 + 0.9 * step_hz, d)[0].beat_hz == 0.0
    fine = frequency_plan.slides(12500.0 + 2.5 * step_hz)[0].beat_hz
    assert frequency_plan.slides(12500.0 + 2.5 * step_hz, d)[0].beat_hz == pytest.approx(0.6 * fine, rel=1e-4)


def test_near_a_ratio_they_wander_with_the_beat():
    f_hz = 12500.0 + 0.02
    slow = frequency_plan.slides(f_hz)[0]
    at = np.arange(int(2 * f_hz * 4 / slow.beat_hz)) / (2 * f_hz) * DEFAULT.tick_hz
    late = np.ceil(at) - at
    jumps = np.count_nonzero(np.abs(np.diff(late)) > 0.5)
    assert jumps == pytest.approx(4, abs=1)  # one fall of the sawtooth to a beat


@given(st.floats(10, 60000), st.sampled_from([4000.0, 8000.0]))
def test_an_alias_is_where_samples_show_it(f_hz, rate_hz):
    seen = frequency_plan.alias_hz(f_hz, rate_hz)
    n = np.arange(50)
    assert np.allclose(np.cos(2 * math.pi * f_hz / rate_hz * n), np.cos(2 * math.pi * seen / rate_hz * n), atol=1e-6)
    assert 0 <= seen <= rate_hz / 2


def test_ripple_is_what_three_poles_and_three_sums_leave():
    d = Device()
    f_hz, fine = 700.0, 1 << 16
    t = np.arange(64 * 64) / d.adc_modulator_hz
    box = np.ones(64) / 64
    tone = np.exp(2j * math.pi * f_hz * t)
    for _ in range(3):
        tone = np.convolve(tone, box, "valid")
    poles = 1 / abs(1 + 2j * math.pi * f_hz * 2 * d.sid_r_ohm * d.sid_c_f) ** 3
    assert frequency_plan.ripple_db(f_hz, d) == pytest.approx(20 * math.log10(abs(tone[fine % 64]) * poles), abs=1e-6)


def line(found, word):
    return next(m for m in found if word in m.what)


def test_what_the_plan_minds():
    good = frequency_plan.plan(Device(), 25.0, 0.005)
    assert all(m.kept for m in good)
    assert not line(frequency_plan.plan(Device(fx_hz=12500.01), 25.0), "edges").kept
    assert not line(frequency_plan.plan(Device(carrier_ppm=0.5), 25.0), "carrier").kept
    coarse = DEFAULT._replace(dds_bits=28)
    assert not line(frequency_plan.plan(Device(), 25.0, design=coarse), "DDS").kept
    # a fast demodulator lets its ripple through; at a multiple of the frames' rate sinc3 has a zero
    fast = Device(fx_hz=8500.0, sid_c_f=1e-9)
    assert not line(frequency_plan.plan(fast, 600.0), "1 f").kept
    assert line(frequency_plan.plan(fast, 25.0), "1 f").kept
    slow = line(frequency_plan.plan(Device(fx_hz=8001.0), 25.0), "1 f")
    assert slow.kept
    assert slow.distance_hz == 1.0


def test_rates_are_those_of_the_design():
    other = DEFAULT._replace(master_hz=24_000_000, tick_clocks=24)
    assert frequency_plan.slides(12500.0, other)[0].beat_hz == 0.0
    half = DEFAULT._replace(tick_clocks=13, frame_ticks=250)
    assert frequency_plan.slides(12500.0, half)[0].wander_deg == pytest.approx(2.25)

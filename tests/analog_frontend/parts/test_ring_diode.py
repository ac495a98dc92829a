"""The averaged ring diode against the circuit itself (ngspice), and its numbers against hand calculation."""

import math

import numpy as np
import pytest

from analog_frontend.parts import propagator, ring_diode
from analog_frontend.parts.device import Device
from analog_frontend.parts.ring_diode import HSMS_282X
from tests import spice

needs_ngspice = pytest.mark.skipif(
    spice.NGSPICE is None, reason="SKIPPED: ngspice is not installed, the ring diode is unchecked"
)

CARRIER_HZ = 8e6
HALF_S = 0.5 / CARRIER_HZ
SETTLED_S = 5e-6  # 16 time constants
DC_F = 2e-15  # 2 mV: far below what clips
NO_JUNCTION = HSMS_282X._replace(cj0_f=0.0)
CASES = [
    (5.0, 50e-12, NO_JUNCTION, 27.0),
    (3.3, 32e-12, NO_JUNCTION, 27.0),
    (5.0, 32e-12, HSMS_282X, 27.0),
    (5.0, 45e-12, HSMS_282X, 27.0),
    (5.0, 45e-12, HSMS_282X, -20.0),
    (5.0, 45e-12, HSMS_282X, 70.0),
]


def circuit(carrier_v, cref_f, diode, temp_degc, dc_f, folder, stop_s=6e-6):
    """Waveform V(C) - V(D) of the ring whose Cp is 3 pF at 25 degC."""
    stray = ring_diode.diode_ring(carrier_v, CARRIER_HZ, 2e-12, 3e-12, cref_f, diode, temp_degc).stray_f
    nominal, warm = (float(ring_diode.built_in_v(diode, t)) for t in (27.0, temp_degc))
    slope = (nominal - warm) / ((temp_degc - 27.0) or 1.0)
    netlist = spice.ring_diode(
        carrier_v=carrier_v,
        dc_f=dc_f,
        stray_f=stray,
        cref_f=cref_f,
        cj0_f=diode.cj0_f,
        vj_per_k=slope,
        temp_degc=temp_degc,
        stop_s=stop_s,
    )
    times, (c, d) = spice.run(netlist, folder)
    return times, c - d


@needs_ngspice
@pytest.mark.parametrize(
    "case", [case if k in (1, 5) else pytest.param(case, marks=pytest.mark.slow) for k, case in enumerate(CASES)]
)
def test_gain_step_and_delay_are_those_of_the_circuit(case, tmp_path):
    carrier_v, cref_f, diode, temp_degc = case
    want = ring_diode.diode_ring(carrier_v, CARRIER_HZ, 2e-12, 3e-12, cref_f, diode, temp_degc)

    times, v = circuit(*case, DC_F, tmp_path)
    gain = spice.mean(times, v, SETTLED_S, SETTLED_S + 8 * HALF_S) / DC_F
    exact = diode.cj0_f == 0.0
    assert gain == pytest.approx(want.gain_v_per_f, rel=5e-4 if exact else 0.01)

    # the step at t = 0, seen at the end of each half period: a straight line in the logarithm
    k = np.arange(6, 24)
    left = np.interp(80 * HALF_S - 30e-12, times, v) - np.interp(k * HALF_S - 30e-12, times, v)
    settle = -HALF_S / np.polyfit(k, np.log(left), 1)[0]
    assert settle == pytest.approx(want.settle_s, rel=5e-4 if exact else 0.01)

    # a ramp of dC comes out late by the delay of the mean
    ramp = DC_F / 5e-6
    times, v = circuit(*case, f"{ramp}*time", tmp_path)
    late = SETTLED_S + 4 * HALF_S - spice.mean(times, v, SETTLED_S, SETTLED_S + 8 * HALF_S) / gain / ramp
    assert late == pytest.approx(want.tau_s, rel=0.01)


@needs_ngspice
def test_the_circuit_clips_at_two_diodes(tmp_path):
    case = (5.0, 50e-12, NO_JUNCTION, 27.0)
    want = ring_diode.diode_ring(5.0, CARRIER_HZ, 2e-12, 3e-12, 50e-12, NO_JUNCTION, 27.0).gain_v_per_f
    lost = {}
    for dc_f in (0.1e-12, 0.25e-12, 0.5e-12):
        times, v = circuit(*case, dc_f, tmp_path)
        lost[dc_f] = 1 - spice.mean(times, v, SETTLED_S, SETTLED_S + 8 * HALF_S) / dc_f / want
    assert abs(lost[0.1e-12]) < 1e-3
    assert 0.003 < lost[0.25e-12] < 0.01
    assert 0.15 < lost[0.5e-12] < 0.25


@needs_ngspice
def test_the_textbook_gain_is_five_percent_high(tmp_path):
    case = (5.0, 50e-12, NO_JUNCTION, 27.0)
    times, v = circuit(*case, DC_F, tmp_path)
    want = ring_diode.diode_ring(5.0, CARRIER_HZ, 2e-12, 3e-12, 50e-12, NO_JUNCTION, 27.0)
    measured = spice.mean(times, v, SETTLED_S, SETTLED_S + 8 * HALF_S) / DC_F
    assert 1.04 < want.textbook_gain_v_per_f / measured < 1.06


def test_without_junctions_the_formula_is_the_one_on_the_page():
    n_vt = 1.08 * 1.380649e-23 / 1.602176634e-19 * 300.15
    tail = 5e-12 * 50e-12 / 55e-12
    u = 2.2e-8 * HALF_S / (n_vt * tail)
    vf = 2 * n_vt * math.atanh(math.exp(-2 * u))
    bounce = (2e-12 * 5.0 - 2 * vf * 5e-12) / 55e-12
    got = ring_diode.diode_ring(5.0, CARRIER_HZ, 2e-12, 3e-12, 50e-12, NO_JUNCTION, 27.0)
    assert got.vf_v == pytest.approx(vf, rel=1e-12)
    g = u / math.tanh(u)
    inside = 5.0 - 2 * vf - 2 * n_vt * (g - math.log(math.cosh(u))) - bounce
    assert got.g == pytest.approx(g, rel=1e-12)
    assert got.gain_v_per_f == pytest.approx(inside / 5e-12 / g, rel=1e-12)
    assert got.stray_f == pytest.approx(3e-12, rel=1e-12)
    assert got.textbook_tau_s == pytest.approx(312.5e-9, rel=1e-12)
    assert got.tau_s == pytest.approx(312.5e-9 * (1 / g + 0.1**2 / (2 * 1.1)), rel=1e-12)
    assert got.settle_s == pytest.approx(HALF_S / math.log((1 + 0.1 * g) / (1 - 0.1 * g)), rel=1e-12)


def test_saturation_current_follows_the_law_of_spice():
    for temp in (-40.0, 27.0, 85.0):
        t, vt = temp + 273.15, 1.380649e-23 / 1.602176634e-19 * (temp + 273.15)
        want = 2.2e-8 * (t / 300.15) ** (2 / 1.08) * math.exp((t / 300.15 - 1) * 0.69 / (1.08 * vt))
        assert float(ring_diode.saturation_current_a(HSMS_282X, temp)) == pytest.approx(want, rel=1e-12)


def test_gain_temperature_coefficient_emerges():
    def tc(carrier_v, diode):
        cold, warm = (
            ring_diode.diode_ring(carrier_v, CARRIER_HZ, 2e-12, 3e-12, 50e-12, diode, t).gain_v_per_f
            for t in (24.0, 26.0)
        )
        return (warm - cold) / (warm + cold)

    # expected: 667-749 ppm/K at 5 V, 1050-1225 ppm/K at 3.3 V for fixed capacitances
    assert 667e-6 < tc(5.0, NO_JUNCTION) < 749e-6
    assert 1050e-6 < tc(3.3, NO_JUNCTION) < 1225e-6
    # the junctions' own drift takes back a third of it
    assert 400e-6 < tc(5.0, HSMS_282X) < 550e-6


def test_a_compensated_carrier_keeps_gain_and_pole():
    at_reference = propagator.cv_chain(Device(), "drive", 25.0)
    assert propagator.cv_chain(Device(), "drive", 45.0)[0] > 1.005 * at_reference[0]
    assert propagator.cv_chain(Device(diode_tc_on=0), "drive", 75.0) == at_reference


def test_impossible_rings_are_refused():
    for bad, word in (
        ({"carrier_v": 0.3}, "carrier_v"),
        ({"cp_f": 1e-12}, "cp_f"),
        ({"carrier_hz": 0.0}, "carrier_hz"),
    ):
        with pytest.raises(ValueError, match=word):
            propagator.cv_chain(Device(**bad), "drive", 25.0)

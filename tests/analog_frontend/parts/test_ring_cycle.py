"""The ring beyond small signals: against the circuit itself (ngspice), its own small-signal law and symmetry."""

import math

import numpy as np
import pytest

from analog_frontend.parts import ring_cycle, ring_diode
from analog_frontend.parts.ring_diode import HSMS_282X
from tests import spice
from tests.analog_frontend.parts.test_ring_diode import (
    CARRIER_HZ,
    HALF_S,
    NO_JUNCTION,
    SETTLED_S,
    circuit,
    needs_ngspice,
)

DEFAULT = (5.0, CARRIER_HZ, 2e-12, 3e-12, 32e-12, HSMS_282X)
FULL_F = 0.5e-12  # dC of the default board: 5 um times 1e-7 F/m
AMPLITUDES = (0.05, 0.2, 0.5, 0.8, 1.0, 1.2, 1.35, 1.5)
TEMPERATURES = (-20.0, 25.0, 50.0)
SINE_HZ = CARRIER_HZ / 727  # 11004 Hz: whole carrier periods, so that its ripple is not seen at the harmonics


def harmonic(times, volts, start, period, k):
    """Complex amplitude of harmonic k about sin, of a waveform that is straight between its samples."""
    inner = (times > start) & (times < start + period)
    t = np.concatenate([[start], times[inner], [start + period]])
    w = 2 * np.pi * k / period
    return 2j / period * np.trapezoid(np.interp(t, times, volts) * np.exp(-1j * w * t), t)


@needs_ngspice
@pytest.mark.slow
@pytest.mark.parametrize("temp_degc", TEMPERATURES)
def test_sines_come_out_as_from_the_circuit(temp_degc, tmp_path):
    losses, linear = [], ring_diode.diode_ring(*DEFAULT, temp_degc)
    for part in AMPLITUDES:
        dc_f, w = part * FULL_F, 2 * math.pi * SINE_HZ
        sine = f"{dc_f!r}*sin({w!r}*time)"
        times, volts = circuit(5.0, 32e-12, HSMS_282X, temp_degc, sine, tmp_path, SETTLED_S + 2e-6 + 1 / SINE_HZ)
        first, third = (harmonic(times, volts, SETTLED_S + 1e-6, 1 / SINE_HZ, k) for k in (1, 3))
        got = ring_cycle.large(ring_cycle.circuit(*DEFAULT, temp_degc), dc_f)
        assert got.gain_v_per_f == pytest.approx(abs(first) / dc_f, rel=0.01)
        assert got.delay_s == pytest.approx(-np.angle(first) / w, abs=2e-9)
        assert abs(got.third) == pytest.approx(abs(third) / abs(first), rel=0.1)
        # the sense of the third harmonic: its phase is near 0 or near half a turn
        assert np.sign(got.third) == np.sign(third.real)
        losses.append(got.loss)
        gain, delay_s, size = abs(first) / dc_f, -np.angle(first) / w, abs(third) / abs(first)
        lost = 1 - gain * (1 - got.loss) / got.gain_v_per_f
        row = (temp_degc, dc_f * 1e12, 100 * lost, delay_s * 1e9, 100 * size)
        row += tuple(100 * (v / gain - 1) for v in (linear.gain_v_per_f, got.gain_v_per_f))
        print(*row, (got.delay_s - delay_s) * 1e9, 100 * (abs(got.third) / size - 1))
    assert losses == sorted(losses)
    if temp_degc >= 25.0:
        assert sum(loss > 0.1 for loss in losses) >= 3


@needs_ngspice
def test_a_constant_comes_out_as_from_the_circuit(tmp_path):
    for temp_degc, dc_f, least in ((25.0, FULL_F, 0.15), (50.0, 1.5 * FULL_F, 0.5)):
        times, volts = circuit(5.0, 32e-12, HSMS_282X, temp_degc, dc_f, tmp_path)
        want = spice.mean(times, volts, SETTLED_S, SETTLED_S + 8 * HALF_S)
        p = ring_cycle.circuit(*DEFAULT, temp_degc)
        got = ring_cycle.steady_state(p, dc_f).volts
        assert got == pytest.approx(want, rel=0.003)
        assert got < (1 - least) * dc_f * ring_cycle.steady_state(p, 0.0).volts_per_f


def test_small_signals_are_those_of_the_closed_form():
    for diode, gain_rel, delay_rel in ((NO_JUNCTION, 1e-3, 2e-3), (HSMS_282X, 4e-3, 4e-3)):
        for temp_degc in TEMPERATURES:
            want = ring_diode.diode_ring(5.0, CARRIER_HZ, 2e-12, 3e-12, 32e-12, diode, temp_degc)
            got = ring_cycle.large(ring_cycle.circuit(5.0, CARRIER_HZ, 2e-12, 3e-12, 32e-12, diode, temp_degc), 1e-15)
            assert got.gain_v_per_f == pytest.approx(want.gain_v_per_f, rel=gain_rel)
            assert got.delay_s == pytest.approx(want.tau_s, rel=delay_rel)
            assert abs(got.loss) < 1e-6
            assert got.demodulated_v_per_f == pytest.approx(got.gain_v_per_f, rel=1e-6)


def test_the_output_is_odd_and_its_delay_even_in_dc():
    p = ring_cycle.circuit(*DEFAULT, 25.0)
    plus, minus = (ring_cycle.steady_state(p, s * FULL_F) for s in (1, -1))
    assert minus.volts == pytest.approx(-plus.volts, rel=1e-9)
    assert minus.volts_per_f == pytest.approx(plus.volts_per_f, rel=1e-6)
    assert minus.slope_v_s_per_f == pytest.approx(plus.slope_v_s_per_f, rel=1e-6)
    near = [ring_cycle.steady_state(p, FULL_F + d).volts for d in (-1e-14, 1e-14)]
    assert plus.volts_per_f == pytest.approx((near[1] - near[0]) / 2e-14, rel=1e-3)


def test_steps_and_start_of_the_integration_are_not_seen():
    for temp_degc, dc_f in ((-20.0, 0.75e-12), (50.0, 0.75e-12), (85.0, 0.5e-12)):
        p = ring_cycle.circuit(*DEFAULT, temp_degc)
        want = ring_cycle.steady_state(p, dc_f)
        fine = p._replace(steps=8 * p.steps)
        # a later start of the tail: the charge forgets it
        for other, rel in ((fine, 2e-6), (p._replace(start_v=p.start_v - 2 * p.nvt_v), 1e-4)):
            got = ring_cycle.steady_state(other, dc_f)
            assert got.volts == pytest.approx(want.volts, rel=rel)
            small = ring_cycle.steady_state(other, 0.0).slope_v_s_per_f
            assert got.slope_v_s_per_f == pytest.approx(want.slope_v_s_per_f, abs=1e-4 * small)


def test_a_sine_is_the_sum_over_its_points():
    """Fundamental, third harmonic and mean of the curve by a rule of another kind, adaptive quadrature."""
    from scipy.integrate import quad

    p = ring_cycle.circuit(*DEFAULT, 50.0)
    got = ring_cycle.large(p, FULL_F)
    volts = {}

    def v(angle):
        if angle not in volts:
            volts[angle] = ring_cycle.steady_state(p, FULL_F * math.sin(angle)).volts
        return volts[angle]

    first, third, mean = (
        quad(lambda x, f=f: v(x) * f(x), 0, math.pi / 2, epsabs=1e-6, epsrel=1e-6)[0]
        for f in (math.sin, lambda x: math.sin(3 * x), lambda x: 1.0)
    )
    assert got.gain_v_per_f == pytest.approx(4 / math.pi * first / FULL_F, rel=1e-5)
    assert got.third == pytest.approx(third / first, rel=1e-4)
    assert got.demodulated_v_per_f == pytest.approx(mean / FULL_F, rel=1e-4)


def test_exponential_and_junction_are_those_of_the_library():
    for x in (-700.0, -40.5, -1.0, -1e-9, 0.0, 0.3, 16.2, 700.0):
        assert ring_cycle.exponential(x) == pytest.approx(math.exp(x), rel=1e-14)
    p = ring_cycle.circuit(*DEFAULT, 50.0)
    for v in (-3.0, -0.4, 0.0, 0.2, 0.31, 0.33, 0.6):
        capacitance, _ = ring_cycle.junction(p, v)
        charge = [ring_cycle.junction(p, v + s)[1] for s in (-1e-6, 1e-6)]
        assert capacitance == pytest.approx((charge[1] - charge[0]) / 2e-6, rel=1e-7)
    assert ring_cycle.junction(p, -1.0)[0] == pytest.approx(0.7e-12 * (1 + 1.0 / p.vj_v) ** -0.5, rel=1e-13)
    assert ring_cycle.junction(p, 0.0) == pytest.approx((0.7e-12, 0.0), abs=1e-28)


def test_compiled_and_interpreted_have_the_same_bits():
    for temp_degc, dc_f in ((25.0, 0.3e-12), (85.0, 1.9e-12)):
        p, nodes_v = ring_cycle.circuit(*DEFAULT, temp_degc), np.array([-0.3, -0.2, -0.1, -0.05])
        outs = [np.empty(5) for _ in range(2)]
        ring_cycle.half_period(p, nodes_v, dc_f, 3e-8, outs[0])
        getattr(ring_cycle.half_period, "py_func", ring_cycle.half_period)(p, nodes_v, dc_f, 3e-8, outs[1])
        assert outs[0].tobytes() == outs[1].tobytes()
        assert np.isfinite(outs[0]).all()


def test_impossible_amplitudes_are_refused():
    for dc_f in (0.0, -1e-13, 2e-12, math.nan):
        with pytest.raises(ValueError, match="dc_f"):
            ring_cycle.large(ring_cycle.circuit(*DEFAULT, 25.0), dc_f)

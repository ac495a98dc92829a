"""Temperature laws against exact rationals and Decimal, and against the paper's quadrature voltages (docs/paper.md)."""

from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.parts import device, thermal

temps = st.one_of(st.sampled_from([-55.0, -20.0, 24.999, 25.0, 25.001, 50.0, 125.0]), st.floats(-55, 125))


def linear(value, tc, temp, ref=25.0):
    """Nearest double of value (1 + tc (temp - ref)): exact rationals, one rounding."""
    return float(Fraction(value) * (1 + Fraction(tc) * (Fraction(temp) - Fraction(ref))))


def exponential(value, tc, temp):
    with localcontext() as context:
        context.prec = 60
        return float(Decimal(value) * (Decimal(tc) * (Decimal(temp) - Decimal(25))).exp())


@given(temps)
def test_laws(temp):
    dev = device.make(dac_rc_tc_per_k=2e-4, sid_rc_tc_per_k=-1e-4)
    warm = thermal.device_at_temperature(dev, temp)
    expected = dev._asdict()
    expected["fx_hz"] = linear(11002.3, -27e-6, temp)
    expected["fy_hz"] = linear(10863.3, -27e-6, temp)
    expected["qx"] = expected["qy"] = exponential(2e5, -0.005, temp)
    expected["kxy_n_per_m"] = linear(0.0561, 0.0044 if temp < 25.0 else 0.0035, temp)
    expected["opamp_gbw_hz"] = linear(10.3e6, -0.002, temp)
    for name in ("drive_pole_1_s", "drive_pole_2_s", "drive_pole_3_s", "sense_pole_1_s", "sense_pole_2_s",
                 "sense_pole_3_s"):  # fmt: skip
        expected[name] = linear(getattr(dev, name), 2e-4, temp)
    expected["sid_r_ohm"] = linear(10e3, -1e-4, temp)
    assert warm._asdict() == expected


def power(value, exponent, temp):
    with localcontext() as context:
        context.prec = 60
        ratio = (Decimal(temp) + Decimal("273.15")) / Decimal("298.15")
        return float(Decimal(value) * ratio ** Decimal(exponent))


@given(temps)
def test_laws_of_noise_carrier_and_switches(temp):
    dev = device.make(
        carrier_tc_per_k=-4e-4,
        sid_charge_tc_per_k=0.003,
        sid_leakage_a=1e-10,
        ina_voltage_noise_v_per_rthz=1.07e-9,
        ina_current_noise_a_per_rthz=1.9e-12,
        ina_bias_exponent=0.5,
        ina_beta_exponent=1.75,
        sid_flicker_exponent=0.5,
    )
    warm = thermal.device_at_temperature(dev, temp)
    assert warm.carrier_v == linear(5.0, -4e-4, temp)
    assert warm.sid_charge_c == linear(1e-12, 0.003, temp)
    assert warm.sid_leakage_a == pytest.approx(1e-10 * 2 ** ((temp - 25) / 10), rel=1e-14)
    assert warm.ina_voltage_noise_v_per_rthz == power(1.07e-9, 0.75, temp)
    assert warm.ina_current_noise_a_per_rthz == power(1.9e-12, -0.625, temp)
    assert warm.sid_flicker_v_per_rthz == power(37e-9, 0.5, temp)


@given(temps, st.floats(-1e-3, 1e-3))
def test_output_amplifiers_go_with_their_gbw(temp, tc):
    dev = device.make(dac_amplifier_tc_on=1, dac_rc_tc_per_k=tc)
    warm = thermal.device_at_temperature(dev, temp)
    for channel in ("drive", "sense"):
        first, *rest = (f"{channel}_pole_{n}_s" for n in (1, 2, 3))
        assert getattr(warm, first) == linear(getattr(dev, first), tc, temp)
        for name in rest:
            delay = getattr(warm, name) * warm.opamp_gbw_hz
            assert delay == pytest.approx(getattr(dev, name) * dev.opamp_gbw_hz, rel=1e-14)


def test_the_reference_temperature_changes_nothing():
    dev = device.make(temp_ref_degc=20.0, fx_hz=11000.1)
    assert thermal.device_at_temperature(dev, 20.0) is dev
    assert thermal.device_at_temperature(dev, 20.5).fx_hz == linear(11000.1, -27e-6, 20.5, 20.0)


def test_laws_that_are_off_change_nothing():
    laws = "tcf_per_k dlnq_per_k kxy_tc_below_per_k kxy_tc_above_per_k opamp_gbw_tc_per_k".split()
    dev = device.make(**dict.fromkeys(laws, 0.0))
    for temp in (-55.0, 125.0):
        assert thermal.device_at_temperature(dev, temp) == dev


@pytest.mark.parametrize(("temp", "paper_v"), [(-20.0, 4.0469), (25.0, 4.5247), (50.0, 4.7182)])
def test_quadrature_voltage_of_the_paper(temp, paper_v):
    dev = thermal.device_at_temperature(device.make(), temp)
    # the model starts from 4.52 V, 0.1 % below the paper's 4.5247 V
    assert (dev.kxy_n_per_m / dev.kq_n_per_m_per_v2) ** 0.5 == pytest.approx(paper_v, rel=2e-3)


def test_frequency_slope_and_split():
    """-0.3 Hz/K; the split keeps to 139 Hz within the same 27 ppm/K."""
    a, b = (thermal.device_at_temperature(device.make(), t) for t in (25.0, 26.0))
    assert b.fx_hz - a.fx_hz == pytest.approx(-0.297, abs=1e-3)
    assert (b.fx_hz - b.fy_hz) / (a.fx_hz - a.fy_hz) - 1 == pytest.approx(-27e-6, abs=1e-9)


@pytest.mark.parametrize("temp", [float("nan"), -55.1, 125.1, float("inf")])
def test_temperatures_outside_the_parts_are_refused(temp):
    with pytest.raises(ValueError, match=r"temp_degc = .* outside -55 .. 125 \(unit degC\)"):
        thermal.device_at_temperature(device.make(), temp)


def test_a_law_that_leaves_the_limits_is_refused():
    with pytest.raises(ValueError, match="kxy_n_per_m"):
        thermal.device_at_temperature(device.make(kxy_n_per_m=0.49, kxy_tc_above_per_k=0.05), 100.0)


def test_warm_up_is_bit_for_bit_nothing_when_off():
    p = thermal.design(device.make(), 0.1)
    rise = 0.0
    for _ in range(100):
        rise = thermal.step(p, rise)
        assert rise == 0.0
    assert thermal.rise_k(device.make(), 100.0) == 0.0


def test_warm_up_steps_follow_the_closed_form():
    dev = device.make(self_heating_k=6.0, warm_up_tau_s=450.0)
    p = thermal.design(dev, 2.0)
    rise, n = 0.0, 1000
    for k in range(1, n + 1):
        rise = thermal.step(p, rise)
        with localcontext() as context:
            context.prec = 40
            exact = 6 * (1 - (Decimal(-2 * k) / 450).exp())
        # every step rounds three times, at most 6 K each, and forgets at the rate alpha = 1/225; alpha is rounded too
        assert abs(Decimal(rise) - exact) < Decimal(6 * 2.0**-53 * 3 * 226)
        assert abs(Decimal(thermal.rise_k(dev, 2.0 * k)) - exact) < Decimal(6 * 2.0**-53)
    assert rise == pytest.approx(6.0, rel=0.02)


def test_many_steps_at_once_are_those_steps():
    p, wanted = thermal.design(device.make(self_heating_k=6.0), 2.0), [0.5]
    for _ in range(50):
        wanted.append(thermal.step(p, wanted[-1]))
    np.testing.assert_array_equal(thermal.rises(p, 0.5, 50), wanted)


@pytest.mark.parametrize("step_s", [0.0, -1.0, float("nan"), 1e5])
def test_warm_up_steps_must_be_positive(step_s):
    with pytest.raises(ValueError, match="step_s"):
        thermal.design(device.make(), step_s)

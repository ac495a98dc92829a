"""The record of plant parameters and its limits."""

import math

import numpy as np
import pytest

from analog_frontend.parts import device

UNIT_SUFFIX = {
    "ppm": "_ppm", "Hz": "_hz", "V": "_v", "V s": "_v_s", "s": "_s", "kg": "_kg", "N/V": "_n_per_v", "N/m": "_n_per_m",
    "N/m/V^2": "_n_per_m_per_v2", "F": "_f", "F/m": "_f_per_m", "A": "_a", "ohm": "_ohm", "eV": "_ev", "C": "_c",
    "code": "_code", "V/rtHz": "_v_per_rthz", "V/s": "_v_per_s",
    "A/rtHz": "_a_per_rthz", "degC": "_degc", "1/K": "_per_k", "K": "_k",
}  # fmt: skip
DIMENSIONLESS = (
    "exponent _on bow qx qy dxy_ratio diode_n diode_m diode_xti ina_noise_gain driver_noise_gain signal_gain "
    "sid_charge_mismatch adc_pga_drive adc_pga_sense adc_decimation"
).split()
INTS = (
    "diode_tc_on",
    "ring_noise_on",
    "ring_saturation_on",
    "dac_amplifier_tc_on",
    "adc_pga_drive",
    "adc_pga_sense",
    "adc_decimation",
    "adc_step_code",
)
by_field = pytest.mark.parametrize("field", device.FIELDS, ids=[f.name for f in device.FIELDS])


def message(**values):
    with pytest.raises(ValueError, match=r".") as caught:
        device.make(**values)
    return str(caught.value)


def test_defaults_pass_unchanged():
    assert device.make() == device.Device()
    assert device.validate(device.Device()) == device.Device()
    assert hash(device.make()) == hash(device.Device())


@by_field
def test_the_name_carries_the_unit(field):
    if field.unit == "1":
        assert any(field.name.endswith(name) for name in DIMENSIONLESS)
    else:
        assert field.name.endswith(UNIT_SUFFIX[field.unit])


@by_field
def test_limits_are_allowed_and_their_neighbours_are_not(field):
    kind = int if field.name in INTS else float
    assert type(getattr(device.make(), field.name)) is kind
    for limit, outward in ((field.lo, -1), (field.hi, 1)):
        inside = getattr(device.make(**{field.name: kind(limit)}), field.name)
        assert inside == limit
        assert type(inside) is kind
        outside = limit + outward if kind is int else math.nextafter(limit, outward * math.inf)
        text = message(**{field.name: outside})
        for part in (field.name, repr(outside), f"{field.lo:g}", f"{field.hi:g}", f"unit {field.unit}"):
            assert part in text


@by_field
def test_what_is_no_number_is_refused(field):
    for value in (math.nan, math.inf, -math.inf, "1", None, True, 1j, [1.0]):
        text = message(**{field.name: value})
        assert text.startswith(f"{field.name} = {value!r} is ")
        assert f"unit {field.unit}" in text


def test_numbers_of_other_types_become_plain_ones():
    dev = device.make(qx=300_000, fx_hz=np.float64(11000.5), adc_pga_drive=np.int64(2))
    assert (dev.qx, dev.fx_hz, dev.adc_pga_drive) == (300_000.0, 11000.5, 2)
    assert [type(v) for v in (dev.qx, dev.fx_hz, dev.adc_pga_drive)] == [float, float, int]
    assert "not int" in message(adc_step_code=10.0)


def test_only_gains_the_converter_has():
    for gain in (1, 2, 3, 4, 6, 8, 12):
        assert device.make(adc_pga_sense=gain).adc_pga_sense == gain
    for gain in (5, 7, 9, 10, 11):
        assert "gains" in message(adc_pga_sense=gain)


def test_unknown_names_are_refused():
    assert "phase_error_deg" in message(phase_error_deg=1.0)


def test_the_default_set():
    """The numbers the design is tuned to; a change here is a change of the whole model."""
    dev = device.make()
    assert (dev.fx_hz, dev.fy_hz, dev.qx, dev.qy) == (11002.3, 10863.3, 2e5, 2e5)
    assert dev.mass_kg == dev.coriolis_mass_kg == 2.325e-7
    assert dev.k_vf_drive_n_per_v == dev.k_vf_sense_n_per_v == 2.72e-7
    assert (dev.drive_pole_1_s, dev.drive_pole_2_s, dev.drive_pole_3_s) == (100e-9, 40e-9, 40e-9)
    assert (dev.sense_pole_1_s, dev.sense_pole_2_s, dev.sense_pole_3_s) == (68e-9, 16e-9, 40e-9)
    assert (dev.drive_dac_delay_s, dev.sense_dac_delay_s, dev.sid_switch_s) == (0.0, 130e-9, 80e-9)
    # triple pole of the demodulator at 1/(4 pi R C)
    assert 1 / (4 * math.pi * dev.sid_r_ohm * dev.sid_c_f) == pytest.approx(50.05, abs=0.01)
    # ring-diode time constants Cref / (4 fc (C0 + Cp))
    total = 4 * dev.carrier_hz * (dev.c0_f + dev.cp_f)
    assert dev.cref_drive_f / total == pytest.approx(200e-9)
    assert dev.cref_sense_f / total == pytest.approx(281.25e-9)

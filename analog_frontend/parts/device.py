"""Every number of the plant in one record: `Device`; the type of a field is its unit and its limits.

The defaults are the base plant at `temp_ref_degc`; `thermal.device_at_temperature` gives it at another temperature.
`drive` is the x mode and its electronics, `sense` the y mode. All values are SI with the unit in the name; a number
without a unit suffix is dimensionless.

What each default is, and whether it is fact, derived, fitted or assumed: provenance.py
Not here                phase errors (nobody enters one), the firmware's registers, effects (each has its own Params)
Refused                 a value out of range, NaN, a bool, a text, a float for an int, an unknown PGA gain
Source                  docs/plant.md, docs/configuration.md
"""

import math
from numbers import Integral, Real
from typing import NamedTuple


class Limits(NamedTuple):
    """Unit of a field of `Device`, and its limits; both ends are allowed."""

    unit: str
    lo: float
    hi: float


class Device(NamedTuple):
    """One gyroscope with its analog board; plain floats and ints, so that it can be hashed, stored and sampled."""

    # clocks
    clock_ppm: Limits("ppm", -1000.0, 1000.0) = 0.0
    clock_jitter_s: Limits("s", 0.0, 1e-9) = 1e-12
    adc_clock_ppm: Limits("ppm", -30000.0, 30000.0) = 0.0
    carrier_hz: Limits("Hz", 1e6, 50e6) = 8e6
    carrier_ppm: Limits("ppm", -1000.0, 1000.0) = 20.0
    # DACs
    drive_dac_span_v: Limits("V", 0.1, 20.0) = 10.0
    sense_dac_span_v: Limits("V", 0.1, 20.0) = 10.0
    quad_dac_span_v: Limits("V", 0.1, 20.0) = 5.5
    drive_dac_power_on_v: Limits("V", -20.0, 20.0) = -10.0
    sense_dac_power_on_v: Limits("V", -20.0, 20.0) = 0.0
    quad_dac_power_on_v: Limits("V", 0.0, 20.0) = 0.0
    drive_dac_delay_s: Limits("s", 0.0, 10e-6) = 0.0
    sense_dac_delay_s: Limits("s", 0.0, 10e-6) = 130e-9
    quad_dac_delay_s: Limits("s", 0.0, 10e-6) = 0.0
    drive_dac_bow: Limits("1", -0.01, 0.01) = 0.0
    sense_dac_bow: Limits("1", -0.01, 0.01) = 0.0
    drive_dac_glitch_v_s: Limits("V s", 0.0, 1e-6) = 0.0
    sense_dac_glitch_v_s: Limits("V s", 0.0, 1e-6) = 0.0
    # output chains, DAC output to electrode voltage, unity gain
    drive_pole_1_s: Limits("s", 2e-9, 10e-6) = 100e-9
    drive_pole_2_s: Limits("s", 2e-9, 10e-6) = 40e-9
    drive_pole_3_s: Limits("s", 2e-9, 10e-6) = 40e-9
    sense_pole_1_s: Limits("s", 2e-9, 10e-6) = 68e-9
    sense_pole_2_s: Limits("s", 2e-9, 10e-6) = 16e-9
    sense_pole_3_s: Limits("s", 2e-9, 10e-6) = 40e-9
    # resonator
    mass_kg: Limits("kg", 1e-9, 1e-4) = 2.325e-7
    coriolis_mass_kg: Limits("kg", 0.0, 1e-4) = 2.325e-7
    fx_hz: Limits("Hz", 1e3, 50e3) = 11002.3
    fy_hz: Limits("Hz", 1e3, 50e3) = 10863.3
    qx: Limits("1", 100.0, 1e8) = 2e5
    qy: Limits("1", 100.0, 1e8) = 2e5
    kxy_n_per_m: Limits("N/m", -0.5, 0.5) = 0.0561
    dxy_ratio: Limits("1", -1.0, 1.0) = 0.03
    # transducer
    k_vf_drive_n_per_v: Limits("N/V", -1e-4, 1e-4) = 2.72e-7
    k_vf_sense_n_per_v: Limits("N/V", -1e-4, 1e-4) = 2.72e-7
    bias_v: Limits("V", -100.0, 100.0) = 5.0
    kq_n_per_m_per_v2: Limits("N/m/V^2", 0.0, 1.0) = 0.0561 / (4.52 * 4.52)
    # ring-diode C/V and its amplifiers
    carrier_v: Limits("V", 0.5, 50.0) = 5.0
    carrier_tc_per_k: Limits("1/K", -0.005, 0.005) = 0.0
    c0_f: Limits("F", 1e-14, 1e-9) = 2e-12
    cp_f: Limits("F", 0.0, 1e-9) = 3e-12
    dcdx_f_per_m: Limits("F/m", -1e-4, 1e-4) = 1e-7
    dcdy_f_per_m: Limits("F/m", -1e-4, 1e-4) = 1e-7
    cref_drive_f: Limits("F", 1e-13, 1e-8) = 32e-12
    cref_sense_f: Limits("F", 1e-13, 1e-8) = 45e-12
    diode_is_a: Limits("A", 1e-15, 1e-3) = 2.2e-8
    diode_n: Limits("1", 1.0, 2.0) = 1.08
    diode_rs_ohm: Limits("ohm", 0.0, 1e3) = 6.0
    diode_cj0_f: Limits("F", 0.0, 1e-10) = 0.7e-12
    diode_vj_v: Limits("V", 0.1, 2.0) = 0.65
    diode_m: Limits("1", 0.1, 0.9) = 0.5
    diode_eg_ev: Limits("eV", 0.1, 2.0) = 0.69
    diode_xti: Limits("1", 0.0, 10.0) = 2.0
    diode_tc_on: Limits("1", 0, 1) = 1
    ring_saturation_on: Limits("1", 0, 1) = 0
    opamp_gbw_hz: Limits("Hz", 1e5, 1e9) = 10.3e6
    amplifier_slew_v_per_s: Limits("V/s", 1e3, 1e12) = 14.8e6
    amplifier_swing_v: Limits("V", 0.1, 100.0) = 12.0
    ina_noise_gain: Limits("1", 1.0, 1000.0) = 5.0
    driver_noise_gain: Limits("1", 1.0, 1000.0) = 2.0
    signal_gain: Limits("1", -1000.0, 1000.0) = 5.0
    # synchronous integral demodulator
    sid_r_ohm: Limits("ohm", 10.0, 1e9) = 10e3
    sid_c_f: Limits("F", 1e-12, 1e-3) = 159e-9
    sid_switch_s: Limits("s", 0.0, 10e-6) = 80e-9
    sid_fall_s: Limits("s", -100e-9, 100e-9) = 0.0
    sid_charge_c: Limits("C", -1e-9, 1e-9) = 1e-12
    sid_charge_mismatch: Limits("1", -1.0, 1.0) = 0.1
    sid_charge_tc_per_k: Limits("1/K", -0.05, 0.05) = 0.0
    sid_leakage_a: Limits("A", -1e-6, 1e-6) = 0.0
    # converters
    adc_vref_v: Limits("V", 0.1, 10.0) = 4.0
    adc_pga_drive: Limits("1", 1, 12) = 1
    adc_pga_sense: Limits("1", 1, 12) = 12
    adc_decimation: Limits("1", 16, 1024) = 64
    adc_modulator_hz: Limits("Hz", 1e4, 1e7) = 512e3
    adc_delay_s: Limits("s", 0.0, 1e-3) = 0.0
    adc_step_code: Limits("code", 1, 1024) = 10
    adc_noise_drive_v: Limits("V", 0.0, 1.0) = 12.4e-6
    adc_noise_sense_v: Limits("V", 0.0, 1.0) = 1.8e-6
    sar_span_v: Limits("V", 0.1, 20.0) = 5.0
    # noise densities, one-sided
    cv_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 18.2e-9
    carrier_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 0.0
    ring_noise_on: Limits("1", 0, 1) = 0
    cv_resistor_ohm: Limits("ohm", 0.0, 1e9) = 0.0
    ina_voltage_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 0.0
    ina_current_noise_a_per_rthz: Limits("A/rtHz", 0.0, 1e-6) = 0.0
    ina_bias_exponent: Limits("1", -5.0, 5.0) = 1.0
    ina_beta_exponent: Limits("1", -5.0, 5.0) = 1.5
    c0_imbalance_f: Limits("F", -1e-12, 1e-12) = 0.0
    sid_flicker_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 37e-9
    sid_flicker_exponent: Limits("1", -20.0, 20.0) = 0.0
    drive_dac_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 15e-9
    sense_dac_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 7.5e-9
    # temperature
    temp_ref_degc: Limits("degC", -55.0, 125.0) = 25.0
    tcf_per_k: Limits("1/K", -1e-3, 1e-3) = -27e-6
    dlnq_per_k: Limits("1/K", -0.02, 0.02) = -0.005
    kxy_tc_below_per_k: Limits("1/K", -0.05, 0.05) = 0.0044
    kxy_tc_above_per_k: Limits("1/K", -0.05, 0.05) = 0.0035
    opamp_gbw_tc_per_k: Limits("1/K", -0.005, 0.005) = -0.002
    dac_rc_tc_per_k: Limits("1/K", -0.005, 0.005) = 0.0
    dac_amplifier_tc_on: Limits("1", 0, 1) = 0
    sid_rc_tc_per_k: Limits("1/K", -0.005, 0.005) = 0.0
    self_heating_k: Limits("K", 0.0, 50.0) = 0.0
    warm_up_tau_s: Limits("s", 1.0, 1e5) = 600.0


class Field(NamedTuple):
    """Name, unit and limits of a field of `Device`."""

    name: str
    unit: str
    lo: float
    hi: float


FIELDS = tuple(Field(name, *limits) for name, limits in Device.__annotations__.items())
PGA_GAINS = (1, 2, 3, 4, 6, 8, 12)


def _check_field(field, value):
    """`value` as the plain float or int the field holds; raises if it is neither, not finite or out of range."""
    kind = type(Device._field_defaults[field.name])
    number_type = Integral if kind is int else Real
    if isinstance(value, bool) or not isinstance(value, number_type):
        raise ValueError(
            f"{field.name} = {value!r} is {type(value).__name__}, not {kind.__name__} "
            f"(limits {field.lo:g} .. {field.hi:g}, unit {field.unit})"
        )
    number = kind(value)
    # written so that NaN fails
    if not (math.isfinite(number) and field.lo <= number <= field.hi):
        raise ValueError(f"{field.name} = {value!r} is outside {field.lo:g} .. {field.hi:g} (unit {field.unit})")
    if field.name.startswith("adc_pga") and number not in PGA_GAINS:
        raise ValueError(f"{field.name} = {value!r} is none of the gains {PGA_GAINS} (limits 1 .. 12, unit 1)")
    return number


def validate(device):
    """The same device with every field a plain float or int; ValueError names field, value, limits and unit."""
    return Device(*(_check_field(field, value) for field, value in zip(FIELDS, device)))


def make(**values):
    """The default device with some fields changed, validated; an unknown name is a ValueError too."""
    invalid_names = sorted(set(values) - set(Device._fields))
    if invalid_names:
        raise ValueError(f"device: unknown field {', '.join(invalid_names)}")
    return validate(Device(**values))

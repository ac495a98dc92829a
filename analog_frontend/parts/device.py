"""Every number of the plant in one record: `Device`; the type of a field is its unit and its limits.

The defaults are the base plant at `temp_ref_degc`; `thermal.at_temperature` gives the record at another temperature.
`drive` is the x mode and its electronics, `sense` the y mode. All values are SI with the unit in the name; a number
without a unit suffix is dimensionless.

Marks of the comments   S  a source was read    D  derived from other numbers    A  assumed    M  memory of a datasheet
Not here                phase errors (nobody enters one), the firmware's registers, effects (each has its own Params)
Source                  docs/parts/device.md
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
    clock_ppm: Limits("ppm", -1000.0, 1000.0) = 0.0  # A  error of the 26 MHz master; the tick is 1 us / (1 + 1e-6 ppm)
    clock_jitter_s: Limits("s", 0.0, 1e-9) = 1e-12  # M  rms of one edge, TCXO class
    adc_clock_ppm: Limits("ppm", -30000.0, 30000.0) = 0.0  # A  only read when the ADC runs free of the master clock
    carrier_hz: Limits("Hz", 1e6, 50e6) = 8e6  # S  ring-diode carrier
    carrier_ppm: Limits("ppm", -1000.0, 1000.0) = 20.0  # A  generic XO, 25-50 ppm total
    # DACs
    drive_dac_span_v: Limits("V", 0.1, 20.0) = 10.0  # S  DAC8811, bipolar: -span .. +span
    sense_dac_span_v: Limits("V", 0.1, 20.0) = 10.0  # D  AD5791; the span that makes the scale factor 8651 LSB/(deg/s)
    quad_dac_span_v: Limits("V", 0.1, 20.0) = 5.5  # S  DAC82002, unipolar 0 .. span; VDD maximum
    drive_dac_power_on_v: Limits("V", -20.0, 20.0) = -10.0  # M  clears to code 0, minus full scale in offset binary
    sense_dac_power_on_v: Limits("V", -20.0, 20.0) = 0.0  # S  output clamped to ground until the control word
    quad_dac_power_on_v: Limits("V", 0.0, 20.0) = 0.0  # A  zero-scale reset
    drive_dac_delay_s: Limits("s", 0.0, 10e-6) = 0.0  # A  CS rise to start of the output; the settling is in the poles
    sense_dac_delay_s: Limits("s", 0.0, 10e-6) = 130e-9  # M  LDAC fall to start of the output
    quad_dac_delay_s: Limits("s", 0.0, 10e-6) = 0.0  # A  V_q is DC
    drive_dac_bow: Limits("1", -0.01, 0.01) = 0.0  # A  INL bow as a fraction of full scale; off (B grade: 2 LSB = 3e-5)
    sense_dac_bow: Limits("1", -0.01, 0.01) = 0.0  # A  off (B grade: 1 LSB = 1e-6)
    drive_dac_glitch_v_s: Limits("V s", 0.0, 1e-6) = 0.0  # A  per segment border; off (typical 2e-9)
    sense_dac_glitch_v_s: Limits("V s", 0.0, 1e-6) = 0.0  # A  off (typical 3.1e-9 at +-10 V)
    # output chains, DAC output to electrode voltage, unity gain
    drive_pole_1_s: Limits("s", 2e-9, 10e-6) = 100e-9  # D  I/V stage, 5 k with its feedback capacitor
    drive_pole_2_s: Limits("s", 2e-9, 10e-6) = 40e-9  # D  second bipolar amplifier
    drive_pole_3_s: Limits("s", 2e-9, 10e-6) = 40e-9  # D  differential driver
    sense_pole_1_s: Limits("s", 2e-9, 10e-6) = 68e-9  # D  AD5791 3.4 k with 20 pF
    sense_pole_2_s: Limits("s", 2e-9, 10e-6) = 16e-9  # D  unity buffer
    sense_pole_3_s: Limits("s", 2e-9, 10e-6) = 40e-9  # D  differential driver
    # resonator
    mass_kg: Limits("kg", 1e-9, 1e-4) = 2.325e-7  # D  k_xy / (2 Omega w_d)
    coriolis_mass_kg: Limits("kg", 0.0, 1e-4) = 2.325e-7  # A  equal to the mass
    fx_hz: Limits("Hz", 1e3, 50e3) = 11002.3  # D  undamped frequency of the drive mode, off the 26 MHz and 1 MHz grids
    fy_hz: Limits("Hz", 1e3, 50e3) = 10863.3  # D  139 Hz below: phi_y = 180 deg needs w_d > w_y
    qx: Limits("1", 100.0, 1e8) = 2e5  # S  "> 2e5"
    qy: Limits("1", 100.0, 1e8) = 2e5  # S
    kxy_n_per_m: Limits("N/m", -0.5, 0.5) = 0.0561  # D  100 deg/s of quadrature
    dxy_ratio: Limits("1", -1.0, 1.0) = 0.03  # A  d_xy / d_x: 0.3 deg/s of bias
    # transducer
    k_vf_drive_n_per_v: Limits("N/V", -1e-4, 1e-4) = 2.72e-7  # D  2 Vdc dC/dx, from the scale factor
    k_vf_sense_n_per_v: Limits("N/V", -1e-4, 1e-4) = 2.72e-7  # D
    bias_v: Limits("V", -100.0, 100.0) = 5.0  # A  Vdc of the push-pull force electrodes
    kq_n_per_m_per_v2: Limits("N/m/V^2", 0.0, 1.0) = 0.0561 / (4.52 * 4.52)  # D  V_q = 4.52 V nulls k_xy at 25 degC
    # ring-diode C/V and its amplifiers
    carrier_v: Limits("V", 0.5, 50.0) = 5.0  # A  peak to peak at the movable plate
    carrier_tc_per_k: Limits("1/K", -0.005, 0.005) = 0.0  # A  off; below 0 it makes up for the diodes, whose drop falls
    c0_f: Limits("F", 1e-14, 1e-9) = 2e-12  # A  pick-off capacitance at rest
    cp_f: Limits("F", 0.0, 1e-9) = 3e-12  # A  stray plus two diode junctions
    dcdx_f_per_m: Limits("F/m", -1e-4, 1e-4) = 1e-7  # A  closes the noise budget
    dcdy_f_per_m: Limits("F/m", -1e-4, 1e-4) = 1e-7  # A
    cref_drive_f: Limits("F", 1e-13, 1e-8) = 32e-12  # D  tau 200 ns
    cref_sense_f: Limits("F", 1e-13, 1e-8) = 45e-12  # D  tau 281 ns
    diode_is_a: Limits("A", 1e-15, 1e-3) = 2.2e-8  # S  HSMS-282x SPICE
    diode_n: Limits("1", 1.0, 2.0) = 1.08  # S
    diode_rs_ohm: Limits("ohm", 0.0, 1e3) = 6.0  # S
    diode_cj0_f: Limits("F", 0.0, 1e-10) = 0.7e-12  # S
    diode_vj_v: Limits("V", 0.1, 2.0) = 0.65  # S
    diode_m: Limits("1", 0.1, 0.9) = 0.5  # S
    diode_eg_ev: Limits("eV", 0.1, 2.0) = 0.69  # S
    diode_xti: Limits("1", 0.0, 10.0) = 2.0  # S
    diode_tc_on: Limits("1", 0, 1) = 1  # A  0 keeps the diodes at temp_ref_degc: a compensated carrier
    opamp_gbw_hz: Limits("Hz", 1e5, 1e9) = 10.3e6  # S  AD8597 vendor macro-model
    ina_noise_gain: Limits("1", 1.0, 1000.0) = 5.0  # D  pole at GBW / noise gain
    driver_noise_gain: Limits("1", 1.0, 1000.0) = 2.0  # D  inverting unity driver
    signal_gain: Limits("1", -1000.0, 1000.0) = 5.0  # D  ring diode to SID input; 10 clips the ADC
    # synchronous integral demodulator
    sid_r_ohm: Limits("ohm", 10.0, 1e9) = 10e3  # A  triple pole at 1/(4 pi R C) = 50 Hz
    sid_c_f: Limits("F", 1e-12, 1e-3) = 159e-9  # A
    sid_switch_s: Limits("s", 0.0, 10e-6) = 80e-9  # M  FPGA pin to analog switch
    sid_fall_s: Limits("s", -100e-9, 100e-9) = 0.0  # A  a switch follows a falling edge so much later than a rising one
    sid_charge_c: Limits("C", -1e-9, 1e-9) = 1e-12  # A  injected at each edge
    sid_charge_mismatch: Limits("1", -1.0, 1.0) = 0.1  # A  between the two halves
    sid_charge_tc_per_k: Limits("1/K", -0.05, 0.05) = 0.0  # A  off; the charge goes with the switch's logic swing
    sid_leakage_a: Limits("A", -1e-6, 1e-6) = 0.0  # A  of open switches, difference of two halves; doubles in 10 K; off
    # converters
    adc_vref_v: Limits("V", 0.1, 10.0) = 4.0  # S  ADS1298 internal reference
    adc_pga_drive: Limits("1", 1, 12) = 1  # D  2.88 V of 4 V
    adc_pga_sense: Limits("1", 1, 12) = 12  # D  y is nulled
    adc_decimation: Limits("1", 16, 1024) = 64  # M  sinc3 length in modulator samples
    adc_modulator_hz: Limits("Hz", 1e4, 1e7) = 512e3  # M  high-resolution mode, f_CLK / 4
    adc_delay_s: Limits("s", 0.0, 1e-3) = 0.0  # A  last modulator sample to DRDY; the filter has its own delay
    adc_step_code: Limits("code", 1, 1024) = 10  # S  codes move in steps of ten at 8 kSPS
    adc_noise_drive_v: Limits("V", 0.0, 1.0) = 12.4e-6  # M  rms at the input, PGA 1
    adc_noise_sense_v: Limits("V", 0.0, 1.0) = 1.8e-6  # M  rms at the input, PGA 12
    sar_span_v: Limits("V", 0.1, 20.0) = 5.0  # A  board without analog SID: -span .. +span
    # noise densities, one-sided
    cv_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 18.2e-9  # D  at the ring diode, before signal_gain and folding
    carrier_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 0.0  # A  of the carrier, a drive frequency off it; off
    ring_noise_on: Limits("1", 0, 1) = 0  # A  1 adds what the four diodes themselves make; off
    cv_resistor_ohm: Limits("ohm", 0.0, 1e9) = 0.0  # A  its Johnson noise is at the ring's output; off
    ina_voltage_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 0.0  # A  of each of two inputs; off (M: 1.07e-9)
    ina_current_noise_a_per_rthz: Limits("A/rtHz", 0.0, 1e-6) = 0.0  # A  of each of two inputs; off (M: 1.9e-12)
    ina_bias_exponent: Limits("1", -5.0, 5.0) = 1.0  # A  collector current as a power of T: 1 is PTAT
    ina_beta_exponent: Limits("1", -5.0, 5.0) = 1.5  # A  current gain as a power of T: XTB of SPICE, 1.5 to 2
    c0_imbalance_f: Limits("F", -1e-12, 1e-12) = 0.0  # A  half the difference of a pick-off's capacitances at rest; off
    sid_flicker_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 37e-9  # D  after the SID, before the PGA, at 1 Hz
    sid_flicker_exponent: Limits("1", -20.0, 20.0) = 0.0  # A  that density as a power of T; off
    drive_dac_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 15e-9  # M
    sense_dac_noise_v_per_rthz: Limits("V/rtHz", 0.0, 1e-3) = 7.5e-9  # S
    # temperature
    temp_ref_degc: Limits("degC", -55.0, 125.0) = 25.0  # A  where the numbers above hold
    tcf_per_k: Limits("1/K", -1e-3, 1e-3) = -27e-6  # M  relative change of fx and fy
    dlnq_per_k: Limits("1/K", -0.02, 0.02) = -0.005  # S  range up to 1 %/K
    kxy_tc_below_per_k: Limits("1/K", -0.05, 0.05) = 0.0044  # D  from V_q at -20 degC
    kxy_tc_above_per_k: Limits("1/K", -0.05, 0.05) = 0.0035  # D  from V_q at 50 degC
    opamp_gbw_tc_per_k: Limits("1/K", -0.005, 0.005) = -0.002  # A  bipolar gm goes as 1/T
    dac_rc_tc_per_k: Limits("1/K", -0.005, 0.005) = 0.0  # A  all six output poles; off (resistors: 1e-4 .. 3e-4)
    dac_amplifier_tc_on: Limits("1", 0, 1) = 0  # A  1: output poles 2 and 3 are amplifiers and go with 1/GBW; off
    sid_rc_tc_per_k: Limits("1/K", -0.005, 0.005) = 0.0  # A  off
    self_heating_k: Limits("K", 0.0, 50.0) = 0.0  # A  final rise of the package over ambient; off
    warm_up_tau_s: Limits("s", 1.0, 1e5) = 600.0  # A  300-900 s


class Field(NamedTuple):
    """Name, unit and limits of a field of `Device`."""

    name: str
    unit: str
    lo: float
    hi: float


FIELDS = tuple(Field(name, *limits) for name, limits in Device.__annotations__.items())
PGA_GAINS = (1, 2, 3, 4, 6, 8, 12)


def _checked(field, value):
    """`value` as the plain float or int the field holds; raises if it is neither, not finite or out of range."""
    kind = type(Device._field_defaults[field.name])
    wanted = Integral if kind is int else Real
    if isinstance(value, bool) or not isinstance(value, wanted):
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
    return Device(*(_checked(field, value) for field, value in zip(FIELDS, device)))


def make(**values):
    """The default device with some fields changed, validated; an unknown name is a ValueError too."""
    unknown = sorted(set(values) - set(Device._fields))
    if unknown:
        raise ValueError(f"no such field of the device: {', '.join(unknown)}")
    return validate(Device(**values))

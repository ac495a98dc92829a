"""Where each default of `Device` comes from: its kind, what it is and the reason.

    fact       read in a source                derived    follows from facts or from other defaults
    fitted     chosen or kept because it brings a number of the paper nearer
    assumed    none of these; its reason mentions no number of the paper

What was remembered from a data sheet without a page that was read is assumed.
Source    docs/references.md, docs/limits.md
"""

from typing import NamedTuple

FACT, DERIVED, FITTED, ASSUMED = KINDS = "fact", "derived", "fitted", "assumed"


class Origin(NamedTuple):
    """Kind of a default, and what it is and why."""

    kind: str
    text: str


PLANT = {
    # clocks
    "clock_ppm": Origin(ASSUMED, "error of the 26 MHz master: the tick is 1 us / (1 + 1e-6 ppm); assumed zero"),
    "clock_jitter_s": Origin(ASSUMED, "rms of one edge; from memory of data sheets of compensated oscillators"),
    "adc_clock_ppm": Origin(ASSUMED, "error of the converter's own clock, used only when that runs free; assumed zero"),
    "carrier_hz": Origin(FACT, "carrier of the ring diode, stated by the paper"),
    "carrier_ppm": Origin(ASSUMED, "error of the carrier: an ordinary oscillator has 25 to 50 ppm in all"),
    # DACs
    "drive_dac_span_v": Origin(ASSUMED, "DAC8811, bipolar: -span .. +span; the usual reference of 10 V"),
    "sense_dac_span_v": Origin(FITTED, "AD5791, bipolar: the span that gives the scale factor with k_vf"),
    "quad_dac_span_v": Origin(FACT, "DAC82002, unipolar 0 .. span: the largest supply of its data sheet"),
    "drive_dac_power_on_v": Origin(ASSUMED, "minus full scale: code 0 in offset binary; from memory of the data sheet"),
    "sense_dac_power_on_v": Origin(FACT, "the output is clamped to ground until the control word is written"),
    "quad_dac_power_on_v": Origin(ASSUMED, "zero-scale reset"),
    "drive_dac_delay_s": Origin(ASSUMED, "CS high to the start of the output; zero beyond the poles"),
    "sense_dac_delay_s": Origin(ASSUMED, "LDAC low to the start of the output; from memory of the data sheet"),
    "quad_dac_delay_s": Origin(ASSUMED, "zero, because V_q is DC"),
    "drive_dac_bow": Origin(ASSUMED, "INL bow as a fraction of full scale; off (B grade: 2 LSB = 3e-5)"),
    "sense_dac_bow": Origin(ASSUMED, "INL bow as a fraction of full scale; off (B grade: 1 LSB = 1e-6)"),
    "drive_dac_glitch_v_s": Origin(ASSUMED, "glitch at each border of a segment; off (typical 2e-9)"),
    "sense_dac_glitch_v_s": Origin(ASSUMED, "glitch at each border of a segment; off (typical 3.1e-9 at +-10 V)"),
    # output chains, DAC output to electrode voltage, unity gain
    "drive_pole_1_s": Origin(FITTED, "I/V stage, 5 k with its feedback capacitor; chosen to match xe1"),
    "drive_pole_2_s": Origin(FITTED, "second bipolar amplifier; chosen to match xe1"),
    "drive_pole_3_s": Origin(FITTED, "differential driver; chosen to match xe1"),
    "sense_pole_1_s": Origin(FITTED, "output resistance of the AD5791, 3.4 k, with 20 pF; chosen to match ye1"),
    "sense_pole_2_s": Origin(FITTED, "unity buffer; chosen to match ye1"),
    "sense_pole_3_s": Origin(FITTED, "differential driver; chosen to match ye1"),
    # resonator
    "mass_kg": Origin(DERIVED, "k_xy / (2 Omega w_d): the paper's k_xy is 100 deg/s of quadrature"),
    "coriolis_mass_kg": Origin(ASSUMED, "equal to the mass"),
    "fx_hz": Origin(DERIVED, "undamped drive frequency: the paper's 11 kHz, off the 26 MHz and 1 MHz grids"),
    "fy_hz": Origin(DERIVED, "below fx_hz by the paper's split: phi_y = 180 deg needs w_d > w_y"),
    "qx": Origin(FACT, "quality factor of the drive mode: the paper's lower bound"),
    "qy": Origin(FACT, "quality factor of the sense mode: the paper's lower bound"),
    "kxy_n_per_m": Origin(FITTED, "stiffness that couples x to y: the paper's model parameter, for V_q"),
    "dxy_ratio": Origin(FITTED, "damping that couples x to y, over that of x: gives a bias of the paper's size"),
    # transducer
    "k_vf_drive_n_per_v": Origin(FITTED, "force per volt, 2 Vdc dC/dx: that of the sense side"),
    "k_vf_sense_n_per_v": Origin(FITTED, "force per volt, 2 Vdc dC/dy: gives the scale factor at 25 degC"),
    "bias_v": Origin(ASSUMED, "Vdc of the push-pull force electrodes; a usual supply"),
    "kq_n_per_m_per_v2": Origin(FITTED, "k_xy per V_q^2: gives V_q at 25 degC"),
    # ring-diode C/V and its amplifiers
    "carrier_v": Origin(ASSUMED, "peak to peak at the movable plate: a CMOS oscillator of 5 V"),
    "carrier_tc_per_k": Origin(ASSUMED, "relative change of the carrier; off (a value below 0 compensates the diodes)"),
    "c0_f": Origin(ASSUMED, "pick-off capacitance at rest; typical"),
    "cp_f": Origin(ASSUMED, "stray capacitance and two diode junctions; typical"),
    "dcdx_f_per_m": Origin(FITTED, "change of capacitance with x; chosen to match the ARW in the noise budget"),
    "dcdy_f_per_m": Origin(FITTED, "change of capacitance with y; chosen to match the ARW in the noise budget"),
    "cref_drive_f": Origin(FITTED, "reference capacitors of the drive ring, time constant 200 ns; chosen to match xe2"),
    "cref_sense_f": Origin(FITTED, "reference capacitors of the sense ring, time constant 281 ns; chosen to match ye2"),
    "diode_is_a": Origin(FACT, "saturation current, HSMS-282x SPICE"),
    "diode_n": Origin(FACT, "ideality, HSMS-282x SPICE"),
    "diode_rs_ohm": Origin(FACT, "series resistance, HSMS-282x SPICE"),
    "diode_cj0_f": Origin(FACT, "junction capacitance at 0 V, HSMS-282x SPICE"),
    "diode_vj_v": Origin(FACT, "junction potential, HSMS-282x SPICE"),
    "diode_m": Origin(FACT, "grading, HSMS-282x SPICE"),
    "diode_eg_ev": Origin(FACT, "barrier height, HSMS-282x SPICE"),
    "diode_xti": Origin(FACT, "exponent of the saturation current, HSMS-282x SPICE"),
    "diode_tc_on": Origin(ASSUMED, "1: the diodes follow the temperature; 0 keeps them at temp_ref_degc"),
    "ring_saturation_on": Origin(ASSUMED, "1: the ring of diodes clips as its circuit does; 0 keeps it linear"),
    "opamp_gbw_hz": Origin(FACT, "gain-bandwidth, AD8597 vendor macro-model"),
    "amplifier_slew_v_per_s": Origin(FACT, "slew rate, AD8597 vendor macro-model; used only for the budget"),
    "amplifier_swing_v": Origin(ASSUMED, "of each output, -swing .. +swing: usual supplies of 15 V, minus 3 V"),
    "ina_noise_gain": Origin(
        FITTED, "of the instrumentation amplifier, pole at GBW / gain; with Cref to match xe2, ye2"
    ),
    "driver_noise_gain": Origin(FITTED, "of the inverting unity driver; with Cref to match xe2 and ye2"),
    "signal_gain": Origin(DERIVED, "ring diode to SID input: gain of the amplifiers; a gain of 10 would clip the ADC"),
    # synchronous integral demodulator
    "sid_r_ohm": Origin(FITTED, "triple pole at 1/(4 pi R C) = 50 Hz: chosen to match the bandwidth"),
    "sid_c_f": Origin(FITTED, "triple pole at 1/(4 pi R C) = 50 Hz: chosen to match the bandwidth"),
    "sid_switch_s": Origin(FITTED, "FPGA pin to analog switch; chosen to match ye2 minus xe2"),
    "sid_fall_s": Origin(ASSUMED, "extra delay of a switch at a falling edge over a rising edge; assumed zero"),
    "sid_charge_c": Origin(ASSUMED, "charge injected at each edge of a switch; typical of small analog switches"),
    "sid_charge_mismatch": Origin(ASSUMED, "mismatch of the charge between the two halves; typical"),
    "sid_charge_tc_per_k": Origin(ASSUMED, "relative change of the charge, follows the switch's logic swing; off"),
    "sid_leakage_a": Origin(ASSUMED, "leakage of open switches, difference of the two halves, doubles in 10 K; off"),
    # converters
    "adc_vref_v": Origin(FACT, "ADS1298, internal reference"),
    "adc_pga_drive": Origin(DERIVED, "gain of the drive channels: 2.88 V of 4 V"),
    "adc_pga_sense": Origin(DERIVED, "gain of the sense channels: the largest, because y is nulled"),
    "adc_decimation": Origin(ASSUMED, "length of the sinc3 in samples of the modulator; from memory of the data sheet"),
    "adc_modulator_hz": Origin(ASSUMED, "high-resolution mode, f_CLK / 4; from memory of the data sheet"),
    "adc_delay_s": Origin(ASSUMED, "from the last modulator sample to DRDY; zero beyond the filter"),
    "adc_step_code": Origin(FACT, "codes move in steps of ten at 8 kSPS"),
    "adc_noise_drive_v": Origin(ASSUMED, "rms at the input, PGA 1; from memory of the data sheet"),
    "adc_noise_sense_v": Origin(ASSUMED, "rms at the input, PGA 12; from memory of the data sheet"),
    "sar_span_v": Origin(ASSUMED, "board without analog SID: -span .. +span"),
    # noise densities, one-sided
    "cv_noise_v_per_rthz": Origin(FITTED, "noise at the ring diode, before signal_gain and folding: gives the ARW"),
    "carrier_noise_v_per_rthz": Origin(ASSUMED, "noise of the carrier at an offset of the drive frequency; off"),
    "ring_noise_on": Origin(ASSUMED, "1 adds the noise of the four diodes; off"),
    "cv_resistor_ohm": Origin(ASSUMED, "its Johnson noise is at the ring's output; off"),
    "ina_voltage_noise_v_per_rthz": Origin(ASSUMED, "of each of two inputs; off (data sheet, from memory: 1.07e-9)"),
    "ina_current_noise_a_per_rthz": Origin(ASSUMED, "of each of two inputs; off (data sheet, from memory: 1.9e-12)"),
    "ina_bias_exponent": Origin(ASSUMED, "collector current as a power of T: 1 is proportional to T"),
    "ina_beta_exponent": Origin(ASSUMED, "current gain as a power of T: XTB of SPICE, 1.5 to 2"),
    "c0_imbalance_f": Origin(ASSUMED, "half the difference of a pick-off's capacitances at rest; off"),
    "sid_flicker_v_per_rthz": Origin(
        FITTED, "behind the SID, before the PGA, at 1 Hz; chosen to match the bias instability"
    ),
    "sid_flicker_exponent": Origin(ASSUMED, "that density as a power of T; off"),
    "drive_dac_noise_v_per_rthz": Origin(ASSUMED, "from memory of the data sheet, 12 to 18 nV/rtHz"),
    "sense_dac_noise_v_per_rthz": Origin(FACT, "AD5791"),
    # temperature
    "temp_ref_degc": Origin(ASSUMED, "temperature at which the values above hold"),
    "tcf_per_k": Origin(ASSUMED, "relative change of fx and fy: half the change of silicon's stiffness; from memory"),
    "dlnq_per_k": Origin(ASSUMED, "relative change of Q: within the published range of up to 1 %/K"),
    "kxy_tc_below_per_k": Origin(FITTED, "relative change of k_xy below temp_ref_degc: gives V_q at -20 degC"),
    "kxy_tc_above_per_k": Origin(FITTED, "relative change of k_xy above temp_ref_degc: gives V_q at 50 degC"),
    "opamp_gbw_tc_per_k": Origin(ASSUMED, "the transconductance of a bipolar input falls with temperature"),
    "dac_rc_tc_per_k": Origin(ASSUMED, "change of output poles with resistor and capacitor; off (1e-4 to 3e-4)"),
    "dac_amplifier_tc_on": Origin(ASSUMED, "1: output poles 2 and 3 are amplifiers, proportional to 1/GBW; off"),
    "sid_rc_tc_per_k": Origin(ASSUMED, "relative change of the demodulator's resistors; off"),
    "self_heating_k": Origin(ASSUMED, "final rise of the package over ambient; off"),
    "warm_up_tau_s": Origin(ASSUMED, "time constant of the package, 300 to 900 s"),
}

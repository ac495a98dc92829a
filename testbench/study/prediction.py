"""What word lengths do to a gyroscope, from its configuration alone: the closed form that the study holds runs against.

    rate word W     spectrum S = sum of |H|^2 times the density of each source, H of the linear loop (paper/loop)
    ADC             q^2/12 a conversion, 2 q^2/12/f_frame one-sided;  q = step_code
    force DAC       4 D^2/12/f_tick in phase, and the in-phase error of a rounded sine (`rounding`);  D in LSB of W
    sine            force per word: (1 - 2^(1-b)) sinc(1/M)^2 sinc(2^-P);  M = 2^(a+2), P = 2 + a + f;  scale is 1/that
    lines           chord 1/(M k)^2 at M k +- 1;  phase 2^-P/k at 2^P k +- 1;  rounding (`rounding`)
    loop gains      kp and ki as rounded: bandwidth
    rule            holds where the input noise of ADC, force DAC and frequency word is 0.4 LSB or more of each

ARW = 60 sqrt(S/2), S the mean over BAND_HZ; noise is the rms of W; both with the loop's own response.
Source    docs/word_lengths.md
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from analog_frontend.parts import adc
from fpga_model import cordic
from fpga_model.design_record import DEFAULT
from testbench.engines import chips
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import RAW_GAIN, loop_parameters
from testbench.run import build
from testbench.study import rounding

RULE_LSB = 0.4
BAND_HZ = 0.5, 5.0
TAU_S = 10.0
LAGS = 4000
FRAME_S = 1 / DEFAULT.frame_hz
GRID_HZ = np.concatenate([np.arange(0.05, 300.0, 0.1), np.arange(300.0, 4000.0, 4.0)])
INPUTS = (lp.RATE, lp.OFFSET_SIN, lp.OFFSET_COS)


class Prediction(NamedTuple):
    """Of a design; rates in deg/s, words of 24 bits in LSB."""

    holds: bool  # the rule
    adc_input_lsb: float  # input noise of each quantiser, by its step
    dac_input_lsb: float
    dds_input_lsb: float
    arw_deg_per_rt_h: float
    noise_lsb: float  # rms of the rate word
    adev_deg_per_h: float  # Allan deviation at TAU_S: white noise and flicker
    bias_dps: float
    scale_lsb_per_dps: float
    quadrature_dps: float  # residual: half a step of the ADC where no noise dithers it
    code_per_dps: float  # residual rate at the ADC, loop open
    bandwidth_hz: float
    spur_harmonic: int  # of the drive DAC's codes
    spur_dbc: float


def parameters_with_table_gain(config):
    """`LoopParameters` of a configuration, with the force that the sine's table leaves of a word."""
    p = loop_parameters(config)
    return p._replace(volts_per_word=p.volts_per_word * table_gain(config.design))


def table_gain(design):
    """Fundamental of the sine by its last code: chords below the arc, cells of phase."""
    row = 2.0 ** -(2 + design.sine_address_bits)
    return float(np.sinc(row) ** 2 * np.sinc(row * 2.0**-design.sine_fraction_bits))


class Word(NamedTuple):
    """Spectrum of the rate word without the force DAC's rounding, on GRID_HZ, and the loop's response to a rate."""

    density: np.ndarray  # LSB^2/Hz, one-sided
    per_dps: np.ndarray  # |word per deg/s|
    flicker: np.ndarray  # part of `density`

    def mean(self, values):
        """Mean over BAND_HZ of values on the grid."""
        return float(np.mean(values[(GRID_HZ >= BAND_HZ[0]) & (GRID_HZ <= BAND_HZ[1])]))


def word_spectrum(p, loop):
    """`Word` of the linear loop: all sources of noise, and the ADC's rounding."""
    z = np.exp(2j * math.pi * GRID_HZ * FRAME_S)
    row_resolvent = lp.resolvent(loop.a.T, z, loop.row)
    rate, by_sin, by_cos = (np.abs(row_resolvent @ loop.b[:, column]) ** 2 for column in INPUTS)
    # what a conversion adds behind the filter reaches word and V_q at once
    code_sin, code_cos = np.zeros(len(loop.a)), np.zeros(len(loop.a))
    code_sin[lp.ACC], code_sin[lp.WORD] = p.word_ki, p.word_ki + p.word_kp
    code_cos[lp.U] = -p.u_ki
    per_code = np.abs(row_resolvent @ code_sin) ** 2 + np.abs(row_resolvent @ code_cos) ** 2
    per_volt = (by_sin + by_cos) / (1 + (GRID_HZ / p.sid_hz) ** 2) ** p.sid_stages
    a_frame = 2 * FRAME_S
    flicker = per_code * (p.flicker_v_per_rthz * p.code_per_v) ** 2 / GRID_HZ
    coriolis = 2 * p.coriolis_mass_kg * p.w_rad_s * p.amplitude_m
    lsb = advisor.dc_gain(loop)
    density = (
        flicker
        + per_code * ((p.adc_noise_v * p.code_per_v) ** 2 + p.step_code**2 / 12) * a_frame
        + per_volt * (2 * p.cv_noise_v_per_rthz) ** 2
        + rate * 2 * (p.force_noise_n_per_rthz / coriolis) ** 2
        + rate * 2 * (p.dac_noise_v_per_rthz / (p.volts_per_word * lsb)) ** 2
    )
    return Word(density, np.sqrt(rate) * lp.DEG, flicker)


@functools.lru_cache(maxsize=1)
def _cosines(lags):
    return np.cos(2 * math.pi * FRAME_S * np.outer(np.arange(lags), GRID_HZ))


def covariance(density, lags=LAGS):
    """Autocovariance at whole frames of a one-sided density on GRID_HZ."""
    return _cosines(lags) @ (density * np.gradient(GRID_HZ))


def drive_noise_codes(config):
    """Rms (codes) of the drive's converter before it rounds."""
    d = config.device()
    return d.adc_noise_drive_v * d.adc_pga_drive / d.adc_vref_v * adc.FULL_CODE * config.noise.adc


def drive_word(config, p):
    """(amplitude, rms) of the drive's amplitude word (LSB of 24 bits): damping of the drive mode, noise of its ADC."""
    d = config.device()
    volts = d.mass_kg * p.w_rad_s**2 * p.amplitude_m / d.qx / d.k_vf_drive_n_per_v
    code = math.hypot(drive_noise_codes(config), d.adc_step_code / 12**0.5)
    kp = build.firmware(config).control.agc.loop.kp / RAW_GAIN
    return volts / d.drive_dac_span_v * 2**23, kp * float(cordic.gain(config.design.cordic_iterations)) * code


def largest_spur(config, p):
    """(harmonic, dBc) of the largest line in the codes of the drive DAC beside the carrier."""
    d, lsb = config.design, 2.0 ** (24 - chips.dac_chips(config.design).drive.bits)
    amplitude, rms = (word / lsb for word in drive_word(config, p))
    n, size = rounding.rounding_harmonics(amplitude, rms)
    power = dict(zip(n.tolist(), ((size / amplitude) ** 2).tolist()))
    rows, cells = 2 ** (d.sine_address_bits + 2), 2 ** (2 + d.sine_address_bits + d.sine_fraction_bits)
    full = 2.0 ** (d.sine_bits - 1)
    more = [(k * rows + side, 1 / (rows * k) ** 2) for k in (1, 2, 3) for side in (-1, 1)]
    more += [(k * cells + side, 1 / (cells * k)) for k in (1, 2, 3) for side in (-1, 1)]
    more += [(round(2 * math.pi * full) | 1, rounding.largest_line(full))]
    for harmonic, level in more:
        power[harmonic] = power.get(harmonic, 0.0) + level**2
    top = max(power, key=power.get)
    return top, 10 * math.log10(power[top])


def dds_input_lsb(config):
    """Noise of the frequency word that its loop passes at once, by its LSB: of the drive's converter, as phase."""
    n = build.nominal(config)
    signal = config.firmware.amplitude_um * n["v_per_um"] / n["adc_drive_v"] * adc.FULL_CODE
    turns = math.hypot(drive_noise_codes(config), config.device().adc_step_code / 12**0.5) / signal / (2 * math.pi)
    return build.firmware(config).control.frequency_tracker.loop.kp / RAW_GAIN * turns * 2**cordic.PHASE.f


def predict(config):
    """`Prediction` of a configuration."""
    p = parameters_with_table_gain(config)
    loop = lp.close(p)
    word, lsb = word_spectrum(p, loop), advisor.dc_gain(loop) * lp.DEG
    still = lp.steady_state(loop, (p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg), p.kxy_n_per_m, *p.sid_offset_v))
    dac_lsb = p.dac_lsb_v / config.device().sense_dac_span_v * 2**23
    bias_word, word_covariance = float(still[lp.WORD_BEFORE]), covariance(word.density)
    spread = word_covariance / dac_lsb**2
    rms = math.sqrt(spread[0])
    error = rounding.in_phase_error(bias_word / dac_lsb, rms) * dac_lsb
    rounded = 4 / 12 / p.tick_hz + rounding.error_density(bias_word / dac_lsb, spread, FRAME_S)
    density = word.density + rounded * dac_lsb**2 * (word.per_dps / lsb) ** 2
    passed_hz = math.pi / 2 * p.sid_hz * 3 / 8
    at_sense = math.hypot(p.adc_noise_v, 2 * p.cv_noise_v_per_rthz * math.sqrt(passed_hz)) * p.code_per_v
    adc_input = min(at_sense, drive_noise_codes(config)) / p.step_code
    dds_input = dds_input_lsb(config)
    harmonic, spur = largest_spur(config, p)
    opened = lp.close(p, 0.0, 0.0)
    per_dps = float(
        abs((opened.codes @ lp.steady_state(opened, (lp.DEG, 0, 0, 0)) + opened.codes_b[:, lp.RATE] * lp.DEG)[0])
    )
    # 2 ln 2 h for flicker of density h/f, S/2 tau for white noise of density S; both at the low end of the grid
    allan = 2 * math.log(2) * word.flicker[0] * GRID_HZ[0] + (density - word.flicker)[0] / 2 / TAU_S
    return Prediction(
        holds=bool(min(adc_input, rms, dds_input) >= RULE_LSB),
        adc_input_lsb=adc_input,
        dac_input_lsb=rms,
        dds_input_lsb=dds_input,
        arw_deg_per_rt_h=60 * math.sqrt(word.mean(density) / 2) / lsb,
        noise_lsb=math.sqrt(float(np.sum(density * np.gradient(GRID_HZ)))),
        adev_deg_per_h=3600 * math.sqrt(allan) / lsb,
        bias_dps=(bias_word - error) / lsb,
        scale_lsb_per_dps=lsb,
        quadrature_dps=0.0 if adc_input >= RULE_LSB else p.step_code / 2 / per_dps,
        code_per_dps=per_dps,
        bandwidth_hz=advisor.bandwidth(loop)[0],
        spur_harmonic=int(harmonic),
        spur_dbc=spur,
    )

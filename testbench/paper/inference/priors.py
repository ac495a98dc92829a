"""What is assumed of the paper's board before any of its numbers is seen: one table, each row with its reason.

    continuous   a number z with a standard normal prior; normal: lo + hi are its 5 % and 95 %; lognormal: of ln(value)
    discrete     modes, each with its choices; a choice is as probable as any other of its mode

Reasons are data sheets, physics and what a part must do to work. None is a number of a fitted row.
Source    docs/inference.md
"""

import math
from typing import NamedTuple

import numpy as np

QUANTILE = 1.6448536269514722  # of 95 %


class Prior(NamedTuple):
    """One assumed number: 5 % and 95 % of its prior."""

    name: str
    unit: str
    law: str
    lo: float
    hi: float
    why: str

    def value(self, z):
        """The number of z; shapes follow z."""
        if self.law == "lognormal":
            low, high = math.log(self.lo), math.log(self.hi)
            return np.exp((low + high) / 2 + z * (high - low) / (2 * QUANTILE))
        return (self.lo + self.hi) / 2 + z * (self.hi - self.lo) / (2 * QUANTILE)


LOG, NORMAL = "lognormal", "normal"
PRIORS = (
    Prior("drive_pole_1_s", "s", LOG, 40e-9, 170e-9, "I/V stage of DAC8811: 5 k with 10 to 30 pF, settling 0.5 us"),
    Prior("drive_pole_2_s", "s", LOG, 20e-9, 60e-9, "second amplifier of a bipolar output, GBW 10 MHz"),
    Prior("drive_pole_3_s", "s", LOG, 20e-9, 60e-9, "differential driver"),
    Prior("sense_pole_1_s", "s", LOG, 34e-9, 170e-9, "AD5791: 3.4 k with 10 to 50 pF"),
    Prior("sense_pole_2_s", "s", LOG, 11e-9, 32e-9, "unity buffer, GBW 5 to 14 MHz"),
    Prior("sense_pole_3_s", "s", LOG, 20e-9, 60e-9, "differential driver"),
    Prior("sense_dac_delay_s", "s", LOG, 80e-9, 180e-9, "AD5791: LDAC to output, 130 ns typical"),
    Prior("cref_f", "F", LOG, 25e-12, 85e-12, "standard capacitors: carrier ripple below, bandwidth above"),
    Prior("cref_ratio", "1", NORMAL, -0.116, 0.116, "ratio of sense to drive minus 1: the same part, 5 % each"),
    Prior("opamp_gbw_hz", "Hz", LOG, 8.2e6, 12.4e6, "AD8597: 10.3 MHz in its model, 20 %"),
    Prior("sid_switch_s", "s", LOG, 60e-9, 150e-9, "analog switch: turn-on of its class"),
    Prior("fx_hz", "Hz", NORMAL, 10750.0, 11250.0, "the text says 11 kHz"),
    Prior("amplitude_um", "um", LOG, 2.0, 10.0, "comb drives of this size"),
    Prior(
        "pickoff_v",
        "V",
        LOG,
        0.03,
        0.12,
        "x at the ring: above its noise, below 0.14 V, where the warm ring loses 1 %",
    ),
    Prior(
        "sense_pickoff_ratio",
        "1",
        LOG,
        1.0,
        10.0,
        "dC/dy over dC/dx: closing over sliding combs, the ratio of overlap to gap",
    ),
    Prior("full_scale_dps", "deg/s", LOG, 550.0, 2000.0, "tested to 500 deg/s; usual margin from 10 % to 4 times"),
    Prior("quadrature_dps", "deg/s", LOG, 20.0, 400.0, "published two-mass devices"),
    Prior("v_q_null_v", "V", LOG, 2.0, 5.3, "quadrature must be within the DAC's 5.5 V"),
    Prior("kxy_tc_below_per_k", "1/K", NORMAL, -0.008, 0.008, "stress: 10 ppm of the stiffness over the range"),
    Prior("kxy_tc_above_per_k", "1/K", NORMAL, -0.008, 0.008, "the same above 25 degC"),
    Prior("carrier_v", "V", LOG, 3.0, 5.5, "HCMOS oscillator at 3.3 or 5 V"),
    Prior(
        "carrier_tc_error_per_k",
        "1/K",
        NORMAL,
        -1e-4,
        1e-4,
        "error of a compensated carrier: a sixth of the diodes' drift",
    ),
    Prior("cv_resistor_ohm", "ohm", LOG, 1.5e3, 40e3, "bias and gain resistors of the C/V channel: 5 to 26 nV"),
    Prior("ina_current_noise_a_per_rthz", "A/rtHz", LOG, 1.3e-12, 2.8e-12, "AD8597: 1.9 pA typical"),
    Prior("ina_bias_exponent", "1", NORMAL, 0.0, 1.5, "collector current: constant, or as T"),
    Prior("ina_beta_exponent", "1", NORMAL, 1.2, 2.0, "current gain of bipolars, XTB of SPICE"),
    Prior("adc_noise_sense_v", "V", LOG, 1.3e-6, 2.5e-6, "ADS1298 at PGA 12: 1.8 uV typical"),
    Prior("sid_flicker_v_per_rthz", "V/rtHz", LOG, 10e-9, 200e-9, "bipolar amplifiers at 10 k: corner 10 to 50 Hz"),
    Prior("sid_flicker_exponent", "1", NORMAL, -2.0, 2.0, "no derived law"),
    Prior("damping_dps", "deg/s", NORMAL, -0.5, 0.5, "misaligned damping axes: a few per cent of 5 to 10 deg/s"),
    Prior(
        "offset_dps",
        "deg/s",
        NORMAL,
        -2.0,
        2.0,
        "charge injection of analog switches: 1 pC, 10 % mismatch, at such a pickoff",
    ),
    Prior("sid_charge_tc_per_k", "1/K", NORMAL, -2e-3, 2e-3, "logic swing of a CMOS switch"),
    Prior("leakage_dps", "deg/s", NORMAL, -0.3, 0.3, "leakage of open analog switches: 0.1 nA at 25 degC, not matched"),
    Prior("q", "1", LOG, 2e5, 4e5, "the text says above 200000"),
    Prior("dlnq_per_k", "1/K", NORMAL, -0.009, -0.001, "thermoelastic or gas damping, up to 1 %/K"),
    Prior("opamp_gbw_tc_per_k", "1/K", NORMAL, -0.003, -0.001, "bipolar transconductance as 1/T"),
    Prior("dac_rc_tc_per_k", "1/K", NORMAL, -1e-4, 3e-4, "resistors and C0G capacitors"),
    Prior("tcf_per_k", "1/K", NORMAL, -33e-6, -21e-6, "Young's modulus of silicon"),
)
NAMES = tuple(p.name for p in PRIORS)


def board_numbers(z):
    """{name: array} of the numbers; z (..., len(PRIORS))."""
    return {p.name: p.value(z[..., k]) for k, p in enumerate(PRIORS)}


class Choice(NamedTuple):
    """One discrete assumption."""

    name: str
    choices: tuple
    why: str


CHOICES = (
    Choice("net_registers", tuple(range(-2, 9)), "registers of the signal minus those of the reference"),
    Choice("reference_retimed", (0, 1), "references on the 26 MHz clock, or on the grid of the DAC's updates"),
    Choice("frame_latency_drive", (0, 1), "frames of 1 us by which a drive code is delayed"),
    Choice("frame_latency_sense", (0, 1), "frames of 1 us by which a sense code is delayed"),
    Choice("ye2_at_pin", (0, 1), "the printed ye2 ends at the demodulator, or at the switch's pin"),
    Choice("carrier_compensated", (0, 1), "the carrier is constant, or it falls with the diodes' drop"),
    Choice(
        "response_in_pole",
        (0, 1),
        "the DAC's response comes before the settling of its pole, or is part of it",
    ),
)


def modes():
    """{name: array} of every combination of the choices, and how many there are."""
    grids = np.meshgrid(*(np.array(c.choices) for c in CHOICES), indexing="ij")
    return {c.name: g.ravel() for c, g in zip(CHOICES, grids)}, grids[0].size

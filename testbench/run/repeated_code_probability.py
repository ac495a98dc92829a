"""How surely a frozen converter is told from a quiet one: how often noise alone repeats a code.

    p        two samples of the noise fall on one step of the converter, at the offset at which that is likeliest
    p_any    one of the converter's channels repeats
    alarm    p_any ** repeats: every repetition of a debounce is such a one, though no channel is frozen

The firmware's check of a board is on where `alarm` is below LIMIT. Noise that is the same for some ticks counts once.
Source    fpga_model/fault_monitor.py, fpga_model/digital_sid.py, docs/decisions/0016-frozen-channels.md
"""

import itertools
import math

from analog_frontend.parts import noise
from analog_frontend.parts.cv_noise import cv_density
from fpga_model import digital_sid, fault_monitor

LIMIT = 1e-12  # of a false alarm, per frame: one in four years
FULL_CODE = 1 << 23
SAR_CODES = 1 << 17


def repeats(sigma_steps):
    """Probability that two samples of a Gaussian rms `sigma_steps`, centred on a step, fall on one step."""
    if not sigma_steps > 0.0:
        return 1.0
    if sigma_steps > 5.0:
        return 1.0 / (2.0 * math.sqrt(math.pi) * sigma_steps)
    gaussian_cdf = [0.5 * (1.0 + math.erf((k - 0.5) / (sigma_steps * math.sqrt(2.0)))) for k in range(-40, 42)]
    return sum((b - a) ** 2 for a, b in itertools.pairwise(gaussian_cdf))


def adc_repeats(config):
    """`repeats` of the four codes of the ADC, in the order of the firmware."""
    d = config.device()
    pairs = ((d.adc_noise_drive_v, d.adc_pga_drive), (d.adc_noise_sense_v, d.adc_pga_sense))
    step_v = d.adc_step_code * d.adc_vref_v / FULL_CODE
    drive, sense = (repeats(volts * pga / step_v if config.noise.adc else 0.0) for volts, pga in pairs)
    return drive, drive, sense, sense


def sar_repeats(config):
    """`repeats` of both samples of the board without the analog SID, from one sample of the noise to the next."""
    d = config.device()
    density = cv_density(d, d.temp_ref_degc) * abs(d.signal_gain) if config.noise.cv else 0.0
    sigma_v = noise.sigma_demodulated(density, d.fx_hz, 1 / config.design_record().tick_hz)
    return (repeats(sigma_v * SAR_CODES / d.sar_span_v),) * 2


def alarm(channels, times):
    """Probability that `times` frames in a row each repeat some channel, none of which is frozen."""
    return (1.0 - math.prod(1.0 - p for p in channels)) ** times


def adc_alarm(config):
    """`alarm` of STUCK, per frame."""
    return alarm(adc_repeats(config), fault_monitor.design().stuck)


def sar_alarm(config):
    """`alarm` of samples at rest, per new sample of the noise."""
    return alarm(sar_repeats(config), digital_sid.STILL_TICKS // noise.HOLD)

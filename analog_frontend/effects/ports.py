"""Where an effect may enter the plant, and what each effect must say about itself.

Source  docs/effects.md
"""

from typing import NamedTuple

# name, unit of what is added or changed there, how the engine applies it
PORTS = (
    ("force_x", "N", "velocity impulse on z[7] before the linear step of a tick"),
    ("force_y", "N", "velocity impulse on z[9] before the linear step of a tick"),
    ("coupling", "N/m", "added to kappa, which is constant over a tick"),
    ("cv_x", "V", "added at the input of both drive SIDs, constant over a tick"),
    ("cv_y", "V", "added at the input of both sense SIDs, constant over a tick"),
    ("demod_drive_sin", "V", "added to a SID output, or its own sid.Params (RC, charge)"),
    ("demod_drive_cos", "V", "as above"),
    ("demod_sense_sin", "V", "as above"),
    ("demod_sense_cos", "V", "as above"),
    ("dac_drive", "V", "added to the held voltage from its take-effect instant on; glitch: impulse column"),
    ("dac_sense", "V", "as above"),
    ("dac_quad", "V", "as above"),
    ("adc_0", "V", "added at the converter's input before a tick's chord; offset, gain, bend in adc.Params"),
    ("adc_1", "V", "as above"),
    ("adc_2", "V", "as above"),
    ("adc_3", "V", "as above"),
    ("adc_temp", "V", "as above"),
    ("clock_master", "s", "period of the master clock: plant rebuilt when it changes"),
    ("clock_adc", "s", "modulator period, an integer of 1/2^32 cycle"),
    ("clock_carrier", "Hz", "changes the C/V gain and delay: plant rebuilt"),
    ("ref_edge", "s", "added to the instant of a reference edge at the switch"),
    ("temperature", "degC", "thermal.py: every law of temperature reads this"),
)
FORCE_PORTS = ("force_x", "force_y")
CV_PORTS = ("cv_x", "cv_y")
NAMES = tuple(name for name, _, _ in PORTS)
MECHANISMS = ("gain", "offset", "delay", "pole", "polynomial", "leak", "tone", "drift", "saturation", "noise")


class Info(NamedTuple):
    """What an effect says about itself; the catalogue is made of these."""

    name: str
    port: str
    mechanism: str
    unit: str
    source: str
    fingerprint: str

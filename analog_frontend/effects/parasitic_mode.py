"""A third mode that the rebalance electrodes drive and the sense pick-offs see: both masses of a pair in phase.

    y3 = p k_vf w / (m (w3^2 - w_d^2))      p: share of force and motion that does not cancel between the masses
    n_y += S y3, S the C/V gain (V/m).  Coriolis forces of the two masses cancel in it
    quasi-static: its pole in the baseband, MODE_HZ - f_d, is 60 times above the demodulator's

With y nulled the rebalance force is larger by p r, r = (f_d^2 - f_y^2)/(f_3^2 - f_d^2) = 0.0405: +405 ppm for p = 0.01.
plant.k_vf_sense_n_per_v absorbs it unless rate or split change. Vibration near f_d has no input.
"""

import math

from analog_frontend.effects.ports import Info
from analog_frontend.parts import propagator

MODE_HZ = 14e3  # A

INFO = Info(
    name="parasitic_mode",
    port="cv_y",
    mechanism="leak from force_y",
    unit="1",
    source="in-phase mode of a dual-mass gyroscope, frequency assumed",
    fingerprint="scale factor changes by p times the mode split over the distance to the mode; no change at rest",
)
IDS, LIMIT, EXAMPLE, SIGN = "E28", 1.0, 0.01, 0
DOC = "in-phase mode at 14 kHz: share of rebalance force and sense motion that is common to both masses"
PHYSICS = (0.0, 1.0, "a mode above the drive frequency has a positive compliance; a share is below 1")


def terms(value, device):
    """Laws of a share p."""
    per_m, _ = propagator.cv_chain(device, "sense", device.temp_ref_degc)
    stiffness = 4 * math.pi**2 * device.mass_kg * (MODE_HZ**2 - device.fx_hz**2)
    return (f"cv_y = {value * device.signal_gain * per_m * device.k_vf_sense_n_per_v / stiffness!r} w",)

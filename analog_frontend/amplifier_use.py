"""What amplifiers are asked for, as parts of their swing and of their slew rate; the plant simulates neither.

    C/V amplifier, driver   V at drive amplitude A: signal_gain G A; where the ring saturates its steady output at dC(A)
                            slope at the zero of the sine, where no ring clips: w signal_gain G A
    output chains           a sine of V, new every T, through the pole tau in front: q = e^(-T/tau)
                            slope behind an update: V 2 sin(w T/2)/(tau sqrt(1 - 2 q cos(w T) + q^2)) at most

Amplifiers behind that pole only average: none is steeper. A use above 1 is one that the plant does not follow; a run
warns and goes on. The sense outputs are taken at full scale, the drive outputs at the kick or the ceiling, and at lock.
Limits    plant.amplifier_slew_v_per_s (14.8e6, a fact) and plant.amplifier_swing_v (12, assumed) hold for every
          amplifier at every temperature
Steps     of 10 V, at power-on and both ends of the kick, ask for 6.76 times the slew rate. A real amplifier slews for
          0.68 us and loses 0.0064 % of the kick's area; no warning counts them
Source    docs/plant.md
"""

import math
from typing import NamedTuple

from analog_frontend import ring_tables
from analog_frontend.parts import propagator, ring_cycle


class Use(NamedTuple):
    """An amplifier at work: largest voltage and slope, and both over what the amplifier gives."""

    where: str
    peak_v: float
    slope_v_per_s: float
    swing_use: float
    slew_use: float


def use(device, where, peak_v, slope_v_per_s):
    """`Use` of a voltage (V) and a slope (V/s) by the amplifiers of a Device."""
    swing, slew = peak_v / device.amplifier_swing_v, slope_v_per_s / device.amplifier_slew_v_per_s
    return Use(where, peak_v, slope_v_per_s, swing, slew)


def pickoff(device, temp_degc, amplitude_m, f_hz):
    """Use of the drive's C/V amplifier and driver at a drive amplitude (m) and a frequency (Hz)."""
    gain, _ = propagator.cv_chain(device, "drive", temp_degc)
    linear_v = abs(device.signal_gain * gain) * amplitude_m
    peak_v = linear_v
    if device.ring_saturation_on:
        dc_f = abs(device.dcdx_f_per_m) * amplitude_m
        steady = ring_cycle.steady_state(ring_tables.circuit(device, "drive", temp_degc), dc_f)
        peak_v = abs(device.signal_gain * steady.volts)
    return use(device, "C/V amplifier and driver", peak_v, 2 * math.pi * f_hz * linear_v)


def output(device, where, peak_v, tau_s, f_hz, tick_s):
    """Use of the amplifiers behind a pole (s) by a sine of `peak_v` (V) that a DAC updates every `tick_s`."""
    q, angle = math.exp(-tick_s / tau_s), 2 * math.pi * f_hz * tick_s
    denominator_magnitude = math.sqrt((1 - q) ** 2 + 4 * q * math.sin(angle / 2) ** 2)
    return use(device, where, peak_v, peak_v * 2 * abs(math.sin(angle / 2)) / (tau_s * denominator_magnitude))


def sentence(uses):
    """What all amplifiers are asked for, in one line."""
    swing_slew_text = "; ".join(f"{u.where} {100 * u.swing_use:.3g} and {100 * u.slew_use:.3g} %" for u in uses)
    return f"Use of amplifier swing and slew rate (the plant simulates neither limit): {swing_slew_text}."


def warnings(uses):
    """Lines: which amplifier is asked for more than it has."""
    for u in uses:
        for part, demand, unit, key in (
            (u.swing_use, u.peak_v, "V", "amplifier_swing_v"),
            (u.slew_use, u.slope_v_per_s, "V/s", "amplifier_slew_v_per_s"),
        ):
            if part > 1:
                yield (
                    f"{u.where}: {demand:.3g} {unit} is {part:.3g} times plant.{key} = {demand / part:.3g} {unit}; "
                    "the plant does not clip or slew there"
                )

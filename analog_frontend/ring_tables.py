"""Tables of ring_saturation.py, from the integrated ring: cubics through values and slopes at its points.

Source    analog_frontend/parts/ring_cycle.py
"""

import numpy as np

from analog_frontend.parts import ring_cycle, ring_diode
from analog_frontend.ring_saturation import INTERVALS, OFF, Params

STEP_K = 2.5  # between tables; a straight line over it errs by 2e-4 of the voltage
CHANNELS = ("drive", "sense")


def design(device, temp_lo_degc, temp_hi_degc, tick_s):
    """`Params` of a Device (as it is at temp_ref) for a range of temperatures; OFF where ring_saturation_on is 0."""
    if not device.ring_saturation_on:
        return OFF
    if temp_lo_degc == temp_hi_degc:
        temps = [temp_lo_degc]
    else:
        first = np.floor((temp_lo_degc - device.temp_ref_degc) / STEP_K)
        last = max(np.ceil((temp_hi_degc - device.temp_ref_degc) / STEP_K), first + 1)
        temps = [device.temp_ref_degc + STEP_K * k for k in range(int(first), int(last) + 1)]
    temperature_tables = [[_cubics(device, channel, temp, tick_s) for channel in CHANNELS] for temp in temps]
    per_v, cubics = (np.array([[one[k] for one in row] for row in temperature_tables]) for k in range(2))
    return Params(1, float(temps[0]), STEP_K, len(temps), per_v, cubics)


def circuit(device, channel, temp_degc):
    """`ring_cycle.Circuit` of a channel of a Device."""
    return ring_cycle.circuit(*ring_diode.arguments(device, channel, temp_degc))


def _cubics(device, channel, temp_degc, tick_s):
    """Intervals per volt and cubics of a channel at a temperature."""
    ring = ring_diode.diode_ring(*ring_diode.arguments(device, channel, temp_degc))
    curve = ring_cycle.curve(circuit(device, channel, temp_degc), INTERVALS)
    gain = abs(device.signal_gain)
    h, lag = curve.step_f, curve.slope_v_s_per_f
    bend = np.concatenate([[0.0], (lag[2:] - lag[:-2]) / 2, [lag[-1] - lag[-2]]])  # L' times the interval
    area = np.concatenate([[0.0], np.cumsum(h * ((lag[1:] + lag[:-1]) / 2 + (bend[:-1] - bend[1:]) / 12))])
    linear = ring.gain_v_per_f * h
    static = gain * (curve.volts - linear * np.arange(INTERVALS + 1))
    moving = gain / tick_s * (ring.tau_s * curve.volts - area)
    slopes = gain * (h * curve.volts_per_f - linear), gain / tick_s * h * (ring.tau_s * curve.volts_per_f - lag)
    return 1.0 / (gain * linear), np.hstack([_hermite(static, slopes[0]), _hermite(moving, slopes[1])])


def _hermite(values, slopes):
    """Cubic of each interval, and the line beyond, from values and slopes per interval: (INTERVALS + 1, 4)."""
    a, b, da, db = values[:-1], values[1:], slopes[:-1], slopes[1:]
    rows = np.stack([a, da, 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db], axis=1)
    return np.vstack([rows, [values[-1], slopes[-1], 0.0, 0.0]])

"""Levels of a ring that saturates: where it leaves 1 %, which amplitude gives a signal, delay at an amplitude.

Each takes a Device as it is at temp_ref, and a temperature.
Source    analog_frontend/parts/ring_diode.py
"""

import functools

from analog_frontend import ring_tables
from analog_frontend.parts import ring_cycle, ring_diode

SMALL_F = 1e-15
MOST_C0_SHARE = 0.98
ROUNDS = 24  # of the search: 1e-7 of the amplitude


def limit_m(device, temp_degc):
    """Drive amplitude (m) at which the ring's gain has lost 1 %; a closed form, within 8 %."""
    return ring_diode.limit_f(*ring_diode.arguments(device, "drive", temp_degc)) / abs(device.dcdx_f_per_m)


def demodulated_v_per_m(device, temp_degc, amplitude_m):
    """Gain (V/m) of the drive's ring as a square-wave demodulator sees it at an amplitude."""
    circuit, slope = ring_tables.circuit(device, "drive", temp_degc), device.dcdx_f_per_m
    return ring_cycle.large(circuit, abs(slope) * amplitude_m).demodulated_v_per_f * slope


def delay_s(device, channel, temp_degc, amplitude_m=0.0):
    """Delay of the fundamental behind a channel's ring at an amplitude (m); 0 for small signals."""
    slope = abs(device.dcdx_f_per_m if channel == "drive" else device.dcdy_f_per_m)
    return ring_cycle.large(ring_tables.circuit(device, channel, temp_degc), max(slope * amplitude_m, SMALL_F)).delay_s


def amplitude_m(device, temp_degc, demodulated_v):
    """Drive amplitude (m) at which the demodulator sees a sine of `demodulated_v` behind the ring; ValueError."""
    return _amplitude_f(ring_tables.circuit(device, "drive", temp_degc), demodulated_v) / abs(device.dcdx_f_per_m)


@functools.lru_cache(maxsize=256)
def _amplitude_f(circuit, demodulated_v):
    def volts(dc_f):
        return ring_cycle.large(circuit, dc_f).demodulated_v_per_f * dc_f

    low_f, high_f = SMALL_F, MOST_C0_SHARE * circuit.c0_f
    if volts(high_f) < demodulated_v:
        raise ValueError(
            f"plant.ring_saturation_on = 1: the set-point needs {demodulated_v:g} V behind the ring, which gives "
            f"at most {volts(high_f):g} V; lower firmware.amplitude_um or plant.dcdx_f_per_m, or raise plant.carrier_v"
        )
    for _ in range(ROUNDS):
        middle_f = (low_f + high_f) / 2
        low_f, high_f = (middle_f, high_f) if volts(middle_f) < demodulated_v else (low_f, middle_f)
    return (low_f + high_f) / 2

"""The ring diode of a configuration at the amplitude that its loop holds: delay, and where it leaves 1 %.

Source    docs/parts/ring_diode.md
"""

import functools
import math

from scipy.optimize import brentq

from analog_frontend import ring_tables
from analog_frontend.parts import propagator, ring_cycle, ring_diode
from testbench.run import build

SID_GAIN = 4 / math.pi
SMALL_F = 1e-15
NEAR_C0 = 0.98


def limit_m(device, temp_degc):
    """Drive amplitude (m) at which the ring's gain has lost 1 %; a closed form, within 8 %."""
    return ring_diode.limit_f(*ring_diode.arguments(device, "drive", temp_degc)) / abs(device.dcdx_f_per_m)


def delay_s(config, channel, temp_degc):
    """Delay of a channel's ring: small signal, or that of the fundamental where it saturates."""
    device = config.device()
    if not device.ring_saturation_on:
        return propagator.cv_chain(device, channel, temp_degc)[1]
    circuit = ring_tables.circuit(device, channel, temp_degc)
    return ring_cycle.large(circuit, held_f(config, temp_degc) if channel == "drive" else SMALL_F).delay_s


def held_f(config, temp_degc):
    """Amplitude (F) of the drive's dC at which the demodulator sees the set-point. ValueError: none is so large."""
    device = config.device()
    circuit = ring_tables.circuit(device, "drive", temp_degc)
    seen_v = build.nominal(config)["v_per_um"] * config.firmware.amplitude_um / (SID_GAIN * abs(device.signal_gain))
    return _seen_at_f(circuit, abs(seen_v))


@functools.lru_cache(maxsize=256)
def _seen_at_f(circuit, volts):
    def missing(dc_f):
        return ring_cycle.large(circuit, dc_f).seen_v_per_f * dc_f - volts

    top_f = NEAR_C0 * circuit.c0_f
    if missing(top_f) < 0:
        most = missing(top_f) + volts
        raise ValueError(
            f"plant.ring_saturation_on = 1: the set-point is {volts:g} V behind the ring, which gives {most:g} V at "
            "most: lower firmware.amplitude_um or plant.dcdx_f_per_m, or raise plant.carrier_v"
        )
    return brentq(missing, SMALL_F, top_f, rtol=1e-7, xtol=1e-20)


def sentence(config, temp_degc):
    """Where the ring leaves 1 %, and what the plant makes of it."""
    device = config.device()
    limit_um, temp = 1e6 * limit_m(device, temp_degc), f"{temp_degc:g} degC"
    said = f"Ring diode: its gain has lost 1 % at {limit_um:.3g} um ({temp}, within 8 %); set-point"
    said += f" {config.firmware.amplitude_um:g} um"
    if device.ring_saturation_on:
        held_um = 1e6 * held_f(config, temp_degc) / abs(device.dcdx_f_per_m)
        return f"{said}, held at {held_um:.4g} um. It saturates in this plant (plant.ring_saturation_on = 1)."
    return f"{said}. The plant keeps it linear (plant.ring_saturation_on = 0)."

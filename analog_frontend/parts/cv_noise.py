"""White noise of a C/V channel at the ring's output, source by source, each with its law over temperature.

    rest       cv_noise_v_per_rthz, the same at every T: what no other source here explains (the default's only one)
    carrier    e dC/(C0 + Cp): noise of the carrier a drive frequency off it, through the imbalance at rest
    ring       sqrt(2 n kT F(u)/(fc Ct g^2))         charge noise of the four diodes: `diode_charge`
    resistors  sqrt(4 kT R)
    voltage    sqrt(2) e_n(T)                        two inputs of the instrumentation amplifier, independent
    current    sqrt(2) i_n(T)/(4 fc Ct g)            each meets half of what the ring shows, 1/(2 fc Ct g)

e_n(T), i_n(T) are `thermal.device_at_temperature`'s: sqrt(2 q Ic) kT/(q Ic) and sqrt(2 q Ib(T)) of a bipolar input.

Keys      carrier_noise_v_per_rthz with c0_imbalance_f, ring_noise_on, cv_resistor_ohm, ina_voltage_noise_v_per_rthz,
          ina_current_noise_a_per_rthz: off by default. One-sided, before the signal gain
Ring      a Monte Carlo of both diodes' shot noise agrees with F within 6 %; ngspice cannot judge it
Refused   a temperature profile with sources that have laws over temperature
Source    docs/plant.md
"""

import math

from analog_frontend.parts import ring_diode, thermal
from analog_frontend.parts.noise import BOLTZMANN_J_PER_K, ZERO_DEGC_K

CHARGE_Q = 1.602176634e-19
# Keys whose sources have a law over temperature
WITH_LAW = ("ring_noise_on", "cv_resistor_ohm", "ina_voltage_noise_v_per_rthz", "ina_current_noise_a_per_rthz")
STEPS = 400  # Simpson's rule on a smooth integrand: 1e-9


def diode_charge(u):
    """F(u): variance of the charge that one half period of one node adds to the difference, in units of n kT Ct.

    u    as in `ring_diode`: u = Is T/(2 n VT Ct), the half period measured by the diodes' own relaxation
    Charges of the conducting and the blocking diode count w and 1 - w, w(v) = (1 - sinh(u - 2 v)/sinh u)/2, and are
    shot noise of Is (coth v + 1) and Is (tanh v + 1). F -> 1/2 + 2 u/3 for small u: half of kTC, as the tail is one-way
    """

    def density(v):
        w = 0.5 * (1.0 - math.sinh(u - 2.0 * v) / math.sinh(u))
        conducting = w * w / math.tanh(v) if v else 0.0  # w goes as v
        return conducting + w * w + (1.0 - w) ** 2 * (1.0 + math.tanh(v))

    step = u / STEPS
    weights = (1 if k in (0, STEPS) else 4 if k % 2 else 2 for k in range(STEPS + 1))
    return step / 3.0 * sum(weight * density(k * step) for k, weight in enumerate(weights))


def _ring_noise_resistance(device, channel, temp_degc):
    """(charge noise V/rtHz, resistance ohm that the ring shows between its two outputs)."""
    arguments = ring_diode.arguments(device, channel, temp_degc)
    ring, (carrier_v, carrier_hz, *_, diode_degc, _) = ring_diode.diode_ring(*arguments), arguments
    kt = BOLTZMANN_J_PER_K * (diode_degc + ZERO_DEGC_K)
    ct = (carrier_v - 2.0 * ring.vf_v) / ring.textbook_gain_v_per_f
    u = math.atanh(math.exp(-ring.vf_v * CHARGE_Q / (device.diode_n * kt)))
    charge_noise = math.sqrt(2.0 * device.diode_n * kt * diode_charge(u) / (carrier_hz * ct)) / ring.g
    return charge_noise, 1.0 / (2.0 * carrier_hz * ct * ring.g)


def cv_noise_shares(device, temp_degc, channel="sense"):
    """{source: one-sided V/rtHz at the ring's output} of "drive" or "sense"; `device` as it is at temp_ref."""
    warm = thermal.device_at_temperature(device, temp_degc)
    shares = {
        "rest": device.cv_noise_v_per_rthz,
        "carrier": device.carrier_noise_v_per_rthz * device.c0_imbalance_f / (device.c0_f + device.cp_f),
        "ring": 0.0,
        "resistors": math.sqrt(4.0 * BOLTZMANN_J_PER_K * (temp_degc + ZERO_DEGC_K) * device.cv_resistor_ohm),
        "voltage": math.sqrt(2.0) * warm.ina_voltage_noise_v_per_rthz,
        "current": 0.0,
    }
    # the ring is only asked where somebody wants to know: a chain of another kind has none
    if device.ring_noise_on or device.ina_current_noise_a_per_rthz:
        ring_charge_noise, ohm = _ring_noise_resistance(device, channel, temp_degc)
        shares["ring"] = ring_charge_noise if device.ring_noise_on else 0.0
        shares["current"] = warm.ina_current_noise_a_per_rthz * ohm / math.sqrt(2.0)
    return shares


def cv_density(device, temp_degc, channel="sense"):
    """V/rtHz at the ring's output: all sources together."""
    return math.hypot(*cv_noise_shares(device, temp_degc, channel).values())

"""Temperature: the laws that turn a `Device` into the same device at T, and the warm-up of the package.

    f(T)    = f (1 + tcf dT)                    dT = T - temp_ref, both modes: Young's modulus dominates
    Q(T)    = Q exp(dlnq dT)
    k_xy(T) = k_xy (1 + tc dT)                  tc is one number below temp_ref and another above it
    GBW(T)  = GBW (1 + tc dT)
    RC(T)   = RC (1 + tc dT)                    output poles and SID resistors, both off by default;
                                                with dac_amplifier_tc_on output poles 2 and 3 go with 1/GBW instead
    E(T)    = E (1 + tc dT)                     carrier, off by default; so the charge that a switch injects
    I(T)    = I 2^(dT/10 K)                     leakage of open switches, off by default
    e_n(T)  = e_n t^(1 - p/2)                   t = T/T_ref in kelvin; bipolar, I_c as t^p: sqrt(2 q I_c) kT/(q I_c)
    i_n(T)  = i_n t^((p - b)/2)                 sqrt(2 q I_b), I_b = I_c/beta, beta as t^b
    1/f(T)  = 1/f t^p                           no derived law: p is an assumption, 0 by default
    rise(t) = self_heating (1 - exp(-t / tau))  package over ambient, off by default

The ring diode is not here: `propagator.cv_chain` takes the device at temp_ref and the temperature.
Leakage  I/(2 f) a half turn on each held capacitor, taken as a charge at the edge. It doubles in 10 K: a rule of thumb
Bias     d_xy/(2 m_c) + (d rate/d sine + d rate/d cosine)(6 R f dQ + dQ/(4 C)), dQ = Q mismatch + I/(2 f). d_xy is a
         share of d_x, so its bias goes with 1/Q(T)
Range    -55 to 125 degC
Numbers  240-bit arithmetic, rounded once per field: the same doubles on every machine. At temp_ref nothing changes.
Source   docs/plant.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.exact import MP
from analog_frontend.parts.device import Device, validate
from fpga_model.jit import inlined, kernel

TEMP_LO_DEGC = -55.0
TEMP_HI_DEGC = 125.0
GBW_FIELDS = ("opamp_gbw_hz",)
FREQUENCY_FIELDS = ("fx_hz", "fy_hz")
Q_FIELDS = ("qx", "qy")
DAC_RC_FIELDS = ("drive_pole_1_s", "sense_pole_1_s")
DAC_AMPLIFIER_FIELDS = ("drive_pole_2_s", "drive_pole_3_s", "sense_pole_2_s", "sense_pole_3_s")
SID_RC_FIELDS = ("sid_r_ohm",)
LEAKAGE_DOUBLES_K = 10
ZERO_DEGC_K = MP.mpf("273.15")


def check(temp_degc):
    """`temp_degc` as a float; ValueError outside the range of the parts, or for NaN."""
    if not TEMP_LO_DEGC <= temp_degc <= TEMP_HI_DEGC:
        raise ValueError(f"temp_degc = {temp_degc!r} is outside {TEMP_LO_DEGC:g} .. {TEMP_HI_DEGC:g} (unit degC)")
    return float(temp_degc)


def device_at_temperature(device, temp_degc):
    """The device at `temp_degc`; the result must not be given to this function again."""
    dt = MP.mpf(check(temp_degc)) - MP.mpf(device.temp_ref_degc)
    if dt == 0:
        return device
    ratio = 1 + dt / (MP.mpf(device.temp_ref_degc) + ZERO_DEGC_K)
    bias, beta = MP.mpf(device.ina_bias_exponent), MP.mpf(device.ina_beta_exponent)
    rc, gbw = 1 + MP.mpf(device.dac_rc_tc_per_k) * dt, 1 + MP.mpf(device.opamp_gbw_tc_per_k) * dt
    kxy_tc = device.kxy_tc_below_per_k if dt < 0 else device.kxy_tc_above_per_k
    laws = (
        (FREQUENCY_FIELDS, 1 + MP.mpf(device.tcf_per_k) * dt),
        (Q_FIELDS, MP.exp(MP.mpf(device.dlnq_per_k) * dt)),
        (("kxy_n_per_m",), 1 + MP.mpf(kxy_tc) * dt),
        (GBW_FIELDS, gbw),
        (DAC_RC_FIELDS, rc),
        (DAC_AMPLIFIER_FIELDS, 1 / gbw if device.dac_amplifier_tc_on else rc),
        (SID_RC_FIELDS, 1 + MP.mpf(device.sid_rc_tc_per_k) * dt),
        (("carrier_v",), 1 + MP.mpf(device.carrier_tc_per_k) * dt),
        (("sid_charge_c",), 1 + MP.mpf(device.sid_charge_tc_per_k) * dt),
        (("sid_leakage_a",), MP.mpf(2) ** (dt / LEAKAGE_DOUBLES_K)),
        (("ina_voltage_noise_v_per_rthz",), ratio ** (1 - bias / 2)),
        (("ina_current_noise_a_per_rthz",), ratio ** ((bias - beta) / 2)),
        (("sid_flicker_v_per_rthz",), ratio ** MP.mpf(device.sid_flicker_exponent)),
    )
    scaled_fields = {name: float(MP.mpf(getattr(device, name)) * factor) for names, factor in laws for name in names}
    return validate(Device(**(device._asdict() | scaled_fields)))


class Params(NamedTuple):
    """Warm-up as one pole: final rise (K), and the part of the way that one step covers."""

    final_k: float
    alpha: float


def design(device, step_s):
    """Warm-up in steps of `step_s` seconds."""
    if not 0.0 < step_s <= 1e4:
        raise ValueError(f"step_s = {step_s!r} is outside 0 .. 10000 (unit s)")
    return Params(device.self_heating_k, float(-MP.expm1(-MP.mpf(step_s) / MP.mpf(device.warm_up_tau_s))))


@inlined
def step(p, rise_k):
    """Rise over ambient (K) one step later; starts at 0."""
    return rise_k + (p.final_k - rise_k) * p.alpha


@kernel
def rises(p, rise_k, steps):
    """Rises over ambient (K), float64: now, and after each of `steps`."""
    out = np.full(steps + 1, rise_k)
    for n in range(steps):
        out[n + 1] = step(p, out[n])
    return out


def rise_k(device, time_s):
    """The same law in closed form: rise over ambient (K) at `time_s` after power-on."""
    return float(-MP.mpf(device.self_heating_k) * MP.expm1(-MP.mpf(time_s) / MP.mpf(device.warm_up_tau_s)))

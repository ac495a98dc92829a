"""Bias with the rate of change of temperature, for a package that warms up after power-on: F = -d e^(-t/tau) vx, tau
= plant.warm_up_tau_s.

A ramp of temperature both ways separates it from a bias that follows T.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="thermoelastic_bias",
    port="force_y",
    mechanism="drift",
    unit="N s/m",
    source="temperature gradients while dT/dt is not 0; value assumed",
    fingerprint="bias that decays with the warm-up: d e^(-t/tau)/(2 m) rad/s",
)
IDS, LIMIT, EXAMPLE, SIGN = "E24", 1e-06, 8e-11, 0
DOC = "damping coupling with dT/dt of the warm-up: decays with plant.warm_up_tau_s from power-on"


def terms(value, device):
    return (f"force_y = {-value!r} vx", f"force_y = {value!r} lag({device.warm_up_tau_s!r}) vx")

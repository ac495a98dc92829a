"""Coupling damping beyond first order: F_y = -d x^2 vx.

At one amplitude it is damping_coupling; two amplitudes separate them.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="bias_cubic",
    port="force_y",
    mechanism="polynomial",
    unit="N s/m^3",
    source="squeeze film with tilt; value assumed",
    fingerprint="bias changes by d A^2/(8 m) rad/s, proportional to the square of the amplitude",
)
IDS, LIMIT, EXAMPLE, SIGN = "E12b", 100000.0, 10.0, 0
DOC = "bias that grows with the amplitude: F = -d x^2 vx on the sense mode"


def terms(value, device):
    return (f"force_y = {-value!r} x^2 vx",)

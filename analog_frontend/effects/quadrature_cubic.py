"""Coupling stiffness beyond first order: F_y = -k x^3.

At one amplitude it is k_xy; two amplitudes separate them.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="quadrature_cubic",
    port="force_y",
    mechanism="polynomial",
    unit="N/m^3",
    source="beams that bend out of their axis; value assumed",
    fingerprint="quadrature voltage changes as if k_xy grew by (3/4) k A^2, with the square of the amplitude",
)
IDS, LIMIT, EXAMPLE, SIGN = "E12a", 10000000000.0, 1000000.0, 0
DOC = "quadrature that grows with the amplitude: F = -k x^3 on the sense mode"


def terms(value, device):
    return (f"force_y = {-value!r} x^3",)

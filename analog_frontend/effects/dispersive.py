"""Dispersive coupling, potential k x^2 y^2/2: F_y = -k x^2 y, F_x = -k x y^2.

In closed loop y is near zero: the split shows in the response to a rate step alone.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="dispersive",
    port="force_y",
    mechanism="polynomial",
    unit="N/m^3",
    source="tension of shared beams; value assumed",
    fingerprint="frequency split moves by k A^2/(4 m w) rad/s, proportional to the square of the drive amplitude",
)
IDS, LIMIT, EXAMPLE, SIGN = "E11", 10000000000000.0, 1000000000.0, 0
DOC = "stiffness of each mode that grows with the square of the other's motion: F_y = -k x^2 y, F_x = -k x y^2"


def terms(value, device):
    return (f"force_y = {-value!r} x^2 y", f"force_x = {-value!r} x y^2")

"""Centrifugal force on both modes: F = c m Omega^2 (x, y); c = 1 for a point mass.

Even in rate: 3.5 uHz at 100 deg/s. The only size of the catalogue that physics gives.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="centrifugal",
    port="force_x",
    mechanism="polynomial",
    unit="1",
    source="rotating frame",
    fingerprint="drive frequency falls by c Omega^2/(2 w^2) f, even in rate, by 3.5 uHz at 100 deg/s",
)
IDS, LIMIT, EXAMPLE, SIGN = "E10", 10000.0, 1.0, 0
DOC = "centrifugal softening of both modes, 1 for a point mass: F = c m rate^2 x"
PHYSICS = (0.0, 1.0, "it is the share of the moving inertia that acts in the plane of rotation")


def terms(value, device):
    return (
        f"force_x = {value * device.mass_kg!r} rate^2 x",
        f"force_y = {value * device.mass_kg!r} rate^2 y",
    )

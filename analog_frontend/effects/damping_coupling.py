"""Damping force on the sense mode from the drive velocity: F = -d vx, added to what plant.dxy_ratio gives.

plant.dxy_ratio scales with Q, this does not. Feedthrough is the rival: it goes with the drive word.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="damping_coupling",
    port="force_y",
    mechanism="leak from force_x",
    unit="N s/m",
    source="anisotropic squeeze film: bias 9.9 deg/s times d_xy/d_x",
    fingerprint="bias changes by d/(2 m) rad/s, independent of rate and of the drive voltage",
)
IDS, LIMIT, EXAMPLE, SIGN = "E06", 1e-06, 8e-11, 0
DOC = "damping that couples drive velocity into sense, in addition to plant.dxy_ratio: F = -d vx"


def terms(value, device):
    return (f"force_y = {-value!r} vx",)

"""Damping that grows with speed: F = -d2 |vx| vx.

Three amplitudes separate it from coulomb_friction and damping_cubic.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="damping_quadratic",
    port="force_x",
    mechanism="polynomial",
    unit="N s^2/m^2",
    source="gas flow beyond Stokes; value assumed",
    fingerprint="drive amplitude word rises by 8 d2 w A/(3 pi d), proportional to the amplitude",
)
IDS, LIMIT, EXAMPLE, SIGN = "E14b", 1e-05, 3e-10, 1
DOC = "turbulent damping of the drive mode: F = -d2 |vx| vx"


def terms(value, device):
    return (f"force_x = {-value!r} abs(vx) vx",)

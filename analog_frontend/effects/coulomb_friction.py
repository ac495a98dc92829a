"""Dry friction of the drive mode: F = -Fc sgn(vx).

Largest at small amplitude. The sign is taken at each tick, so the force changes up to one tick late.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="coulomb_friction",
    port="force_x",
    mechanism="polynomial",
    unit="N",
    source="slip at anchors and stoppers, getter dust; value assumed",
    fingerprint="drive amplitude word rises by 4 Fc/pi over the drive force; the rise is largest at small amplitude",
)
IDS, LIMIT, EXAMPLE, SIGN = "E14a", 1e-07, 2e-11, 1
DOC = "dry friction of the drive mode: F = -Fc sgn(vx)"


def terms(value, device):
    return (f"force_x = {-value!r} sgn(vx)",)

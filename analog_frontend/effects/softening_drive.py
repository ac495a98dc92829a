"""Electrostatic softening of the drive mode by the drive voltage: F = e u^2 x.

u leads x by a quarter turn, so u^2 x has A_d^2/4 of x in its fundamental. A change of Q separates it from Duffing.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="softening_drive",
    port="force_x",
    mechanism="polynomial",
    unit="N/m/V^2",
    source="second derivative of the electrode's capacitance; value assumed",
    fingerprint="drive frequency falls by e A_d^2/(8 k) f, proportional to 1/Q squared at fixed amplitude",
)
IDS, LIMIT, EXAMPLE, SIGN = "E09", 10.0, 0.001, 0
DOC = "electrostatic softening of the drive mode by its own drive voltage: F = e u^2 x"


def terms(value, device):
    return (f"force_x = {value!r} u^2 x",)

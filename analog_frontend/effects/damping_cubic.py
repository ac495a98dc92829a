"""Damping of the drive mode that grows with the square of the amplitude: F = -d3 x^2 vx.

Over a cycle x^2 vx does the work of a damper d3 A^2/4. Nearest rival: pickoff_cubic_x, which changes the amplitude that
the AGC reads; a larger amplitude or a ring-down separates them.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="damping_cubic",
    port="force_x",
    mechanism="polynomial",
    unit="N s/m^3",
    source="squeeze film and anchor losses beyond first order; value assumed",
    fingerprint="drive amplitude word rises by d3 A^2/(4 d), with the square of the amplitude, independent of rate",
)
IDS, LIMIT, EXAMPLE, SIGN = "E02", 100000.0, 10.0, 1
DOC = "damping of the drive mode that grows with x squared: F = -d3 x^2 vx"


def terms(value, device):
    return (f"force_x = {-value!r} x^2 vx",)

"""Electrical feedthrough of the drive voltage into its own C/V output: n_x += c u.

u is in phase with the velocity, a quarter turn from x: the loop has a phase error c A_d/V, and f_x/(2Q) of it in
frequency.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="feedthrough_x",
    port="cv_x",
    mechanism="leak from force_x",
    unit="V/V",
    source="stray capacitance next to the ring diode; value assumed",
    fingerprint="the lock shifts by c A_d in quadrature with x: a phase error proportional to 1/Q",
)
IDS, LIMIT, EXAMPLE, SIGN = "E25", 0.01, 0.0001, 0
DOC = "drive electrode voltage that reaches the drive C/V output"


def terms(value, device):
    return (f"cv_x = {value!r} u",)

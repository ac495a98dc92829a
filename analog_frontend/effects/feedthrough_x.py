"""Electrical feedthrough of the drive voltage into its own C/V output: n_x += c u."""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="feedthrough_x",
    port="cv_x",
    mechanism="leak from force_x",
    unit="V/V",
    source="stray capacitance beside the ring diode; value assumed",
    fingerprint="lock moves by c A_d in quadrature with x: a phase error that goes with 1/Q",
)
IDS, LIMIT, EXAMPLE, SIGN = "E25", 0.01, 0.0001, 0
DOC = "drive electrode voltage that reaches the drive C/V output"


def terms(value, device):
    return (f"cv_x = {value!r} u",)

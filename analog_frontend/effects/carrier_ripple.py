"""Ripple of the mains on the carrier: V -> V (1 + a cos(2 pi 50 t)).

The demodulator passes 50 Hz with its triple pole; means over whole periods do not move.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="carrier_ripple",
    port="cv_x",
    mechanism="tone",
    unit="1",
    source="supply of the carrier's driver; value assumed",
    fingerprint="lines at 50 Hz in amplitude and rate; they grow with the drive amplitude, not with rate",
)
IDS, LIMIT, EXAMPLE, SIGN = "E23", 0.01, 1e-05, 0
DOC = "mains ripple on the carrier: gain of both C/V outputs times 1 + a cos(2 pi 50 t)"


def terms(value, device):
    return (f"cv_x = {value!r} cos(50.0) cx", f"cv_y = {value!r} cos(50.0) cy")

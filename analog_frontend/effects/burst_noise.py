"""Burst noise in phase with the drive: n_y = a B(t) u / 1 V, B = +1 or -1 at random, anew every 10 ms.

Repeats differ, and the distribution has two humps. Real bursts last random times; these last whole multiples of 10 ms.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="burst_noise",
    port="cv_y",
    mechanism="noise",
    unit="V",
    source="contacts, popcorn noise of amplifiers; value assumed",
    fingerprint="bias jumps between two levels: repeats differ, the distribution has two peaks",
)
IDS, LIMIT, EXAMPLE, SIGN = "N04", 0.01, 1e-07, 0
DOC = "burst noise of the sense C/V chain: one of two levels, drawn at random every 10 ms"


def terms(value, device):
    return (f"cv_y = {value!r} flip(0.01) u",)

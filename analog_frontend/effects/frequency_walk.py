"""Random walk of the drive mode's stiffness: F = -k W(t) x, variance of W t/1 s.

Repeats differ, so the noise alarm rises and tracing names no effect.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="frequency_walk",
    port="force_x",
    mechanism="noise",
    unit="N/m",
    source="stress relaxation, charge hopping; value assumed",
    fingerprint="drive frequency is a random walk: its variance grows with time, and repeats differ",
)
IDS, LIMIT, EXAMPLE, SIGN = "N02", 1.0, 1e-07, 0
DOC = "random walk of the drive mode's stiffness, sd after one second"


def terms(value, device):
    return (f"force_x = {-value!r} walk(1.0) x",)

"""Electrostatic softening of the sense mode by the force-to-rebalance voltage: F = e w^2 y.

In closed loop y is near zero and the law nearly silent; it shows in the step response.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="softening_sense",
    port="force_y",
    mechanism="polynomial",
    unit="N/m/V^2",
    source="single-ended part of the rebalance electrodes; value assumed",
    fingerprint="sense mode softens with rate squared: visible while y moves, as in a step response, hardly at rest",
)
IDS, LIMIT, EXAMPLE, SIGN = "E27", 10.0, 0.01, 0
DOC = "electrostatic softening of the sense mode by the rebalance voltage: F = e w^2 y"


def terms(value, device):
    return (f"force_y = {value!r} w^2 y",)

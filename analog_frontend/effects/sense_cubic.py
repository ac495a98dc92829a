"""Cubic term of the rebalance electrode: F = c w^3.

It shows at several rates only, as nonlinearity of the scale factor in ppm.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="sense_cubic",
    port="force_y",
    mechanism="polynomial",
    unit="N/V^3",
    source="gap law of the rebalance electrodes to third order, amplifier compression; value assumed",
    fingerprint="scale factor changes by (3/4) c W^2/k_vf, with rate squared: a nonlinearity of the scale factor",
)
IDS, LIMIT, EXAMPLE, SIGN = "E12c, E18", 1e-06, 1e-10, 0
DOC = "cubic term of the rebalance electrode: F = c w^3"


def terms(value, device):
    return (f"force_y = {value!r} w^3",)

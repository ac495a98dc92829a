"""Steady acceleration along the sense gap: both pairs of electrodes are off their middle by y0 = a / w_y^2.

    C', C of a side go as 1/(d -+ y0), 1/(d -+ y0)^2: a pair's sum changes by its mismatch s,  e = 2 s y0 / d
    k_vf -> k_vf (1 + e)      S -> S (1 + e)      k_y -> k_y + e k_c, k_c the carrier's softening

e is 53 ppm at 1 g. One attitude cannot separate it from plant.k_vf_sense_n_per_v,
so it is no candidate of tracing; +1 g and -1 g are two configurations. (y0/d)^2 = 2.8e-7 is left out.
"""

import math

from analog_frontend.effects.ports import Info

G_M_PER_S2 = 9.80665
GAP_M, MISMATCH = 4e-6, 0.05  # A

INFO = Info(
    name="acceleration",
    port="force_y",
    mechanism="gain",
    unit="g",
    source="parallel plates, gap and mismatch assumed",
    fingerprint="scale factor changes by -e with tilt, f_y slightly; both are independent of rate",
)
IDS, LIMIT, EXAMPLE, SIGN = "E29", 1000.0, 1.0, 0
DOC = "steady acceleration along the sense gap: electrodes are off centre"


def shift(value, device):
    """Relative change e of a pair of electrodes."""
    return 2 * MISMATCH * value * G_M_PER_S2 / ((2 * math.pi * device.fy_hz) ** 2 * GAP_M)


def carrier_softening_n_per_m(carrier_v, c0_f, gap_m):
    """Stiffness of a gap-changing pick-off pair under the carrier, -2 (E/2)^2 C0 / d^2."""
    return -0.5 * carrier_v * carrier_v * c0_f / (gap_m * gap_m)


def terms(value, device):
    """Laws of an acceleration in g."""
    e = shift(value, device)
    softer = carrier_softening_n_per_m(device.carrier_v, device.c0_f, GAP_M)
    return (
        f"force_y = {e * device.k_vf_sense_n_per_v!r} w",
        f"force_y = {-e * softer!r} y",
        f"cv_y = {e!r} cy",
    )

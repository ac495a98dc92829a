"""A resonator's law carried over to the gyroscope's drive mode, as a text for `effects.laws`.

    the law's force over the linear one it adds to is the same at the gyroscope's amplitude as at the part's largest
    springs     F = -k c A_p^(n-1) X (X/A)^(n-1)         over the spring
    dampings    the same over the linear damping: c Q_p / Q_g
    ring-down   dP/dt = -c P^m: r = c P_p^(m-1) / g      F = -d |x|^.. vx with its mean rate r w / Q_g at amplitude A
    sweep       f0 moves by s at the largest response: k3 = (8/3) k (s / f0) / A^2
What belongs to an instrument or a preparation is no law of the plant and gives none.
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.effects import law
from testbench.measured.models.terms import TERMS

AMPLITUDE_M = 5e-6
# mean rate of d F / (m A^(n-1)) for F = -d x^2 vx, |vx| vx / w, x^4 vx
RATES = {"damping_cubic": 1 / 4, "damping_quadratic": 8 / (3 * np.pi), "damping_quintic": 1 / 8}
POWERS = {"damping_cubic": 2.0, "damping_quadratic": 1.5, "damping_quintic": 3.0}
SHAPES = {"damping_cubic": "x^2 vx", "damping_quadratic": "abs(vx) vx", "damping_quintic": "x^4 vx"}


class LawOfLoop(NamedTuple):
    """One law for the gyroscope: text, and how strong it is there, over what it adds to."""

    name: str
    text: str
    share: float
    of: str


def laws_of_loop(effects, working, device, amplitude_m=AMPLITUDE_M):
    """`Carried` of those effects (as in a report's JSON) that are laws of the plant."""
    out = []
    m, w = device.mass_kg, 2 * np.pi * device.fx_hz
    k = m * w * w
    for e in effects:
        name, c = e["law"], e["value"]
        if e["kind"] != "plant" or e["port"] != "force_x":
            continue
        if working.kind == "driven":
            item = law.parse(f"force_x = 1 {TERMS[name]}")
            if any(f.name == "u" for f in item.factors):
                continue
            speeds = sum(f.power for f in item.factors if f.name == "vx" and f.dress != law.SGN)
            n = speeds + sum(f.power for f in item.factors if f.name == "x")
            odd = any(f.name == "vx" for f in item.factors) and name != "inertia"
            share = c * working.amplitude ** (n - 1)
            share = share * working.q if odd else share
            value = share * k / (device.qx if odd else 1.0) * amplitude_m ** (1 - n) / w**speeds
            text, of = f"force_x = {-float(value)!r} {TERMS[name]}", "linear damping" if odd else "spring"
        elif working.kind == "ringdown" and name in RATES:
            power = POWERS[name]
            share = c * working.amplitude ** (2 * (power - 1)) * working.q / (2 * np.pi * working.f_hz)
            n = 2 * (power - 1)
            value = share * m * w / device.qx / (RATES[name] * amplitude_m**n)
            value = value / w if name == "damping_quadratic" else value
            text, of = f"force_x = {-float(value)!r} {SHAPES[name]}", "linear damping"
        elif working.kind == "swept" and name == "duffing":
            share = c * working.amplitude**2 / working.f_hz * 8 / 3
            text, of = f"force_x = {-float(share * k / amplitude_m**2)!r} x^3", "spring"
        else:
            continue
        out.append(LawOfLoop(name, text.replace("--", ""), float(share), of))
    return out

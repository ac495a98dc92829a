"""What the tick of the plant adds to the lag of a C/V output: no part of the board, and some 1e-8 deg.

    cubic   the engines drive the C/V chain by Hermite's cubic through x and x' at both ends of a tick, not by x
    images  the staircase of the force moves the mode at w_k = w + 2 pi k/h, too. Samples h apart fold that onto w, in
            x by X_k, in x' by i w_k X_k, so the cubic meets a velocity that is rho of i w x more than its positions say

    X_k/X = -a (w/w_k) e^(-i 2 pi k t/h) prod (1 + i w tau)/(1 + i w_k tau) / (w_k^2 - w^2)        k = +-1, +-2, ..
    rho   = sum of (w_k/w - 1) X_k/X
    lag   = -arg(1 + z/H)       H = prod 1/(1 + i w tau);  z  the chain's answer to the cubic less the vibration

a is force over mass and displacement, t the instant in the tick at which the force's DAC steps.
Size      in the diagnosis of the default board 21e-9 deg of xe2 and 47e-9 deg of ye2
Source    analog_frontend/parts/propagator.py
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

IMAGES = np.concatenate([-np.arange(400, 0, -1), np.arange(1, 401)])
NODES = 128  # of Gauss and Legendre on a tick


class Force(NamedTuple):
    """Force over mass and displacement (1/s^2, phasors at w), poles of its output (s), instant of its step (s)."""

    per_m: complex
    poles_s: tuple
    instant_s: float


NONE = Force(0.0, (), 0.0)


def image_velocity_ratio(w, tick_s, force):
    """rho."""
    w_k = w + 2 * math.pi * IMAGES / tick_s
    chain = np.ones_like(w_k, complex)
    for tau in force.poles_s:
        chain *= (1 + 1j * w * tau) / (1 + 1j * w_k * tau)
    turned = np.exp(-2j * np.pi * IMAGES * force.instant_s / tick_s)
    return complex(np.sum((w_k / w - 1) * -force.per_m * (w / w_k) * turned * chain / (w_k**2 - w**2)))


def lag_deg(poles_s, frequency_hz, tick_s, force=NONE):
    """Lag (deg) that the tick adds to that of a C/V chain of these poles, of a mode that vibrates at `frequency_hz`."""
    w, rates = 2 * math.pi * frequency_hz, 1 / np.asarray(poles_s)
    a = np.diag(-rates) + np.diag(rates[1:], -1)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    u, weights = (nodes + 1) / 2, weights / 2 * tick_s
    begin, end, slope = 1.0, np.exp(1j * w * tick_s), 1j * w * tick_s * (1 + image_velocity_ratio(w, tick_s, force))
    cubic = begin * (1 - 3 * u**2 + 2 * u**3) + end * (3 * u**2 - 2 * u**3)
    cubic += slope * (begin * (u - 2 * u**2 + u**3) + end * (u**3 - u**2))
    error = cubic - np.exp(1j * w * tick_s * u)
    answers = expm(a * (tick_s * (1 - u))[:, None, None])[:, :, 0] * rates[0]
    z = np.linalg.solve(end * np.eye(len(a)) - expm(a * tick_s), (weights * error) @ answers)[-1]
    return -math.degrees(np.angle(1 + z * np.prod(1 + 1j * w / rates)))

"""The ring diode at three temperatures as polynomials in ln(Cref) and the carrier: a thousand boards cost nothing.

    of a ring      ln of gain (V/F), delay (s), noise of its own (V/rtHz) and by current (V/A), output at 1 % loss (V)
    polynomial     Chebyshev of degree DEGREE over ln(Cref) in CREF_F and the carrier in CARRIER_V
    nodes          `ring_diode.diode_ring` and `cv_noise` themselves, with capacitances and diodes of the default board

Beyond the box a board is taken to be on its edge; the priors reach it with a probability below 1e-3.
Source    docs/inference.md, analog_frontend/parts/ring_diode.py
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from analog_frontend.parts import cv_noise, ring_diode
from analog_frontend.parts.device import Device

TEMPERATURES_DEGC = -20.0, 25.0, 50.0
CREF_F = 9e-12, 240e-12
CARRIER_V = 2.0, 8.0
DEGREE = 13
PROBE_A = 1e-12


class Ring(NamedTuple):
    """Of rings at one temperature; arrays."""

    gain_v_per_f: np.ndarray
    tau_s: np.ndarray
    noise_v_per_rthz: np.ndarray
    noise_ohm: np.ndarray
    limit_v: np.ndarray


def _chebyshev_argument(x, lo, hi):
    return np.clip((2 * x - lo - hi) / (hi - lo), -1.0, 1.0)


def exact_ring(carrier_v, cref_f, temp_degc):
    """The numbers of one ring, as the parts have them."""
    changed = {"carrier_v": carrier_v, "cref_sense_f": cref_f, "ring_noise_on": 1, "ina_bias_exponent": 0.0}
    device = Device()._replace(**changed, ina_beta_exponent=0.0, ina_current_noise_a_per_rthz=PROBE_A)
    arguments = ring_diode.arguments(device, "sense", temp_degc)
    one = ring_diode.diode_ring(*arguments)
    shares = cv_noise.cv_noise_shares(device, temp_degc)
    limit_v = one.gain_v_per_f * ring_diode.limit_f(*arguments)
    return Ring(one.gain_v_per_f, one.tau_s, shares["ring"], shares["current"] / PROBE_A, limit_v)


@functools.cache
def _chebyshev_coefficients():
    """Chebyshev coefficients of the logarithms, one (n, numbers, n) for each temperature."""
    nodes = chebyshev.chebpts1(DEGREE + 1)
    low, high = map(math.log, CREF_F)
    crefs = np.exp((low + high) / 2 + nodes * (high - low) / 2)
    carriers = sum(CARRIER_V) / 2 + nodes * (CARRIER_V[1] - CARRIER_V[0]) / 2
    basis = np.linalg.inv(chebyshev.chebvander(nodes, DEGREE))
    out = {}
    for temp in TEMPERATURES_DEGC:
        log_numbers = np.log([[exact_ring(float(e), float(c), temp) for e in carriers] for c in crefs])
        out[temp] = np.einsum("ai,ijk,bj->akb", basis, log_numbers, basis)
    return out


def rings(carrier_v, cref_f, temp_degc):
    """`Ring` of arrays of one shape (n,)."""
    u = chebyshev.chebvander(_chebyshev_argument(np.log(cref_f), *map(math.log, CREF_F)), DEGREE)
    v = chebyshev.chebvander(_chebyshev_argument(carrier_v, *CARRIER_V), DEGREE)
    at = (u @ _chebyshev_coefficients()[temp_degc].reshape(DEGREE + 1, -1)).reshape(len(u), -1, DEGREE + 1)
    return Ring(*np.exp(np.einsum("noj,nj->on", at, v)))

"""The ring diode's gain and delay as a polynomial in ln(Cref) and the carrier, so that a thousand boards cost nothing.

    gain, tau at one temperature   Chebyshev of degree DEGREE over ln(Cref) in CREF_F and carrier in CARRIER_V
    nodes                          `ring_diode.ring` itself, with the capacitances and diodes of the default board

Beyond the box a board is taken to be on its edge; the priors reach it with a probability below 1e-4.
Source    docs/inference.md, docs/parts/ring_diode.md
"""

import functools
import math

import numpy as np
from numpy.polynomial import chebyshev

from analog_frontend.parts import ring_diode
from analog_frontend.parts.device import Device

TEMPERATURES_DEGC = -20.0, 25.0, 50.0
CREF_F = 9e-12, 240e-12
CARRIER_V = 2.0, 8.0
DEGREE = 13


def _unit(x, lo, hi):
    return np.clip((2 * x - lo - hi) / (hi - lo), -1.0, 1.0)


@functools.cache
def _tables():
    """Chebyshev coefficients of ln(gain) and ln(tau) at each temperature, (n, 2 temperatures n)."""
    d = Device()
    nodes = chebyshev.chebpts1(DEGREE + 1)
    low, high = map(math.log, CREF_F)
    diode = ring_diode.Diode(*(getattr(d, f"diode_{name}") for name in ring_diode.Diode._fields))
    hz = d.carrier_hz * (1 + 1e-6 * d.carrier_ppm)
    found = np.empty((len(TEMPERATURES_DEGC), 2, DEGREE + 1, DEGREE + 1))
    for k, temp in enumerate(TEMPERATURES_DEGC):
        for i, u in enumerate(nodes):
            for j, v in enumerate(nodes):
                cref = math.exp((low + high) / 2 + u * (high - low) / 2)
                carrier = sum(CARRIER_V) / 2 + v * (CARRIER_V[1] - CARRIER_V[0]) / 2
                one = ring_diode.ring(carrier, hz, d.c0_f, d.cp_f, cref, diode, temp, d.temp_ref_degc)
                found[k, :, i, j] = math.log(one.gain_v_per_f), math.log(one.tau_s)
    basis = np.linalg.inv(chebyshev.chebvander(nodes, DEGREE))
    return np.moveaxis(basis @ found @ basis.T, 2, 0).reshape(DEGREE + 1, -1)


def rings(carrier_v, cref_f):
    """{temperature: (gain V/F, tau s)} of rings; arrays of one shape (n,)."""
    u = chebyshev.chebvander(_unit(np.log(cref_f), *map(math.log, CREF_F)), DEGREE)
    v = chebyshev.chebvander(_unit(carrier_v, *CARRIER_V), DEGREE)
    at = (u @ _tables()).reshape(len(u), len(TEMPERATURES_DEGC), 2, DEGREE + 1)
    found = np.exp(np.einsum("ntoj,nj->ton", at, v))
    return {temp: tuple(found[k]) for k, temp in enumerate(TEMPERATURES_DEGC)}

"""The C/V output of a ring that saturates: what is added to that of the plant's linear chain.

    linear  u = g G dC(t - tau)              a C/V output behind ring, amplifier and driver; g the signal gain
    ring    w = g V(dC) - g L(dC) dC'        V and L of ring_cycle.py, seen through the same amplifiers
    added   w - u = S(u) + M'(u) u'          S(u) = g V(dC) - u,   M(u) = g (tau V - int L)(dC),   dC = u/(g G)
            held over a tick: (S(u0) + S(u1))/2 + (M(u1) - M(u0))/h, from u at both of its ends

    z[CV_X], z[CV_Y] --u--+--------------------(+)--> SID
                          '--[S, M tables]--added^
ring_tables.py makes the tables. First order in what delays u: the second is (w tau)^2, 2e-4 of the part that is lost.
Beyond the tables, and between their temperatures: straight lines. Off: no table is read, bit for bit nothing.
Laws at the C/V ports still see u. Refused: the board `digital_sid`, gyroscopes side by side.
Port      cv_x, cv_y   Mechanism saturation   Unit V
Source    docs/plant.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.parts import propagator
from fpga_model.jit import inlined, kernel

INTERVALS = 32
COLUMNS = 8  # cubic of S, then that of M, in the part of an interval


class Params(NamedTuple):
    """Switch, temperatures of the tables, intervals per volt of u, and the cubics; the last is the line beyond."""

    on: int
    temp_lo_degc: float
    temp_step_k: float
    temp_count: int
    per_v: np.ndarray  # (temperatures, 2)
    cubics: np.ndarray  # (temperatures, 2, INTERVALS + 1, COLUMNS), V


OFF = Params(0, 0.0, 1.0, 1, np.zeros((1, 2)), np.zeros((1, 2, INTERVALS + 1, COLUMNS)))


@inlined
def locate(p, temp_degc):
    """Table below a temperature and the weight of the next."""
    return propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)


@inlined
def _odd(p, index, channel, u):
    """S and M of one table at `u`."""
    s = abs(u) * p.per_v[index, channel]
    k = INTERVALS
    if s < INTERVALS:  # not a number belongs to the line beyond
        k = int(s)
    s = s - k
    c = p.cubics[index, channel, k]
    static = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
    moving = c[4] + s * (c[5] + s * (c[6] + s * c[7]))
    return (static, moving) if u >= 0.0 else (-static, -moving)


@inlined
def saturation_terms(p, index, weight, channel, u):
    """S and M at an output voltage `u` of the linear chain, between two temperatures."""
    static, moving = _odd(p, index, channel, u)
    if weight > 0.0:
        static_1, moving_1 = _odd(p, index + 1, channel, u)
        static, moving = static + weight * (static_1 - static), moving + weight * (moving_1 - moving)
    return static, moving


@inlined
def volts(p, index, weight, channel, start_v, end_v):
    """What is added over a tick, from the linear chain's output at both of its ends."""
    static_0, moving_0 = saturation_terms(p, index, weight, channel, start_v)
    static_1, moving_1 = saturation_terms(p, index, weight, channel, end_v)
    return 0.5 * (static_0 + static_1) + (moving_1 - moving_0)


@kernel
def _fill_saturation_terms(p, index, weight, channel, u, static, moving):
    for k in range(len(u)):
        static[k], moving[k] = saturation_terms(p, index, weight, channel, u[k])


def saturated_output(p, temp_degc, channel, u):
    """(n,) C/V output at the first instants of consecutive ticks, from that of the linear chain."""
    index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    static, moving = np.empty(len(u)), np.empty(len(u))
    _fill_saturation_terms(p, index, weight, channel, np.ascontiguousarray(u), static, moving)
    return u + static + np.gradient(moving)

"""The synchronous demodulator without averaging: its response to a slowly modulated carrier, period by period.

    input     e^(j W t) sin(w t + a),  W the modulation      group 1 follows for half a period, group 2 for the other
    period    (capacitors, tones, integral of the output e^(-j W t)) by matrix exponentials; steady when a period
              multiplies everything by e^(j W T)
    answer    the output's component at W, beside  4/pi cos(a) / (1 + j W 2 RC)^3 of the averaged model

Source    docs/loop.md
"""

import math

import numpy as np
from scipy.linalg import expm

STAGES = 3


def averaged(f_hz, rc_s, angle_rad=0.0):
    """What the linear model takes: 4/pi and three poles at half the rate."""
    return 4 / math.pi * np.cos(angle_rad) / (1 + 2j * math.pi * np.asarray(f_hz) * 2 * rc_s) ** STAGES


def response(f_hz, carrier_hz, rc_s, angle_rad=0.0):
    """Output component (V/V) at the modulation frequency `f_hz` for a carrier late by `-angle_rad` of the reference."""
    w, modulation, half_s = 2 * math.pi * carrier_hz, 2 * math.pi * f_hz, 0.5 / carrier_hz
    # columns: 6 capacitors, two tones, integral
    size = 2 * STAGES + 3
    tones = (1j * (modulation + w), 1j * (modulation - w))
    weights = (np.exp(1j * angle_rad) / 2j, -np.exp(-1j * angle_rad) / 2j)
    maps = []
    for on in (0, STAGES):
        a = np.zeros((size, size), complex)
        for k in range(STAGES):
            a[on + k, on + k] = -1 / rc_s
            if k:
                a[on + k, on + k - 1] = 1 / rc_s
        a[on, 6:8] = np.array(weights) / rc_s
        a[6, 6], a[7, 7] = tones
        # the integral is kept in the frame that turns with the modulation
        a[8, 2], a[8, 5], a[8, 8] = 1.0, -1.0, 1j * modulation
        maps.append(expm(a * half_s))
    period = maps[1] @ maps[0]
    turn = np.exp(2j * modulation * half_s)
    tone = np.array([1.0, 1.0])
    caps = np.linalg.solve(turn * np.eye(6) - period[:6, :6], period[:6, 6:8] @ tone)
    integral = period[8, :6] @ caps + period[8, 6:8] @ tone
    return integral / turn / (2 * half_s)

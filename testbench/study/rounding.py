"""Rounding of a sine, in LSB: its error as a series, lines, mean and spectrum. Nothing here is simulated.

    q(x) = round(x) - x = sum over m of (-1)^m/(pi m) sin(2 pi m x)
    x = A sin t          harmonic n (odd):  c_n = sum over m of 2 (-1)^m/(pi m) J_n(2 pi m A);  in phase: n = 1
    A Gaussian, rms s    mean of c_1: each term times exp(-(2 pi m s)^2/2);  covariance at lag l, R of A:
                         sum over m of g_m^2/2 (exp(-(2 pi m)^2 (s^2 - R(l))) - exp(-(2 pi m)^2 s^2)),
                         g_m = 2/(pi m) sqrt(J_1^2 + Y_1^2)(2 pi m A), the envelope of J_1
    largest line         near n = 2 pi A, where J_n is at its first maximum: 0.675 n^(-1/3)

Source    docs/word_lengths.md
"""

import functools
import math

import numpy as np
from scipy.special import j1, jv, y1

ORDERS = np.arange(1, 61)
LINE_ORDERS = 12  # terms of the series in a line
REACH = 1.3  # times 2 pi A: the largest line of the first term, with room; those of later terms are smaller
AIRY = 0.6749  # largest value of J_n near its first maximum, times n^(1/3)
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(15)


def in_phase_error(amplitude, rms=0.0):
    """Mean in-phase error (LSB) of a rounded sine whose amplitude (LSB) has this rms."""
    damped = np.exp(-((2 * math.pi * ORDERS * rms) ** 2) / 2)
    terms = 2 * (-1.0) ** ORDERS / (math.pi * ORDERS) * j1(2 * math.pi * ORDERS * abs(amplitude))
    return math.copysign(float(terms @ damped), amplitude)


def error_density(amplitude, covariance, step_s):
    """One-sided density (LSB^2/Hz) at low frequency of the in-phase error; covariance[l] of the amplitude, lag l."""
    at = 2 * math.pi * ORDERS * max(abs(amplitude), 1e-3)
    power = (2 / (math.pi * ORDERS)) ** 2 * (j1(at) ** 2 + y1(at) ** 2) / 2
    kappa = (2 * math.pi * ORDERS) ** 2
    lag_terms = np.exp(-np.outer(covariance[0] - covariance, kappa)) - np.exp(-kappa * covariance[0])
    of_lag = lag_terms @ power
    return 2 * step_s * float(of_lag[0] + 2 * of_lag[1:].sum())


@functools.lru_cache(maxsize=64)
def rounding_harmonics(amplitude, rms=0.0):
    """(odd harmonics n from 3 on, their amplitudes (LSB)) of a rounded sine whose amplitude has this rms."""
    top = int(2 * math.pi * REACH * amplitude) + 10
    n = np.arange(3, top, 2)
    sizes = np.abs(amplitude + rms * NODES)
    harmonic_amplitudes = np.zeros(len(n))
    for m in range(1, LINE_ORDERS + 1):
        mean = WEIGHTS @ jv(n[None, :], 2 * math.pi * m * sizes[:, None]) / WEIGHTS.sum()
        harmonic_amplitudes += 2 * (-1.0) ** m / (math.pi * m) * mean
    return n, np.abs(harmonic_amplitudes)


def largest_line(amplitude):
    """Largest harmonic of a rounded sine by its own amplitude, far above one LSB and without noise."""
    n = 2 * math.pi * amplitude
    return 2 / math.pi * AIRY * n ** (-1 / 3) / amplitude

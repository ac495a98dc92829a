"""What the beating of reference edges on their grid leaves of a mean, from the frequency words that the host reads.

    edge     late by a saw of the grid's phase: sum over k of g/(pi k) sin(2 pi k t_edge/G), G the grid, g it in degrees
    k        at edges of both slopes (2 theta whole) turns by 2 pi k t/G - 2 pi m 2 theta(t), m the nearest whole: slow
             if k/G is near m 2 f; frames are whole multiples of G, so at frame n the phase is -4 pi m theta(n)
    left     rms over the phase that nobody knows: sqrt(sum (g/(pi k) |C_k|)^2 / 2), C_k the mean of exp(i phase)

theta(n) is the sum of the words of the record, so the loop's own wandering is in it. sgn(cos) has the sign of (-1)^m:
the mean of both has even m alone.
Source    docs/paper.md
"""

import math

import numpy as np

from fpga_model.rates import FRAME_TICKS, MASTER_HZ, TICK_CYCLES

FRAME_CLOCKS = FRAME_TICKS * TICK_CYCLES
TURN_BITS = 48
HARMONICS = 4000  # beyond: g/(pi k) is 0.3 mdeg for one of them, on the 1 MHz grid
NEAR_HZ = 200.0  # faster beats leave nothing of a mean over a second
EVERY = 16  # frames; 500 Hz


def left_deg(words, weights, grid_clocks, both=False):
    """Standard deviation (deg) that the grid leaves of the weighted mean of a reference's edges.

    words        frequency words, one a frame; weights of the same frames
    grid_clocks  period of the grid in clocks
    both         the mean of sgn(sin) and sgn(cos)
    """
    words = np.asarray(words, np.int64)
    f = float(words.mean()) * MASTER_HZ / 2**TURN_BITS
    grid_hz = MASTER_HZ / grid_clocks
    k = np.arange(1, HARMONICS + 1)
    m = np.round(k * grid_hz / (2 * f)).astype(np.int64)
    slow = np.abs(k * grid_hz - m * 2 * f) < NEAR_HZ
    if both:
        slow &= m % 2 == 0
    theta = np.cumsum(words * FRAME_CLOCKS)[::EVERY]  # wraps at 2^64, a multiple of a turn
    share = np.asarray(weights, float)[::EVERY]
    share = share / share.sum()
    sizes = []
    for order, number in zip(k[slow], m[slow]):
        phase = (2 * number * theta & (1 << TURN_BITS) - 1) / 2.0**TURN_BITS
        sizes.append(abs(share @ np.exp(-2j * math.pi * phase)) / order)
    return 360.0 * f / grid_hz / math.pi * math.sqrt(sum(s * s for s in sizes) / 2)


def hann(n):
    """Weights of a record of n frames."""
    return np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2

"""Allan deviation of a rate record: angle random walk, bias instability with confidence.

    adev(tau)   overlapping, tau = m t0
    fit         adev^2 = N^2/tau + (0.664 B)^2, neither below zero, over FIT_S, weighted by the degrees of freedom;
                white rate noise of one-sided density S has N = sqrt(S/2), flicker S = h/f has 0.664 B = sqrt(2 ln 2 h)
    edf         of flicker frequency noise: 5 n^2 / (4 m (n + 3 m)); limits from chi-squared
    floor       the least deviation, with its limits, beside the fit

Units       rate in deg/s in, N in deg/sqrt(h), floor in deg/h
Source      IEEE Std 647 annex C; NIST SP 1065 tables 5 and 6; docs/paper.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

BASE_FRAMES = 80  # 10 ms
FIT_S = (0.3, 100.0)
FLICKER = math.sqrt(2 * math.log(2) / math.pi)  # 0.664
LIMIT = 0.6827
LEAST_S = 4.0  # shortest record
LEAST = 1e-30  # (deg/s)^2: the weights of a record that does not move at all


class Allan(NamedTuple):
    """A record's Allan deviation, and what it says."""

    tau_s: tuple
    adev_dps: tuple
    arw_deg_per_rt_h: float
    instability_deg_per_h: float  # of the fit, 0.664 B
    floor_deg_per_h: float  # least deviation
    floor_low_deg_per_h: float
    floor_high_deg_per_h: float
    floor_tau_s: float
    relative_sigma: tuple  # of each deviation


def overlapping_allan_deviation(rate, m):
    """Overlapping Allan deviation over m values; needs 2 m + 1 of them."""
    x = np.concatenate([[0.0], np.cumsum(rate - np.mean(rate))])
    second = x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]
    return math.sqrt(second @ second / (2 * len(second))) / m


def degrees_of_freedom(n, m):
    """Equivalent degrees of freedom of the overlapping estimate of flicker frequency noise from n phase points."""
    if m == 1:
        return 2.0 * (n - 2) ** 2 / (2.3 * n - 4.9)
    return 5.0 * n**2 / (4.0 * m * (n + 3.0 * m))


def analyse(rate_dps, base_s):
    """`Allan` of a record of rates (deg/s), one value per `base_s`; needs at least 4 s."""
    n = len(rate_dps)
    if n * base_s < LEAST_S:
        raise ValueError(f"Allan deviation: {n * base_s:g} s of record is below the limit {LEAST_S:g} s")
    longest = int(math.log2(n // 5))
    counts = sorted({round(2 ** (k / 2)) for k in range(2 * longest + 1)})
    tau = np.array(counts) * base_s
    dev = np.array([overlapping_allan_deviation(np.asarray(rate_dps, float), m) for m in counts])
    edf = np.array([degrees_of_freedom(n + 1, m) for m in counts])
    use = (tau >= FIT_S[0]) & (tau <= FIT_S[1])
    # weighted by what each deviation squared is worth; twice, because the weight needs the answer
    basis = np.stack([1 / tau[use], np.ones(use.sum())], axis=1)
    level = dev[use] ** 2
    for _ in range(3):
        w = np.sqrt(edf[use] / 2) / np.maximum(level, LEAST)
        square, floor = optimize.nnls(basis * w[:, None], dev[use] ** 2 * w)[0]
        level = square / tau[use] + floor
    least = int(np.argmin(dev))
    low, high = stats.chi2.ppf([(1 + LIMIT) / 2, (1 - LIMIT) / 2], edf[least])
    hour = 3600.0
    return Allan(
        tuple(tau.tolist()),
        tuple(dev.tolist()),
        math.sqrt(square) * math.sqrt(hour),
        math.sqrt(floor) * hour,
        float(dev[least]) * hour,
        float(dev[least]) * math.sqrt(edf[least] / low) * hour,
        float(dev[least]) * math.sqrt(edf[least] / high) * hour,
        float(tau[least]),
        tuple(np.sqrt(0.5 / edf).tolist()),
    )


def average_row_blocks(words, frames=BASE_FRAMES):
    """Means of `frames` rows each; the rest is dropped."""
    used_length = len(words) // frames * frames
    return words[:used_length].reshape(-1, frames).mean(axis=1)

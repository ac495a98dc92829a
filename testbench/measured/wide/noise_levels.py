"""Level of the 1/f noise of the demodulators, from what repeats of a condition differ by.

    W + s^2 F   covariance of the features that show slow noise: all other noise, and 1/f noise of the declared level.
                Power-ons of the averaged plant say both; F by one noise with and without it, without slips of edges
    s           likeliest by the differences of the repeats, with a prior within a factor of 2 of the declared level,
                and never below that
An effect is alike in all repeats, so it is not taken for noise.
Source    docs/wide_priors.md
"""

import numpy as np
from scipy.linalg import helmert

from testbench import config as configuration
from testbench.measured.closed_loop.loop_difference_plant import disable_retiming
from testbench.measured.closed_loop.loop_runs import NAMES

KEY = "plant.sid_flicker_v_per_rthz"
SLOW, BINS = ("force", "v_q2"), 3  # observables and longest bins of a dwell where it shows
DRAWS = 16  # power-ons of each condition
LEVELS = np.exp(np.linspace(0.0, np.log(10.0), 60))
PRIOR = np.log(2.0)  # sd of the logarithm of a level
REPORT_GAIN = 16.0  # gain of -2 ln of the posterior over the declared level: four sigmas, for W and F are of few draws


def fit_flicker_level(loop, cfg):
    """(configuration with the level, lines) of an `AveragedLoop` at the board of a configuration."""
    bins = min(BINS, *(rows.shape[1] // len(NAMES) for rows in loop.recorded))
    # orthonormal contrasts of n repeats: n - 1 rows with the variance of one
    contrasts = [helmert(len(rows)) @ _slow(rows, bins) for rows in loop.recorded]
    declared = cfg.plant.sid_flicker_v_per_rthz
    if not any(map(len, contrasts)) or not declared or not cfg.noise.flicker:
        return cfg, ()

    def simulate_slow_features(of):
        return np.stack([_slow(rows, bins) for rows in loop.power_ons(of, DRAWS)])

    flicker_free = configuration.changed(cfg, {KEY: 0.0})
    other_noise_draws = simulate_slow_features(flicker_free)
    flicker = simulate_slow_features(disable_retiming(cfg)) - simulate_slow_features(disable_retiming(flicker_free))
    other_noise_draws -= other_noise_draws.mean(axis=1, keepdims=True)
    level, gain = likeliest(contrasts, covariances(other_noise_draws), covariances(flicker))
    level_text = (
        f"noise: 1/f noise of the demodulators is {level:.2g} times the declared level, estimated from the repeats"
    )
    return configuration.changed(cfg, {KEY: level * declared}), (level_text,) if gain > REPORT_GAIN else ()


def likeliest(contrasts, other_covariances, flicker):
    """(level s, its gain over 1 in -2 ln) of rows of each condition; covariances (conditions, n, n)."""
    cost = (np.log(LEVELS) / PRIOR) ** 2
    for rows, w, f in zip(contrasts, other_covariances, flicker):
        # a code at its limit does not scatter, and tells nothing
        if not np.all(np.diag(w)):
            continue
        c = w + LEVELS[:, None, None] ** 2 * f
        cost += len(rows) * np.linalg.slogdet(c)[1] + np.sum(rows.T * np.linalg.solve(c, rows.T), axis=(1, 2))
    best = int(np.argmin(cost))
    return float(LEVELS[best]), float(cost[0] - cost[best])


def covariances(draws):
    """Second moments (conditions, n, n) of draws about zero; the conditions share their correlations."""
    sd = np.sqrt(np.mean(draws**2, axis=1))
    z = draws / np.where(sd == 0, 1.0, sd)[:, None]
    shared = np.einsum("cdi,cdj->ij", z, z) / np.prod(z.shape[:2])
    return shared * sd[:, :, None] * sd[:, None, :]


def _slow(rows, bins):
    """(..., n) of (..., features)."""
    each = rows.reshape(*rows.shape[:-1], len(NAMES), -1)[..., [NAMES.index(name) for name in SLOW], -bins:]
    return each.reshape(*rows.shape[:-1], -1)

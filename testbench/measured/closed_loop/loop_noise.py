"""Noise of a closed loop's features: every power-on has a drive frequency and a phase of its own.

    jitter   draw k is moved by jitter_hz(k), quantiles of a normal scatter JITTER_HZ wide
    noise    covariance of draws less what their jitter does, plus that of the jitter
    R        of its correlations: w R_own + (1 - w) R_pooled, w = UNPOOLED_WEIGHT: edges slip otherwise in each one
    level    one factor, so that the draws have unit variance in their own noise: R does not give them that
    gain     data are not among the draws that made the noise, and larger by 1 / gain
    along    mean square of draws left out along the laws, in units of that over all directions: weights by R favour
             directions where R is too small by chance, so estimates scatter more than it says
Source    Dodelson & Schneider, Phys. Rev. D 88 (2013); docs/measured.md
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import norm

from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_runs

JITTER_HZ = 1e-3
NOISE_DRAWS = 64  # of the averaged plant, per condition
UNPOOLED_WEIGHT = 0.3  # the likeliest of draws left out
FOLDS = 8
# quantiles in random order: their variance is that of the scatter, not that of 64 draws of it
JITTER = np.random.default_rng(3).permutation(norm.ppf((np.arange(NOISE_DRAWS) + 0.5) / NOISE_DRAWS))
JITTER *= JITTER_HZ / np.sqrt(np.mean(JITTER**2))
LATER = np.random.default_rng(4).integers(loop_runs.MOST_DELAY_FRAMES, size=NOISE_DRAWS)


class Noise(NamedTuple):
    """Covariance of a condition's features: sigma, and the Cholesky factor of correlations times the level's square."""

    sigma: np.ndarray
    chol: np.ndarray


def jitter_hz(draw):
    """Shift of the drive frequency that belongs to a draw."""
    return float(JITTER[draw])


def estimate_noise(draws, draw_shifts_hz=JITTER):
    """{condition: Noise} of {condition: ((draws, n), change per hertz)}; draw_shifts_hz: jitter of each.

    The scatter of the power-ons is what it is; correlations of the rest are shared among conditions of one length.
    """
    pools, sigma, scaled = {}, {}, {}
    jitter = draw_shifts_hz - np.mean(draw_shifts_hz)
    for name, (rows, slope) in draws.items():
        jitter_free_rows = rows - rows.mean(axis=0) - np.outer(jitter, slope)
        sd = jitter_free_rows.std(axis=0, ddof=1)
        least = 0.1 * np.median(sd.reshape(len(loop_runs.NAMES), -1), axis=1)
        sigma[name] = np.maximum(sd, np.repeat(np.maximum(least, 1e-300), len(sd) // len(loop_runs.NAMES)))
        scaled[name] = jitter_free_rows / sigma[name]
        pools.setdefault(rows.shape[1], []).append(scaled[name])
    out = {}
    for name, (rows, slope) in draws.items():
        n, z = rows.shape[1], np.concatenate(pools[rows.shape[1]])
        dof = len(z) - len(pools[n])
        if dof < n + 10:
            raise ConfigError(
                f"noise of {name}: {dof} deviations for {n} features, {n + 10} are needed; use more draws or fewer bins"
            )
        r = UNPOOLED_WEIGHT * scaled[name].T @ scaled[name] / (len(rows) - 1) + (1 - UNPOOLED_WEIGHT) * z.T @ z / dof
        c = r * np.outer(sigma[name], sigma[name]) + JITTER_HZ**2 * np.outer(slope, slope)
        total_sigma = np.sqrt(np.diag(c))
        out[name] = Noise(total_sigma, np.linalg.cholesky(c / np.outer(total_sigma, total_sigma)))
    level = np.sqrt(_mean_square(out, {k: deviations(rows) for k, (rows, _) in draws.items()}))
    return {name: n._replace(chol=level * n.chol) for name, n in out.items()}


def cross_validation_folds(draws):
    """FOLDS times: {condition: Noise} without some draws, {condition: (n, features)} of those less the others' mean."""
    count = len(next(iter(draws.values()))[0])
    for fold in range(FOLDS):
        out = np.arange(count) % FOLDS == fold
        training = {k: (rows[~out], slope) for k, (rows, slope) in draws.items()}
        size = np.sqrt(1 + 1 / np.sum(~out))
        excluded = {k: (v[out] - v[~out].mean(axis=0)) / size for k, (v, _) in draws.items()}
        yield estimate_noise(training, JITTER[~out]), excluded


def compute_noise_gain(draws):
    """Factor on whitened data that makes them as large as the draws are which the noise is made of.

    Those are inside their own covariance, data are not: 1 over the rms of draws left out, FOLDS times.
    """
    return float(1 / np.sqrt(np.mean([_mean_square(noise, rows) for noise, rows in cross_validation_folds(draws)])))


def deviations(rows):
    """(draws, n) about their mean, as large as about the true one."""
    return (rows - rows.mean(axis=0)) * np.sqrt(len(rows) / (len(rows) - 1))


def _mean_square(noise, deviations):
    """Mean square of whitened deviations {condition: (n, features)}."""
    scaled = {k: solve_triangular(n.chol, (deviations[k] / n.sigma).T, lower=True) for k, n in noise.items()}
    return float(np.mean([np.mean(z**2) for z in scaled.values()]))

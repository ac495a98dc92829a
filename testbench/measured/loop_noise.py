"""Noise of a closed loop's features: every power-on has a drive frequency and a phase of its own.

    jitter   draw k is moved by jitter_hz(k), quantiles of a normal scatter JITTER_HZ wide
    noise    covariance of draws less what their jitter does, plus that of the jitter; correlations pooled
Source    docs/measured.md
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from testbench.errors import ConfigError
from testbench.measured import loop_runs

JITTER_HZ = 1e-3
NOISE_DRAWS = 64  # of the averaged plant, per condition
# quantiles in random order: their variance is that of the scatter, not that of 64 draws of it
JITTER = np.random.default_rng(3).permutation(norm.ppf((np.arange(NOISE_DRAWS) + 0.5) / NOISE_DRAWS))
JITTER *= JITTER_HZ / np.sqrt(np.mean(JITTER**2))
LATER = np.random.default_rng(4).integers(loop_runs.LATE, size=NOISE_DRAWS)


class Noise(NamedTuple):
    """Covariance of a condition's features as sigma and the Cholesky factor of the correlations."""

    sigma: np.ndarray
    chol: np.ndarray


def jitter_hz(draw):
    """Shift of the drive frequency that belongs to a draw."""
    return float(JITTER[draw])


def noise_of(draws):
    """{condition: Noise} of {condition: ((draws, n), change per hertz)}.

    The scatter of the power-ons is what it is; correlations of the rest are pooled over conditions of one length.
    """
    pools, sigma = {}, {}
    jitter = JITTER - JITTER.mean()
    for name, (rows, slope) in draws.items():
        rest = rows - rows.mean(axis=0) - np.outer(jitter, slope)
        own = rest.std(axis=0, ddof=1)
        least = 0.1 * np.median(own.reshape(len(loop_runs.NAMES), -1), axis=1)
        sigma[name] = np.maximum(own, np.repeat(np.maximum(least, 1e-300), len(own) // len(loop_runs.NAMES)))
        pools.setdefault(rows.shape[1], []).append(rest / sigma[name])
    out = {}
    for name, (rows, slope) in draws.items():
        n = rows.shape[1]
        z = np.concatenate(pools[n])
        dof = len(z) - len(pools[n])
        if dof < n + 10:
            raise ConfigError(
                f"noise of {name}: {dof} deviations for {n} features; more draws or fewer bins are needed"
            )
        # its inverse is too large in the mean: the core takes that out (noise_estimated_from), so it is not done here
        c = z.T @ z / dof * np.outer(sigma[name], sigma[name]) + JITTER_HZ**2 * np.outer(slope, slope)
        whole = np.sqrt(np.diag(c))
        out[name] = Noise(whole, np.linalg.cholesky(c / np.outer(whole, whole)))
    return out

"""The noise of features, from repeats of the same condition alone: pure error, no noise model.

    deviation   of a repeat from the mean of its group: G groups of R repeats have G (R - 1) of them
    variance    of an observable over a bin of so many frames, pooled over all groups that have such a bin
    correlation of the bins of an observable, pooled, and drawn towards none: weight bins / (bins + deviations)

A variance is never below (a tenth of the median sigma of its observable)^2: saturated or quantised bins have none.
Source    docs/measured.md
"""

from typing import NamedTuple

import numpy as np

LEAST_SIGMA = 0.1  # of the observable's median


class Group(NamedTuple):
    """Features of the repeats of a condition: (repeats, observables, bins), and the bins' widths in frames."""

    name: str
    values: np.ndarray
    widths: np.ndarray


class Floor(NamedTuple):
    """Noise of single repeats."""

    sigma: dict  # group: (observables, bins)
    correlation: dict  # number of bins: (observables, bins, bins)
    dof: int  # deviations that it rests on

    def whiten_group(self, group, values):
        """(observables, bins) whose noise is that of one repeat, in units of independent sigmas."""
        sigma, correlation = self.sigma[group], self.correlation[values.shape[-1]]
        scaled = values / sigma
        return np.stack([np.linalg.solve(np.linalg.cholesky(c), row) for c, row in zip(correlation, scaled)])


def estimate_noise_floor(groups):
    """`Floor` of groups with two repeats or more; ValueError if there is none."""
    repeated = [g for g in groups if len(g.values) >= 2]
    if not repeated:
        raise ValueError("noise floor: needs a condition with 2 repeats or more, found none")
    observables = repeated[0].values.shape[1]
    sums, counts, dof = {}, {}, 0
    for g in repeated:
        spread = g.values - g.values.mean(axis=0)
        squares = (spread**2).sum(axis=0)
        dof += len(g.values) - 1
        for k, width in enumerate(g.widths.tolist()):
            sums[width] = sums.get(width, 0.0) + squares[:, k]
            counts[width] = counts.get(width, 0) + len(g.values) - 1
    variance = {width: sums[width] / counts[width] for width in sums}
    median = np.median(np.sqrt(np.stack(list(variance.values()))), axis=0)
    least = np.where(median > 0, LEAST_SIGMA * median, 1.0)
    sigma = {}
    for g in groups:
        rows = [_nearest(variance, width) for width in g.widths.tolist()]
        sigma[g.name] = np.maximum(np.sqrt(np.stack(rows, axis=1)), least[:, None])
    return Floor(sigma, _correlations(groups, repeated, sigma, observables), dof)


def _nearest(variance, width):
    """Variance for a bin of `width` frames: of the nearest width that was repeated."""
    return variance[min(variance, key=lambda known: abs(np.log(known / width)))]


def _correlations(groups, repeated, sigma, observables):
    out = {}
    for count in {len(g.widths) for g in groups}:
        total, number = np.zeros((observables, count, count)), 0
        for g in repeated:
            if len(g.widths) == count:
                z = (g.values - g.values.mean(axis=0)) / sigma[g.name]
                total += np.einsum("rob,roc->obc", z, z)
                number += len(g.values) - 1
        shrink = count / (count + number)
        identity = np.eye(count)
        scale = np.sqrt(np.maximum(np.einsum("obb->ob", total), 1e-300))
        pooled = total / (scale[:, :, None] * scale[:, None, :])
        pooled[:, range(count), range(count)] = 1.0
        out[count] = (1 - shrink) * pooled + shrink * identity
    return out

"""A problem whose prediction is a sum of known columns: y_k = sum_j theta_j A_kj + sum_l c_l B_kl, and its noise.

    Noise objects   whiten(v): unit variance and white; draws(count, rng): (n, count); sd: (n,) rms of each feature
    diagonal        independent features of known sd
    dense           any covariance, up to a few thousand features
    common          channels x points, own sd of each channel and one error that all channels see

Nothing here knows what the part is.
"""

import copy
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from testbench.measured.models.part_problem import PartProblem
from testbench.tracing.problem.problem import PredictionFailed, Segment


class Diagonal:
    """Independent features."""

    def __init__(self, sd):
        self.sd = np.asarray(sd, float)

    def whiten(self, v):
        return v / (self.sd if v.ndim == 1 else self.sd[:, None])

    def draws(self, count, rng):
        return (self.sd * rng.normal(size=(count, len(self.sd)))).T


class Dense:
    """Features of any covariance (n, n)."""

    def __init__(self, covariance):
        self.root = np.linalg.cholesky(covariance)
        self.sd = np.sqrt(np.diag(covariance))

    def whiten(self, v):
        return solve_triangular(self.root, v, lower=True)

    def draws(self, count, rng):
        return self.root @ rng.normal(size=(count, len(self.sd))).T


class Common:
    """`channels` blocks of `points` features; at a point the covariance is diag(own^2) + common^2 (all ones).

    own     (channels, points);  common  (points,)
    """

    def __init__(self, channel_sd, common):
        self.own, self.common = np.asarray(channel_sd, float), np.asarray(common, float)
        self.shape = self.own.shape
        channels = self.shape[0]
        covariance = np.einsum("cp,cd->pcd", self.own**2, np.eye(channels)) + (self.common**2)[:, None, None]
        value, vector = np.linalg.eigh(covariance)
        self._root = np.einsum("pij,pj,pkj->pik", vector, value**-0.5, vector)
        self.sd = np.sqrt(self.own**2 + self.common**2).ravel()

    def whiten(self, v):
        w = v.reshape(*self.shape, -1)
        return np.einsum("pcd,dpk->cpk", self._root, w).reshape(v.shape)

    def draws(self, count, rng):
        channels, points = self.shape
        unit = rng.normal(size=(count, channels + 1, points))
        return (self.own * unit[:, :-1] + self.common * unit[:, -1:]).reshape(count, -1).T


def observable_noise_rms(noise, segment):
    """{observable: rms} of a segment with a noise object."""
    return {o.name: float(np.sqrt(np.mean(noise.sd[o.rows] ** 2))) for o in segment.observables}


class Stretch(NamedTuple):
    """One segment of a linear problem: what it is, its features and their noise object."""

    segment: Segment
    data: np.ndarray
    noise: object


class LinearProblem(PartProblem, adds="noise columns"):
    """Problem of the tracing core. `columns`: {nuisance or law: [(n_k,) per stretch]}; axis: function, or None."""

    def __init__(self, name, nuisances, laws, stretches, columns, hashes, axis=None):
        self.name, self.nuisances, self.laws = name, tuple(nuisances), tuple(laws)
        self.segments, self._data, self.noise = zip(*stretches)
        self.hashes, self.columns, self._axis = dict(hashes), columns, axis
        self.linear_in = frozenset([n.name for n in nuisances] + [law.name for law in laws])
        self._theta = [
            np.stack([columns[n.name][k] for n in nuisances], axis=1) if nuisances else np.zeros((len(y), 0))
            for k, y in enumerate(self._data)
        ]

    def axis(self, segment, observable):
        return self._axis(segment) if self._axis else None

    def observed_features(self, k):
        return self._data[k]

    def predict(self, points, which):
        predictions = []
        for theta, effects in points:
            parts = []
            for k in which:
                y = self._theta[k] @ np.asarray(theta, float)
                for name, c in effects.items():
                    y = y + c * self.columns[name][k]
                if not np.all(np.isfinite(y)):
                    raise PredictionFailed("coefficients without bound")
                parts.append(y)
            predictions.append(parts)
        return predictions

    def whiten(self, k, v):
        return self.noise[k].whiten(v)

    def noise_draw(self, k, rng):
        return self.noise_draws(k, 1, rng)[:, 0]

    def noise_draws(self, k, count, rng):
        return self.noise[k].draws(count, rng)

    def repeatability_rms(self, k):
        return observable_noise_rms(self.noise[k], self.segments[k])

    def replace_data(self, data):
        new_problem = copy.copy(self)
        new_problem._data = tuple(data)
        return new_problem

"""The whitened space of all groups of a role: one mean per group, and the contrasts between its repeats.

    mean       z_g = w_g W_g (mean_r y_gr - mu_g), w_g = sqrt(R_g / (1 + a R_g))     unit variance if the declared noise
               is true; a: variance of mu_g itself in units of a repeat's, 0 unless the problem says so
    contrasts  d_gc = W_g sum_r h_cr y_gr, c = 1 .. R_g - 1      the same noise, and nothing that repeats
h are Helmert's orthonormal contrasts. Contrasts stay in declared units: refined by themselves they would no longer be
like the mean. Rows of all groups are stacked; a block is one observable in one group.
Source    Hartlap, Simon & Schneider, Astron. Astrophys. 464 (2007); docs/tracing.md
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import helmert

from testbench.errors import ConfigError


class Block(NamedTuple):
    """Rows of one observable of one group, in the stacked vector, in time order."""

    group: int
    observable: str
    rows: slice


class Group(NamedTuple):
    """Repeats of one condition."""

    name: str
    condition: dict
    members: tuple  # segments
    rows: slice  # in the stacked vector


def _group_blocks(problem, k, rows, group, start):
    segment = problem.segments[k]
    observable_rows = problem.whitened_rows(k)
    if observable_rows is not None:
        return [Block(group, o, slice(start + s.start, start + s.stop)) for o, s in observable_rows.items()]
    features = len(problem.observed_features(k))
    covered = sum(len(range(*o.rows.indices(features))) for o in segment.observables)
    if rows == features == covered and all(o.rows.step in (None, 1) for o in segment.observables):
        spans = [(o.name, *o.rows.indices(features)[:2]) for o in segment.observables]
        return [Block(group, name, slice(start + a, start + b)) for name, a, b in spans if b > a]
    return [Block(group, "all", slice(start, start + rows))]


def _gain(problem):
    """Factor on whitened rows if the covariance was estimated: Hartlap's, or the problem's own `noise_gain`."""
    if problem.noise_gain is not None:
        return problem.noise_gain
    if problem.noise_estimated_from is None:
        return 1.0
    deviations, features = problem.noise_estimated_from
    if deviations <= features + 2:
        raise ConfigError(
            f"{problem.name}: noise of {features} features is estimated from {deviations} deviations, "
            f"at least {features + 3} are needed"
        )
    return float(np.sqrt((deviations - features - 2) / (deviations - 1)))


class Space:
    """Groups of the segments with one role ("fit" or "validate"; None: all)."""

    def __init__(self, problem, role, noise=None):
        """noise: `noise.Noise` whose variance ratios whiten everything again; None: the declared noise."""
        self.problem, self.role = problem, role
        self.refine = self.declared = lambda v: v  # `declared` undoes `refine`
        self.gain = _gain(problem)
        members = {}
        for k, s in enumerate(problem.segments):
            if role in (s.role, None):
                members.setdefault(s.group, []).append(k)
        self.groups, self.blocks, self.contrasts, self._means, start = [], [], [], [], 0
        for name, ks in members.items():
            y = np.stack([np.asarray(problem.observed_features(k), float) for k in ks])
            mean = self.whiten_rows(ks[0], y.mean(axis=0))
            rows = slice(start, start + len(mean))
            self.blocks += _group_blocks(problem, ks[0], len(mean), len(self.groups), start)
            self.groups.append(Group(name, dict(problem.segments[ks[0]].condition), tuple(ks), rows))
            self._means.append(y.mean(axis=0))
            if len(ks) > 1:
                self.contrasts.append(self.whiten_rows(ks[0], (helmert(len(ks)) @ y).T).T)
            else:
                self.contrasts.append(np.zeros((0, len(mean))))
            start = rows.stop
        self.size = start
        self.which = tuple(g.members[0] for g in self.groups)
        self.repeats = np.array([len(g.members) for g in self.groups], int)
        self.weights = np.sqrt(self.repeats / (1 + problem.prediction_noise * self.repeats))
        if noise is not None and noise.octaves:
            self.refine, self.declared = noise.whitener(self), noise.whitener(self, 0.5)

    def whiten_rows(self, k, v):
        """Whitened by the declared noise of segment k; what is not finite is refused."""
        w = np.asarray(self.problem.whiten(k, v), float) * self.gain
        if not np.all(np.isfinite(w)):
            name = self.problem.segments[k].name
            raise ConfigError(f"segment {name}: whitened features are not finite: is there a variance of zero?")
        return w

    def residual(self, prediction):
        """Stacked z of a prediction (list of arrays, one per group)."""
        return self.whitened_change(self._means, prediction)

    def whitened_change(self, prediction, other):
        """Stacked whitened difference prediction - other: a column of a Jacobian before division."""
        parts = [
            w * self.whiten_rows(g.members[0], a - b)
            for g, w, a, b in zip(self.groups, self.weights, prediction, other)
        ]
        return self.refine(np.concatenate(parts)) if parts else np.zeros(0)

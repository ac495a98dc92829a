"""Ranking of laws by their projected, whitened signatures: what is left of each when the nuisances have taken theirs.

    A = [J; prior rows] = Q R       P v = v - Q Q' v       s_k = W dmu/dc_k
    d_k per unit = |P s_k|          t_k = s_k' P z / |P s_k|      c_k = t_k / |P s_k|, sd 1 / |P s_k|
    Gram G_kl = s_k' P s_l          cosine C_kl = G_kl / sqrt(G_kk G_ll)
t has unit variance when nothing is missing; d of an effect c is |c| |P s|. Sets of laws come from the same G.
Source    Ljung, System Identification (1999), 16.6 (Rao's score test); docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.problem.model import law_step, tangents
from testbench.tracing.problem.problem import all_laws

BENT = 1.0  # sigmas, over all rows
HIDDEN = 1e-6  # share of a signature's length below which the nuisances have taken all of it


class Projection:
    """P of a Jacobian with its prior rows; vectors are stacked rows without the prior's."""

    def __init__(self, jacobian, prior_columns):
        a = np.concatenate([jacobian, prior_columns])
        self.rows, self.priors = len(jacobian), len(prior_columns)
        scale = np.linalg.norm(a, axis=0)
        u, s, _ = np.linalg.svd(a / np.where(scale > 0, scale, 1.0), full_matrices=False)
        self.q = u[:, s > 1e-10 * max(s.max(initial=0.0), 1e-300)]

    def project_with_priors(self, v, prior=None):
        """P of [v; prior] with the prior's rows still there; columns stay columns."""
        prior_rows = np.zeros((self.priors, *v.shape[1:])) if prior is None else prior
        stacked_rows = np.concatenate([v, prior_rows])
        return stacked_rows - self.q @ (self.q.T @ stacked_rows)

    def __call__(self, v, prior=None):
        return self.project_with_priors(v, prior)[: self.rows]


class Ranking(NamedTuple):
    """Scores of laws at a fit, in the order of `names`."""

    names: tuple
    signatures: np.ndarray  # (rows, laws), not projected
    projected: np.ndarray  # (rows + priors, laws)
    gram: np.ndarray
    b: np.ndarray  # s' P z
    length: np.ndarray  # |P s|: d per unit of coefficient
    t: np.ndarray
    hidden: tuple  # laws that the nuisances imitate or the data do not see
    failed: tuple  # laws that could not be predicted

    @property
    def cosines(self):
        scale = np.where(self.length > 0, self.length, 1.0)
        return self.gram / np.outer(scale, scale)

    def index(self, name):
        return self.names.index(name)


def signatures(fit, names):
    """Whitened d(prediction)/dc at a fit of laws that are not in it, (rows, laws); nan columns: not predictable."""
    model, laws_by_name = fit.model, all_laws(fit.model.problem)
    laws = [laws_by_name[name] for name in names]
    steps = [law_step(law, model.problem) for law in laws]

    def point_at(j, step):
        return fit.point.theta, model.effects(fit.point) | {laws[j].name: step}

    first, fixed = [s for s, _ in steps], [f for _, f in steps]
    return tangents(model.space, model.predictor, fit.prediction, point_at, first, fixed)


class Signatures:
    """Signatures at fits, computed once; those of the base fit serve for fits that hardly bend away from it."""

    def __init__(self, base):
        self.base, self._cache = base, {}

    def signature_columns(self, fit, names):
        """(rows, laws) at a fit, or at the base fit if the model is as good as linear between them."""
        source = self.base if fit.bend < BENT else fit
        key = (source.model.names, source.point.theta.tobytes(), source.point.c.tobytes())
        missing = [n for n in names if (key, n) not in self._cache]
        if missing:
            new_columns = signatures(source, missing)
            self._cache |= {(key, n): new_columns[:, i] for i, n in enumerate(missing)}
        columns = [self._cache[key, n] for n in names]
        return np.stack(columns, axis=1) if columns else np.zeros((fit.model.space.size, 0))


def prior_z(fit):
    return fit.model.prior_rows(fit.point)


def rank(fit, names, columns, projection=None, z=None):
    """`Ranking` of laws at a fit; `columns` are their signatures (whitened as z is)."""
    projection = projection or Projection(fit.jacobian, fit.model.prior_columns())
    z = fit.z if z is None else z
    good = np.isfinite(columns).all(axis=0)
    failed = tuple(n for n, ok in zip(names, good) if not ok)
    names, columns = tuple(n for n, ok in zip(names, good) if ok), columns[:, good]
    projected = projection.project_with_priors(columns)
    residual = projection.project_with_priors(z[:, None], prior_z(fit)[:, None])[:, 0]
    length, unprojected_length = np.linalg.norm(projected, axis=0), np.linalg.norm(columns, axis=0)
    is_visible = (length > HIDDEN * unprojected_length) & (unprojected_length > 0)
    hidden = tuple(n for n, ok in zip(names, is_visible) if not ok)
    length = np.where(is_visible, length, 0.0)
    b = np.where(is_visible, projected.T @ residual, 0.0)
    t = np.divide(b, length, out=np.zeros_like(b), where=length > 0)
    gram = projected.T @ projected
    return Ranking(names, columns, projected, gram, b, length, t, hidden, failed)


def one_sided(ranking, laws):
    """t with the sign constraint of each law: what points to the forbidden side counts as nothing."""
    sign = np.array([laws[name].sign for name in ranking.names])
    return np.where(sign == 0, np.abs(ranking.t), np.maximum(sign * ranking.t, 0.0))

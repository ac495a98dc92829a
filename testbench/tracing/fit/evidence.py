"""How well each set of laws explains the data, all paid for: evidence of nested models, BIC, posterior.

    c_hat, S_c   least squares of the coefficients, nuisances marginalised, no prior on c
    p(c) = 1 / (2 L sqrt(c^2 + s^2) (1 + c^2 / T^2)),  L = ln(1 + 2 T / s)      T: the law's scale, s^2: diagonal of S_c
    ln Z = -cost_min / 2 - ln |H_theta| / 2 + ln |2 pi S_c| / 2 + sum ln p(c_hat) + ln(side)
    p: any size up to about T is as likely by its logarithm, so what a law pays depends on its d, hardly on its scale;
    T is known to a factor: beyond it p falls by a power, 1 / c^3
    side: share of the posterior on the allowed side, doubled, for laws with a sign
    prior of a model: product over its laws of 1 / K, of catalogue and library alike: scanning more laws costs more
Laplace's approximation; in the coefficients to 0.3 for small d, and to 6 / d^2.
Source    MacKay, Information Theory (2003), ch. 28; docs/tracing.md
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from testbench.tracing.problem.problem import LIMIT_SDS, all_laws

DEGENERATE = 1e-9  # determinant of the cosines of a set, below which its coefficients are not known
INFLATED = 5.0  # variance of a coefficient over its variance without the others; of two laws, a cosine of 0.894


def log_coefficients(c_hat, cov, scale, sign):
    """ln of the integral of exp(-(c - c_hat)' cov^-1 (c - c_hat) / 2) p(c) dc, sign constraints in.

    Arrays (.., m) and (.., m, m): one set of m laws, or many. Sign and smallest size are taken law by law, from the
    marginal posterior.
    """
    m = np.shape(c_hat)[-1]
    variance = np.diagonal(cov, axis1=-2, axis2=-1)
    out = 0.5 * (m * np.log(2 * np.pi) + np.linalg.slogdet(cov)[1])
    out = out - np.sum(np.log(2 * np.log1p(2 * scale / np.sqrt(variance))), axis=-1)
    out = out - np.sum(0.5 * np.log(c_hat**2 + variance) + np.log1p(c_hat**2 / (scale**2 + variance)), axis=-1)
    side = norm.logcdf(sign * c_hat / np.sqrt(variance)) + np.log(2.0)
    return out + np.sum(np.where(np.asarray(sign) != 0, side, 0.0), axis=-1)


class LinearSets(NamedTuple):
    """Sets of laws by the Gram matrix alone; a degenerate set has fall 0 and gain -inf."""

    names: tuple
    members: np.ndarray  # (sets, laws) places in `names`
    fall: np.ndarray  # of chi2
    c: np.ndarray  # (sets, laws)
    gain: np.ndarray  # ln Z less that of none; -inf too where a law is `blind`, inflated, or against physics

    def laws(self, i):
        return tuple(self.names[j] for j in self.members[i])


def linear_sets(ranking, names, laws, size):
    """`LinearSets` of all sets of `size` of the laws `names`.

    Laws that are alike correct each other's shape, and so imitate what is none of them: such sets are not ranked.
    """
    at = np.array([ranking.index(name) for name in names], int)
    members = np.array(list(itertools.combinations(range(len(names)), size)), int).reshape(-1, size)
    k = at[members]
    d = np.where(ranking.length > 0, ranking.length, 1.0)[k]
    cosines = ranking.gram[k[:, :, None], k[:, None, :]] / (d[:, :, None] * d[:, None, :])
    good = (np.linalg.det(cosines) > DEGENERATE) & np.all(ranking.length[k] > 0, axis=1)
    inverse = np.linalg.inv(np.where(good[:, None, None], cosines, np.eye(size)))
    good &= np.all(np.diagonal(inverse, axis1=1, axis2=2) < INFLATED, axis=1)
    cov = inverse / (d[:, :, None] * d[:, None, :])
    c = np.einsum("nij,nj->ni", cov, ranking.b[k])
    law_limits = np.array([(law.scale, law.sign, law.low, law.high) for law in (laws[n] for n in names)]).reshape(-1, 4)
    scale, sign, low, high = np.moveaxis(law_limits[members], 2, 0)
    sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    is_admissible = good & np.all((sd <= scale) & (c >= low - LIMIT_SDS * sd) & (c <= high + LIMIT_SDS * sd), axis=1)
    fall = np.where(good, np.einsum("ni,ni->n", c, ranking.b[k]), 0.0)
    gain = np.where(is_admissible, 0.5 * fall + log_coefficients(c, cov, scale, sign), -np.inf)
    return LinearSets(tuple(names), members, fall, c, gain)


def is_inflated(ranking, names, laws):
    """True if the laws of a set are too alike for one set."""
    return not linear_sets(ranking, names, laws, len(names)).fall[0]


def linear_gain(ranking, names, laws):
    """ln Z of a set less ln Z of none, from the Gram matrix; None if degenerate, `blind` or against physics."""
    (gain,) = linear_sets(ranking, tuple(names), laws, len(names)).gain
    return float(gain) if np.isfinite(gain) else None


def blind(cov, laws):
    """Names of laws, of a covariance of their coefficients, of which data do not see their plausible size.

    They add nothing to the laws beside them, and where the prior is narrower than the likelihood Laplace's ln Z is not
    that of a set.
    """
    return [law.name for law, variance in zip(laws, np.diag(cov)) if not variance <= law.scale**2]


class Candidate(NamedTuple):
    """One set of laws, as far as it is known."""

    names: tuple
    log_z: float
    bic: float
    refitted: bool
    fit: object = None


def log_evidence(fit, reference_scale):
    """ln Z of a fit up to a constant that all models of the same data share.

    reference_scale  units of the nuisances, the same for all models
    """
    model, n = fit.model, len(fit.point.theta)
    a = np.concatenate([fit.jacobian[:, :n], model.prior_columns()[:, :n]]) * reference_scale
    s = np.linalg.svd(a, compute_uv=False)
    s = s[s > 1e-10 * s.max(initial=1e-300)]
    out = -0.5 * fit.cost - float(np.sum(np.log(s)))
    if model.laws:
        scale = np.array([law.scale for law in model.laws])
        sign = np.array([law.sign for law in model.laws])
        out += float(log_coefficients(fit.point.c, fit.covariance[n:, n:], scale, sign))
    return out


def bic(fit):
    """cost + m ln(rows): for the reader who wants it beside ln Z."""
    return float(fit.cost + len(fit.model.laws) * np.log(max(fit.model.space.size, 2)))


def log_priors(names):
    """{law: ln of its prior}, the same for all that are tried."""
    return dict.fromkeys(names, -np.log(max(len(names), 1)))


def log_prior(names, priors):
    """ln of the prior of one model, {law: ln prior} given."""
    return float(sum(priors[name] for name in names))


def posterior(candidates, priors):
    """Probabilities of `Candidate`s, in their order."""
    logs = np.array([c.log_z + log_prior(c.names, priors) for c in candidates])
    p = np.exp(logs - logs.max())
    return p / p.sum()


def best_sets(ranking, names, problem, size, count, priors):
    """The `count` best sets of `size` laws by linear evidence and prior: [(gain without prior, names)], best first."""
    candidate_sets = linear_sets(ranking, names, all_laws(problem), size)
    prior = np.array([priors[name] for name in candidate_sets.names])[candidate_sets.members].sum(axis=1)
    order = np.argsort(-(candidate_sets.gain + prior), kind="stable")[:count]
    return [
        (float(candidate_sets.gain[i]), candidate_sets.laws(i)) for i in order if np.isfinite(candidate_sets.gain[i])
    ]

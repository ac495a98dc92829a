"""How well each set of laws explains the data, all paid for: evidence of nested models, BIC, posterior.

    c_hat, S_c   least squares of the coefficients, nuisances marginalised, no prior on c
    ln Z = -cost_min / 2 - ln |H_theta| / 2 + ln |S_c| / 2 - ln |T + S_c| / 2 - c_hat' (T + S_c)^-1 c_hat / 2 + ln(side)
    T: diagonal of the laws' scale^2, the coefficients' Gaussian prior
    side: share of the posterior on the allowed side, doubled, for laws with a sign
    prior of a model with m of K laws: (1 / K)^m: scanning more laws costs more by itself
Exact for a linear problem, Laplace's approximation otherwise.
Source    MacKay, Information Theory (2003), ch. 28; docs/tracing.md
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from testbench.tracing.problem import all_laws


def log_gaussian_evidence(c_hat, cov, scale, sign):
    """ln of the integral of exp(-(c - c_hat)' cov^-1 (c - c_hat) / 2) N(c; 0, diag scale^2) dc, sign constraints in.

    A constraint is taken law by law on the marginal posterior: exact for one law.
    """
    m = len(c_hat)
    if m == 0:
        return 0.0
    total = cov + np.diag(scale**2)
    whole = -0.5 * (c_hat @ np.linalg.solve(total, c_hat)) - 0.5 * np.linalg.slogdet(total)[1]
    out = whole + 0.5 * np.linalg.slogdet(cov)[1]
    gain = np.diag(scale**2) @ np.linalg.inv(total)
    mean, sd = gain @ c_hat, np.sqrt(np.maximum(np.diag(gain @ cov), 1e-300))
    for i in np.flatnonzero(sign):
        out += norm.logcdf(sign[i] * mean[i] / sd[i]) + np.log(2.0)
    return float(out)


def linear_gain(ranking, names, laws):
    """(ln Z of a set less ln Z of none, its c_hat, its covariance) from the Gram matrix; None if it is degenerate."""
    k = [ranking.index(name) for name in names]
    gram, b = ranking.gram[np.ix_(k, k)], ranking.b[k]
    scale = np.array([laws[name].scale for name in names])
    if np.any(ranking.length[k] == 0):
        return None
    d = np.sqrt(np.diag(gram))
    if np.linalg.cond(gram / np.outer(d, d)) > 1e10:
        return None
    cov = np.linalg.inv(gram)
    c = cov @ b
    sign = np.array([laws[name].sign for name in names])
    return 0.5 * float(b @ c) + log_gaussian_evidence(c, cov, scale, sign), c, cov


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
        out += log_gaussian_evidence(fit.point.c, fit.covariance[n:, n:], scale, sign)
    return out


def bic(fit):
    """cost + m ln(rows): for the reader who wants it beside ln Z."""
    return float(fit.cost + len(fit.model.laws) * np.log(max(fit.model.space.size, 2)))


def log_prior(m, laws):
    """ln of the prior of one model with m of so many laws."""
    return -m * np.log(max(laws, 1))


def posterior(candidates, laws):
    """Probabilities of `Candidate`s, in their order."""
    logs = np.array([c.log_z + log_prior(len(c.names), laws) for c in candidates])
    p = np.exp(logs - logs.max())
    return p / p.sum()


def best_sets(ranking, names, problem, size, count):
    """The `count` best sets of `size` laws by linear evidence: [(gain, names)], best first."""
    laws = all_laws(problem)
    found = []
    for chosen in itertools.combinations(names, size):
        gain = linear_gain(ranking, chosen, laws)
        if gain is not None:
            found.append((gain[0], chosen))
    return sorted(found, key=lambda item: (-item[0], item[1]))[:count]

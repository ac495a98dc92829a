"""How well each set of laws explains the data, all paid for: evidence of nested models, BIC, posterior.

    c_hat, S_c   least squares of the coefficients, nuisances marginalised, no prior on c
    p(c) = 1 / (2 L sqrt(c^2 + s^2) (1 + c^2 / T^2)),  L = ln(1 + 2 T / s)      T: the law's scale, s^2: diagonal of S_c
    ln Z = -cost_min / 2 - ln |H_theta| / 2 + ln |2 pi S_c| / 2 + sum ln p(c_hat) + ln(side)
    p: any size up to about T is as likely by its logarithm, so what a law pays depends on its d, hardly on its scale;
    T is known to a factor: beyond it p falls by a power, 1 / c^3
    side: share of the posterior on the allowed side, doubled, for laws with a sign
    prior of a model: product over its laws of KNOWN / K in a catalogue of K, (1 - KNOWN) / K' in a library of K':
    scanning more laws costs more by itself
Laplace's approximation; in the coefficients to 0.3 for small d, and to 6 / d^2.
Source    MacKay, Information Theory (2003), ch. 28; docs/tracing.md
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from testbench.tracing.problem.problem import all_laws

KNOWN = 0.9  # of what is found on a bench, by the expectation of who wrote the catalogue


def log_coefficients(c_hat, cov, scale, sign):
    """ln of the integral of exp(-(c - c_hat)' cov^-1 (c - c_hat) / 2) p(c) dc, sign constraints in.

    Sign and smallest size are taken law by law, from the marginal posterior.
    """
    m = len(c_hat)
    if m == 0:
        return 0.0
    variance = np.diag(cov)
    out = 0.5 * (m * np.log(2 * np.pi) + np.linalg.slogdet(cov)[1])
    out -= np.sum(np.log(2 * np.log1p(2 * scale / np.sqrt(variance))))
    out -= np.sum(0.5 * np.log(c_hat**2 + variance) + np.log1p(c_hat**2 / (scale**2 + variance)))
    for i in np.flatnonzero(sign):
        out += norm.logcdf(sign[i] * c_hat[i] / np.sqrt(variance[i])) + np.log(2.0)
    return float(out)


def linear_fit(ranking, names):
    """(fall of chi2, c_hat, its covariance) of a set from the Gram matrix; None if it is degenerate."""
    k = [ranking.index(name) for name in names]
    gram, b = ranking.gram[np.ix_(k, k)], ranking.b[k]
    if np.any(ranking.length[k] == 0):
        return None
    d = np.sqrt(np.diag(gram))
    if np.linalg.cond(gram / np.outer(d, d)) > 1e10:
        return None
    cov = np.linalg.inv(gram)
    c = cov @ b
    return float(b @ c), c, cov


def linear_gain(ranking, names, laws):
    """ln Z of a set less ln Z of none, from the Gram matrix; None if it is degenerate, or one of its laws `blind`."""
    found = linear_fit(ranking, names)
    if found is None or blind(found[2], [laws[name] for name in names]):
        return None
    fall, c, cov = found
    scale, sign = np.array([(laws[name].scale, laws[name].sign) for name in names]).T
    return 0.5 * fall + log_coefficients(c, cov, scale, sign)


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
        out += log_coefficients(fit.point.c, fit.covariance[n:, n:], scale, sign)
    return out


def bic(fit):
    """cost + m ln(rows): for the reader who wants it beside ln Z."""
    return float(fit.cost + len(fit.model.laws) * np.log(max(fit.model.space.size, 2)))


def log_priors(catalogue, library=()):
    """{law: ln of its prior}: one cause in ten is expected to be none of the catalogue's."""
    known = KNOWN if catalogue and library else 1.0
    out = dict.fromkeys(catalogue, np.log(known / max(len(catalogue), 1)))
    return out | dict.fromkeys(library, np.log((1 - KNOWN if catalogue else 1.0) / max(len(library), 1)))


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
    laws = all_laws(problem)
    found = []
    for chosen in itertools.combinations(names, size):
        gain = linear_gain(ranking, chosen, laws)
        if gain is not None:
            found.append((gain, chosen))
    return sorted(found, key=lambda item: (-item[0] - log_prior(item[1], priors), item[1]))[:count]

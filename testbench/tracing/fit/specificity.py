"""How often a set of laws imitates a law that is not listed: each law of the pool is left out in turn.

    C     cosines of the signatures, what the nuisances take removed
    R^2 = C_SL' C_SS^-1 C_SL          share of a law L outside that the set S explains
    L is imitated by S at size d if d sqrt(1 - R^2) < least, S is not degenerate or inflated, and no law of S is minor
The share of the laws that sets of m imitate, of those that no smaller set does, is what an effect from outside the
lists does to a verdict: the library stands for the laws that it lacks.
Source    docs/tracing.md
"""

import itertools

import numpy as np
from scipy.stats import norm

from testbench.tracing.fit.evidence import DEGENERATE, INFLATED

SURE = 0.9  # chance with which the alarm after the fit would see the remainder
CHUNK = 20_000  # sets at a time


def detection_limit(laws, level):
    """Sigmas of a remainder that the scores of `laws` laws show at `level` with the chance SURE."""
    return float(norm.isf(level / (2 * laws)) + norm.ppf(SURE))


def _largest_r2(cosines, size, minor):
    """(laws,) largest R^2 of each law by sets of `size` others."""
    count = len(cosines)
    best = np.zeros(count)
    sets = itertools.combinations(range(count), size)
    while chunk := list(itertools.islice(sets, CHUNK)):
        s = np.array(chunk)
        set_cosines = cosines[s[:, :, None], s[:, None, :]]
        good = np.linalg.det(set_cosines) > DEGENERATE
        inverse = np.linalg.inv(np.where(good[:, None, None], set_cosines, np.eye(size)))
        inflation = np.diagonal(inverse, axis1=1, axis2=2)
        good &= np.all(inflation < INFLATED, axis=1)
        c = inverse @ cosines[s]
        d = np.abs(c) / np.sqrt(inflation)[:, :, None]
        square = np.einsum("nik,nik->nk", c, cosines[s])
        square[~(good[:, None] & np.all(d >= minor * d.max(axis=1, keepdims=True), axis=1))] = 0.0
        np.put_along_axis(square, s, 0.0, axis=1)
        best = np.maximum(best, square.max(axis=0))
    return best


def imitated_share(ranking, names, size, d, least, minor):
    """Share of the laws `names` that sets of `size` others imitate at d sigmas, of those that no smaller set does.

    least  `detection_limit`;   minor  smallest part of the largest law of a set, in sigmas
    0 where no law is left: then nothing speaks against a set.
    """
    at = [ranking.index(n) for n in names if ranking.length[ranking.index(n)] > 0]
    cosines = ranking.cosines[np.ix_(at, at)]
    free = np.ones(len(at), bool)
    for m in range(1, size + 1):
        alike = d**2 * (1 - _largest_r2(cosines, m, minor)) < least**2
        if m < size:
            free &= ~alike
    return float(np.mean(alike[free])) if free.any() else 0.0

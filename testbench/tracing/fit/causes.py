"""The class of causes that the data do not tell apart: the best set of laws, and every rival of it.

A rival has other laws (not those of a smaller rival or of the best set beside more), no more coefficients, none against
physics; it passes the held-out test; after its own refit its chi2 is less than AS_GOOD above that of the best set, or
the odds between the two are below ODDS. The Gram matrix orders all sets; those that come near are refitted, until none
is left or the class has more than MOST members. After TRIED refits it stops, and the class may be incomplete.
Source    docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.fit.evidence import linear_sets
from testbench.tracing.fit.search import WORTH

AS_GOOD = 2 * WORTH  # chi2 at which laws of one prior differ by odds of 20
ODDS = 50.0  # so that the truth is left out of 2 % of classes at most
MOST = 5  # members; a larger class explains nothing
TRIED = 200  # refits


class Cause(NamedTuple):
    """A member of the class."""

    names: tuple
    fit: object
    chi2: float  # above that of the best set, priors counted


def nearby_law_sets(ranking, best, fit, laws):
    """Sets that the linear model puts near the best one, small ones first; `fit` is that of the best set."""
    pool, rows = tuple(n for n in ranking.names if n not in ranking.hidden), []
    sets_by_size = [linear_sets(ranking, pool, laws, size) for size in range(1, len(best) + 1)]
    mine = linear_sets(ranking, best, laws, len(best)).fall[0]
    # what the linear model may be off by, where it is not one
    margin = 2 * AS_GOOD + fit.bend * (fit.bend + 2 * np.sqrt(max(mine, 0.0)))
    for sets in sets_by_size:
        for i in np.flatnonzero(np.isfinite(sets.gain) & (sets.fall > mine - margin)):
            rows.append((sets.members.shape[1], mine - sets.fall[i], sets.laws(i)))
    return [names for _, _, names in sorted(rows) if set(names) != set(best)]


def find_causes(work, ranking, best, passes):
    """([`Cause`] of the best set of a `search.Search` first, then its rivals; near sets that were not tried).

    ranking  of all laws at the base fit;   passes  function(fit): the held-out test
    """
    top = work.candidates[best]
    out, todo, tried = [Cause(best, top.fit, 0.0)], nearby_law_sets(ranking, best, top.fit, work.laws), 0
    while todo and tried < TRIED and len(out) <= MOST:
        names = tuple(sorted(todo.pop(0)))
        if any(set(c.names) <= set(names) for c in out):
            continue
        tried += 1
        if not work.refit(names):
            continue
        fit = work.candidates[names].fit
        chi2 = fit.cost - top.fit.cost
        if (chi2 < AS_GOOD or work.score(best) - work.score(names) < np.log(ODDS)) and passes(fit):
            out.append(Cause(names, fit, float(chi2)))
    return [out[0], *sorted(out[1:], key=lambda c: (c.chi2, c.names))], len(todo)

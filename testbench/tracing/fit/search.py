"""From a fit without laws to the sets of laws that explain it: top singles, then bigger sets, forward and backward.

Linear evidence from one Gram matrix orders all sets; a few are refitted, and only refitted sets may win. A set that
fails to be refitted is listed and never ranked. The search ends when the best set is adequate and no more law pays.
Source    docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.fit import evidence
from testbench.tracing.fit.rank import rank
from testbench.tracing.fit.refit import refit
from testbench.tracing.problem.problem import all_laws

REFITS, MOST_TRIES = 4, 8
WORTH = np.log(20.0)  # log odds from which one more law is tried although the model is adequate
CREDIBLE = 0.95


class SearchResult(NamedTuple):
    """All sets that were tried, and the best one."""

    candidates: dict  # names: Candidate
    failed: dict  # names: reason
    best: tuple
    adequate: bool
    checks: list  # what the adequacy test said, in order
    pool: tuple
    dropped: tuple = ()  # the best set, if all data together are not worth naming it

    def fit(self, names):
        return self.candidates[names].fit


class Search:
    """Evidence of sets of laws on top of a base fit.

    table     `rank.Signatures` of the base fit
    adequate  function(fit) -> (bool, dict): section 5 run again with the effects added
    """

    def __init__(self, base, table, reference_scale, adequate, progress=None):
        self.base, self.table, self.scale, self.adequate = base, table, reference_scale, adequate
        self.progress, self.ranking = progress, None
        self.laws = all_laws(base.model.problem)
        self.candidates, self.failed, self.checks, self._verdicts, self.priors = {}, {}, [], {}, {}
        self._add_candidate((), base)

    def _add_candidate(self, names, new_fit):
        log_z = evidence.log_evidence(new_fit, self.scale)
        self.candidates[names] = evidence.Candidate(names, log_z, evidence.bic(new_fit), True, new_fit)

    def _linear(self, names, gain, base_names):
        if names not in self.failed and not (names in self.candidates and self.candidates[names].refitted):
            log_z = self.candidates[base_names].log_z + gain
            self.candidates[names] = evidence.Candidate(names, log_z, float("nan"), False)

    def refit(self, names, start=()):
        """True if the set has been refitted, now or before."""
        names = tuple(sorted(names))
        if (
            self.ranking
            and len(names) > 1
            and not evidence.linear_sets(self.ranking, names, self.laws, len(names)).fall[0]
        ):
            self.failed[names] = "its laws are too similar to be in one set"
        if names in self.failed:
            self.candidates.pop(names, None)
            return False
        candidate = self.candidates.get(names)
        if candidate is not None and candidate.refitted:
            return True
        if self.progress:
            self.progress(f"refitting {' + '.join(names)}", 0, 1)
        new_fit = refit(self.candidates[start].fit, names, self.table)
        why = new_fit.failed or _unseen_reason(new_fit) or _unphysical_reason(new_fit)
        if why:
            self.failed[names] = why
            self.candidates.pop(names, None)
            return False
        self._add_candidate(names, new_fit)
        return True

    def score(self, names):
        """ln of evidence and prior of a set that is known."""
        return self.candidates[names].log_z + evidence.log_prior(names, self.priors)

    def _best(self, level=None):
        """Best refitted set, of `level` laws if that is given; None if there is none."""
        refitted = [n for n, c in self.candidates.items() if c.refitted and level in (len(n), None)]
        return max(refitted, key=lambda n: (self.score(n), n), default=None)

    def is_adequate(self, names):
        if names not in self._verdicts:
            ok, why = self.adequate(self.candidates[names].fit)
            self._verdicts[names] = ok
            self.checks.append({"laws": list(names), "adequate": ok, **why})
        return self._verdicts[names]

    def run(self, ranking, max_laws, proposals=()):
        """`SearchResult` with laws that are ranked at the base fit.

        proposals  sets that are refitted besides those that linear evidence finds
        """
        pool, self.ranking = tuple(n for n in ranking.names if n not in ranking.hidden), ranking
        self.priors = evidence.log_priors(pool)
        for names in proposals:
            if len(names) <= max_laws and set(names) <= set(pool):
                self.refit(names)
        singles = evidence.best_sets(ranking, pool, self.base.model.problem, 1, len(pool), self.priors)
        for gain, names in singles:
            self._linear(names, gain, ())
        refit_count = 0
        for _, names in singles[:MOST_TRIES]:
            refit_count += self.refit(names)
            if refit_count == REFITS:
                break
        self._settle()
        for level in range(1, max_laws):
            best = self._best(level)
            if best is None or not self._grow(best, ranking, pool):
                break
            self._settle()
            bigger = self._best(level + 1)
            if bigger is None or self.score(bigger) <= self.score(best):
                break
        return self.result(pool)

    def result(self, pool):
        """`SearchResult` of what has been tried."""
        best = self._best()
        adequate = bool(best) and self.is_adequate(best)
        return SearchResult(self.candidates, self.failed, best, adequate, self.checks, pool)

    def _grow(self, best, ranking, pool):
        """Refit sets with one law more than `best`, and their subsets; False if it is adequate and no more law pays."""
        remaining_laws = tuple(n for n in pool if n not in best)
        if not remaining_laws:
            return False
        fit = self.candidates[best].fit
        after = rank(fit, remaining_laws, self.table.signature_columns(fit, remaining_laws))
        visible_laws = [n for n in after.names if n not in after.hidden]
        forward = evidence.best_sets(after, visible_laws, fit.model.problem, 1, REFITS, self.priors)
        worth = bool(forward) and forward[0][0] + evidence.log_prior(forward[0][1], self.priors) > WORTH
        if self.is_adequate(best) and not worth:
            return False
        for gain, (name,) in forward:
            self._linear(tuple(sorted((*best, name))), gain, best)
            self.refit((*best, name), best)
        for gain, names in evidence.best_sets(ranking, pool, fit.model.problem, len(best) + 1, REFITS, self.priors):
            self._linear(tuple(sorted(names)), gain, ())
            self.refit(names)
        for names in [n for n, c in self.candidates.items() if c.refitted and len(n) == len(best) + 1]:
            if self.score(names) >= self.score(best):
                for dropped in names if len(names) > 1 else ():
                    self.refit(tuple(n for n in names if n != dropped))
        return True

    def _settle(self, most=12):
        """Refit what the credible set holds by linear evidence only."""
        for _ in range(most):
            names, p = self.posterior()
            loose = [n for n, x in zip(names, p) if not self.candidates[n].refitted and x > (1 - CREDIBLE) / 10]
            if not loose:
                break
            start = max((n for n, c in self.candidates.items() if c.refitted and set(n) <= set(loose[0])), key=len)
            self.refit(loose[0], start)

    def posterior(self):
        """(sets, probabilities), most probable first."""
        every = list(self.candidates.values())
        p = evidence.posterior(every, self.priors)
        order = np.argsort(-p, kind="stable")
        return [every[i].names for i in order], [float(p[i]) for i in order]


def _unseen_reason(fit):
    """Why a set is none whose laws' coefficients are known: ""."""
    n = len(fit.point.theta)
    names = evidence.blind(fit.covariance[n:, n:], fit.model.laws)
    return f"the data are not sensitive to a plausible size of {', '.join(names)}" if names else ""


def _unphysical_reason(fit):
    """Which coefficients physics forbids: ""."""
    law_coefficients = zip(fit.model.laws, fit.point.c, fit.sd[len(fit.point.theta) :])
    return "; ".join(why for law, c, sd in law_coefficients if (why := law.beyond(float(c), float(sd))))


def inclusion(names, p):
    """{law: probability that it is part of the explanation}."""
    laws = sorted({law for n in names for law in n})
    return {law: float(sum(x for n, x in zip(names, p) if law in n)) for law in laws}


def credible(names, p, level=CREDIBLE):
    """Smallest set of models that holds `level` of the probability."""
    total, out = 0.0, []
    for n, x in zip(names, p):
        out.append((n, x))
        total += x
        if total >= level:
            break
    return out

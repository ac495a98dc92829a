"""From fits of single registers and pins to causes: one for each fault, in order of rank; none where nothing explains.

    a cause covers the registers whose wrong rows it explains; it may not disturb a register that is right
    share  part of the wrong rows that the cause explains, the mean over all registers and pins at fault,
           divided by the number of causes that explain as many, and by one more if it changes a row that is right,
           or if the wrong rows do not tell its class

Source  docs/diagnosis.md
"""

from math import log2
from typing import NamedTuple

from testbench.golden.diagnosis.fault_search import ALWAYS, EITHER, FEW_DIFFERENCES, LEAST_PRECISION, RESET
from testbench.golden.diagnosis.perturb import WORDS
from testbench.golden.diagnosis.value_hypotheses import UNCLASSIFIED

SURE = 0.99  # share from which a cause is certain
COMPLETE_SHARE = 0.99  # share from which a register needs no further cause
MOST_REPORTED_CAUSES = 8
MOST_RANKED = 150
HEADS = 3  # registers that are searched together, the first at fault
MOST_SEARCHED = 9
SPARE_BITS = 2.0  # evidence beyond that of as many hypotheses as were tried: the least for a name
CERTAIN_BITS = 24.0  # the same for a certain name
MOST_CERTAIN = 11  # cost beyond which a mistake is too rare or complicated to be certain

# classes that wrong rows tell from others where they show less than values
IDENTIFIABLE_BY_DIFFERENCE = {
    RESET: ("reset", "no_reset", "async_reset"),
    ALWAYS: (),
    EITHER: ("condition",),
    FEW_DIFFERENCES: ("rounding", "limit"),
}


class Cause(NamedTuple):
    """One cause: its class, the register or pin that it drives, the share of the wrong rows, and in words what.

    Where registers are hidden, `register` is the first port that shows it.
    """

    cause: str
    register: str
    share: float
    what: str

    @property
    def sure(self):
        return self.share >= SURE

    def text(self):
        return f"{self.cause}: {WORDS[self.cause]} ({self.register}: {self.what}; share {100 * self.share:.0f} %)"


class _HypothesisFits(NamedTuple):
    """A hypothesis with its fits at the targets that it covers."""

    fits: dict

    @property
    def hypothesis(self):
        return next(iter(self.fits.values())).hypothesis

    @property
    def rank(self):
        """What explains all wrong rows of its registers goes first, then what explains more, then what costs less."""
        explains_all_rows = all(fit.share == 1.0 for fit in self.fits.values())
        return (not explains_all_rows, -round(self.total, 2), self.hypothesis.cost, self.hypothesis.site.id)

    @property
    def total(self):
        return sum(round(fit.share * fit.precision, 3) for fit in self.fits.values())


def _disturbs(search, hypothesis):
    """Whether a hypothesis changes a register or pin that is right."""
    for target in search.targets.values():
        if target.name in search.faulty or not target.root.cone >> hypothesis.site.id & 1:
            continue
        fit = search.fit(target, hypothesis)
        if (target.compared_mask & (fit.column != target.sound)).any():
            return True
    return False


def _group_by_hypothesis(fits, names):
    """Hypotheses by what they cover of `names`, the best first."""
    fits_by_hypothesis = {}
    for name in names:
        for fit in fits[name]:
            fits_by_hypothesis.setdefault(fit.key, {})[name] = fit
    hypothesis_fits = [_HypothesisFits(part) for part in fits_by_hypothesis.values()]
    return sorted(hypothesis_fits, key=lambda w: w.rank)


def _select_rival_causes(search, best, hypotheses):
    """The best and what explains as much with another cause, whatever it costs: one for each cause, the best first."""
    rival_by_cause, careful = {best.hypothesis.cause: best}, not _disturbs(search, best.hypothesis)
    for hypothesis_fits in hypotheses:
        if hypothesis_fits.rank[:2] > best.rank[:2]:
            break
        cause = hypothesis_fits.hypothesis.cause
        if cause not in rival_by_cause and not (careful and _disturbs(search, hypothesis_fits.hypothesis)):
            rival_by_cause[cause] = hypothesis_fits
    return list(rival_by_cause.values())


def _is_identified(search, best, hypotheses, names):
    """Whether the wrong rows of one of the registers tell the class of the best from those without a hypothesis."""
    cause = best.hypothesis.cause
    cause_hypotheses = [w for w in hypotheses if w.hypothesis.cause == cause and w.rank[:2] <= best.rank[:2]]
    if all(w.hypothesis.fitted for w in cause_hypotheses):
        return False
    return any(cause in IDENTIFIABLE_BY_DIFFERENCE.get(search.difference_kind(name), (cause,)) for name in names)


def _enough(search, names, spare):
    """Whether the wrong rows of the registers are evidence enough for one of as many hypotheses as were tried."""
    tried = max(search.tried[name] for name in names)
    return sum(search.evidence(name) for name in names) >= log2(max(tried, 1)) + spare


def _add_explained_registers(search, best, names):
    """The best with those of `names` that it explains as well."""
    fits = dict(best.fits)
    for name in names:
        if name not in fits:
            fit = search.fit(search.targets[name], best.hypothesis)
            if fit.share >= COMPLETE_SHARE and fit.precision >= LEAST_PRECISION:
                fits[name] = fit
    return _HypothesisFits(fits)


def rank_causes(search, first_row_faults=()):
    """[Cause] of a `Search`, in order of rank; `first_row_faults`: registers wrong in row 0 alone."""
    fits, leading_causes, further_causes = {}, [], []
    count = len({*search.faulty, *first_row_faults})
    open_names = list(search.faulty)
    while open_names and len(fits) < MOST_SEARCHED:
        heads = open_names[:HEADS]
        fits |= {name: search.ranked_fits(name) for name in heads if name not in fits}
        hypotheses = _group_by_hypothesis(fits, heads)
        listable = [w for w in hypotheses if w.hypothesis.cause != UNCLASSIFIED]
        if not listable:
            open_names = open_names[HEADS:]
            continue
        best = next((w for w in listable[:MOST_RANKED] if not _disturbs(search, w.hypothesis)), listable[0])
        if best.rank[0] > listable[0].rank[0]:
            best = listable[0]
        rival_hypotheses, causes = _select_rival_causes(search, best, hypotheses), []
        covered = _add_explained_registers(search, best, open_names).fits
        # what gives another value in a row where the design is right is not the whole truth
        refuted = any(fit.precision < 1.0 for fit in covered.values())
        part = float(sum(fit.share for fit in covered.values())) / count / (len(rival_hypotheses) + refuted)
        cheap = best.hypothesis.cost <= MOST_CERTAIN
        certain = (
            cheap and _is_identified(search, best, hypotheses, covered) and _enough(search, best.fits, CERTAIN_BITS)
        )
        if len(rival_hypotheses) == 1 and not refuted and not certain:
            part /= 2
        for rival in rival_hypotheses:
            if rival.hypothesis.cause != UNCLASSIFIED and _enough(search, rival.fits, SPARE_BITS):
                causes.append(Cause(rival.hypothesis.cause, next(iter(rival.fits)), part, rival.hypothesis.what))
        more = [
            _second(search, n, best.hypothesis, (1 - fit.share) / count)
            for n, fit in best.fits.items()
            if fit.share < COMPLETE_SHARE
        ]
        # a part of the wrong rows counts only if a second fault explains the others
        if all(more):
            leading_causes += causes[:1]
            further_causes += [*more, *causes[1:]]
        open_names = [name for name in open_names if name not in covered]
    leading_causes.sort(key=lambda cause: search.faulty.index(cause.register))
    return (leading_causes + further_causes)[:MOST_REPORTED_CAUSES]


def _second(search, name, hypothesis, share):
    """The second fault of a register that explains, beside a first one, all of its wrong rows; or None."""
    for fit in search.ranked_fits(name, ((hypothesis.site, hypothesis.by),))[:1]:
        if fit.share >= COMPLETE_SHARE:
            return Cause(fit.hypothesis.cause, name, float(share), fit.hypothesis.what)
    return None


def hidden_causes(search, every=False):
    """[Cause] of a `HiddenRegisterSearch`: only what explains every row counts; it has the name of a port that is seen.

    One of each class and port, or `every` hypothesis.
    """
    if not search.wrong.any():
        return []
    explained = [(h, search.affected_port(h)) for h, share in search.hypothesis_shares() if share == 1.0]
    first = {}
    for h, port in explained:
        first.setdefault((h.cause, port), h)
    async_reset_port = search.async_reset_port()
    # what was not run, and what is read off the rows of registers, may explain the rows as well
    part = 1.0 / (len(first) + 1 + (async_reset_port is not None))
    causes = [Cause("async_reset", async_reset_port, part, "all registers at once")] if async_reset_port else []
    causes += [Cause(h.cause, port, part, h.what) for h, port in explained if every or first[h.cause, port] is h]
    return causes if every else causes[:MOST_REPORTED_CAUSES]

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
MOST_CAUSES = 8
MOST_RANKED = 150
HEADS = 3  # registers that are searched together, the first at fault
MOST_SEARCHED = 9
SPARE_BITS = 2.0  # evidence beyond that of as many hypotheses as were tried: the least for a name
CERTAIN_BITS = 24.0  # the same for a certain name
MOST_CERTAIN = 11  # cost beyond which a mistake is too rare or complicated to be certain

# classes that wrong rows tell from others where they show less than values
IDENTIFIED_CLASSES = {
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
        is_complete = all(fit.share == 1.0 for fit in self.fits.values())
        return (not is_complete, -round(self.total, 2), self.hypothesis.cost, self.hypothesis.site.id)

    @property
    def total(self):
        return sum(round(fit.share * fit.precision, 3) for fit in self.fits.values())


def _disturbs(search, hypothesis):
    """Whether a hypothesis changes a register or pin that is right."""
    for target in search.targets.values():
        if target.name in search.faulty or not target.root.cone >> hypothesis.site.id & 1:
            continue
        fit = search.fit(target, hypothesis)
        if (target.compared_rows & (fit.column != target.sound)).any():
            return True
    return False


def _group_fits(fits, names):
    """Hypotheses by what they cover of `names`, the best first."""
    fits_by_key = {}
    for name in names:
        for fit in fits[name]:
            fits_by_key.setdefault(fit.key, {})[name] = fit
    candidates = [_HypothesisFits(part) for part in fits_by_key.values()]
    return sorted(candidates, key=lambda w: w.rank)


def _rival_candidates(search, best, candidates):
    """The best and what explains as much with another cause, whatever it costs: one for each cause, the best first."""
    rivals, careful = {best.hypothesis.cause: best}, not _disturbs(search, best.hypothesis)
    for candidate in candidates:
        if candidate.rank[:2] > best.rank[:2]:
            break
        cause = candidate.hypothesis.cause
        if cause not in rivals and not (careful and _disturbs(search, candidate.hypothesis)):
            rivals[cause] = candidate
    return list(rivals.values())


def _is_identified(search, best, candidates, names):
    """Whether the wrong rows of one of the registers tell the class of the best from those without a hypothesis."""
    cause = best.hypothesis.cause
    alternatives = [w for w in candidates if w.hypothesis.cause == cause and w.rank[:2] <= best.rank[:2]]
    if all(w.hypothesis.fitted for w in alternatives):
        return False
    return any(cause in IDENTIFIED_CLASSES.get(search.difference_kind(name), (cause,)) for name in names)


def _enough(search, names, spare):
    """Whether the wrong rows of the registers are evidence enough for one of as many hypotheses as were tried."""
    tried = max(search.tried[name] for name in names)
    return sum(search.evidence(name) for name in names) >= log2(max(tried, 1)) + spare


def _extend_fits(search, best, names):
    """The best with those of `names` that it explains as well."""
    fits = dict(best.fits)
    for name in names:
        if name not in fits:
            fit = search.fit(search.targets[name], best.hypothesis)
            if fit.share >= COMPLETE_SHARE and fit.precision >= LEAST_PRECISION:
                fits[name] = fit
    return _HypothesisFits(fits)


def rank_causes(search, first_row_registers=()):
    """[Cause] of a `Search`, in order of rank; `first_row_registers`: registers wrong in row 0 alone."""
    fits, primary, secondary = {}, [], []
    count = len({*search.faulty, *first_row_registers})
    open_names = list(search.faulty)
    while open_names and len(fits) < MOST_SEARCHED:
        heads = open_names[:HEADS]
        fits |= {name: search.ranked_fits(name) for name in heads if name not in fits}
        candidates = _group_fits(fits, heads)
        listable = [w for w in candidates if w.hypothesis.cause != UNCLASSIFIED]
        if not listable:
            open_names = open_names[HEADS:]
            continue
        best = next((w for w in listable[:MOST_RANKED] if not _disturbs(search, w.hypothesis)), listable[0])
        if best.rank[0] > listable[0].rank[0]:
            best = listable[0]
        rivals, causes = _rival_candidates(search, best, candidates), []
        covered = _extend_fits(search, best, open_names).fits
        # what gives another value in a row where the design is right is not the whole truth
        refuted = any(fit.precision < 1.0 for fit in covered.values())
        part = float(sum(fit.share for fit in covered.values())) / count / (len(rivals) + refuted)
        cheap = best.hypothesis.cost <= MOST_CERTAIN
        certain = (
            cheap and _is_identified(search, best, candidates, covered) and _enough(search, best.fits, CERTAIN_BITS)
        )
        if len(rivals) == 1 and not refuted and not certain:
            part /= 2
        for rival in rivals:
            if rival.hypothesis.cause != UNCLASSIFIED and _enough(search, rival.fits, SPARE_BITS):
                causes.append(Cause(rival.hypothesis.cause, next(iter(rival.fits)), part, rival.hypothesis.what))
        more = [
            _second(search, n, best.hypothesis, (1 - fit.share) / count)
            for n, fit in best.fits.items()
            if fit.share < COMPLETE_SHARE
        ]
        # a part of the wrong rows counts only if a second fault explains the others
        if all(more):
            primary += causes[:1]
            secondary += [*more, *causes[1:]]
        open_names = [name for name in open_names if name not in covered]
    primary.sort(key=lambda cause: search.faulty.index(cause.register))
    return (primary + secondary)[:MOST_CAUSES]


def _second(search, name, hypothesis, share):
    """The second fault of a register that explains, beside a first one, all of its wrong rows; or None."""
    for fit in search.ranked_fits(name, ((hypothesis.site, hypothesis.by),))[:1]:
        if fit.share >= COMPLETE_SHARE:
            return Cause(fit.hypothesis.cause, name, float(share), fit.hypothesis.what)
    return None


def hidden_causes(search, every=False):
    """[Cause] of a `PartialObservation`: only what explains every row counts; it has the name of a port that is seen.

    One of each class and port, or `every` hypothesis.
    """
    if not search.wrong.any():
        return []
    explained = [(h, search.affected_port(h)) for h, share in search.hypothesis_shares() if share == 1.0]
    first = {}
    for h, port in explained:
        first.setdefault((h.cause, port), h)
    async_port = search.async_reset_port()
    # what was not run, and what is read off the rows of registers, may explain the rows as well
    part = 1.0 / (len(first) + 1 + (async_port is not None))
    causes = [Cause("async_reset", async_port, part, "all registers at once")] if async_port else []
    causes += [Cause(h.cause, port, part, h.what) for h, port in explained if every or first[h.cause, port] is h]
    return causes if every else causes[:MOST_CAUSES]

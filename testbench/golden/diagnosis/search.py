"""Which hypotheses explain a register or a pin: one step from the design's own rows, register by register.

    sound(n)      what the model gives after row n of the design            wrong rows: the design has something else
    share         wrong rows where a hypothesis gives the design's value, of all wrong rows
    precision     of the rows where it gives another value than the model, those where this is the design's value

Source  docs/diagnosis.md
"""

import collections
import functools
from math import lgamma, log
from typing import NamedTuple

import numpy as np

from fpga_model.block import BIT
from testbench.golden.diagnosis import of_conditions, of_data, perturb
from testbench.golden.diagnosis.net import wrapped
from testbench.golden.diagnosis.perturb import Hypothesis
from testbench.golden.diagnosis.rows import Rows

SHORT = 5  # bits of a register that holds a state
SAMPLE = 40  # wrong rows on which all hypotheses are tried
MOST_FITS = 150  # hypotheses of a target that are then tried on all rows
MOST_OF_CAUSE = 60  # of a cause of which none has given all wrong rows yet
LEAST_SHARE, LEAST_PRECISION = 0.2, 0.95

# what the wrong rows of a target show: they are rows of the reset; one branch was taken in all of them, or one value;
# which of two values was taken; few differences; more than these
RESET, ALWAYS, EITHER, SAME, VALUES = "reset", "always", "either", "same", "values"
FEW = 2  # differences


class Target(NamedTuple):
    """A register or pin: its root, rows of the design that belong to each row of the net, and where they count."""

    name: str
    root: object
    fmt: object
    got: np.ndarray
    judged: np.ndarray
    sound: np.ndarray
    wrong: np.ndarray

    def as_held(self, column):
        """A column as a port of this width holds it."""
        return wrapped(column, self.fmt.width, bool(self.fmt.s))


class Fit(NamedTuple):
    """How far a hypothesis explains a target; `column` is what it gives at all rows."""

    hypothesis: Hypothesis
    share: float
    precision: float
    column: np.ndarray

    @property
    def key(self):
        h = self.hypothesis
        return h.cause, h.site.id, h.by.id


def sampled(rows):
    """Some of many rows: the first ones, and others up to the last one."""
    if len(rows) <= SAMPLE:
        return rows
    spread = np.linspace(0, len(rows) - 1, SAMPLE // 2).astype(int)
    return np.unique(np.concatenate((rows[: SAMPLE // 2], rows[spread])))


class Search:
    """The rows of a design against a net.

    net       of the block
    leaves    {("in" or "reg", name): column}: the design's own registers, golden ones where the log lacks them
    got       {name: column} of the log;  care  {name: rows that count};  expected  {name: golden column}
    """

    def __init__(self, net, leaves, got, care, expected):
        self.net, self.count = net, len(next(iter(leaves.values())))
        self.rows = Rows(net, leaves, self.count)
        self.hypotheses, self._shown, self.tried = {}, {}, {}
        self._usual = {name: self._as_usual(name, got, expected) for name in net.reset if name in got}
        self.targets = {name: self._target(name, got[name], care) for name in net.roots if name in got}
        self.faulty = [
            t.name
            for t in self.targets.values()
            if t.wrong.any() and np.any(care[t.name] & (got[t.name] != expected[t.name]))
        ]
        self.faulty.sort(key=lambda name: int(np.argmax(self.targets[name].wrong)))

    def _as_usual(self, name, got, expected):
        """Rows in which a short register, a state or a counter, is within what the model ever held."""
        if self.net.fmts[name].width > SHORT:
            return np.ones(self.count, bool)
        return (got[name] >= expected[name].min()) & (got[name] <= expected[name].max())

    def _target(self, name, got, care):
        root, fmt = self.net.roots[name], self.net.fmts[name]
        judged = care[name].copy()
        if root.op == "next":
            # row n of the net gives row n + 1 of the register
            got, judged = np.append(got[1:], got[-1:]), np.append(judged[1:], False)
        for node in self.net.inside(root):
            if node.op == "reg" and node.value in care:
                judged &= care[node.value] & self._usual[node.value]
        sound = wrapped(self.rows.full(root), fmt.width, bool(fmt.s))
        return Target(name, root, fmt, got, judged, sound, judged & (got != sound))

    @functools.cached_property
    def bits(self):
        """`of_conditions.Bits` of the rows."""
        return of_conditions.Bits(self.net, self.rows)

    def of_site(self, node):
        """Hypotheses at a node, made once."""
        if node.id not in self.hypotheses:
            self.hypotheses[node.id] = perturb.of_node(self.net, node, self.rows.seen)
        return self.hypotheses[node.id]

    def changed(self, target, faults, at):
        """What a target is with faults, as its port holds it."""
        return target.as_held(self.rows.changed(target.root, faults, at))

    def fit(self, target, hypothesis, others=()):
        """`Fit` of one hypothesis beside `others` that are taken for granted, over all rows."""
        every = slice(None)
        column = self.changed(target, ((hypothesis.site, hypothesis.by), *others), every)
        before = self.changed(target, others, every) if others else target.sound
        wrong = target.judged & (target.got != before)
        active = target.judged & (column != before)
        explained = wrong & (column == target.got)
        hits = np.count_nonzero(explained)
        return Fit(hypothesis, hits / max(np.count_nonzero(wrong), 1), hits / max(np.count_nonzero(active), 1), column)

    def fits(self, name, others=()):
        """Fits of a target that explain enough and disturb little, the best first."""
        target = self.targets[name]
        before = self.changed(target, others, slice(None)) if others else target.sound
        wrong = np.flatnonzero(target.judged & (target.got != before))
        if not len(wrong):
            return []
        picked = sampled(wrong)
        inside = [node for node in self.net.inside(target.root) if node.id < self.net.own]
        tried = [h for node in inside for h in self.of_site(node)]
        rivals = []
        if not others:
            read = of_data.hypotheses(self.net, self.rows, target, inside, wrong)
            read += of_conditions.hypotheses(self, target, inside, picked, wrong)
            tried += [h for h in read if h.cost < perturb.FAR]
            rivals = [h for h in read if h.cost >= perturb.FAR]
        self.tried[name] = max(len(tried), self.tried.get(name, 0))
        hits = self._hits(target, tried, others, picked)
        order = sorted(range(len(tried)), key=lambda k: (-hits[k], tried[k].cost))
        whole = [k for k in order if hits[k] == len(picked)]
        part = [k for k in order if LEAST_SHARE * len(picked) <= hits[k] < len(picked)]
        found = self._first_of_each(target, [tried[k] for k in whole], others)
        if any(f.share == 1.0 for f in found):
            rivals += [] if others else of_data.beyond(self.net, target, inside)
            hits = self._hits(target, rivals, others, picked)
            found += self._kept(target, [h for h, n in zip(rivals, hits) if n == len(picked)], others)
        else:
            found += self._kept(target, [tried[k] for k in part[:MOST_FITS]], others)
            found += self._last(target, inside, picked, wrong) if not others else []
        return sorted(found, key=lambda f: (-round(f.share * f.precision, 3), f.hypothesis.cost))

    def free(self, target, node, column):
        """A flag that has a value of its own in each row."""
        name = f"free {target.name} {node.id} {len(self.rows.leaves)}"
        self.rows.leaves["in", name] = column.astype(np.int64)
        return self.net.leaf("in", name, BIT)

    def _last(self, target, inside, picked, wrong):
        """What is tried where nothing else explains all wrong rows; none of it makes a name certain."""
        for source in (of_data.of_operands, of_conditions.of_any, of_data.of_any_rounding):
            tried = list(source(self, target, inside, wrong))
            self.tried[target.name] += len(tried)
            hits = self._hits(target, tried, (), picked)
            whole = [h for h, n in zip(tried, hits) if n == len(picked)]
            found = [f for f in self._kept(target, whole[:MOST_FITS], ()) if f.share == f.precision == 1.0]
            if found:
                return found
        return []

    def _hits(self, target, tried, others, picked):
        """How many of the picked rows each hypothesis gives; those of one site are computed together."""
        hits, sites = np.zeros(len(tried), np.int64), {}
        for k, h in enumerate(tried):
            sites.setdefault(h.site.id, []).append(k)
        for numbers in sites.values():
            site = tried[numbers[0]].site
            was = self.rows.plain(site, picked)
            values = [self.rows.plain(tried[k].by, picked) + np.zeros(len(picked), np.int64) for k in numbers]
            active = [n for n, value in enumerate(values) if others or np.any(value != was)]
            if active:
                stack = np.stack([values[n] for n in active])
                found = self.changed(target, ((site, stack), *others), picked)
                counts = np.count_nonzero(np.broadcast_to(found, stack.shape) == target.got[picked], axis=1)
                hits[[numbers[n] for n in active]] = counts
        return hits

    def _kept(self, target, tried, others):
        fits = [self.fit(target, h, others) for h in tried]
        return [f for f in fits if f.share >= LEAST_SHARE and f.precision >= LEAST_PRECISION]

    def _first_of_each(self, target, tried, others):
        """Fits of the first of a list, and of each cause: it is not alone because others are cheaper."""
        found, whole, count = [], set(), collections.Counter()
        for k, h in enumerate(tried):
            if k < MOST_FITS or (h.cause not in whole and count[h.cause] < MOST_OF_CAUSE):
                count[h.cause] += 1
                kept = self._kept(target, [h], others)
                found += kept
                whole |= {f.hypothesis.cause for f in kept if f.share == f.precision == 1.0}
        return found

    @functools.cached_property
    def reset(self):
        """Rows in which the block is reset."""
        return self.rows.leaves.get(("in", "rst"), np.zeros(self.count, np.int64)) != 0

    def shown(self, name):
        """What the wrong rows of a target show: RESET, ALWAYS, EITHER, SAME or VALUES."""
        if name not in self._shown:
            self._shown[name] = self._what_is_shown(self.targets[name])
        return self._shown[name]

    def _what_is_shown(self, target):
        wrong = np.flatnonzero(target.wrong)
        if self.reset[wrong].all() and target.root.op == "next":
            return RESET
        if len(np.unique(target.got[wrong])) == 1:
            return ALWAYS
        inside = [node for node in self.net.inside(target.root) if node.id < self.net.own]
        mask, taken = (1 << target.fmt.width) - 1, []

        def few(at):
            got, sound = target.got[at], target.sound[at]
            return any(len(np.unique(difference & mask)) <= FEW for difference in (got ^ sound, got - sound))

        found = SAME if few(wrong) else VALUES
        for given, both in of_conditions.decisions(
            self, target, inside, wrong, lambda rest: not len(rest) or few(rest)
        ):
            if given.all():
                taken.append(both)
            else:
                found = SAME
        return (EITHER if any(taken) else ALWAYS) if taken else found

    def evidence(self, name):
        """Bits that the wrong rows of a target are worth: log2 of the ways to choose so many, or one; values too."""
        target = self.targets[name]
        n, k = np.count_nonzero(target.judged), np.count_nonzero(target.wrong)
        return k * min(target.fmt.width - 1, 4) + max(k, (lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)) / log(2))

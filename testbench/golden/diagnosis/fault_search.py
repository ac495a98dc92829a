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
from testbench.golden.diagnosis import condition_hypotheses, perturb, value_hypotheses
from testbench.golden.diagnosis.net import wrap_column
from testbench.golden.diagnosis.node_rows import Rows
from testbench.golden.diagnosis.perturb import Hypothesis

SHORT = 5  # bits of a register that holds a state
SAMPLE = 40  # wrong rows on which all hypotheses are tried
MOST_FITS = 150  # hypotheses of a target that are then tried on all rows
MOST_OF_CAUSE = 60  # of a cause of which none has given all wrong rows yet
LEAST_SHARE, LEAST_PRECISION = 0.2, 0.95

# what the wrong rows of a target show: they are rows of the reset; one branch was taken in all of them, or one value;
# which of two values was taken; few differences; more than these
RESET, ALWAYS, EITHER, FEW_DIFFERENCES, VALUES = "reset", "always", "either", "same", "values"
FEW = 2  # differences


class Target(NamedTuple):
    """A register or pin: its root, rows of the design that belong to each row of the net, and where they count."""

    name: str
    root: object
    fmt: object
    got: np.ndarray
    compared_mask: np.ndarray
    sound: np.ndarray
    wrong: np.ndarray

    def wrap_to_port(self, column):
        """A column as a port of this width holds it."""
        return wrap_column(column, self.fmt.width, bool(self.fmt.s))


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


def sample_rows(rows):
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
        self.hypotheses, self._difference_kinds, self.tried = {}, {}, {}
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
        compared_mask = care[name].copy()
        if root.op == "next":
            # row n of the net gives row n + 1 of the register
            got, compared_mask = np.append(got[1:], got[-1:]), np.append(compared_mask[1:], False)
        for node in self.net.cone_nodes(root):
            if node.op == "reg" and node.value in care:
                compared_mask &= care[node.value] & self._usual[node.value]
        sound = wrap_column(self.rows.node_column(root), fmt.width, bool(fmt.s))
        return Target(name, root, fmt, got, compared_mask, sound, compared_mask & (got != sound))

    @functools.cached_property
    def bits(self):
        """`condition_hypotheses.Bits` of the rows."""
        return condition_hypotheses.Bits(self.net, self.rows)

    def site_hypotheses(self, node):
        """Hypotheses at a node, made once."""
        if node.id not in self.hypotheses:
            self.hypotheses[node.id] = perturb.node_hypotheses(self.net, node, self.rows.observed_range)
        return self.hypotheses[node.id]

    def values_with_faults(self, target, faults, at):
        """What a target is with faults, as its port holds it."""
        return target.wrap_to_port(self.rows.values_with_faults(target.root, faults, at))

    def fit(self, target, hypothesis, assumed_faults=()):
        """`Fit` of one hypothesis beside `assumed_faults` that are taken for granted, over all rows."""
        every = slice(None)
        column = self.values_with_faults(target, ((hypothesis.site, hypothesis.by), *assumed_faults), every)
        before = self.values_with_faults(target, assumed_faults, every) if assumed_faults else target.sound
        wrong = target.compared_mask & (target.got != before)
        active = target.compared_mask & (column != before)
        explained_mask = wrong & (column == target.got)
        hits = np.count_nonzero(explained_mask)
        return Fit(hypothesis, hits / max(np.count_nonzero(wrong), 1), hits / max(np.count_nonzero(active), 1), column)

    def ranked_fits(self, name, assumed_faults=()):
        """Fits of a target that explain enough and disturb little, the best first."""
        target = self.targets[name]
        before = self.values_with_faults(target, assumed_faults, slice(None)) if assumed_faults else target.sound
        wrong = np.flatnonzero(target.compared_mask & (target.got != before))
        if not len(wrong):
            return []
        picked = sample_rows(wrong)
        inside = [node for node in self.net.cone_nodes(target.root) if node.id < self.net.model_size]
        tried = [h for node in inside for h in self.site_hypotheses(node)]
        rivals = []
        if not assumed_faults:
            read = value_hypotheses.hypotheses(self.net, self.rows, target, inside, wrong)
            read += condition_hypotheses.hypotheses(self, target, inside, picked, wrong)
            tried += [h for h in read if h.cost < perturb.FAR]
            rivals = [h for h in read if h.cost >= perturb.FAR]
        self.tried[name] = max(len(tried), self.tried.get(name, 0))
        hits = self._hits(target, tried, assumed_faults, picked)
        order = sorted(range(len(tried)), key=lambda k: (-hits[k], tried[k].cost))
        complete_indices = [k for k in order if hits[k] == len(picked)]
        part = [k for k in order if LEAST_SHARE * len(picked) <= hits[k] < len(picked)]
        fits = self._fits_across_causes(target, [tried[k] for k in complete_indices], assumed_faults)
        if any(f.share == 1.0 for f in fits):
            rivals += [] if assumed_faults else value_hypotheses.unclassified_hypotheses(self.net, target, inside)
            hits = self._hits(target, rivals, assumed_faults, picked)
            fits += self._acceptable_fits(target, [h for h, n in zip(rivals, hits) if n == len(picked)], assumed_faults)
        else:
            fits += self._acceptable_fits(target, [tried[k] for k in part[:MOST_FITS]], assumed_faults)
            fits += self._fallback_fits(target, inside, picked, wrong) if not assumed_faults else []
        return sorted(fits, key=lambda f: (-round(f.share * f.precision, 3), f.hypothesis.cost))

    def free(self, target, node, column):
        """A flag that has a value of its own in each row."""
        name = f"free {target.name} {node.id} {len(self.rows.leaves)}"
        self.rows.leaves["in", name] = column.astype(np.int64)
        return self.net.leaf("in", name, BIT)

    def _fallback_fits(self, target, inside, picked, wrong):
        """What is tried where nothing else explains all wrong rows; none of it makes a name certain."""
        for source in (
            value_hypotheses.operand_hypotheses,
            condition_hypotheses.free_condition_hypotheses,
            value_hypotheses.free_rounding_hypotheses,
        ):
            tried = list(source(self, target, inside, wrong))
            self.tried[target.name] += len(tried)
            hits = self._hits(target, tried, (), picked)
            complete = [h for h, n in zip(tried, hits) if n == len(picked)]
            fits = [f for f in self._acceptable_fits(target, complete[:MOST_FITS], ()) if f.share == f.precision == 1.0]
            if fits:
                return fits
        return []

    def _hits(self, target, tried, assumed_faults, picked):
        """How many of the picked rows each hypothesis gives; those of one site are computed together."""
        hits, sites = np.zeros(len(tried), np.int64), {}
        for k, h in enumerate(tried):
            sites.setdefault(h.site.id, []).append(k)
        for numbers in sites.values():
            site = tried[numbers[0]].site
            was = self.rows.node_values(site, picked)
            values = [self.rows.node_values(tried[k].by, picked) + np.zeros(len(picked), np.int64) for k in numbers]
            active = [n for n, value in enumerate(values) if assumed_faults or np.any(value != was)]
            if active:
                stack = np.stack([values[n] for n in active])
                predicted_values = self.values_with_faults(target, ((site, stack), *assumed_faults), picked)
                counts = np.count_nonzero(np.broadcast_to(predicted_values, stack.shape) == target.got[picked], axis=1)
                hits[[numbers[n] for n in active]] = counts
        return hits

    def _acceptable_fits(self, target, tried, assumed_faults):
        all_fits = [self.fit(target, h, assumed_faults) for h in tried]
        return [f for f in all_fits if f.share >= LEAST_SHARE and f.precision >= LEAST_PRECISION]

    def _fits_across_causes(self, target, tried, assumed_faults):
        """Fits of the first of a list, and of each cause: it is not alone because others are cheaper."""
        fits, complete_causes, count = [], set(), collections.Counter()
        for k, h in enumerate(tried):
            if k < MOST_FITS or (h.cause not in complete_causes and count[h.cause] < MOST_OF_CAUSE):
                count[h.cause] += 1
                hypothesis_fits = self._acceptable_fits(target, [h], assumed_faults)
                fits += hypothesis_fits
                complete_causes |= {f.hypothesis.cause for f in hypothesis_fits if f.share == f.precision == 1.0}
        return fits

    @functools.cached_property
    def reset(self):
        """Rows in which the block is reset."""
        return self.rows.leaves.get(("in", "rst"), np.zeros(self.count, np.int64)) != 0

    def difference_kind(self, name):
        """What the wrong rows of a target show: RESET, ALWAYS, EITHER, FEW_DIFFERENCES or VALUES."""
        if name not in self._difference_kinds:
            self._difference_kinds[name] = self._classify_differences(self.targets[name])
        return self._difference_kinds[name]

    def _classify_differences(self, target):
        wrong = np.flatnonzero(target.wrong)
        if self.reset[wrong].all() and target.root.op == "next":
            return RESET
        if len(np.unique(target.got[wrong])) == 1:
            return ALWAYS
        inside = [node for node in self.net.cone_nodes(target.root) if node.id < self.net.model_size]
        mask, both_values_flags = (1 << target.fmt.width) - 1, []

        def few(at):
            got, sound = target.got[at], target.sound[at]
            return any(len(np.unique(difference & mask)) <= FEW for difference in (got ^ sound, got - sound))

        kind = FEW_DIFFERENCES if few(wrong) else VALUES
        for explained_mask, both in condition_hypotheses.decisions(
            self, target, inside, wrong, lambda other: not len(other) or few(other)
        ):
            if explained_mask.all():
                both_values_flags.append(both)
            else:
                kind = FEW_DIFFERENCES
        return (EITHER if any(both_values_flags) else ALWAYS) if both_values_flags else kind

    def evidence(self, name):
        """Bits that the wrong rows of a target are worth: log2 of the ways to choose so many, or one; values too."""
        target = self.targets[name]
        n, k = np.count_nonzero(target.compared_mask), np.count_nonzero(target.wrong)
        return k * min(target.fmt.width - 1, 4) + max(k, (lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)) / log(2))

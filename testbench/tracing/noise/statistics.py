"""The statistics of the alarms, on projected whitened residuals with those of the priors below; all draws at once.

    chi2                total                           catalogue, library  largest |t| (one-sided for laws with a sign)
    group, observable   largest (chi2 - n) / sqrt(2n)   whiteness           lag products 1 .. 4 of e and of e^2 - 1
    condition           score against a condition       cusum               largest Brownian bridge of any block
    line                largest periodogram ordinate    prior       largest pull of a nuisance from its prior, in sd
Each becomes a p by its rank among null draws, with an exponential tail where ranks end; the smallest p of all becomes
one by its own rank: that is the look-elsewhere correction.
Source    Westfall & Young, Resampling-Based Multiple Testing (1993); Ljung (1999), ch. 16; docs/tracing.md
"""

import numpy as np

from testbench.tracing.noise.noise_model import bridge
from testbench.tracing.noise.stacks import stacks

LAGS = 4
SHORT, LINES = 8, 16  # rows that a CUSUM and a periodogram need
LEAST_PULL_SHARE = 1e-4  # share of its sd by which data must move a nuisance, or its pull is rounding
TAIL = 0.95, 0.995  # of null draws: far enough for sums of products, whose tail is the longest


class Statistics:
    """Statistics of a space (or some of its groups), with the signatures of laws at hand."""

    def __init__(self, space, rankings, laws, projection, groups=None):
        """rankings: {"catalogue": Ranking, "library": Ranking}; laws: {name: Law}; projection: `rank.Projection`."""
        self.space, self.parts = space, stacks(space, groups)
        spread = np.sqrt(np.maximum(1 - np.sum(projection.q[projection.rows :] ** 2, axis=1), 0.0))
        self.pulled = np.flatnonzero(spread > LEAST_PULL_SHARE)
        self.spread = spread[self.pulled, None]
        self.chosen = [g for g in range(len(space.groups)) if groups is None or g in groups]
        self.scores = {}
        for label, ranking in rankings.items():
            is_visible = ranking.length > 0
            if is_visible.any():
                sign = np.array([laws[name].sign for name in ranking.names])[is_visible]
                self.scores[label] = ((ranking.signatures[:, is_visible] / ranking.length[is_visible]).T, sign)
        self.observables = sorted({b.observable for b in space.blocks})
        self.members = [
            np.concatenate([np.arange(b.rows.start, b.rows.stop) for b in blocks])
            for o in self.observables
            if (blocks := [b for b in space.blocks if b.observable == o and b.group in set(self.chosen)])
        ]
        self.drivers = self._drivers()
        self.names = ["chi2", *self.scores, "group", "observable"]
        lengths = [stack.rows.shape[1] for stack in self.parts]
        self.names += ["whiteness"] if max(lengths, default=0) > LAGS else []
        self.names += ["condition"] if len(self.drivers) else []
        self.names += ["cusum"] if max(lengths, default=0) >= SHORT else []
        self.names += ["line"] if max(lengths, default=0) >= LINES else []
        self.names += ["prior"] if len(self.pulled) else []

    def _drivers(self):
        """Unit vectors over the chosen groups: each numeric condition and its magnitude, less their means."""
        names = sorted({name for g in self.chosen for name in self.space.groups[g].condition})
        out = []
        for name in names:
            condition_values = [self.space.groups[g].condition.get(name) for g in self.chosen]
            if all(isinstance(v, (int, float)) for v in condition_values):
                for x in (np.array(condition_values, float), np.abs(np.array(condition_values, float))):
                    x = x - x.mean()
                    size = np.linalg.norm(x)
                    if size > 1e-9 * (1 + np.abs(x).max(initial=0.0)):
                        out.append(x / size)
        return np.array(out)

    def evaluate(self, e):
        """(statistics, draws) of projected residuals (rows and priors, draws)."""
        e, prior_residuals = e[: self.space.size], e[self.space.size :]
        square = e * e
        out = [square.sum(axis=0)]
        for u, sign in self.scores.values():
            t = u @ e
            out.append(np.where((sign == 0)[:, None], np.abs(t), sign[:, None] * t).max(axis=0))
        spans = [self.space.groups[g].rows for g in self.chosen]
        out.append(_worst([(square[s].sum(axis=0), s.stop - s.start) for s in spans]))
        out.append(_worst([(square[m].sum(axis=0), len(m)) for m in self.members]))
        if "whiteness" in self.names:
            out.append(self._whiteness(e, square))
        if "condition" in self.names:
            out.append(self._condition(e))
        for name, least, measure in (("cusum", SHORT, _cusum), ("line", LINES, _line)):
            if name in self.names:
                stack_maxima = [measure(e[stack.rows]) for stack in self.parts if stack.rows.shape[1] >= least]
                out.append(np.max(stack_maxima, axis=0))
        if "prior" in self.names:
            out.append(np.max(np.abs(prior_residuals[self.pulled]) / self.spread, axis=0))
        return np.array(out)

    def _whiteness(self, e, square):
        best = np.zeros(e.shape[1])
        for v in (e, square - 1.0):
            for name in self.observables:
                for lag in range(1, LAGS + 1):
                    total, count = np.zeros(e.shape[1]), 0
                    for stack in self.parts:
                        rows = stack.rows[[o == name for o in stack.observables]]
                        if rows.size and rows.shape[1] > lag:
                            w = v[rows]
                            total += np.einsum("bnc,bnc->c", w[:, lag:], w[:, :-lag])
                            count += rows.shape[0] * (rows.shape[1] - lag)
                    if count:
                        best = np.maximum(best, np.abs(total) / np.sqrt(count) / (1.0 if v is e else 2.0))
        return best

    def _condition(self, e):
        at = {g: i for i, g in enumerate(self.chosen)}
        best = np.zeros(e.shape[1])
        for name in self.observables:
            means = np.zeros((len(self.chosen), e.shape[1]))
            for block in self.space.blocks:
                if block.observable == name and block.group in at:
                    means[at[block.group]] = e[block.rows].sum(axis=0) / np.sqrt(block.rows.stop - block.rows.start)
            best = np.maximum(best, np.abs(self.drivers @ means).max(axis=0))
        return best


def _worst(pairs):
    return np.max([(s - n) / np.sqrt(2.0 * n) for s, n in pairs], axis=0)


def _cusum(v):
    return bridge(v, 1)[0].max(axis=0)


def _line(v):
    return (np.abs(np.fft.rfft(v, axis=1)[:, 1:]) ** 2 / v.shape[1]).max(axis=(0, 1))


def tail_p(values, null):
    """p of `values` by rank among `null`; above the last TAIL point an exponential through both.

    The tail only breaks the ties of ranks: without it all statistics beyond the last draw would look the same.
    """
    ordered = np.sort(null)
    p = (len(ordered) - np.searchsorted(ordered, values, side="left")) / len(ordered)
    low, high = np.quantile(ordered, TAIL)
    if high > low:
        most, least = (1 - t for t in TAIL)
        rate = np.log(most / least) / (high - low)
        tail_probability = least * np.exp(-rate * np.clip(values - high, 0.0, 600.0 / rate))
        p = np.where(values > high, tail_probability, np.maximum(p, least))
    return np.maximum(p, 1e-300)


def ranks(observed, null):
    """(p of each statistic, global p): `observed` (statistics,), `null` (statistics, draws) under the same law."""
    all_statistics = np.concatenate([observed[:, None], null], axis=1)
    p = np.empty(all_statistics.shape)
    for i, row in enumerate(all_statistics):
        p[i] = tail_p(row, row)
    smallest = p.min(axis=0)
    return p[:, 0], float(np.mean(smallest <= smallest[0]))

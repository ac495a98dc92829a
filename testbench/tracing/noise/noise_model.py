"""Is the declared noise the noise of the repeats? And if not, by how much, per observable and octave of slowness.

Contrasts between repeats hold noise and nothing that repeats. Whitened by the declared model they are independent with
variance 1, if that model is true. Their DCT along time, pooled over groups, gives a variance ratio f per observable
and octave:

    f = (sum of squares + w) / (nu + w)      nu squares; w: weight of the declared model; once it is rejected,
                                             0 where the repeats are louder: the few that are quiet by chance
                                             would make misfits out of nothing
    w = 2 / (scatter of the ratios beyond chance + its standard error)      empirical Bayes, LEAST_TRUST .. MOST_TRUST
Refined noise is the declared one with f; a residual divided by sqrt(f) is t-distributed with nu + w, per octave.
Fitted data are refined by their own repeats, held-out data by all, and there no octave is quieter than declared:
contrasts hold nothing that a fit could learn, and not what repeats have in common.
Assumption: the noise's spectrum departs from the declared one in the same way in all conditions.
Source    docs/tracing.md
"""

from typing import NamedTuple

import numpy as np
from scipy.fft import dct
from scipy.stats import chi2

from testbench.tracing.noise.stacks import bands, multiply, stacks

LEAST_TRUST, MOST_TRUST = 2.0, 20.0
LEAST = 6  # squares behind an f; octaves are joined until they have as many


class Octave(NamedTuple):
    """Variance ratio of an observable's octaves first .. last."""

    observable: str
    first: int
    last: int
    ratio: float  # measured / declared
    nu: int
    f: float
    dof: float


class Noise(NamedTuple):
    """Octaves of all observables, and the test of the declared model."""

    octaves: tuple
    p: float  # global, of the declared model on the contrasts; nan without repeats
    worst: str
    jump: str  # where a CUSUM of a contrast is largest
    dof: int

    def _rows(self, stack, values, empty):
        """(blocks, length, ...) of values[octave] at every DCT coefficient."""
        level, of = bands(stack.rows.shape[1]), {}
        for name in set(stack.observables):
            octaves = [o for o in self.octaves if o.observable == name]
            row = np.full((len(level), *np.shape(empty)), empty)
            for o in octaves:
                row[(level >= o.first) & ((level <= o.last) | (o is octaves[-1]))] = values[o]
            of[name] = row
        return np.stack([of[name] for name in stack.observables])

    def whitener(self, space, power=-0.5):
        """Function that whitens stacked vectors again, by f^-1/2; power 0.5 undoes it."""
        parts = stacks(space)
        factor = {o: o.f**power for o in self.octaves}
        table = [self._rows(stack, factor, 1.0) for stack in parts]

        def rewhiten(v):
            queue = iter(table)
            return multiply(parts, v, lambda stack: next(queue))

        return rewhiten

    def refined_draws(self, space, count, rng):
        """(rows, count) draws of a residual in refined units: t-distributed per octave."""
        return self.unit_noise().scale_octaves(space, rng.normal(size=(space.size, count)), rng)

    def scale_octaves(self, space, draws, rng):
        """Draws (rows, count) of unit variance, each with octaves as loud as they may be for all that repeats tell."""
        parts, count = stacks(space), draws.shape[1]
        scale = {o: np.sqrt(o.f * o.dof / rng.chisquare(o.dof, size=count)) for o in self.octaves}

        plain = np.ones(count)
        return multiply(parts, draws, lambda stack: self._rows(stack, scale, plain))

    def unit_noise(self):
        """The same in units of itself: of a space that it has whitened again."""
        return self._replace(octaves=tuple(o._replace(f=1.0) for o in self.octaves))

    def loud(self):
        """The same with no octave quieter than declared: what repeats have in common is not in their contrasts."""
        return self._replace(octaves=tuple(o._replace(f=max(1.0, o.f)) for o in self.octaves))


def _squares(spaces):
    """{(observable, octave): (sum of squares, number)} of all contrasts."""
    sums_by_octave = {}
    for space in spaces:
        repeated = {g for g, c in enumerate(space.contrasts) if len(c)}
        for stack in stacks(space, repeated):
            level = bands(stack.rows.shape[1])
            for i, (name, g) in enumerate(zip(stack.observables, stack.groups)):
                start = space.groups[g].rows.start
                spectrum = dct(space.contrasts[g][:, stack.rows[i] - start], axis=1, norm="ortho") ** 2
                for octave in range(level.max() + 1):
                    chosen = spectrum[:, level == octave]
                    s, n = sums_by_octave.get((name, octave), (0.0, 0))
                    sums_by_octave[name, octave] = (s + float(chosen.sum()), n + chosen.size)
    return sums_by_octave


def _merge_octaves(sums_by_octave):
    """(observable, first, last, sum, number) with at least LEAST squares each where there are as many."""
    out = []
    for name in sorted({n for n, _ in sums_by_octave}):
        pending = None
        for octave in sorted(o for n, o in sums_by_octave if n == name):
            s, n = sums_by_octave[name, octave]
            pending = (
                (octave, octave, s, n) if pending is None else (pending[0], octave, pending[2] + s, pending[3] + n)
            )
            if pending[3] >= LEAST:
                out.append((name, *pending))
                pending = None
        if pending is not None:
            if out and out[-1][0] == name:
                _, first, _, s, n = out.pop()
                pending = (first, pending[1], s + pending[2], n + pending[3])
            out.append((name, *pending))
    return out


def _octaves(joined, trust, rejected=False):
    out = []
    for name, first, last, s, n in joined:
        w = 0.0 if rejected and s > n else trust
        out.append(Octave(name, first, last, s / n, int(n), (s + w) / (n + w), n + w))
    return tuple(out)


def _trust(joined):
    """Squares that the declared model is worth, from how the ratios scatter about 1."""
    if not joined:
        return LEAST_TRUST
    ratio = np.array([s / n for *_, s, n in joined])
    chance = np.array([2.0 / n for *_, n in joined])  # variance of a ratio if the model is true
    weight = 1.0 / chance
    scatter = float(np.sum(weight * ((ratio - 1) ** 2 - chance)) / weight.sum())
    error = float(np.sqrt(2.0 * len(ratio)) / weight.sum())
    return float(np.clip(2.0 / (max(scatter, 0.0) + error), LEAST_TRUST, MOST_TRUST))


def estimate_octave_noise(spaces, rng, alpha=0.01, draws=400, judge=True):
    """`Noise` of spaces; `judge` False if the declared noise was itself made from these repeats: no test then."""
    joined = _merge_octaves(_squares(spaces))
    dof = int(sum(n for *_, n in joined))
    trust = _trust(joined)
    octaves = _octaves(joined, trust)
    if not dof or not judge:
        return Noise(octaves, float("nan"), "", "", dof)
    p = [2 * min(chi2.cdf(s, n), chi2.sf(s, n)) for *_, s, n in joined]
    at = int(np.argmin(p))
    spectral = min(1.0, 1 - (1 - min(p[at], 1.0)) ** len(p))
    o = octaves[at]
    span = "the mean" if o.last == 0 else f"octaves {o.first}..{o.last}"
    worst = f"{o.observable}, {span}: variance {o.ratio:.3g} times the declared one"
    jump_p, jump = _jump(spaces, rng, draws)
    p_global = float(min(1.0, 2 * min(spectral, jump_p)))
    return Noise(_octaves(joined, trust, rejected=p_global < alpha), p_global, worst, jump, dof)


def bridge(v, axis):
    """Largest |CUSUM| of v less its mean along an axis, / sqrt(length), and where."""
    n = v.shape[axis]
    path = np.abs(np.cumsum(v - v.mean(axis=axis, keepdims=True), axis=axis)) / np.sqrt(n)
    return path.max(axis=axis), path.argmax(axis=axis)


def _jump(spaces, rng, draws):
    """p of the largest CUSUM of all contrasts against white noise, and where it is."""
    best, shapes = (0.0, ""), []
    for space, block in ((s, block) for s in spaces for block in s.blocks):
        c, rows = space.contrasts[block.group], block.rows.stop - block.rows.start
        if len(c) and rows >= 8:
            a = block.rows.start - space.groups[block.group].rows.start
            part = c[:, a : a + rows]
            size, where = bridge(part, 1)
            k = int(np.argmax(size))
            shapes.append(part.shape)
            if size[k] > best[0]:
                best = (float(size[k]), f"{block.observable} of {space.groups[block.group].name}, row {int(where[k])}")
    if not shapes:
        return 1.0, ""
    rows = sum(a * b for a, b in shapes)
    count = max(20, min(draws, int(2e7 // rows)))
    largest = np.zeros(count)
    for length in sorted({b for _, b in shapes}):
        paths = sum(a for a, b in shapes if b == length)
        for draw in range(count) if paths * length * count > 4e6 else (slice(None),):
            shape = (count, paths, length) if isinstance(draw, slice) else (1, paths, length)
            largest[draw] = np.maximum(largest[draw], bridge(rng.normal(size=shape), 2)[0].max(axis=1))
    return (int(np.sum(largest >= best[0])) + 1) / (count + 1), best[1]

"""Does something repeat that the model lacks? Alarms that do not believe the declared noise, beside one that does.

    rotation    needs no noise model: sqrt(R) (mean - mu) and the contrasts of R repeats have one law, so have all their
                rotations within a group (two repeats: swaps). p = rank of the observed statistics among rotated data
    refined     noise refined by the contrasts (noise.py), its uncertainty in the null draws: t instead of Gauss
    declared    null draws from the problem's noise, whitened and projected
    deterministic misfit  Cauchy's combination of rotation and refined; without repeats `declared` is all there is

The fit has taken Q Q' z out of the mean: for the rotations it is replaced by Q Q' of a random contrast, so that the
mean is as long as the contrasts are.
Source    Langsrud, Statistics and Computing 15 (2005); Liu & Xie, J. Am. Stat. Assoc. 115 (2020); docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.fit.rank import Projection, prior_z, rank
from testbench.tracing.noise.statistics import Statistics, ranks
from testbench.tracing.problem.problem import all_laws
from testbench.tracing.problem.trace_checkpoint import digest

BATCH = 4_000_000  # numbers in memory per batch of draws


class Test(NamedTuple):
    """One alarm: p of every statistic, and the global one."""

    p: dict
    p_global: float
    draws: int
    values: dict


class Alarms(NamedTuple):
    """All alarms at a fit."""

    rotation: Test | None
    refined: Test | None
    declared: Test
    p_deterministic: float
    model_based: bool  # True: no repeats
    reference: np.ndarray  # null statistics of the refined (or declared) test, for power
    statistics: Statistics


def batches(draws, rows):
    """Sizes of batches of draws."""
    size = max(1, min(draws, BATCH // max(rows, 1)))
    return [min(size, draws - start) for start in range(0, draws, size)]


def cauchy(p, draws):
    """One p of several dependent ones: the mean of tan((1/2 - p) pi) has Cauchy's tail however they depend."""
    p = np.clip(p, 1e-15, draws / (draws + 1))
    return float(np.clip(0.5 - np.arctan(np.mean(np.tan((0.5 - p) * np.pi))) / np.pi, 0.0, 1.0))


def _test(statistics, observed, null):
    p, p_global = ranks(observed, null)
    p_by_name = {name: float(v) for name, v in zip(statistics.names, p)}
    return Test(p_by_name, p_global, null.shape[1], {n: float(v) for n, v in zip(statistics.names, observed)})


def declared_draws(space, count, rng):
    """(rows, count) draws of the problem's noise, whitened: the law of a mean's residual if that noise is true."""
    ks = [g.members[0] for g in space.groups]
    return space.refine(
        np.concatenate([space.whiten_rows(k, space.problem.noise_draws(k, count, rng)) / space.gain for k in ks])
    )


def null_statistics(statistics, projection, draw, draws, rng):
    """(statistics, draws) of noise pushed through the projection of the fit, priors drawn too."""
    batch_statistics = []
    for count in batches(draws, projection.rows):
        prior = rng.normal(size=(projection.priors, count))
        batch_statistics.append(statistics.evaluate(projection.project_with_priors(draw(count), prior)))
    return np.concatenate(batch_statistics, axis=1)


def rotation_test(space, rankings, fit, draws, rng):
    """`Test` by rotations within groups that have repeats; None if there are none, or two rotations only."""
    groups = {g for g, c in enumerate(space.contrasts) if len(c)}
    if not groups:
        return None
    mask = np.zeros(space.size, bool)
    for g in groups:
        mask[space.groups[g].rows] = True
    inside = Projection(np.where(mask[:, None], space.declared(fit.jacobian), 0.0), fit.model.prior_columns())
    z = np.where(mask, space.declared(fit.z), 0.0)
    laws = all_laws(space.problem)
    group_rankings = {
        label: rank(fit, r.names, np.where(mask[:, None], space.declared(r.signatures), 0.0), inside, z)
        for label, r in rankings.items()
    }
    statistics = Statistics(space, group_rankings, laws, inside, groups)
    residual = inside.project_with_priors(z[:, None], prior_z(fit)[:, None])[:, 0]
    observed = statistics.evaluate(residual[:, None])[:, 0]
    null_batches = []
    for count in batches(draws, space.size):
        copy, mixed = np.zeros((space.size, count)), np.zeros((space.size, count))
        turns = {}
        for g in groups:
            contrasts, span = space.contrasts[g], space.groups[g].rows
            a = rng.normal(size=(len(contrasts), count))
            copy[span] = contrasts.T @ (a / np.linalg.norm(a, axis=0))
            turn = rng.normal(size=(len(contrasts) + 1, count))
            turns[g] = turn / np.linalg.norm(turn, axis=0)
        prior = rng.normal(size=(inside.priors, count))
        stacked = np.concatenate([copy, prior])
        mean = residual[: space.size, None] + (stacked - inside.project_with_priors(copy, prior))[: space.size]
        for g in groups:
            span, turn = space.groups[g].rows, turns[g]
            mixed[span] = turn[0] * mean[span] + space.contrasts[g].T @ turn[1:]
        null_batches.append(
            statistics.evaluate(inside.project_with_priors(mixed, rng.normal(size=(inside.priors, count))))
        )
    return _test(statistics, observed, np.concatenate(null_batches, axis=1))


def refined_view(fit, rankings, noise):
    """(projection, z, `Statistics`, rankings) of a fit in units of the refined noise."""
    again = noise.whitener(fit.model.space)
    z, projection = again(fit.z), Projection(again(fit.jacobian), fit.model.prior_columns())
    refined = {label: rank(fit, r.names, again(r.signatures), projection, z) for label, r in rankings.items()}
    return projection, z, Statistics(fit.model.space, refined, all_laws(fit.model.problem), projection), refined


def alarms(store, fit, rankings, noise, draws, seed):
    """`Alarms` at a fit; their draws are taken from the store if they have been computed from the same numbers.

    rankings  {"catalogue": Ranking, "library": Ranking}, at that fit;   noise  `noise.Noise`
    """
    space, prior = fit.model.space, prior_z(fit)[:, None]
    rng = np.random.default_rng([seed, 3])
    projection = Projection(fit.jacobian, fit.model.prior_columns())
    statistics = Statistics(space, rankings, all_laws(fit.model.problem), projection)
    views = [(projection, fit.z, statistics, declared_draws)]
    if noise.octaves:
        views.append((*refined_view(fit, rankings, noise)[:3], noise.refined_draws))

    def against_null(inner, z, statistics, draw):
        observed = statistics.evaluate(inner.project_with_priors(z[:, None], prior))[:, 0]
        null = null_statistics(statistics, inner, lambda count: draw(space, count, rng), draws, rng)
        return _test(statistics, observed, null), null

    def compute():
        declared, null = against_null(*views[0])
        if not noise.octaves:
            return {"tests": [None, None, declared._asdict()], "p": declared.p_global, "reference": null.tolist()}
        rotation = rotation_test(space, rankings, fit, draws, rng)
        refined, null = against_null(*views[1])
        tests = [None if t is None else t._asdict() for t in (rotation, refined, declared)]
        return {"tests": tests, "p": cauchy([refined.p_global, rotation.p_global], draws), "reference": null.tolist()}

    arrays = [part for r in rankings.values() for part in (r.signatures, r.length)]
    octaves = [list(o) for o in noise.octaves]
    key = digest(
        "alarms, priors too", draws, seed, octaves, fit.z, fit.jacobian, prior_z(fit), *arrays, fit.model.problem.hashes
    )
    stored_alarms = store.load_or_compute(key, compute)
    tests = [None if t is None else Test(**t) for t in stored_alarms["tests"]]
    return Alarms(*tests, stored_alarms["p"], not noise.octaves, np.array(stored_alarms["reference"]), views[-1][2])

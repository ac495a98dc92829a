"""The inference judged on papers that it could have been given: boards from the prior, rows with noise and rounding.

    board      priors and modes drawn; rows by `likelihood.simulate_papers`; the inference sees nothing else
    parameter  rank of the truth among the draws of the whole fit
    held out   rank of a row that the fit did not see among noisy rows of the draws: steps after the whole fit, and the
               rows of one fold by class and one by temperature, in turn
    coverage   share of ranks within 5 % and 95 %

Source    docs/inference.md
"""

from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, heldout_measurements, infer, likelihood, priors, rows

DRAWS = 300


class TruthRanks(NamedTuple):
    """Ranks by parameter and by row; the probability that the true mode got; effective draws."""

    parameters: dict
    heldout_ranks: dict
    true_mode: list
    sizes: list


def board(seed, number):
    """(z, mode, generator) of one board that works, arrays of one; the same however many are drawn."""
    rng = np.random.default_rng([seed, number])
    while True:
        z = rng.standard_normal((1, infer.SIZE))
        mode = {c.name: rng.choice(c.choices, 1) for c in priors.CHOICES}
        if forward.works(forward.predict(z, mode, steps=False))[0]:
            return z, mode, rng


def rank(values, weight, truth, rng):
    """Share of the weight below a truth; of what equals it, a random part."""
    return float(weight[values < truth].sum() + rng.uniform() * weight[values == truth].sum())


def simulate_truth_ranks(count, seed, draws=DRAWS, progress=None):
    """`TruthRanks` of `count` boards."""
    folds = rows.folds()
    by_class = [f for f in folds if "class" in f.rule]
    by_temp = [f for f in folds if "temperature" in f.rule]
    out = TruthRanks({p.name: [] for p in priors.PRIORS}, {}, [], [])
    for number in range(count):
        z, mode, rng = board(seed, number)
        (paper,) = likelihood.simulate_papers(z, mode, rng)
        post = infer.posterior(likelihood.compared_rows(paper), rng, draws)
        out.sizes.append(post.size)
        for k, prior in enumerate(priors.PRIORS):
            out.parameters[prior.name].append(rank(post.z[:, k], post.weight, z[0, k], rng))
        is_true_mode = np.all([post.mode[name] == mode[name] for name in mode], axis=0)
        out.true_mode.append(float(post.weight[is_true_mode].sum()))
        steps = tuple(row.name for row in likelihood.STEPPED)
        todo = [(post, steps)]
        for fold in (by_class[number % len(by_class)], by_temp[number % len(by_temp)]):
            todo.append((infer.posterior(likelihood.compared_rows(paper, fold.rows), rng, draws), fold.rows))
        for fitted, names in todo:
            row_draws = heldout_measurements.draw_noisy_predictions(fitted, rng)
            for name in names:
                got = rank(row_draws[name], fitted.weight, paper.values[name], rng)
                out.heldout_ranks.setdefault(name, []).append(got)
        if progress:
            progress("simulated papers", number + 1, count)
    return out


def coverage(ranks):
    """Share of ranks within the central 90 %."""
    ranks = np.asarray(ranks)
    return float(np.mean((ranks > 0.05) & (ranks < 0.95)))

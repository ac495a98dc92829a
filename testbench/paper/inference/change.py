"""The smallest change of one number that would meet what is contradicted; d in standard deviations of its prior.

    between register sets
    before   case 3 or 4 of the most probable board        after   case 4 or 5 of the same board, one number moved by d
    cost     sum of ((|change| - paper)/sigma)^2 + d^2

    at a temperature that was left out
    moved    every draw of the fit without it, one number moved by d at this temperature alone
    smallest least |d| with which no class of that temperature is contradicted; doubled up to FAR, then halved.
             What is met only between two of the doubled steps is not found
    sign     the same fold judged with the bias of SIGN_ROW printed with the other sign

The board itself stays: neither a written register nor a law over temperature moves a part so. The result says how much
one would have to.
Source    docs/inference.md
"""

from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, heldout_measurements, infer, likelihood, priors, rows

REACH, STEP = 60.0, 0.02  # standard deviations of a prior
FIRST, FAR, HALVED = 1 / 16, 8.0, 6  # first and last |d|; halvings of the last interval
SIGN_ROW = "bias_50"  # printed without the minus sign that the other two have


class Move(NamedTuple):
    """One number moved: from, to, in its unit, and how its class is met without and with that.

    without, together   chi2 of the class between register sets; at a temperature its p
    """

    group: str
    name: str
    unit: str
    before: float
    after: float
    moved: float  # standard deviations of the prior
    without: float
    together: float
    fold: str = ""  # the temperature that was left out


def smallest(z, mode, best=2):
    """{class: [`Move`, ...]} for each change between cases; z (priors,), mode of numbers: a board."""
    d = np.arange(-REACH, REACH + STEP, STEP)
    one = {name: np.full(len(d), choice) for name, choice in mode.items()}
    base = forward.compute_board_rows(np.tile(z, (len(d), 1)), one)
    class_moves = {}
    for k, prior in enumerate(priors.PRIORS):
        shifted_z = np.tile(z, (len(d), 1))
        shifted_z[:, k] += d
        with np.errstate(all="ignore"):
            shifted_rows = forward.compute_board_rows(shifted_z, one, (4, 5))
            for group in rows.STEPPED:
                for step in rows.STEPS:
                    unmet = _unmet(base, shifted_rows, group, step)
                    cost = np.where(np.isfinite(unmet), unmet + d**2, np.inf)
                    at = int(np.argmin(cost))
                    v = prior.value(np.array([z[k], shifted_z[at, k]]))
                    still = float(unmet[len(d) // 2])
                    item = Move(f"{group}_{step}", prior.name, prior.unit, *map(float, v), float(d[at]), still,
                                float(unmet[at]))  # fmt: skip
                    class_moves.setdefault(item.group, []).append(item)
    return {group: sorted(items, key=lambda i: i.together + i.moved**2)[:best] for group, items in class_moves.items()}


def _unmet(base, shifted_rows, group, step):
    """Chi2 of the class at each d."""
    case_before, case_after = map(int, step.split("to"))
    total = 0.0
    for row in likelihood.STEPPED:
        if row.group == f"{group}_{step}":
            change = forward.relative_case_change(
                base.cases[case_before, group, row.temp_degc], shifted_rows.cases[case_after, group, row.temp_degc]
            )
            total = total + ((np.abs(change) - row.value) / row.sigma) ** 2
    return total


def _shifted_predictions(post, draws, exact, fold, k, d):
    """{row: array} of the fold's printed numbers with number k of every draw moved by d: noise stays."""
    z = post.z.copy()
    z[:, k] += d
    with np.errstate(all="ignore"):
        shifted = forward.predict(z, post.mode, steps=False)
    return {
        n: draws[n] * shifted[n] / exact[n] if n in forward.LOGARITHMIC else draws[n] + shifted[n] - exact[n]
        for n in fold.rows
    }


def heldout_moves(paper, fold_result, group, best=2):
    """[`Move`, ...] that bring a contradicted class of a temperature that was left out inside, medians in its unit.

    fold_result  what `heldout_measurements.judge_folds` keeps of a fold
    """
    fold, post, draws = fold_result
    some = post.weight > 0
    mode = {name: choices[some] for name, choices in post.mode.items()}
    post = post._replace(z=post.z[some], mode=mode, weight=post.weight[some])
    draws = {name: draws[name][some] for name in fold.rows}
    exact = forward.predict(post.z, post.mode, steps=False)
    groups = dict.fromkeys(heldout_measurements.GROUPS[name] for name in fold.rows)

    def shifted_class_p(k, d):
        now = _shifted_predictions(post, draws, exact, fold, k, d)
        if not all(np.isfinite(a).all() for a in now.values()):
            return None
        classes = {
            g: heldout_measurements.compare_class(
                fold.name, g, heldout_measurements.class_row_names(fold, g), now, post.weight, paper
            )
            for g in groups
        }
        return None if any(c.verdict == "contradicted" for c in classes.values()) else classes[group].p

    p_before = heldout_measurements.compare_class(
        fold.name, group, heldout_measurements.class_row_names(fold, group), draws, post.weight, paper
    ).p
    size, met = FIRST, []
    while size <= FAR and len(met) < best:
        met = [(k, d) for k in range(infer.SIZE) for d in (-size, size) if shifted_class_p(k, d) is not None]
        size *= 2
    moves = [_least(post, fold, group, p_before, shifted_class_p, k, d) for k, d in met]
    return sorted(moves, key=lambda m: abs(m.moved))[:best]


def _least(post, fold, group, p_before, shifted_class_p, k, far):
    """`Move` of number k, of which `far` meets: between it and 0."""
    lower_bound, p = 0.0, shifted_class_p(k, far)
    for _ in range(HALVED):
        middle = (lower_bound + far) / 2
        now = shifted_class_p(k, middle)
        lower_bound, far, p = (middle, far, p) if now is None else (lower_bound, middle, now)
    prior, middle = priors.PRIORS[k], infer.quantile(post.z[:, k], post.weight, 0.5)
    before, after = (float(prior.value(np.float64(z))) for z in (middle, middle + far))
    return Move(group, prior.name, prior.unit, before, after, far, p_before, p, fold.name)


def with_other_sign(paper, fold, group, rng, draws, least):
    """`heldout_measurements.Class` of a temperature that was left out, with the other sign printed in SIGN_ROW."""
    turned = likelihood.Paper(paper.values | {SIGN_ROW: -paper.values[SIGN_ROW]})
    post = infer.posterior(likelihood.compared_rows(turned, fold.rows), rng, draws, least)
    row_draws = heldout_measurements.draw_noisy_predictions(post, rng)
    return heldout_measurements.compare_class(
        fold.name, group, heldout_measurements.class_row_names(fold, group), row_draws, post.weight, turned
    )

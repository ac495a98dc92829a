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

from testbench.paper.inference import forward, heldout, infer, likelihood, priors, rows

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
    base = forward.see(np.tile(z, (len(d), 1)), one)
    found = {}
    for k, prior in enumerate(priors.PRIORS):
        moved = np.tile(z, (len(d), 1))
        moved[:, k] += d
        with np.errstate(all="ignore"):
            seen = forward.see(moved, one, (4, 5))
            for group in rows.STEPPED:
                for step in rows.STEPS:
                    unmet = _unmet(base, seen, group, step)
                    cost = np.where(np.isfinite(unmet), unmet + d**2, np.inf)
                    at = int(np.argmin(cost))
                    v = prior.value(np.array([z[k], moved[at, k]]))
                    still = float(unmet[len(d) // 2])
                    item = Move(f"{group}_{step}", prior.name, prior.unit, *map(float, v), float(d[at]), still,
                                float(unmet[at]))  # fmt: skip
                    found.setdefault(item.group, []).append(item)
    return {group: sorted(items, key=lambda i: i.together + i.moved**2)[:best] for group, items in found.items()}


def _unmet(base, seen, group, step):
    """Chi2 of the class at each d."""
    case_before, case_after = map(int, step.split("to"))
    total = 0.0
    for row in likelihood.STEPPED:
        if row.group == f"{group}_{step}":
            change = forward.change(
                base.cases[case_before, group, row.temp_degc], seen.cases[case_after, group, row.temp_degc]
            )
            total = total + ((np.abs(change) - row.value) / row.sigma) ** 2
    return total


def _shifted(post, said, exact, fold, k, d):
    """{row: array} of the fold's printed numbers with number k of every draw moved by d: noise stays."""
    z = post.z.copy()
    z[:, k] += d
    with np.errstate(all="ignore"):
        found = forward.predict(z, post.mode, steps=False)
    return {
        n: said[n] * found[n] / exact[n] if n in forward.LOGARITHMIC else said[n] + found[n] - exact[n]
        for n in fold.rows
    }


def at_temperature(paper, kept, group, best=2):
    """[`Move`, ...] that bring a contradicted class of a temperature that was left out inside, medians in its unit.

    kept  what `heldout.judged` keeps
    """
    fold, post, said = kept
    some = post.weight > 0
    mode = {name: choices[some] for name, choices in post.mode.items()}
    post = post._replace(z=post.z[some], mode=mode, weight=post.weight[some])
    said = {name: said[name][some] for name in fold.rows}
    exact = forward.predict(post.z, post.mode, steps=False)
    groups = dict.fromkeys(heldout.GROUPS[name] for name in fold.rows)

    def judged(k, d):
        now = _shifted(post, said, exact, fold, k, d)
        if not all(np.isfinite(a).all() for a in now.values()):
            return None
        classes = {g: heldout.compared(fold.name, g, heldout.named(fold, g), now, post.weight, paper) for g in groups}
        return None if any(c.verdict == "contradicted" for c in classes.values()) else classes[group].p

    without = heldout.compared(fold.name, group, heldout.named(fold, group), said, post.weight, paper).p
    size, met = FIRST, []
    while size <= FAR and len(met) < best:
        met = [(k, d) for k in range(infer.SIZE) for d in (-size, size) if judged(k, d) is not None]
        size *= 2
    found = [_least(post, fold, group, without, judged, k, d) for k, d in met]
    return sorted(found, key=lambda m: abs(m.moved))[:best]


def _least(post, fold, group, without, judged, k, far):
    """`Move` of number k, of which `far` meets: between it and 0."""
    near, p = 0.0, judged(k, far)
    for _ in range(HALVED):
        middle = (near + far) / 2
        now = judged(k, middle)
        near, far, p = (middle, far, p) if now is None else (near, middle, now)
    prior, middle = priors.PRIORS[k], infer.quantile(post.z[:, k], post.weight, 0.5)
    before, after = (float(prior.value(np.float64(z))) for z in (middle, middle + far))
    return Move(group, prior.name, prior.unit, before, after, far, without, p, fold.name)


def with_other_sign(paper, fold, group, rng, draws, least):
    """`heldout.Class` of a temperature that was left out, with the other sign printed in SIGN_ROW."""
    turned = likelihood.Paper(paper.values | {SIGN_ROW: -paper.values[SIGN_ROW]})
    post = infer.posterior(likelihood.compared(turned, fold.rows), rng, draws, least)
    said = heldout.predictions(post, rng)
    return heldout.compared(fold.name, group, heldout.named(fold, group), said, post.weight, turned)

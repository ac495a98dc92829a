"""Where changes between register sets are contradicted: the smallest change of one number that would meet them.

    before   case 3 or 4 of the most probable board        after   case 4 or 5 of the same board, one number moved by d
    cost     sum of ((|change| - paper)/sigma)^2 + d^2       d in standard deviations of the number's prior

The board itself stays: a register that is written must not move a part. The result says how much one would have to.
Source    docs/inference.md
"""

from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, likelihood, priors, rows

REACH, STEP = 60.0, 0.02  # standard deviations of a prior


class Smallest(NamedTuple):
    """The number whose move costs least: from, to, in its unit; cost, and what of it remains unmet."""

    group: str
    name: str
    unit: str
    before: float
    after: float
    moved: float  # standard deviations of the prior
    unmet: float  # chi2 of the class with the move
    still: float  # chi2 of the class without


def smallest(z, mode, best=2):
    """{class: [`Smallest`, ...]} for each change between cases; z (priors,), mode of numbers: a board."""
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
                    item = Smallest(f"{group}_{step}", prior.name, prior.unit, *map(float, v), float(d[at]),
                                    float(unmet[at]), still)  # fmt: skip
                    found.setdefault(item.group, []).append(item)
    return {group: sorted(items, key=lambda i: i.unmet + i.moved**2)[:best] for group, items in found.items()}


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

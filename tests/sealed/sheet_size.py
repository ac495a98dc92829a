"""Sigmas that the priors of a data sheet leave of an effect, by the second plant alone.

    d_sheet   |r| c     r = (1 - Q Q') W s as in `bank`, with the columns of every parameter of the sheet in J
    beside    what is left of r c where another effect may have any size, too
Two parameters rest: each is tied to others by a symmetry, so that no record holds its direction.
Source    docs/sealed.md
"""

import numpy as np

from testbench.config import Config
from testbench.measured.closed_loop.loop_symmetries import active_symmetries
from testbench.measured.wide import data_sheet

FIRST = 1e-3  # of a value: the step from which the size of a measured change is sought


def nuisances(bank):
    """[(change of the features per unit, sd)] of what the sheet leaves unknown of the default board."""
    wanted = data_sheet.parameters(Config(), data_sheet.read(data_sheet.BUNDLED_PATH))
    held, out = active_symmetries([p.key for p in wanted]), []
    for p in wanted:
        if p.key in held:
            continue

        def run(size, key=p.key, mean=p.mean):
            return bank._run({key: mean + size}, "", 1)

        known = p.key in bank.strata.priors
        found = bank.nuisance(p.key) if known else bank._measured(f"nuisance {p.key}", run, FIRST * abs(p.mean))
        out.append((found.change, p.scale * abs(p.mean) if p.logarithmic else p.scale))
    return out


def left(bank, effects):
    """{name: r per unit of its coefficient}, without effects that have no column."""
    columns, sd = zip(*nuisances(bank))
    j = np.concatenate([np.stack([bank.whiten_rows(c) for c in columns], axis=1), np.diag(1 / np.array(sd))])
    q, _ = np.linalg.qr(j / np.linalg.norm(j, axis=0))
    out = {}
    for effect in effects:
        change = bank.effect(effect).change
        if np.all(np.isfinite(change)):
            white = np.concatenate([bank.whiten_rows(change), np.zeros(len(sd))])
            out[effect.name] = white - q @ (q.T @ white)
    return out


def sizes(bank, effects):
    """{name: d per unit of its coefficient beside the parameters of a sheet}; without effects that have no column."""
    return {name: float(np.linalg.norm(r)) for name, r in left(bank, effects).items()}


def beside(rest, name, value, other):
    """Sigmas that are left of an effect of a size beside the sheet and another effect; `rest` of `left`."""
    r, s = rest[name] * value, rest[other]
    return float(np.linalg.norm(r - s * (r @ s) / (s @ s)))

"""Error before and after on groups that no fit has seen, in units of the observables, beside their own repeatability.

    rms      root mean square of measured - predicted over rows, repeats and groups, single repeats
    CI       paired block bootstrap: the same blocks for all models; a block is a group, or a run of rows if few
    score    sigmas of the predicted change that the held-out means show (rivals.confirmation)
    chi2     of the groups' means, whitened; expected 1 + what the fit's uncertainty adds
Source    Künsch (1989), moving blocks; docs/tracing.md
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2 as chi2_law

from testbench.tracing.model import Model
from testbench.tracing.predictor import Failed
from testbench.tracing.rivals import confirmation

BLOCKS, BOOTSTRAPS, LEVEL = 12, 2000, 0.95
BAND = 0.99  # of the held-out chi2
FLOOR_FACTOR = 1.06


class HeldOut(NamedTuple):
    """Tables per observable or group, and chi2 of all."""

    rows: dict
    chi2: dict  # {model label: chi2 / rows}
    limit: float  # 99 % of chi2 / rows if the last model is right
    score: float = 0.0
    failed: str = ""


def squares(space, predictions, by):
    """{key: [(block id, sum of squares per model (M,), rows)]} of single repeats; floor per key beside it."""
    problem, out, floors, units = space.problem, {}, {}, {}
    for g, group in enumerate(space.groups):
        for k in group.members:
            y, segment, floor = np.asarray(problem.measured(k), float), problem.segments[k], problem.floor(k)
            for o in segment.observables:
                key = _key(by, segment, o)
                errors = np.stack([y[o.rows] - p[g][o.rows] for p in predictions])
                parts = max(1, min(errors.shape[1] // 4, -(-BLOCKS // len(space.groups))))
                for part in np.array_split(np.arange(errors.shape[1]), parts):
                    block = (g, int(part[0])) if parts > 1 else (g, 0)
                    out.setdefault(key, []).append((block, (errors[:, part] ** 2).sum(axis=1), len(part)))
                if o.name in floor:
                    floors.setdefault(key, []).append((float(floor[o.name]) ** 2, errors.shape[1]))
                units.setdefault(key, o.unit)
                if units[key] != o.unit:
                    units[key] = "mixed"
    return out, floors, units


def _key(by, segment, o):
    if by == "group":
        return segment.group if len(segment.observables) == 1 else f"{segment.group} {o.name}"
    return o.name


def bootstrap(pieces, rng):
    """rms of each model, and its bootstrap draws (BOOTSTRAPS, M): blocks drawn with replacement, all repeats of it."""
    blocks = sorted({b for b, _, _ in pieces})
    at = {b: i for i, b in enumerate(blocks)}
    models = len(pieces[0][1])
    total, count = np.zeros((len(blocks), models)), np.zeros(len(blocks))
    for block, s, n in pieces:
        total[at[block]] += s
        count[at[block]] += n
    rms = np.sqrt(total.sum(axis=0) / count.sum())
    weights = rng.multinomial(len(blocks), np.full(len(blocks), 1 / len(blocks)), size=BOOTSTRAPS)
    return rms, np.sqrt((weights @ total) / (weights @ count)[:, None])


def above_floor(rows, label="after"):
    """Names of the rows whose error is for certain more than FLOOR_FACTOR times their repeatability."""
    return [k for k, r in rows.items() if r["floor"] and r[label + "_ci"][0] > FLOOR_FACTOR * r["floor"]]


def _interval(draws):
    lo, hi = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return [float(lo), float(hi)]


def judge(problem, space, predictor, fits, by="observable", seed=0):
    """`HeldOut` of {label: Fit}, in the order before .. after; `space` is that of the validate groups."""
    labels = list(fits)
    models = [Model(space, predictor, f.model.names) for f in fits.values()]
    predictions = []
    for model, f in zip(models, fits.values()):
        (found,) = model.ask([f.point])
        if isinstance(found, Failed):
            return HeldOut({}, {}, float("nan"), 0.0, f"held-out groups: {found.reason}")
        predictions.append(found)
    pieces, floors, units = squares(space, predictions, by)
    rng, rows = np.random.default_rng([seed, 2]), {}
    for key in pieces:
        rms, draws = bootstrap(pieces[key], rng)
        floor = floors.get(key)
        floor = float(np.sqrt(sum(a * n for a, n in floor) / sum(n for _, n in floor))) if floor else None
        row = {"unit": units[key], "floor": floor}
        for i, label in enumerate(labels):
            row[label], row[label + "_ci"] = float(rms[i]), _interval(draws[:, i])
        row["gain"], row["gain_ci"] = float(rms[0] - rms[-1]), _interval(draws[:, 0] - draws[:, -1])
        row["blocks"] = len({b for b, _, _ in pieces[key]})
        excess = rms[0] ** 2 - (floor or 0.0) ** 2
        row["excess_removed"] = float((rms[0] ** 2 - rms[-1] ** 2) / excess) if floor and excess > 0 else None
        rows[key] = row
    z = [space.residual(p) for p in predictions]
    chi2 = {label: float(np.mean(v**2)) if space.size else None for label, v in zip(labels, z)}
    limit = _limit(models[-1], fits[labels[-1]], predictions[-1])
    return HeldOut(rows, chi2, limit, confirmation(space, z[0], z[-1]))


def _limit(model, f, prediction):
    """99 % of chi2 / rows if the last model is right: mean tr(1 + JCJ'), variance 2 tr((1 + JCJ')^2)."""
    j = model.jacobian(f.point, prediction)
    if not np.all(np.isfinite(j)) or not np.all(np.isfinite(f.covariance)):
        return float("inf")
    gram = (j.T @ j) @ f.covariance
    rows = model.space.size
    mean, variance = rows + np.trace(gram), 2 * (rows + 2 * np.trace(gram) + np.trace(gram @ gram))
    dof = 2 * mean**2 / variance  # chi2 of the same mean and variance (Satterthwaite)
    return float(chi2_law.ppf(BAND, dof) * mean / dof / rows)

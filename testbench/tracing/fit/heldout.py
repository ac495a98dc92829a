"""Error before and after on groups that no fit has seen, in units of the observables, beside their own repeatability.

    rms      root mean square of measured - predicted over rows, repeats and groups, single repeats
    expected rms that the last model would show if it were right: repeatability and what the fit does not know
    p_floor  chance of an rms as large as the one seen, if the last model's were FLOOR_FACTOR times the expected one;
             its law is a scaled chi2 with the mean and variance of simulated rms^2: correlated rows are few.
             The same for rms / deviations of the repeats, which asks nothing of the noise's level: the larger p counts
    CI       with BLOCKS groups and more a paired block bootstrap: the same blocks for all models, a block is a group.
             With fewer it is simulated from the declared noise, as `expected` is; if the repeats reject that noise, a
             bootstrap over runs of rows is all there is
    score    sigmas of the predicted change that the held-out means show (rivals.confirmation)
    log_odds ln of the density that the last model foretells for the held-out means along that change, less that of
             the first; both Gaussian, with noise and what their fit does not know
    chi2     of the groups' means, whitened; expected 1 + what the fit's uncertainty adds; p: its chance, for noise as
             loud in each octave as all repeats bear out
Source    Künsch (1989), moving blocks; docs/tracing.md
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2 as chi2_law

from testbench.tracing.fit.rivals import change_noise_sd, confirmation
from testbench.tracing.problem.model import Model
from testbench.tracing.problem.predictor import Failed

BLOCKS, BOOTSTRAPS, LEVEL = 12, 2000, 0.95
SIMULATED, NUMBERS = 1000, 20_000_000  # simulated held-out sets, and numbers drawn for them at most
CHI2_SETS = 400
FLOOR_ALPHA = 0.01  # chance that a right model is found above FLOOR_FACTOR by any of its observables
REFUSED = 0.003  # of right explanations: by an alarm that still rings, by held-out chi2
FLOOR_FACTOR = 1.06
HARM = 0.02  # share of its error by which an observable may become worse


class HeldoutResult(NamedTuple):
    """Tables per observable or group, and chi2 of all."""

    rows: dict
    chi2: dict  # {model label: chi2 / rows}
    limit: float  # 99.7 % of chi2 / rows if the last model is right
    score: float = 0.0
    log_odds: float = 0.0
    failed: str = ""
    p: float = 1.0  # chance of a chi2 as large as the last model's if that is right; 0 if it cannot be predicted


def squares(problem, space, predictions, by):
    """{key: [(block id, sum of squares per model (M,), rows)]} of single repeats; floor per key beside it."""
    out, floors, units = {}, {}, {}
    for g, group in enumerate(space.groups):
        for k in group.members:
            y, segment = np.asarray(problem.observed_features(k), float), problem.segments[k]
            floor = problem.repeatability_rms(k)
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


def uncertainty_directions(space, ask, f):
    """What one standard deviation of each principal direction of a fit moves: [(rows, directions) per group].

    None if a step cannot be predicted.
    """
    sd = np.sqrt(np.diag(f.covariance))
    if not np.all(np.isfinite(f.covariance)) or not sd.all():
        return None
    n = len(f.point.theta)
    # a law with a sign may only be moved away from zero
    steps = sd * np.concatenate([np.ones(n), np.where(f.point.c < 0, -1.0, 1.0)])
    points = [f.point, *(f.model.shift_point(f.point, j, steps[j]) for j in range(len(sd)))]
    (now, *shifted_predictions) = ask([(p.theta, f.model.effects(p)) for p in points], space.which)
    if any(isinstance(m, Failed) for m in (now, *shifted_predictions)):
        return None
    values, vectors = np.linalg.eigh(f.covariance / np.outer(steps, steps))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return [np.stack([m[g] - now[g] for m in shifted_predictions], axis=1) @ root for g in range(len(space.groups))]


def simulate_heldout_sets(problem, space, predictions, directions, by, rng):
    """({key: (sets, models) mean squares of held-out sets}, {key: (sets,) those of deviations between their repeats}).

    Of each set the last prediction is the truth's best fit.
    """
    out, deviation_squares, rows, prediction_noise_sd = {}, {}, {}, np.sqrt(problem.prediction_noise)
    total = sum(len(p) * len(g.members) for p, g in zip(predictions[-1], space.groups))
    count = int(np.clip(NUMBERS // max(total * len(predictions), 1), 100, SIMULATED))
    xi = rng.normal(size=(directions[0].shape[1], count))
    for g, group in enumerate(space.groups):
        prediction_error = (
            prediction_noise_sd * problem.noise_draws(group.members[0], count, rng) if prediction_noise_sd else 0.0
        )
        common = directions[g] @ xi + prediction_error
        draws = np.stack([problem.noise_draws(k, count, rng) for k in group.members])
        for k, noise, repeat_deviation in zip(group.members, draws + common, draws - draws.mean(axis=0)):
            for o in problem.segments[k].observables:
                key = _key(by, problem.segments[k], o)
                e = [noise[o.rows] + (predictions[-1][g] - p[g])[o.rows, None] for p in predictions]
                out[key] = out.get(key, 0.0) + np.stack([(x**2).sum(axis=0) for x in e], axis=1)
                deviation_squares[key] = deviation_squares.get(key, 0.0) + (repeat_deviation[o.rows] ** 2).sum(axis=0)
                rows[key] = rows.get(key, 0) + len(noise[o.rows])
    return {key: v / rows[key] for key, v in out.items()}, {key: v / rows[key] for key, v in deviation_squares.items()}


def deviations(problem, space, by):
    """{key: mean square of the repeats about their mean}, of the data as `simulate_heldout_sets` has it of its sets."""
    out, rows = {}, {}
    for group in space.groups:
        y = np.stack([np.asarray(problem.observed_features(k), float) for k in group.members])
        for k, d in zip(group.members, y - y.mean(axis=0)):
            for o in problem.segments[k].observables:
                key = _key(by, problem.segments[k], o)
                out[key] = out.get(key, 0.0) + float(np.sum(d[o.rows] ** 2))
                rows[key] = rows.get(key, 0) + len(d[o.rows])
    return {key: v / rows[key] for key, v in out.items()}


def p_floor(square, sets, deviation_square, simulated_deviations):
    """The larger of the chances of a mean square, and of its ratio to the repeats' deviations if there are any.

    1 if repeats deviate that by the problem's noise are the same: then no error is too large for that noise.
    """
    if deviation_square > 0 and not simulated_deviations.all():
        return 1.0
    p = mean_square_p(square, sets)
    return max(p, mean_square_p(square / deviation_square, sets / simulated_deviations)) if deviation_square > 0 else p


def fit_scaled_chi2(sets):
    """(factor, dof) of the scaled chi2 with the mean and variance of simulated mean squares (Satterthwaite)."""
    dof = 2 * sets.mean() ** 2 / sets.var()
    return sets.mean() / dof, dof


def mean_square_p(square, sets):
    """Chance of a mean square as large, if the expected one were FLOOR_FACTOR^2 times that of the simulated sets."""
    if sets.min() == sets.max():
        return float(square <= FLOOR_FACTOR**2 * sets[0])
    factor, dof = fit_scaled_chi2(sets)
    return float(chi2_law.sf(square / FLOOR_FACTOR**2 / factor, dof))


def mean_draws(space, rng):
    """(rows, CHI2_SETS) of whitened means of the problem's noise, Gaussian or not, and of the prediction's own."""
    problem, parts = space.problem, []
    prediction_noise_sd = np.sqrt(problem.prediction_noise)
    for g, w in zip(space.groups, space.weights):
        mean = np.mean([problem.noise_draws(k, CHI2_SETS, rng) for k in g.members], axis=0)
        mean = mean + (
            prediction_noise_sd * problem.noise_draws(g.members[0], CHI2_SETS, rng) if prediction_noise_sd else 0.0
        )
        parts.append(w * space.whiten_rows(g.members[0], mean) / space.gain)
    return np.concatenate(parts)


def exceeded_floors(rows):
    """Names of the rows whose error cannot be FLOOR_FACTOR times the expected one, all tested together."""
    p_by_row = {k: r["p_floor"] for k, r in rows.items() if r["p_floor"] is not None}
    return [k for k, p in p_by_row.items() if 1 - (1 - p) ** len(p_by_row) < FLOOR_ALPHA]


def worse(heldout_result):
    """What has become worse with the last model: chi2 of all, or an observable by HARM and significantly.

    The 95 % intervals are as wide as all observables together ask for.
    """
    last = list(heldout_result.chi2.values())
    out = ["chi2"] if len(last) > 1 and last[-1] > last[0] else []
    return out + [k for k, r in heldout_result.rows.items() if r["gain_most"] < 0 and r["gain"] < -HARM * r["before"]]


def _quantiles(draws):
    lo, hi = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return [float(lo), float(hi)]


def _intervals(rms, draws, sets):
    """(95 % interval of each model's rms, draws of the fall from the first to the last)."""
    if sets is None:
        return [_quantiles(d) for d in draws.T], draws[:, 0] - draws[:, -1]
    simulated_rms = np.sqrt(sets)
    middle = np.median(simulated_rms, axis=0)
    fall = simulated_rms[:, 0] - simulated_rms[:, -1]
    return [_quantiles(x) for x in (rms * middle / simulated_rms).T], rms[0] - rms[-1] + np.median(fall) - fall


def compute_fit_errors(problem, space, predictor, fits, by="observable", seed=0, declared=True, noise=None):
    """`HeldoutResult` of {label: Fit}, in the order before .. after; `space` is that of the validate groups.

    declared  False if the repeats have rejected the declared noise: nothing is simulated from it then
    noise     what all repeats, fitted and held out, say of the noise: `Noise` in units of the space, or None
    The problem's `heldout_view`, if it has one, gives the same segments in finer features: errors are told in those.
    """
    labels, models = list(fits), list(fits.values())
    first, last = models[0], models[-1]
    points = [(f.point.theta, f.model.effects(f.point)) for f in fits.values()]
    predictions = predictor(points, space.which)
    for prediction in predictions:
        if isinstance(prediction, Failed):
            return HeldoutResult({}, {}, float("nan"), failed=f"held-out groups: {prediction.reason}", p=0.0)
    view = problem.heldout_view
    ask = predictor if view is None else view.predict
    view, view_predictions = (problem, predictions) if view is None else (view, ask(points, space.which))
    pieces, floors, units = squares(view, space, view_predictions, by)
    rng, rows = np.random.default_rng([seed, 2]), {}
    directions = uncertainty_directions(space, ask, last) if declared and space.size else None
    sets, simulated_deviations = (
        simulate_heldout_sets(view, space, view_predictions, directions, by, rng) if directions else ({}, {})
    )
    repeat_deviations = deviations(view, space, by)
    for key in pieces:
        rms, draws = bootstrap(pieces[key], rng)
        floor, simulated_squares = floors.get(key), sets.get(key)
        floor = float(np.sqrt(sum(a * n for a, n in floor) / sum(n for _, n in floor))) if floor else None
        row = {"unit": units[key], "floor": floor, "blocks": len({b for b, _, _ in pieces[key]})}
        few = simulated_squares if len(space.groups) < BLOCKS else None
        intervals, gains = _intervals(rms, draws, few)
        row["gain_ci"] = _quantiles(gains)
        row["gain_most"] = float(np.quantile(gains, 1 - (1 - LEVEL) / 2 / len(pieces)))
        for label, value, interval in zip(labels, rms, intervals):
            row[label], row[label + "_ci"] = float(value), interval
        row["gain"] = float(rms[0] - rms[-1])
        row["expected"] = row["p_floor"] = None
        if simulated_squares is not None:
            last_squares = simulated_squares[:, -1]
            row["expected"] = float(np.sqrt(last_squares.mean()))
            row["p_floor"] = p_floor(rms[-1] ** 2, last_squares, repeat_deviations[key], simulated_deviations[key])
        excess = rms[0] ** 2 - (floor or 0.0) ** 2
        row["excess_removed"] = float((rms[0] ** 2 - rms[-1] ** 2) / excess) if floor and excess > 0 else None
        rows[key] = row
    z = [space.residual(p) for p in predictions]
    chi2 = {label: float(np.mean(v**2)) if space.size else None for label, v in zip(labels, z)}
    root = _root(space, predictor, last, predictions[-1])
    odds = 0.0
    if np.any(z[0] != z[-1]):
        odds = predictive_log_odds(space, z[0], z[-1], _root(space, predictor, first, predictions[0]), root)
    limit, p = _limit(space, root, declared, noise, rng, chi2[labels[-1]])
    return HeldoutResult(rows, chi2, limit, confirmation(space, z[0], z[-1]), odds, p=p)


def _root(space, predictor, f, prediction):
    """A, A A' = J C J': what a fit does not know of the whitened held-out means; None if a step cannot be predicted."""
    j = Model(space, predictor, f.model.names).jacobian(f.point, prediction)
    if not np.all(np.isfinite(j)) or not np.all(np.isfinite(f.covariance)):
        return None
    # in units of the deviations: coefficients of 1e9 and of 1e-9 stand side by side
    sd = np.where(f.sd > 0, f.sd, 1.0)
    values, vectors = np.linalg.eigh(f.covariance / np.outer(sd, sd))
    return (j * sd) @ vectors * np.sqrt(np.maximum(values, 0.0))


def predictive_log_odds(space, first, last, root_first, root_last):
    """`HeldoutResult.log_odds` of the whitened residuals of two models and the roots of what their fits do not know.

    0 if one of the roots is unknown.
    """
    if root_first is None or root_last is None:
        return 0.0
    change = first - last
    change_direction, noise = change / np.linalg.norm(change), change_noise_sd(space, change, last)
    variance = [noise**2 + np.sum((change_direction @ root) ** 2) for root in (root_first, root_last)]
    cost = [(change_direction @ z) ** 2 / v + np.log(v) for z, v in zip((first, last), variance)]
    return float(cost[0] - cost[1]) / 2


def _loudness(space, noise):
    """Chi2 / rows of the held-out contrasts in units of the noise of all, if significantly (5 %) above 1."""
    most, values = max(map(len, space.contrasts), default=0), []
    again = noise.whitener(space) if noise else lambda v: v
    for i in range(most):
        has_contrast = np.concatenate([np.full(c.shape[1], i < len(c)) for c in space.contrasts])
        rows = np.concatenate([c[i] if i < len(c) else np.zeros(c.shape[1]) for c in space.contrasts])
        values.append(again(space.refine(rows))[has_contrast])
    values = np.concatenate([*values, np.zeros(0)])
    return float(np.mean(values**2)) if len(values) and values @ values > chi2_law.ppf(LEVEL, len(values)) else 1.0


def _limit(space, root, declared, noise, rng, observed_chi2):
    """(99.7 % of chi2 / rows if the last model is right, with what the fit does not know; chance of the one seen).

    From simulated sets, Gaussian if the declared noise has been rejected, each with octaves as loud as they may be for
    all that the repeats tell. Times the chi2 of the held-out repeats in units of that noise, see `_loudness`.
    """
    if root is None:
        return float("inf"), 1.0
    draws = mean_draws(space, rng) if declared else rng.normal(size=(space.size, CHI2_SETS))
    if noise:
        draws = noise.scale_octaves(space, draws, rng)
    z = draws + root @ rng.normal(size=(root.shape[1], CHI2_SETS))
    factor, dof = fit_scaled_chi2((z**2).mean(axis=0))
    factor *= _loudness(space, noise)
    return float(chi2_law.isf(REFUSED, dof) * factor), float(chi2_law.sf(observed_chi2 / factor, dof))

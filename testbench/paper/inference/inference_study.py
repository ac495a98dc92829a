"""What the paper's numbers say of its board, as plain data: posterior, rows before and after, held-out rows, a board.

    before     the default board                     after     the most probable board; both by the linear loops
    carried    the posterior of a number is narrower than INFORMED_WIDTH times its prior
    strained   its mean is more than STRAINED standard deviations of the prior away
    excluded   a choice of a discrete assumption has a probability below EXCLUDED

Source    docs/inference.md
"""

import math

import numpy as np

from testbench.config import Config, changed
from testbench.paper.inference import (
    change,
    forward,
    heldout_measurements,
    infer,
    likelihood,
    measurements,
    priors,
    probable_board,
    rows,
)
from testbench.paper.loop import derived
from testbench.run.budget import budget

SEED, DRAWS, FOLD_DRAWS, LEAST_DRAWS = 1, 2000, 1500, 400.0
INFORMED_WIDTH, STRAINED, EXCLUDED = 0.5, 2.0, 0.01
MOST_REPORTED_MODES = 12
QUANTITIES = {"scale_factor": "lsb_per_dps", "arw": "arw_deg_per_rt_h", "bias_instability": "instability_deg_per_h",
              "v_q": "quadrature_v", "bias": "bias_dps"}  # fmt: skip


def with_words(config, case):
    """The configuration with the compensation words of a case, from its own budget at 25 degC."""
    phases = budget(config, forward.ROOM_DEGC)
    node, loop = phases.node_deg(), phases.loop_deg()
    words = {"drive_sine": ("xe1", node["xe1"]), "drive_ref": ("xe2", -loop["xe2"]), "sense_sine": ("ye1", node["ye1"]),
             "sense_ref": ("ye2", -loop["ye2"])}  # fmt: skip
    phase_words = {f"firmware.phase_{w}_deg": deg for w, (n, deg) in words.items() if case >= forward.COMPENSATED[n]}
    return changed(config, phase_words)


def linear_rows(config, ye2_at_pin=True):
    """{row: value} of a configuration by budget and linear loops, which share no closed form with `forward`."""
    phases = budget(config, forward.ROOM_DEGC)
    node, loop = phases.node_deg(), phases.loop_deg()
    out = {"xe1": node["xe1"], "xe2": loop["xe2"], "ye1": node["ye1"], "ye2": (node if ye2_at_pin else loop)["ye2"]}
    configs = {case: with_words(config, case) for case in forward.CASES}
    for temp in rows.TEMPERATURES_DEGC:
        derived_by_case = {case: derived.derive(c, temp) for case, c in configs.items()}
        for group, name in QUANTITIES.items():
            out[f"{group}_{temp:g}"] = float(np.mean([getattr(derived_by_case[case], name) for case in (1, 2, 3)]))
        for group in rows.STEPPED:
            for step in rows.STEPS:
                before, after = (getattr(derived_by_case[int(case)], QUANTITIES[group]) for case in step.split("to"))
                out[f"{group}_{step}_{temp:g}"] = abs(after - before) / abs(before)
    return out


def pull(row, value):
    """Difference from the paper in its standard uncertainties."""
    return (value - row.value) / row.sigma


def chi2(values, group=None):
    """Sum of squared pulls over the fitted rows, or over those of a class."""
    return sum(pull(row, values[row.name]) ** 2 for row in likelihood.FITTED if group in (None, row.group))


def _numbers(post):
    out = []
    for k, prior in enumerate(priors.PRIORS):
        z = post.z[:, k]
        mean = float(post.weight @ z)
        width = math.sqrt(float(post.weight @ (z - mean) ** 2))
        quantiles = [float(prior.value(infer.quantile(z, post.weight, share))) for share in heldout_measurements.SHARES]
        verdict = "strained" if abs(mean) > STRAINED else "carried" if width < INFORMED_WIDTH else "open"
        out.append({"name": prior.name, "unit": prior.unit, "prior": [prior.lo, prior.hi], "posterior": quantiles,
                    "shift": mean, "width": width, "verdict": verdict, "why": prior.why})  # fmt: skip
    return out


def _choices(post):
    out = []
    for c in priors.CHOICES:
        share = {str(choice): float(post.weight[post.mode[c.name] == choice].sum()) for choice in c.choices}
        out.append({"name": c.name, "why": c.why, "probability": share})
    return out


def _ranked_modes(optima):
    ranks = range(min(MOST_REPORTED_MODES, len(optima.weight)))
    return [
        {"choices": {n: int(a[k]) for n, a in optima.mode.items()}, "weight": float(optima.weight[k]),
         "chi2": float(optima.chi2[k]), "prior_chi2": float(np.sum(optima.z[k] ** 2))} for k in ranks
    ]  # fmt: skip


def best_board(data, optima):
    """(z, mode, covariance) of the most probable mode, at the default's drive frequency, which is on no grid."""
    mode = {name: int(a[0]) for name, a in optima.mode.items()}
    prior = priors.PRIORS[priors.NAMES.index("fx_hz")]
    fx_z = (Config().plant.fx_hz - prior.value(0.0)) / (prior.value(1.0) - prior.value(0.0))
    z, hessian = infer.fit_constrained(optima.z[0], mode, data, {"fx_hz": fx_z})
    return z, mode, np.linalg.inv(hessian)


def _heldout_changes(paper, classes, fits_by_fold, draws):
    """What would meet each class that is contradicted where its temperature is left out: a part moved, or a sign."""
    moves, signs, rng = [], [], np.random.default_rng(SEED)
    for c in classes:
        if c.verdict == "contradicted" and fits_by_fold[c.fold][0].rule == heldout_measurements.TEMPERATURE:
            moves += [m._asdict() for m in change.heldout_moves(paper, fits_by_fold[c.fold], c.group)]
            turned = change.with_other_sign(paper, fits_by_fold[c.fold][0], c.group, rng, draws, LEAST_DRAWS)
            signs.append(turned._asdict() | {"verdict": turned.verdict, "p_as_printed": c.p})
    return {"changes_at_temperature": moves, "other_sign": signs}


def run_inference(paper=None, progress=None, draws=DRAWS, fold_draws=FOLD_DRAWS):
    """All of it as a dict of plain data; about a minute."""

    def report_progress(text, step):
        if progress:
            progress(text, step, 4)

    report_progress("posterior", 0)
    paper = paper or likelihood.the_paper()
    rng = np.random.default_rng(SEED)
    data = likelihood.compared_rows(paper)
    post = infer.posterior(data, rng, draws, LEAST_DRAWS)
    z, mode, covariance = best_board(data, post.optimum)
    v = {name: float(a) for name, a in priors.board_numbers(z).items()}
    report_progress("rows by the linear loops", 1)
    before, after = linear_rows(Config()), linear_rows(probable_board.board_config(v, mode), mode["ye2_at_pin"] == 1)
    report_progress("held-out rows", 2)
    predicted, classes, fits_by_fold = heldout_measurements.judge_folds(paper, rng, fold_draws, LEAST_DRAWS)
    report_progress("changes and measurements", 3)
    worth, open_bits = measurements.worth(post, rng)
    groups = dict.fromkeys(row.group for row in likelihood.FITTED)
    return {
        "draws": draws,
        "effective_draws": post.size,
        "fold_draws": fold_draws,
        "effective_fold_draws": {name: post.size for name, (_, post, _) in fits_by_fold.items()},
        "modes": _ranked_modes(post.optimum),
        "choices": _choices(post),
        "numbers": _numbers(post),
        "rows": [
            {"name": r.name, "class": r.group, "unit": r.unit, "paper": r.value, "sigma": r.sigma,
             "fitted": r in likelihood.FITTED, "before": before[r.name], "after": after[r.name]}
            for r in (*likelihood.FITTED, *likelihood.STEPPED)
        ],
        "chi2": {g or "all": [chi2(before, g), chi2(after, g)] for g in (*groups, None)},
        "held_out": [p._asdict() | {"inside": p.is_in_interval} for p in predicted],
        "classes": [c._asdict() | {"verdict": c.verdict} for c in classes],
        "changes": [i._asdict() for items in change.smallest(z, mode).values() for i in items],
        **_heldout_changes(paper, classes, fits_by_fold, fold_draws),
        "measurements": [w._asdict() for w in worth],
        "open_bits": open_bits,
        "board": {"mode": mode, "settings": probable_board.settings(v, mode), "names": list(priors.NAMES),
                  "z": z.tolist(), "covariance": covariance.tolist()},
    }  # fmt: skip

"""From a finished trace to the `Result`: every number with its unit, every claim with its certificate."""

from dataclasses import asdict

import numpy as np

from testbench.tracing import verdict
from testbench.tracing.fit.causes import AS_GOOD, MOST
from testbench.tracing.fit.discover import lift
from testbench.tracing.fit.evidence import log_prior
from testbench.tracing.fit.heldout import REFUSED
from testbench.tracing.fit.rank import one_sided
from testbench.tracing.fit.rivals import CLEAR
from testbench.tracing.fit.search import credible, inclusion
from testbench.tracing.noise.findings import repeat_findings
from testbench.tracing.noise.noise_model import bridge
from testbench.tracing.noise.power import limits
from testbench.tracing.noise.statistics import SHORT
from testbench.tracing.problem.result import Result

STATUS = {"named": "named", "confounded": "confounded", "candidate": "candidate", "unexplained": "partial"}
MISFIT = 25.0  # of chi2, from which a single law is told although it is against physics


def effects(fit, probability, first_by_duplicate):
    """Laws of a fit as they go into the JSON; d is the size in sigmas after the nuisances have taken their part.

    sd is for intervals; d is in units of the fit's own noise, as limits and alarms are
    first_by_duplicate  {law that was not tried: the law that it is, in other parameters}
    """
    n, out, interval_sd = len(fit.point.theta), [], _ci_sd(fit)
    for i, law in enumerate(fit.model.laws):
        sd, d, c = float(interval_sd[n + i]), float(abs(fit.point.c[i]) / fit.sd[n + i]), float(fit.point.c[i])
        out.append(
            {"law": law.name, "port": law.port, "value": c, "sd": sd, "unit": law.unit, "d": d}
            | {"kind": law.kind, "text": law.text, "page": law.page, "p": probability.get(law.name)}
            | {"same_as": sorted(name for name, first in first_by_duplicate.items() if first == law.name)}
        )
    return out


def _ci_sd(fit):
    return np.sqrt(np.diag(fit.interval_covariance))


def ranking_rows(tracer):
    """All laws at the base fit, biggest first."""
    rows = []
    for label, r in tracer.ranked.items():
        scores = one_sided(r, tracer.laws)
        for i, name in enumerate(r.names):
            law, length = tracer.laws[name], float(r.length[i])
            rows.append(
                {"law": name, "port": law.port, "list": label, "d": float(scores[i]), "t": float(r.t[i])}
                | {"value": float(r.t[i] / length) if length else None, "sd": 1 / length if length else None}
                | {"unit": law.unit, "hidden": name in r.hidden}
            )
        rows += [{"law": name, "list": label, "failed": "cannot be predicted"} for name in r.failed]
    return sorted(rows, key=lambda row: (-row.get("d", -1.0), row["law"]))


def model_rows(tracer):
    """Sets of laws by posterior, which is none where no set is adequate, and the refits that failed."""
    if tracer.found is None:
        return []
    names, p = tracer.posterior
    p = p if tracer.found.adequate else [None] * len(p)
    rows = []
    for n, x in list(zip(names, p))[:20]:
        c = tracer.found.candidates[n]
        rows.append(
            {"laws": list(n), "p": x, "log_z": c.log_z, "bic": c.bic, "refitted": c.refitted}
            | {"log_prior": log_prior(n, tracer.priors), "cost": c.fit.cost if c.fit else None}
        )
    return rows + [{"laws": list(n), "failed": reason} for n, reason in sorted(tracer.found.failed.items())]


def cause_rows(tracer):
    """The class: each member with its laws, their sizes, chi2 above the first, and P; the angle to the first."""
    rows, p = [], dict(zip(*tracer.posterior))
    for cause in tracer.causes:
        row = {"laws": list(cause.names), "chi2": cause.chi2, "p": p.get(cause.names)}
        effect_keys = ("law", "port", "value", "sd", "unit", "same_as")
        row["effects"] = [{k: e[k] for k in effect_keys} for e in effects(cause.fit, {}, tracer.dropped)]
        mine, first = set(cause.names), set(tracer.found.best)
        other, replaced_laws = sorted(mine - first), sorted(first - mine)
        if len(other) == 1 and len(replaced_laws) == 1:
            c = abs(_cosine(tracer, replaced_laws[0], other[0]))
            sine = float(np.sqrt(max(1 - c * c, 0.0)))
            row |= {"instead_of": replaced_laws[0], "cosine": c, "d_to_separate": 3 / sine if sine > 1e-6 else None}
        rows.append(row)
    return rows


def unphysical(tracer):
    """Single laws that would explain as much as the best set, or more, with a coefficient that physics forbids."""
    if tracer.found is None:
        return []
    best = tracer.found.candidates[tracer.found.best].fit if tracer.found.best else None
    needed = tracer.base.fit.cost - best.cost - AS_GOOD if best else MISFIT
    rows = []
    for ranking in tracer.ranked.values():
        for i, name in enumerate(ranking.names):
            law, length = tracer.laws[name], float(ranking.length[i])
            if length and ranking.t[i] ** 2 > max(needed, MISFIT):
                value, sd = float(ranking.t[i] / length), 1 / length
                side = (
                    f"{law.name}: {value:.3g} {law.unit} has the physically impossible sign"
                    if law.sign * value < 0
                    else ""
                )
                why = law.beyond(value, sd) or side
                row = {"law": name, "value": value, "sd": sd, "unit": law.unit, "chi2": float(ranking.t[i] ** 2)}
                rows += [row | {"why": why}] if why else []
    return sorted(rows, key=lambda row: (-row["chi2"], row["law"]))


def _cosine(tracer, a, b):
    return float(tracer.rank(tracer.base.fit, (a, b)).cosines[0, 1])


def rival_count(tracer):
    """Number of models to distinguish: the class, or the 95 % set, at least two, at most MOST."""
    return int(np.clip(len(tracer.causes) or len(credible(*tracer.posterior)), 2, MOST))


def discovery(tracer, out):
    """What was tried beyond the catalogue, and found laws as files."""
    lifted = {}
    for e in (e for e in out.effects if e["law"] in tracer.library):
        law_file_arguments = tracer.laws[e["law"]], e["value"], e["sd"], tracer.problem.hashes
        lifted[e["law"]] = tracer.problem.law_file(*law_file_arguments) or lift(*law_file_arguments)
    return {"ports": [s._asdict() for s in tracer.selections], "files": lifted}


def condition_table(fit):
    """chi2 / rows per group and observable of a fit's whitened residual."""
    rows = []
    for b in fit.model.space.blocks:
        part, g = fit.z[b.rows], fit.model.space.groups[b.group]
        rows.append(
            {"group": g.name, "condition": dict(g.condition), "observable": b.observable}
            | {"rows": len(part), "chi2": float(np.mean(part**2))}
        )
    return {"cells": rows, "parameters_fitted": len(fit.model.columns)}


def describe_misfit(tracer, out):
    """What is known about a misfit that no set of laws covers."""
    last = tracer.fits["after"]
    alarms = tracer.alarm(last, tracer.rankings(last), REFUSED)
    test = alarms.refined or alarms.declared
    worst = max(condition_table(last)["cells"], key=lambda c: (c["chi2"] - 1) * np.sqrt(c["rows"]))
    steps = []
    for b in tracer.space.blocks:
        if b.rows.stop - b.rows.start >= SHORT:
            size, where = bridge(last.z[b.rows], 0)
            steps.append((float(size), tracer.space.groups[b.group].name, b.observable, int(where)))
    jump = max(steps, default=None)
    return {
        "excess_chi2": float(last.z @ last.z - tracer.space.size + len(last.model.columns)),
        "loudest_statistic": min(test.p, key=test.p.get),
        "p": test.p,
        "worst_cell": worst,
        "largest_cusum": dict(zip(("size", "group", "observable", "row"), jump)) if jump else None,
        "port": out.discovery["ports"][0]["port"] if out.discovery.get("ports") else None,
        "best_partial": [e["law"] for e in out.effects],
        "wording": f"none of the {out.looks['laws']} laws tried explains it; one of them may imitate an untried law",
    }


def certificates(tracer):
    base, noise = tracer.base, tracer.noise
    repeats = sorted({int(r) for r in tracer.space.repeats})
    no_repeats_text = "no repeats: effects are ranked, not confirmed; the declared noise is assumed"
    return {
        "calibration": base.certificate,
        "repeats": {"per_group": repeats, "R14": no_repeats_text if tracer.alarms.model_based else None},
        "noise": {"p": noise.p, "worst": noise.worst, "jump": noise.jump, "squares": noise.dof},
        "adequacy": tracer.found.checks if tracer.found else [],
        "laws_left_out": {"imitated": tracer.imitated, "allowed": verdict.MOST_IMITATED},
        "points_predicted": tracer.predictor.asked,
        "rows": int(tracer.space.size),
        "rows_heldout": int(tracer.held.size),
        "heldout_failed": tracer.heldout.failed,
        "firmware": tracer.problem.firmware_certificate,
        "numerical": tracer.problem.numerical_certificate,
    }


def build_result(tracer, decision):
    """`Result` of a `trace.Tracer` that has run."""
    search_result, problem, probability, free = tracer.found, tracer.problem, {}, {}
    if decision is None:
        best = search_result.best
        free = verdict.free_d(search_result.fit(best), tracer.identified) if best else {}
        probability = inclusion(*tracer.posterior) if search_result.adequate else {}
        rejected = "the repeats contradict the declared noise" if tracer.noise_rejected else ""
        doubtful = "no repeats test the declared noise" if tracer.alarms.model_based else rejected
        confirmed = tracer.heldout.score > CLEAR
        unsupported = verdict.unsupported_law_reason(problem, search_result.fit(best)) if best else ""
        sets = tracer.chosen, tracer.untried, tracer.imitated, unsupported, tracer.heldout.log_odds
        set_evidence = verdict.Evidence(bool(tracer.held.size), problem.heldout_independent, confirmed, doubtful, *sets)
        stopped = verdict.naming_obstacle(problem, tracer.base.converged)
        decision = verdict.with_search(search_result, tracer.causes, free, set_evidence, stopped)
    out = Result(problem.name, decision.verdict, decision.sentence)
    if search_result is not None and search_result.best and decision.verdict in STATUS:
        out.effects = effects(search_result.fit(search_result.best), probability, tracer.dropped)
        for row in out.effects:
            row["d_without_priors"] = free[row["law"]]
            row["status"] = STATUS[decision.verdict]
    if decision.verdict in ("named", "confounded", "candidate"):
        out.causes = cause_rows(tracer)
    out.rivals = [{"laws": list(n), "instead_of": law, "vuong": v} for law, n, v in tracer.rivals]
    out.unphysical = unphysical(tracer)
    out.heldout = tracer.heldout.rows
    out.heldout_chi2 = tracer.heldout.chi2 | {k: getattr(tracer.heldout, k) for k in ("limit", "score", "log_odds")}
    out.p_global = tracer.p
    k = sum(len(r.names) for r in tracer.ranked.values())
    out.looks = {"laws": k, "statistics": len(tracer.alarms.declared.p), "declared_by_caller": tracer.options.looks}
    out.looks["same_laws"] = tracer.dropped
    out.certificates, out.hashes = certificates(tracer), dict(problem.hashes)
    out.ranking, out.models = ranking_rows(tracer), model_rows(tracer)
    tests = {name: getattr(tracer.alarms, name) for name in ("rotation", "refined", "declared")}
    out.alarms = {name: test and test._asdict() for name, test in tests.items()}
    noise_findings = [*problem.noise_findings, *repeat_findings(tracer.noise, verdict.LEVEL)]
    out.noise = {"octaves": [o._asdict() for o in tracer.noise.octaves], "p": tracer.noise.p}
    out.noise["findings"] = [f._asdict() | {"text": f.text} for f in noise_findings]
    out.identifiability = {
        "directions": [
            {"eigenvalue": d.eigenvalue, "fixed_by": d.fixed_by, "words": d.words} for d in tracer.identified.directions
        ],
        "at_prior_width": list(tracer.identified.at_prior),
    }
    base, last = tracer.base.fit, tracer.fits["after"]
    out.nuisances = [
        {"name": n.name, "unit": n.unit, "prior": n.value, "prior_sd": n.prior_sd}
        | {"before": float(b), "after": float(x), "sd_before": float(d), "sd": float(s)}
        for n, b, d, x, s in zip(problem.nuisances, base.point.theta, _ci_sd(base), last.point.theta, _ci_sd(last))
    ]
    out.null = dict(tracer.power)
    out.power_d90 = out.null.pop("d90", {})
    if decision.verdict in ("none", "noise-model"):
        out.null["limits"] = {k: v for r in tracer.ranked.values() for k, v in limits(r, tracer.laws).items()}
    out.next_experiment = tracer.experiments
    out.discovery = discovery(tracer, out)
    if decision.verdict == "unexplained":
        out.unexplained = describe_misfit(tracer, out)
    out.tables = {"chi2_before": condition_table(base), "chi2_after": condition_table(last)}
    out.options, out.notes = asdict(tracer.options), [*tracer.notes, *(f.text for f in noise_findings)]
    return out

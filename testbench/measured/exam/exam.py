"""Report of a part whose segments set themselves up (`part.Part`): laws staged, then the segments that decide nothing.

chosen on      fitted and validating segments, as in `staged`, but among laws that have been refitted with all
               nuisances: these models are not linear. No law is looked for where held-out data are at their floor
heldout        every validating and every examining segment by itself: floor, before, after one law, after
nulls          recordings simulated without any law, setup rows too, through the same pipeline (command: nulls.py)
"""

from dataclasses import replace

import numpy as np

from analog_frontend.parts.device import Device
from testbench.measured.exam import part_page
from testbench.measured.exam.staged import (
    ALPHA,
    DECISIVE,
    NOTHING,
    SUPPORTED,
    UNCHANGED_FACTOR,
    Round,
    StagedResult,
    absorb,
    summary,
)
from testbench.measured.models.gyro_laws import laws_of_loop
from testbench.tracing.fit import heldout
from testbench.tracing.fit.evidence import linear_gain, log_evidence
from testbench.tracing.fit.rank import one_sided
from testbench.tracing.fit.refit import refit
from testbench.tracing.problem.predictor import Predictor
from testbench.tracing.problem.result import plain_value
from testbench.tracing.problem.space import Space
from testbench.tracing.trace import Options, Tracer

QUICK = Options(ALPHA, n_null=199, max_laws=1, power=False, experiments=False, grammar=False)
LABELS = ("before", "after_one_law", "after")
REFITTED = 6  # laws per round, those with most evidence of the linear problem


def _heldout_reaches_floor(tracer, fit):
    """True if every held-out segment is at its floor already."""
    rows = heldout.compute_fit_errors(tracer.problem, tracer.held, tracer.predictor, {"now": fit}, "group").rows
    return bool(rows) and all(row["floor"] and row["now"] <= row["floor"] for row in rows.values())


def _decisive(tracer, refused):
    """[(ln evidence of the linear problem, law, d)] of laws above DECISIVE, most evidence first."""
    out = []
    for ranking in tracer.rankings(tracer.base.fit).values():
        scores = one_sided(ranking, tracer.laws)
        for k, name in enumerate(ranking.names):
            gain = None if name in ranking.hidden or name in refused else linear_gain(ranking, [name], tracer.laws)
            if gain is not None and gain - np.log(len(tracer.laws)) > DECISIVE and scores[k] > 0:
                out.append((gain, name, float(scores[k])))
    return sorted(out, key=lambda row: (-row[0], row[1]))


def _round(tracer, refused):
    """(`Round`s tried at a calibrated model: the last is kept, or none is; where the last has settled)."""
    base, total, out, values = tracer.base.fit, len(tracer.laws), [], _fitted_values(tracer.base.fit)
    rows = _decisive(tracer, refused)
    start, tried = log_evidence(base, tracer.identified.scale), []
    for _, name, d in rows[:REFITTED]:
        fit = refit(base, (name,), tracer.table)
        if not fit.failed:
            gain = log_evidence(fit, tracer.identified.scale) - start - np.log(total)
            tried.append((gain, name, d, fit))
    tried.sort(key=lambda row: (-row[0], row[1]))
    for gain, name, d, fit in tried:
        if gain < DECISIVE:
            break
        rivals = tuple(other for its, other, _, _ in tried if other != name and abs(its - gain) < DECISIVE)
        result = heldout.compute_fit_errors(
            tracer.problem, tracer.held, tracer.predictor, {"before": base, "after": fit}, "observable"
        )
        better = (result.chi2["before"] - result.chi2["after"]) * tracer.held.size
        errors = {key: (row["before"], row["after"]) for key, row in result.rows.items()}
        less = all(after < before for before, after in errors.values())
        out.append(
            Round(name, bool(better >= SUPPORTED and less), d, float(fit.point.c[0]), float(better), rivals, errors)
        )
        if out[-1].kept:
            values = _fitted_values(fit)
            break
        refused.add(name)
    return out, values


def run_staged_search(problem, most=None, say=None, settings=QUICK):
    """`StagedResult` of a problem: law after law, each the best of those refitted, kept if held-out data support it."""
    most = problem.most_laws if most is None else most
    first = Tracer(problem, settings, None, None).run()
    rounds, names, refused, values = [], [], set(), {}
    alarmed = first.verdict not in NOTHING or (first.p_global is not None and first.p_global < settings.alpha / 2)
    while alarmed and len(names) < most:
        tracer = Tracer(settle(problem, names, values), settings, None, None)
        tracer.dropped = {}
        if not tracer.calibrate() or _heldout_reaches_floor(tracer, tracer.base.fit):
            break
        tried, values = _round(tracer, refused)
        rounds += tried
        if say:
            say(f"{', '.join(names) or 'nothing'}: {[(r.law, r.kept) for r in tried]}")
        if not tried or not tried[-1].kept:
            break
        names.append(tried[-1].law)
    return _finish_search(problem, first, rounds, names, values, settings)


def _finish_search(problem, first, rounds, names, values, settings):
    """`StagedResult` of laws that are kept, from where the last round has settled."""
    last, fit = first, None
    if names:
        tracer = Tracer(settle(problem, names, values), settings, None, None)
        last, fit = tracer.run(), tracer.base.fit
    rounds = [r._replace(kept=r.law in names) for r in rounds]
    return StagedResult(first, rounds, last, summary(problem, first, rounds, last, fit))


def settle(problem, names, values):
    """The problem with laws as part of the model, to be calibrated from where the last round has settled."""
    now = absorb(problem, list(names))
    if names:
        now.nuisances = tuple(n._replace(value=values.get(n.name, n.value)) for n in now.nuisances)
    return now


def _fitted_values(fit):
    """{nuisance or law: value} of a fit."""
    names = (*(n.name for n in fit.model.problem.nuisances), *fit.model.names)
    return dict(zip(names, (*map(float, fit.point.theta), *map(float, fit.point.c))))


def fit_nested_laws(problem, names):
    """Fits with none, one, two .. of the laws, each from where the one before has settled."""
    values, out = {}, []
    for count in range(len(names) + 1):
        tracer = Tracer(settle(problem, names[:count], values), QUICK, None, None)
        tracer.calibrate()
        out.append(tracer.base.fit)
        values = _fitted_values(refit(out[-1], (names[count],), tracer.table)) if count < len(names) else values
    return out


def compute_segment_errors(problem, names, stage_fits):
    """{segment: {unit, floor, before, after_one_law, after, *_ci}} of all validating and examining segments."""
    out = {}
    for label, count in zip(LABELS, (0, min(1, len(names)), len(names))):
        for part in (problem, problem.exam()):
            now = absorb(part, list(names[:count]))
            space = Space(now, "validate")
            if not space.size:
                continue
            rows = heldout.compute_fit_errors(now, space, Predictor(now), {"model": stage_fits[count]}, "group").rows
            for key, row in rows.items():
                mine = out.setdefault(key, {"unit": row["unit"], "floor": row["floor"]})
                mine |= {label: row["model"], label + "_ci": row["model_ci"]}
    return out


def residuals(problem, names, stage_fits):
    """{(segment, observable): `part_page.Residual`} of all segments, at the first and the last of the fits."""
    out = {}
    for part in (problem, problem.exam()):
        both = (part, stage_fits[0]), (absorb(part, list(names)), stage_fits[-1])
        for k, segment in enumerate(part.segments):
            before, after = (
                part.observed_features(k) - now.predict([(f.point.theta, {})], [k])[0][0] for now, f in both
            )
            (o,) = segment.observables
            rms = part.repeatability_rms(k)[o.name]
            out[segment.name, o.name] = part_page.Residual(segment.role, o.unit, rms, before, after)
    return out


def report(problem, settings=None, progress=None):
    """(JSON, picture): as for the other parts, and what is carried over to the gyroscope."""
    chosen = QUICK
    if settings is not None:
        chosen = replace(QUICK, alpha=settings.alpha, looks=settings.looks, seed=settings.seed)
    most = problem.most_laws if settings is None else min(problem.most_laws, settings.max_laws)
    say = progress and (lambda text: progress(text, 0, 1))
    search = run_staged_search(problem, most, say, chosen)
    names = [r.law for r in search.rounds if r.kept]
    stage_fits = fit_nested_laws(problem, names)
    heldout_errors = compute_segment_errors(problem, names, stage_fits)
    while names and any(
        h["after"] > UNCHANGED_FACTOR * h["before"] for h in heldout_errors.values()
    ):  # the last law goes: never worse than none
        names, stage_fits = names[:-1], stage_fits[:-1]
        search = _finish_search(problem, search.first, search.rounds, names, _fitted_values(stage_fits[-1]), chosen)
        heldout_errors = compute_segment_errors(problem, names, stage_fits)
    values = problem.nuisance_values(stage_fits[-1].point.theta[: len(problem.nuisances)])
    coefficients = dict(zip(names, stage_fits[-1].point.theta[len(problem.nuisances) :]))
    rows = residuals(problem, names, stage_fits)
    data = dict(search.json)
    data["heldout"] = plain_value(heldout_errors)
    for name, floor in problem.repeatability(values, coefficients).items():
        mine = data["heldout"][name]
        mine |= {"noise": mine["floor"], "floor": max(floor, mine["floor"])}
        rows = {key: row._replace(floor=mine["floor"]) if key[0] == name else row for key, row in rows.items()}
    data["notes"] = list(problem.notes)
    data["left"] = []
    pieces = {p.name: p for p in problem.all_pieces}
    for key, row in rows.items():
        if row.role == "validate":
            where = problem.where(pieces[key[0]], row.after, values, coefficients)
            data["left"].append(part_page.describe_residual(problem, key, rows) | ({"where": where} if where else {}))
    data["gyroscope"] = [c._asdict() for c in laws_of_loop(data["effects"], problem.working_at(values), Device())]
    return plain_value(part_page.in_part(data)), part_page.picture(problem, rows)


def nulls(problem, count, seed=0, say=None):
    """Names of the effects found in each of `count` simulated recordings without any."""
    theta = fit_nested_laws(problem, ())[0].point.theta
    out = []
    for k in range(count):
        one = problem.simulate_data(theta, {}, np.random.default_rng([seed, k]))
        law_search = run_staged_search(one, 1)
        out.append([e["law"] for e in law_search.json["effects"]])
        if say:
            say(f"{k + 1}: {out[-1]}, {law_search.json['verdict']}")
    return out

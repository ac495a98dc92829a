"""One law after the other: what is decisive becomes part of the model, if held-out data support it.

    decisive     ln(evidence) of the law less that of none, prior 1 / (number of laws) counted, above ln 20
    chosen       of the decisive laws the one with most evidence
    supported    chi2 of the held-out groups falls by at least 9, coefficient from the fitted groups; a law that blames
                 instrument or preparation must make no observable certainly worse (95 % interval) by 2 %
    rivals       laws of cosine above 0.95 whose evidence is within a factor 20: with one, the law is "confounded"
    never worse  a law goes that makes the held-out error of an observable larger than it was without any law; where
                 no law changes what is predicted of an observable, its error is the one before
A law of many coefficients (`Family`) is one law in all of this. Where fitted and held-out data are of one file, the
verdict is "candidate" at most. The first and the last step is a whole trace: whether anything is missing, and what is
left. A law that is not supported is listed and not tried again; one that the later laws have made superfluous goes in
the end. Held-out data are never fitted; they decide how many laws there are, and for this the error after the last law
is a little too small.
"""

import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from testbench.measured.exam import exam_intervals, structure
from testbench.tracing.fit import evidence
from testbench.tracing.fit.rank import one_sided
from testbench.tracing.fit.refit import refit
from testbench.tracing.problem.problem import Nuisance
from testbench.tracing.problem.result import plain_value
from testbench.tracing.trace import Options, Tracer

QUICK = 199  # null draws of the traces before and after
ALPHA = 0.02  # chance of a false alarm on a clean recording of a part; half of it is that of held-out data
DECISIVE = np.log(20.0)
SUPPORTED = 9.0  # of chi2, three sigmas of one coefficient
ALIKE = 0.95
HARMLESS = 1.02  # by which an observable may become worse
UNCHANGED_FACTOR = (
    1.001  # by which it changes where a law does nothing to it: nuisances and noise that observables share
)
MOST_TRIES = 16  # laws that are refitted before a round gives up
CHANCE = 0.01  # that noise makes the largest of as many laws as were tried as large as the least of those that stay
STRAYED = 3.0  # sd of its prior by which a law's own shape may be moved: further on it is not the law that was tried
NOTHING = ("none", "noise-model")


class Round(NamedTuple):
    """One law that was tried: what it explains on fitted groups (d), and what on held-out ones (chi2)."""

    law: str
    kept: bool
    d: float
    value: float
    chi2_gain: float
    rivals: tuple
    heldout: dict  # {observable: (before, after)}


class StagedResult(NamedTuple):
    """Trace before, laws that were tried, trace after, and the JSON of the whole."""

    first: object
    rounds: list
    last: object
    json: dict


def convert_laws_to_nuisances(problem, names):
    """A copy of a problem in which some laws are nuisances: already part of the model."""
    laws, extended = problem.laws_by_name(), copy.copy(problem)
    added = [
        Nuisance(member, laws[name].unit, 0.0, laws[name].scale)
        for name in names
        for member in (problem.families[name].members if name in problem.families else (name,))
    ]
    replaced = {n for name in names if name in problem.families for n in problem.families[name].replaces}
    indices = [k for k, n in enumerate(problem.nuisances) if n.name not in replaced]
    extended.nuisances = (*(problem.nuisances[k] for k in indices), *added)
    extended.laws = tuple(law for law in problem.laws if law.name not in names)
    extended.library = tuple(law for law in problem.library if law.name not in names)
    extended.families = {} if set(names) & set(problem.families) else problem.families

    def predict(points, which):
        base_points, added_names = [], [n.name for n in added]
        for theta, c in points:
            base_theta = np.zeros(len(problem.nuisances))
            base_theta[indices] = theta[: len(indices)]
            base_points.append((base_theta, dict(zip(added_names, map(float, theta[len(indices) :]))) | dict(c)))
        return problem.predict(base_points, which)

    extended.predict = predict
    return extended


def _decisive(tracer, refused):
    """[(gain, name, d, ranking)] of the laws whose evidence is decisive, the clearest first."""
    decisive_laws = []
    for ranking in tracer.rankings(tracer.base.fit).values():
        pool = [n for n in ranking.names if n not in ranking.hidden]
        scores = one_sided(ranking, tracer.laws)
        for name in pool:
            k = ranking.index(name)
            gain = evidence.linear_gain(ranking, [name], tracer.laws)
            if gain is None or name in refused or gain - np.log(len(tracer.laws)) < DECISIVE or scores[k] <= 0:
                continue
            decisive_laws.append((gain, name, float(scores[k]), ranking))
    decisive_laws += [row for row in structure.gains(tracer) if row[1] not in refused and row[0] > DECISIVE]
    return sorted(decisive_laws, key=lambda row: (-row[0], row[1]))


def _rival_names(row, decisive_laws):
    gain, name, _, ranking = row
    out = []
    for its, other, _, r in decisive_laws if ranking else ():
        if other != name and r is ranking and abs(its - gain) < DECISIVE:
            if abs(ranking.cosines[ranking.index(name), ranking.index(other)]) > ALIKE:
                out.append(other)
    return tuple(out)


def _try(tracer, row, decisive_laws):
    """`Round` of one law: refitted, judged on the held-out groups."""
    _, name, d, ranking = row
    base, law = tracer.base.fit, tracer.problem.laws_by_name()[name]
    if ranking is None:
        other = Tracer(absorb(tracer.problem, [name]), tracer.options, None, None)
        fit, value = (other.base.fit if other.calibrate() else None), float("nan")
    else:
        other, fit = tracer, refit(base, (name,), tracer.table)
        fit, value = (None, 0.0) if fit.failed else (fit, float(fit.point.c[0]))
    if fit is None:
        return Round(name, False, d, float("nan"), float("nan"), (), {})
    before, after = tracer.heldout_result({"now": base}), other.heldout_result({"now": fit})
    gain = (before.chi2["now"] - after.chi2["now"]) * tracer.held.size if tracer.held.size else 0.0
    errors = {key: (r["now"], after.rows[key]["now"]) for key, r in before.rows.items()}
    worse = []
    if law.kind != "plant":
        result = tracer.heldout_result({"before": base, "after": fit})
        worse = [key for key, r in result.rows.items() if r["gain_ci"][1] < 0 and r["after"] > HARMLESS * r["before"]]
    return Round(name, gain >= SUPPORTED and not worse, d, value, float(gain), _rival_names(row, decisive_laws), errors)


def _drop_harmful_laws(problem, names, rounds, options):
    """Laws of which none makes the held-out error of an observable larger than without any law."""
    names, tracer = list(names), Tracer(problem, options, None, None)
    if not names or not tracer.calibrate():
        return names
    before = tracer.heldout_result({"now": tracer.base.fit}).rows
    while names:
        tracer = Tracer(absorb(problem, names), options, None, None)
        if not tracer.calibrate():
            break
        after = tracer.heldout_result({"now": tracer.base.fit}).rows
        worse = [key for key in before if after[key]["now"] > UNCHANGED_FACTOR * before[key]["now"]]
        if not worse:
            break
        share = {r.law: {key: r.heldout[key][1] / r.heldout[key][0] for key in worse} for r in rounds if r.kept}
        active_laws = [name for name in names if any(abs(x - 1) > UNCHANGED_FACTOR - 1 for x in share[name].values())]
        worst_law = max(reversed(active_laws or names), key=lambda name: max(share[name].values()))
        names = [name for name in names if name != worst_law and name not in problem.dependent_nuisances(worst_law)]
    return names


def _drop_weak_laws(problem, names, options):
    """Laws that are still clear, and what they were, beside all the others; the least certain goes first."""
    names, least = list(names), norm.isf(CHANCE / 2 / max(len(problem.laws_by_name()), 1))
    while names:
        now = absorb(problem, names)
        tracer = Tracer(now, options, None, None)
        if not tracer.calibrate():
            break
        fit, dependents_by_law = tracer.base.fit, {name: now.dependent_nuisances(name) for name in names}
        d = np.array([structure.strength(fit, _coefficients(problem, name)) for name in names])
        d[[_is_outside_prior(dependents_by_law[name], now.nuisances, fit.point.theta) for name in names]] = 0.0
        if d.min() >= least:
            break
        weakest_law = names[int(np.argmin(d))]
        names = [name for name in names if name != weakest_law and name not in dependents_by_law[weakest_law]]
    return names


def _coefficients(problem, name):
    """Names of the nuisances that are a law's coefficients once it is part of the model."""
    return problem.families[name].members if name in problem.families else (name,)


def _is_outside_prior(dependent_names, nuisances, theta):
    """True if a nuisance that a law brought along has left its prior."""
    return any(abs(t - n.value) > STRAYED * n.prior_sd for n, t in zip(nuisances, theta) if n.name in dependent_names)


def absorb(problem, names):
    """The problem with some laws as part of the model: its own way (it may bring more nuisances), or as nuisances."""
    return (problem.include_laws(names) or convert_laws_to_nuisances(problem, tuple(names))) if names else problem


def _is_ambiguous_misfit(first, options):
    """True where the trace says "misfit or noise": the held-out groups are to tell."""
    return bool(first.certificates["repeats"]["R14"]) and first.p_global < options.alpha / 2


def _forward(problem, names, refused, most, options, progress):
    """`Round`s of laws that were tried beside `names`, until none is decisive. Adds to `names` and `refused`."""
    rounds = []
    while len(names) < most:
        tracer = Tracer(absorb(problem, names), options, None, None)
        tracer.dropped = {}
        if progress:
            progress(f"laws so far: {len(names)}", len(names), most)
        decisive_laws = _decisive(tracer, refused) if tracer.calibrate() else []
        for row in decisive_laws[:MOST_TRIES]:
            rounds.append(_try(tracer, row, decisive_laws))
            if rounds[-1].kept:
                names.append(row[1])
                break
            refused.add(row[1])
        else:
            break
    return rounds


def add_in_stages(problem, options=None, most=12, progress=None):
    """`StagedResult` of a problem; `most` laws are added at most."""
    options = options or Options(ALPHA)
    quick = replace(options, max_laws=1, n_null=min(options.n_null, QUICK), power=False, experiments=False)
    first = Tracer(problem, quick, progress, None).run()
    rounds, names, refused, last = [], [], set(), first
    if first.verdict not in NOTHING or _is_ambiguous_misfit(first, options):
        rounds = _forward(problem, names, refused, most, quick, progress)
    added, names = names, _drop_weak_laws(problem, names, quick)
    fine = _drop_harmful_laws(problem, names, rounds, quick)
    added, names = [name for name in added if name in fine or name not in names], fine
    superseded = [name for name in added if name not in names]
    rounds = [r._replace(kept=r.law in names) for r in rounds]
    fit = None
    if names:
        tracer = Tracer(absorb(problem, names), quick, progress, None)
        last, fit = tracer.run(), tracer.base.fit
    return StagedResult(first, rounds, last, summary(problem, first, rounds, last, fit, superseded))


def _before(rounds, row):
    """Laws that were part of the model when one was tried."""
    return [r.law for r in rounds[: rounds.index(row)] if r.kept]


def _effect(problem, law, r, fit, sd):
    """Entry of a law that was kept: its coefficient, or the rms of a family's, each with the stated deviation."""
    names = [n.name for n in fit.model.problem.nuisances]
    members = _coefficients(problem, r.law)
    values = {m: (float(fit.point.theta[names.index(m)]), float(sd[names.index(m)])) for m in members}
    (value, sigma), more = values[members[0]], {}
    if r.law in problem.families:
        c, s = np.array(list(values.values())).T
        value, sigma = float(np.sqrt(np.mean(c**2))), float(np.sqrt(np.mean(s**2)))
        more = {"coefficients": {m: {"value": v, "sd": s} for m, (v, s) in values.items()}}
    unsure = r.rivals or " or " in law.port
    status = "confounded" if unsure else "named" if problem.heldout_independent else "candidate"
    return (
        {"law": law.name, "port": law.port, "value": value, "sd": sigma, "unit": law.unit, "d": abs(value) / sigma}
        | {"d_when_added": r.d, "heldout_chi2_gain": r.chi2_gain, "kind": law.kind, "text": law.text}
        | {"page": law.page, "status": status, "rivals": list(r.rivals)}
        | problem.details(r.law, dict(zip(names, map(float, fit.point.theta))))
        | more
    )


def _affected_observables(problem, accepted, fit):
    """Observables whose prediction changes when the coefficients of some laws are halved."""
    now, theta = fit.model.problem, np.array(fit.point.theta, float)
    coefficient_names = [m for r in accepted for m in _coefficients(problem, r.law)]
    half = np.where([n.name in coefficient_names for n in now.nuisances], 0.5, 1.0)
    which = list(range(len(now.segments)))
    full_features, halved_features = now.predict([(theta, {}), (theta * half, {})], which)
    feature_pairs = [(o, full_features[k], halved_features[k]) for k in which for o in now.segments[k].observables]
    return {o.name for o, a, b in feature_pairs if np.any(a[o.rows] != b[o.rows])}


def summary(problem, first, rounds, last, fit, superseded=()):
    """JSON of all together: the keys of a trace, with one entry per law that was kept. fit: with them, or None."""
    accepted, data = [r for r in rounds if r.kept], {}
    laws = {name: law for r in rounds for name, law in absorb(problem, _before(rounds, r)).laws_by_name().items()}
    sd = exam_intervals.stated_sd(fit) if accepted else None
    by_group = problem.heldout_by != "observable"
    affected_names = set(first.heldout) if by_group or not accepted else _affected_observables(problem, accepted, fit)
    effects = [_effect(problem, laws[r.law], r, fit, sd) for r in accepted]
    for key, row in first.heldout.items():
        end = last.heldout.get(key, row) if accepted else row
        one = accepted[0].heldout.get(key, (row["before"],) * 2)[1] if accepted else row["before"]
        end, one = (end, one) if key in affected_names or not accepted else (row, row["before"])
        data[key] = {k: row[k] for k in ("unit", "floor", "before", "before_ci")}
        data[key] |= {"after_one_law": one, "after": end["before"], "after_ci": end["before_ci"]}
    has_residual_misfit = last.verdict not in NOTHING
    if not accepted:
        # without repeats a misfit that no law explains on held-out data is not told from noise
        is_conclusive = first.verdict in (*NOTHING, "firmware") or not first.certificates["repeats"]["R14"]
        verdict = first.verdict if is_conclusive else "noise-model"
        # a first trace may name what held-out data do not bear out
        verdict = "unexplained" if verdict in ("named", "confounded", "candidate") else verdict
    else:
        unsure = any(r.rivals for r in accepted[:1]) or any(" or " in e["port"] for e in effects)
        verdict = "candidate" if not problem.heldout_independent else "confounded" if unsure else "named"
    count = "1 law" if len(accepted) == 1 else f"{len(accepted)} laws"
    words = f"{count}: {', '.join(r.law for r in accepted)}; " if accepted else ""
    return plain_value(
        {
            "problem": problem.name,
            "verdict": verdict,
            "sentence": f"{words}{'afterwards: ' if accepted else ''}{last.sentence}",
            "effects": effects,
            "heldout": data,
            "p_global": first.p_global,
            "p_left": last.p_global if accepted else first.p_global,
            "something_left": bool(accepted and (has_residual_misfit or (last.p_global or 1.0) < 0.01)),
            "heldout_chi2": {"before": first.heldout_chi2.get("before"), "after": last.heldout_chi2.get("before")},
            "not_carried_over": [r.law for r in rounds if not r.kept and r.law not in superseded],
            "superseded": list(superseded),
            "rounds": [r._asdict() for r in rounds],
            "ranking": first.ranking[:12],
            "hashes": dict(problem.hashes),
            "certificates": first.certificates,
        }
    )

"""One law after the other: what is decisive becomes part of the model, if held-out data support it.

    decisive     ln(evidence) of the law less that of none, prior 1 / (number of laws) counted, above ln 20
    chosen       of the decisive laws the one with most evidence; where a problem says `biggest_first`, the one that
                 takes most of the residual's power in the features' own unit
    supported    chi2 of the held-out groups falls by at least 9, coefficient from the fitted groups; a law that blames
                 instrument or preparation must make no observable certainly worse (95 % interval) by 2 %
    rivals       laws of cosine above 0.95 whose evidence is within a factor 20: with one, the law is "confounded"
The first and the last step is a whole trace: whether anything is missing, and what is left. A law that is not supported
is listed and not tried again; one that the later laws have made superfluous goes in the end. Held-out data are never
fitted; they decide how many laws there are, and for this the error after the last law is a little too small.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from testbench.tracing.fit import evidence, heldout
from testbench.tracing.fit.rank import one_sided
from testbench.tracing.fit.refit import refit
from testbench.tracing.problem.problem import Nuisance, PredictionFailed, all_laws, option
from testbench.tracing.problem.result import plain
from testbench.tracing.trace import Options, Tracer

QUICK = 199  # null draws of the traces before and after
DECISIVE = np.log(20.0)
SUPPORTED = 9.0  # of chi2, three sigmas of one coefficient
ALIKE = 0.95
HARMLESS = 1.02  # by which an observable may become worse
MOST_TRIES = 8  # laws that are refitted before a round gives up
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


class Staged(NamedTuple):
    """Trace before, laws that were tried, trace after, and the JSON of the whole."""

    first: object
    rounds: list
    last: object
    json: dict


class Known:
    """A problem in which some laws are nuisances: already part of the model."""

    def __init__(self, problem, names):
        laws = {law.name: law for law in (*problem.laws, *problem.library)}
        self._problem, self._names = problem, tuple(names)
        self._plain = len(problem.nuisances)
        self.nuisances = (*problem.nuisances, *(Nuisance(n, laws[n].unit, 0.0, laws[n].scale) for n in names))
        self.laws = tuple(law for law in problem.laws if law.name not in names)
        self.library = tuple(law for law in problem.library if law.name not in names)

    def __getattr__(self, name):
        return getattr(self._problem, name)

    def predict(self, points, which):
        moved = []
        for theta, effects in points:
            known = dict(zip(self._names, map(float, theta[self._plain :])))
            moved.append((theta[: self._plain], known | dict(effects)))
        return self._problem.predict(moved, which)


def _power(problem, fit, ranking, name):
    """Share of the residual's power (features' own unit) that a law takes at a fit, nuisances moved along with it."""
    k = ranking.index(name)
    c = float(ranking.t[k] / ranking.length[k])
    a = np.concatenate([fit.jacobian, fit.model.prior_columns()])
    s = np.concatenate([ranking.signatures[:, k], np.zeros(len(a) - len(fit.jacobian))])
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    moved = np.linalg.lstsq(a / scale, s, rcond=1e-10)[0] / scale
    groups = fit.model.space.groups
    which = [g.members[0] for g in groups]
    points = [(fit.point.theta, {}), (fit.point.theta - c * moved, {name: c})]
    try:
        plain_rows, bent_rows = problem.predict(points, which)
    except PredictionFailed:
        return 0.0
    left = taken = 0.0
    for g, before, after in zip(groups, plain_rows, bent_rows):
        mean = np.mean([problem.measured(k) for k in g.members], axis=0)
        left += float(np.sum((mean - before) ** 2))
        taken += float(np.sum((mean - before) ** 2) - np.sum((mean - after) ** 2))
    return taken / left if left > 0 else 0.0


def _decisive(tracer, refused):
    """[(power, name, d, gain, ranking)] of the laws whose evidence is decisive, most powerful first."""
    fit, found, biggest = tracer.base.fit, [], getattr(tracer.problem, "biggest_first", False)
    for ranking in tracer.rankings(fit).values():
        pool = [n for n in ranking.names if n not in ranking.hidden]
        scores = one_sided(ranking, tracer.laws)
        for name in pool:
            k = ranking.index(name)
            gain = evidence.linear_gain(ranking, [name], tracer.laws)
            if gain is None or name in refused or gain - np.log(len(tracer.laws)) < DECISIVE or scores[k] <= 0:
                continue
            power = _power(tracer.problem, fit, ranking, name) if biggest else 0.0
            found.append((power, name, float(scores[k]), gain, ranking))
    return sorted(found, key=lambda row: (-row[0] if biggest else -row[3], row[1]))


def _rivals(row, rows):
    _, name, _, gain, ranking = row
    out = []
    for _, other, _, its, r in rows:
        if other != name and r is ranking and abs(its - gain) < DECISIVE:
            if abs(ranking.cosines[ranking.index(name), ranking.index(other)]) > ALIKE:
                out.append(other)
    return tuple(out)


def _try(tracer, row, rows):
    """`Round` of one law: refitted, judged on the held-out groups."""
    _, name, d, _, _ = row
    fit = refit(tracer.base.fit, (name,), tracer.table)
    if fit.failed:
        return Round(name, False, d, float("nan"), float("nan"), (), {})
    fits = {"before": tracer.base.fit, "after": fit}
    judged = heldout.judge(tracer.problem, tracer.held, tracer.predictor, fits)
    gain = (judged.chi2["before"] - judged.chi2["after"]) * tracer.held.size if tracer.held.size else 0.0
    shown = {key: (r["before"], r["after"]) for key, r in judged.rows.items()}
    worse = [key for key, r in judged.rows.items() if r["gain_ci"][1] < 0 and r["after"] > HARMLESS * r["before"]]
    shared = tracer.laws[name].kind != "plant"
    return Round(
        name,
        gain >= SUPPORTED and not (shared and worse),
        d,
        float(fit.point.c[0]),
        float(gain),
        _rivals(row, rows),
        shown,
    )


def _pruned(problem, names, options):
    """Laws that are still clear, and what they were, beside all the others; the least certain goes first."""
    names, least = list(names), norm.isf(CHANCE / 2 / max(len(all_laws(problem)), 1))
    while names:
        now = absorbed(problem, names)
        tracer = Tracer(now, options, None, None)
        if not tracer.calibrate():
            break
        fit, at = tracer.base.fit, [[n.name for n in now.nuisances].index(name) for name in names]
        d = np.abs(fit.point.theta[at]) / np.maximum(fit.sd[at], 1e-300)
        more_of = option(now, "more_of", lambda law: ())
        own = {name: more_of(name) for name in names}
        d[[_strayed(own[name], now.nuisances, fit.point.theta) for name in names]] = 0.0
        if d.min() >= least:
            break
        gone = names[int(np.argmin(d))]
        names = [name for name in names if name != gone and name not in own[gone]]
    return names


def _strayed(own, nuisances, theta):
    """True if a nuisance that a law brought along has left its prior."""
    return any(abs(t - n.value) > STRAYED * n.prior_sd for n, t in zip(nuisances, theta) if n.name in own)


def absorbed(problem, names):
    """The problem with some laws as part of the model: its own way (a law may bring more nuisances), or `Known`."""
    if not names:
        return problem
    own = getattr(problem, "absorbed", None)
    return own(names) if own else Known(problem, names)


def _misfit_without_repeats(first, options):
    """True where the trace says "misfit or noise": the held-out groups are to tell."""
    return bool(first.certificates["repeats"]["R14"]) and first.p_global < options.alpha


def _forward(problem, names, refused, most, options, progress):
    """`Round`s of laws that were tried beside `names`, until none is decisive. Adds to `names` and `refused`."""
    rounds = []
    while len(names) < most:
        tracer = Tracer(absorbed(problem, names), options, None, None)
        tracer.dropped = {}
        if progress:
            progress(f"laws so far: {len(names)}", len(names), most)
        rows = _decisive(tracer, refused) if tracer.calibrate() else []
        for row in rows[:MOST_TRIES]:
            rounds.append(_try(tracer, row, rows))
            if rounds[-1].kept:
                names.append(row[1])
                break
            refused.add(row[1])
        else:
            break
    return rounds


def staged(problem, options=None, most=12, progress=None):
    """`Staged` of a problem; `most` laws are added at most."""
    options = options or Options()
    quick = replace(options, max_laws=1, n_null=min(options.n_null, QUICK), power=False, experiments=False)
    first = Tracer(problem, quick, progress, None).run()
    rounds, names, refused, last = [], [], set(), first
    if first.verdict not in NOTHING or _misfit_without_repeats(first, options):
        rounds = _forward(problem, names, refused, most, quick, progress)
    added, names = names, _pruned(problem, names, quick)
    superseded = [name for name in added if name not in names]
    rounds = [r._replace(kept=r.law in names) for r in rounds]
    if names:
        last = Tracer(absorbed(problem, names), quick, progress, None).run()
    return Staged(first, rounds, last, summary(problem, first, rounds, last, superseded))


def _before(rounds, row):
    """Laws that were part of the model when one was tried."""
    return [r.law for r in rounds[: rounds.index(row)] if r.kept]


def summary(problem, first, rounds, last, superseded=()):
    """JSON of all together: the keys of a trace, with one entry per law that was kept."""
    kept = [r for r in rounds if r.kept]
    laws = {name: law for r in rounds for name, law in all_laws(absorbed(problem, _before(rounds, r))).items()}
    fitted, effects, data = {row["name"]: row for row in last.nuisances}, [], {}
    for r in kept:
        law, row = laws[r.law], fitted[r.law]
        value, sd = row["before"], row["sd_before"]
        more = getattr(problem, "details", None)
        effects.append(
            {"law": law.name, "port": law.port, "value": value, "sd": sd, "unit": law.unit, "d": abs(value) / sd}
            | {"d_when_added": r.d, "heldout_chi2_gain": r.chi2_gain, "kind": law.kind, "text": law.text}
            | {
                "page": law.page,
                "status": "confounded" if r.rivals or " or " in law.port else "named",
                "rivals": list(r.rivals),
            }
            | (more(r.law, {name: row["before"] for name, row in fitted.items()}) if more else {})
        )
    for key, row in first.heldout.items():
        end = last.heldout.get(key, row) if kept else row
        one = kept[0].heldout.get(key, (row["before"],) * 2)[1] if kept else row["before"]
        data[key] = {k: row[k] for k in ("unit", "floor", "before", "before_ci")}
        data[key] |= {"after_one_law": one, "after": end["before"], "after_ci": end["before_ci"]}
    left = last.verdict not in NOTHING
    if not kept:
        # without repeats a misfit that no law explains on held-out data is not told from noise
        told = first.verdict in (*NOTHING, "firmware") or not first.certificates["repeats"]["R14"]
        verdict = first.verdict if told else "noise-model"
        # a first trace may name what held-out data do not bear out
        verdict = "unexplained" if verdict in ("named", "confounded") else verdict
    else:
        unsure = any(r.rivals for r in kept[:1]) or any(" or " in e["port"] for e in effects)
        verdict = "confounded" if unsure else "named"
    words = f"{len(kept)} law(s): {', '.join(r.law for r in kept)}; " if kept else ""
    return plain(
        {
            "problem": problem.name,
            "verdict": verdict,
            "sentence": f"{words}{'left: ' if kept else ''}{last.sentence}",
            "effects": effects,
            "heldout": data,
            "p_global": first.p_global,
            "p_left": last.p_global if kept else first.p_global,
            "something_left": bool(kept and (left or (last.p_global or 1.0) < 0.01)),
            "heldout_chi2": {"before": first.heldout_chi2.get("before"), "after": last.heldout_chi2.get("before")},
            "not_carried_over": [r.law for r in rounds if not r.kept and r.law not in superseded],
            "superseded": list(superseded),
            "rounds": [r._asdict() for r in rounds],
            "ranking": first.ranking[:12],
            "hashes": dict(problem.hashes),
            "certificates": first.certificates,
        }
    )

"""Conditions on offer for the next recording of a closed loop, as a problem: what each would see of some laws.

    offered  the fitted conditions once more, and corners beyond them: amplitude, temperature and detuning at their
             edges, the rate stepping from one side to the other; half of the combinations of four factors
    y        T (theta - first) + L c      tangents at each condition (loop_tangents.py); laws by runs of their own
    noise    that of the fitted condition which is most alike
    second   of wide priors: another amplitude at each temperature that has one. A law is shadowed by a temperature
             coefficient if that takes more than 1 - SHADOWED of the sigmas which all other nuisances leave of it
A corner without a lock, or where a tangent fails, is not offered.
Source    Box & Hunter, Technometrics 3 (1961); docs/measured.md
"""

import itertools
import math

import numpy as np

from testbench.config.toml_text import short_toml
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_runs
from testbench.measured.closed_loop.loop_difference_plant import AIM
from testbench.measured.closed_loop.loop_tangents import Tangents
from testbench.tracing.problem.problem import PredictionFailed, Problem, Segment

TEMPERATURES_DEGC, DETUNINGS_DEG = (-40.0, 85.0), (-25.0, 25.0)
SMALLER, LARGER = 0.5, 1.0  # of the smallest and largest recorded amplitude
LEAST_DPS = 50.0  # of a step, where the record has no rate
SETTLE_S = 3.0  # of a plan
PRINTED = ("a_um", "from_dps", "rate_dps", "temperature_degc", "detune_deg", "settle_s", "seconds")
SHADOWED = 0.5  # of the sigmas of a law
SLOPES = ("tcf_per_k", "dlnq_per_k", "kxy_tc_below_per_k", "kxy_tc_above_per_k")
ALIKE = (("temperature_degc", 60.0), ("detune_deg", 30.0), ("rate_dps", 300.0))  # a distance of one


def corners(recorded):
    """`recording_plan.Condition`s beyond recorded ones; no larger force for the rate than those have had."""
    fastest = max(LEAST_DPS, *(max(abs(c.rate_dps), abs(loop_runs.before_dps(c))) for c in recorded))
    force = max(LEAST_DPS, *(c.a_um * max(abs(c.rate_dps), abs(loop_runs.before_dps(c))) for c in recorded))
    amplitudes = SMALLER * min(c.a_um for c in recorded), LARGER * max(c.a_um for c in recorded)
    out = []
    for k, (i, j, m) in enumerate(itertools.product((0, 1), repeat=3)):
        a_um = float(f"{amplitudes[i]:.3g}")
        dps = float(f"{min(fastest, force / a_um):.3g}") * (-1) ** (i + j + m)
        c = recorded[0]._replace(
            id=f"next{k + 1}", a_um=a_um, rate_dps=dps, from_dps=-dps, temperature_degc=TEMPERATURES_DEGC[j],
            detune_deg=DETUNINGS_DEG[m], role="fit", rate_ramp_dps_s=0.0, temperature_ramp_k_s=0.0,
        )  # fmt: skip
        out.append(c._replace(seconds=most_similar(c, recorded).seconds))
    return out


def most_similar(condition, recorded):
    """The recorded condition that is most alike."""

    def dissimilarity(c):
        scaled_differences = ((getattr(c, name) - getattr(condition, name)) / one for name, one in ALIKE)
        return math.log2(c.a_um / condition.a_um) ** 2 + sum(v * v for v in scaled_differences)

    return min(recorded, key=dissimilarity)


def amplitude_conditions(recorded):
    """`recording_plan.Condition`s with another amplitude at each temperature that has only one."""
    least, most, at = min(c.a_um for c in recorded), max(c.a_um for c in recorded), {}
    for c in recorded:
        at.setdefault(c.temperature_degc, []).append(c)
    out = []
    for only in (group[0] for group in at.values() if len({c.a_um for c in group}) == 1):
        a_um = LARGER * most if only.a_um < math.sqrt(least * most) else SMALLER * least
        # no larger force for the rate than the recorded one
        share = min(1.0, only.a_um / a_um)
        rates = {"rate_dps": share * only.rate_dps, "from_dps": share * loop_runs.before_dps(only)}
        out.append(only._replace(id=f"second{len(out) + 1}", a_um=float(f"{a_um:.3g}"), **rates))
    return out


def describe_shadowed_laws(problem):
    """Lines on laws of the catalogue that a temperature coefficient takes, and the conditions that would show them."""
    recorded = [c for c in problem.conditions.values() if c.role == "fit"]
    conditions = ", ".join(f"{c.a_um:g} um at {c.temperature_degc:g} degC" for c in amplitude_conditions(recorded))
    slopes = [k for k, n in enumerate(problem.nuisances) if n.name.partition(".")[2] in SLOPES]
    if not problem.starts or not slopes or not conditions:
        return ()
    j = problem.whiten_fit_rows(problem.tangent) * [n.prior_sd for n in problem.nuisances]
    shadowed = {}
    for law in problem.laws:
        column = problem.whiten_fit_rows(problem.column(law.name))
        free = _unexplained_sigmas(j, column)
        fixed = {k: _unexplained_sigmas(np.delete(j, k, axis=1), column) for k in slopes}
        most = max(fixed, key=fixed.get)
        if free < SHADOWED * fixed[most]:
            shadowed.setdefault(problem.nuisances[most].name, []).append(
                f"{law.name} ({free / fixed[most]:.0%} of its size remains)"
            )
    return tuple(
        f"not identifiable together with {key}: {', '.join(names)}; to fix it: a second amplitude at two temperatures "
        f"or more ({conditions})"
        for key, names in shadowed.items()
    )


def _unexplained_sigmas(nuisances, column):
    """Sigmas of a whitened column that nuisances in units of their priors leave."""
    a = np.concatenate([nuisances, np.eye(nuisances.shape[1])])
    b = np.concatenate([column, np.zeros(nuisances.shape[1])])
    return float(np.linalg.norm(b - a @ np.linalg.lstsq(a, b, rcond=None)[0]))


class Offered(Problem, adds="of likes conditions tangent columns"):
    """Conditions on offer to a `LoopProblem` that is to tell some of its laws apart."""

    def __init__(self, of, laws):
        self.of, self.name = of, of.name
        self.nuisances, self.laws, self.library, self.linear_in = of.nuisances, of.laws, of.library, of.linear_in
        self.noise_gain, self.prediction_noise = of.noise_gain, of.prediction_noise
        recorded = [c for c in of.conditions.values() if c.role == "fit"]
        self.conditions, self.likes = {c.id: c for c in recorded}, {c.id: c.id for c in recorded}
        self.tangent = {c.id: of.tangent[c.id] for c in recorded}
        self.columns = {name: dict(of.column(name)) for name in laws}
        # steps that move the recorded features by AIM sigmas
        steps = {name: AIM / max(of.size(v), 1e-300) for name, v in self.columns.items()}
        for c in corners(recorded) + (amplitude_conditions(recorded) if of.starts else []):
            similar_id = most_similar(c, recorded).id
            tangent_columns = self._tangents(c, similar_id, steps)
            if tangent_columns is not None:
                self.conditions[c.id], self.likes[c.id], self.tangent[c.id] = c, similar_id, tangent_columns[0]
                for name, column in zip(laws, tangent_columns[1]):
                    self.columns[name][c.id] = column
        rows = {s.group: (k, s) for k, s in enumerate(of.segments)}
        self.likes = {g: rows[similar_id] for g, similar_id in self.likes.items()}
        self.segments = tuple(
            Segment(g, {k: getattr(c, k) for k in PRINTED}, g, 0, "fit", self.likes[g][1].observables)
            for g, c in ((g, _as_plan_condition(c)) for g, c in self.conditions.items())
        )
        self.hashes = of.hashes | {"offered": of.key([*self.conditions.values()], sorted(laws))}

    def _tangents(self, condition, similar_id, steps):
        """(nuisances' columns, laws' columns) at a condition; None without a lock or where one fails."""
        names, laws = [n.name for n in self.nuisances], list(self.columns)
        try:
            tangents = Tangents(self.of.single_condition_problem(condition, similar_id))
            for name in laws:
                sign = self.of.candidates[name].law.sign or 1
                tangents.steps[name] = sign * min(steps[name], tangents.largest(name))
            tangents.steps.update((n, s) for n, s in self.of.tangents.steps.items() if n in names)
            tangents.make([*names, *laws])
            columns = tangents.matrix("fit")[condition.id], [tangents.column_from_runs(n)[condition.id] for n in laws]
        except (ConfigError, PredictionFailed):
            return None
        return columns if all(np.isfinite(v).all() for v in (columns[0], *columns[1])) else None

    def observed_features(self, k):
        """Nothing has been measured: zeros."""
        return np.zeros(len(self.of.observed_features(self.likes[self.segments[k].group][0])))

    def predict(self, points, which):
        out = []
        for theta, effects in points:
            out.append([])
            for g in (self.segments[k].group for k in which):
                y = self.tangent[g] @ (np.asarray(theta) - self.of.first)
                y = y + sum(self.columns[name][g] * effects[name] for name in sorted(effects))
                out[-1].append(y[: len(self.observed_features(which[0]))])
        return out

    def whiten(self, k, v):
        return self.of.whiten(self.likes[self.segments[k].group][0], v)

    def condition_text(self, k):
        """The condition as a plan of a recording takes it."""
        s = self.segments[k]
        rows = [("id", s.group), *s.condition.items()]
        return "\n".join(["[[condition]]", *(f"{key} = {short_toml(value)}" for key, value in rows)])


def _as_plan_condition(c):
    """A condition as a plan has it."""
    return c._replace(settle_s=SETTLE_S, from_dps=loop_runs.before_dps(c))

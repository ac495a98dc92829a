"""Tangents of a closed-loop problem: how its features change per unit of a nuisance or law.

    T = (mu(theta + s) - mu(theta - s)) / 2 s      averaged plant, same noise on both sides, steps s of about AIM
                                                   sigmas; to one side where a law has a sign
    even     re-timed reference edges slip at instants that any change moves: scatter of 3 to 25 % of what nuisances
             leave of a law. So references leave at any clock here, later by what an edge waits for the 1 MHz grid
    smooth   the drive's codes are not rounded: what a law does to the amplitude word would depend on the step
    held     the drive frequency is that of the base run; what its change does is put back by `slope`, 1 Hz per Hz
    weak     directions of wide priors are measured by steps of their own (loop_symmetries.py)
    laws     that are products of states at ports come from the responses of a few runs (loop_responses.py)
Source    docs/measured.md
"""

import numpy as np

from testbench.measured.closed_loop.loop_difference_plant import AIM, FREQUENCY_TOLERANCE_HZ, disable_retiming
from testbench.measured.closed_loop.loop_responses import Responses, covers
from testbench.measured.closed_loop.loop_symmetries import active_symmetries, correct_columns, weak
from testbench.tracing.problem.problem import PredictionFailed

AIM_TOLERANCE = 2.5  # how far off AIM a step may be
MIN_LAW_SIGMAS = 10.0  # sigmas of all features together, that a law's largest step must move
LARGEST_SCALES = 1e4  # of a law of the grammar
GUESSES, SHORTER = 6, 0.03  # steps tried under one condition; factor of a step where the plant leaves its range


class Tangents:
    """{condition: change of the features per unit} of nuisances and laws of a `LoopProblem`, made when asked for.

    Steps come from the fitted conditions. Hardly any law is ever predicted on the others: made by themselves.
    """

    def __init__(self, of):
        self.of, self.slope, self.kept = of, of.slope, of.kept.columns
        self.nuisances = [n.name for n in of.nuisances]
        # the same a few mHz further on
        self._where = of.key(list(of.conditions.values()), *of.starts)
        # {name: step}: 0 of a law that these data do not see
        self.steps = of.kept.steps.setdefault(self._where, {})
        candidate_laws = {name: c.unit_laws(of.model.device()) for name, c in of.candidates.items()}
        self._covered_laws = {name: laws for name, laws in candidate_laws.items() if covers(laws)}
        # of wide priors alone: a direction that no data see must not be fixed by the errors of steps
        self._wide, self._weak = bool(of.starts), None
        self._tied = active_symmetries(self.nuisances) if self._wide else {}
        for role in {c.role for c in of.conditions.values()}:
            self.kept[self._key(role, "plant.fx_hz")] = {c.id: of.slope[c.id] for c in self._conditions(role)}

    def column(self, name, role="fit"):
        """{condition: column} of the conditions with a role; nan where the plant fails."""
        if not self._conditions(role):
            return {}
        if name in self._covered_laws:
            return self._column_from_responses(name, role)
        if name in self._tied:
            columns = {key: self.column(key, role) for key in self._tied[name].partners}
            values = dict(zip(self.nuisances, self.of.first))
            return {
                c.id: self._tied[name].column(values, {key: v[c.id] for key, v in columns.items()})
                for c in self._conditions(role)
            }
        return self.column_from_runs(name, role)

    def column_from_runs(self, name, role="fit"):
        """`column` by runs with this nuisance or law alone."""
        if self._key(role, name) not in self.kept:
            if name not in self.steps:
                self.make(self._batch_names(name))
            self.make(self.nuisances if name in self.nuisances else [name], role)
        return self.kept[self._key(role, name)]

    def _key(self, role, name):
        """What a column depends on: of a law that asks for the time from power-on, on those of the record too."""
        if name not in self.of.timed:
            return self._where, role, name
        after = [self.of.use_record_settle(c, {name: 1.0}).settle_s for c in self._conditions(role)]
        return self._where, role, name, *after

    def matrix(self, role):
        """{condition of a role: columns of all nuisances}, of wide priors with weak directions measured."""
        chosen, sd = self._conditions(role), np.array([n.prior_sd for n in self.of.nuisances])
        if not chosen:
            return {}
        columns = [self.column(name, role) for name in self.nuisances]
        out = {c.id: np.stack([v[c.id] for v in columns], axis=1) for c in chosen}
        if not self._wide:
            return out
        if self._weak is None:
            self._weak = weak(self.of.whiten_fit_rows(out if role == "fit" else self.matrix("fit")) * sd)
        directions, changes = [], []
        base = self._predict_points([(self.of.first, {})], chosen)[0]
        points = [(self.of.first + side * step * d * sd, {}) for d, step in self._weak for side in (1, -1)]
        weak_step_changes = self._changes(points, base)
        for (d, step), up, down in zip(self._weak, weak_step_changes[::2], weak_step_changes[1::2]):
            if up is not None and down is not None:
                directions.append(d)
                changes.append({g: (up[g] - down[g]) / (2 * step) for g in up})
        return {g: correct_columns(v * sd, directions, [m[g] for m in changes]) / sd for g, v in out.items()}

    def _column_from_responses(self, name, role):
        """Column of a law by the responses; zero where its largest step would hardly move the data."""
        response_cache = self.of.kept.responses
        if (self._where, role) not in response_cache:
            response_cache[self._where, role] = Responses(self.of, role)
        key = *self._key(role, name), "responses"
        if key not in self.kept:
            later = {
                c.id: self.of.use_record_settle(c, {name: 1.0}).settle_s - c.settle_s for c in self._conditions(role)
            }
            law_column = response_cache[self._where, role].column(self._covered_laws[name], later)
            is_visible = role != "fit" or self._change_sigmas(law_column) * self.largest(name) >= MIN_LAW_SIGMAS
            self.kept[key] = law_column if is_visible else {g: np.zeros_like(v) for g, v in law_column.items()}
        return self.kept[key]

    def _batch_names(self, name):
        """What is made with a law on the fitted conditions: laws of the library that the responses do not cover."""
        uncovered_names = [one.name for one in self.of.library if one.name not in self._covered_laws]
        return uncovered_names if name in uncovered_names else [name]

    def exclude_response_laws(self, names):
        """Those of some nuisances and laws that have tangents of their own."""
        return [name for name in names if name not in self._covered_laws]

    def _conditions(self, role):
        return [c for c in self.of.conditions.values() if c.role == role]

    def make(self, names, role="fit"):
        """Columns of nuisances and laws on the conditions with a role, that are not there yet."""
        of, columns = self.of, {}
        missing = [n for n in names if n not in self._tied and self._key(role, n) not in self.kept]
        if not missing:
            return
        base = self._predict_points([(of.first, {})], self._conditions(role))[0]
        steps = {name: self.steps.get(name, self._first_step(name)) for name in missing}
        zero, nan = ({g: np.full(len(v), fill) for g, v in base.items()} for fill in (0.0, np.nan))
        columns |= {name: zero for name in missing if not steps[name]}
        todo = [name for name in missing if steps[name]]
        self._guess([name for name in todo if name not in self.steps], steps, base)
        for _ in range(4):
            if not todo:
                break
            again = []
            for name, change in zip(todo, self._changes([self._step_point(name, steps[name]) for name in todo], base)):
                if change is None:
                    steps[name] *= SHORTER
                    again.append(name)
                    continue
                columns[name] = {g: v / steps[name] for g, v in change.items()}
                size = self._change_sigmas(change)
                if name in self.steps:
                    continue
                if size < MIN_LAW_SIGMAS and name in of.candidates:
                    # what the largest step hardly moves is noise, and no law that these data see
                    columns[name] = zero
                if not AIM / AIM_TOLERANCE <= size <= AIM * AIM_TOLERANCE and self._adjust_step(name, steps, size):
                    again.append(name)
            todo = again
        # to both sides where both are allowed: what is of second order in a law falls out
        both = [n for n, v in columns.items() if v is not zero and self._allows_both_signs(n)]
        for name, change in zip(both, self._changes([self._step_point(n, -steps[n]) for n in both], base)):
            if change is not None:
                columns[name] = {g: (v - change[g] / steps[name]) / 2 for g, v in columns[name].items()}
        for name in missing:
            self.steps.setdefault(name, 0.0 if columns.get(name) is zero else steps[name])
            self.kept[self._key(role, name)] = columns.get(name, nan)

    def _first_step(self, name):
        if name in self.nuisances:
            return 0.1 * self.of.nuisances[self.nuisances.index(name)].prior_sd
        one = self.of.candidates[name].law
        return one.scale * (one.sign or 1)

    def _change_sigmas(self, feature_changes):
        """Sigmas of a change of some conditions, if all others moved as they do."""
        return self.of.size(feature_changes) * np.sqrt(len(self.of.conditions) / len(feature_changes))

    def _guess(self, names, steps, base):
        """Steps that move all features by about AIM sigmas, from one condition alone. Mutates `steps`.

        The scale of y^3 is six orders of magnitude above what the plant bears: y hardly moves in a closed loop.
        """
        one = max((self.of.conditions[g] for g in base), key=lambda c: (c.a_um, abs(c.rate_dps)))
        for _ in range(GUESSES):
            predictions = self._predict_points([self._step_point(name, steps[name]) for name in names], (one,))
            failed_names = [name for name, prediction in zip(names, predictions) if prediction is None]
            for name, prediction in zip(names, predictions):
                if prediction is not None:
                    self._adjust_step(name, steps, self._change_sigmas({one.id: prediction[one.id] - base[one.id]}))
            for name in failed_names:
                steps[name] *= SHORTER
            if not failed_names:
                break
            names = failed_names

    def _adjust_step(self, name, steps, size):
        """True if a step that moves `size` sigmas could be changed so that it moves AIM. Mutates `steps`."""
        factor = np.clip(AIM / max(size, 1e-3), 1e-3, 100.0)
        if factor * abs(steps[name]) > self.largest(name):
            return False
        steps[name] *= factor
        return True

    def _allows_both_signs(self, name):
        """True if steps to both sides are allowed."""
        return name not in self.of.candidates or not self.of.candidates[name].law.sign

    def largest(self, name):
        """How far a step may go: half the limit of a key, and no further than physics allows."""
        if name in self.of.candidates:
            c = self.of.candidates[name]
            section, _, field = c.key.partition(".")
            most = LARGEST_SCALES * c.law.scale
            if section == "effects":
                info = type(self.of.model.effects).model_fields[field]
                most = 0.5 * next(m.le for m in info.metadata if hasattr(m, "le"))
            return min(most, max(-c.law.low, c.law.high))
        n = self.of.nuisances[self.nuisances.index(name)]
        return 0.2 * max(abs(n.value), n.prior_sd)

    def _step_point(self, name, step):
        theta, effects = self.of.first.copy(), {}
        if name in self.of.candidates:
            effects[name] = step
        else:
            theta[self.nuisances.index(name)] += step
        return theta, effects

    def _changes(self, points, base):
        """Changes {group: values} from `base` to points, None where the averaged plant fails.

        The drive frequency is held, in two steps; what its change does is put back by `slope`.
        """
        hertz, changes = [dict.fromkeys(base, 0.0) for _ in points], [None] * len(points)
        only = [self.of.conditions[g] for g in base]
        todo = range(len(points))
        for _ in range(3):
            predictions = self._predict_points([points[i] for i in todo], only, [hertz[i] for i in todo])
            remaining_indices = []
            for i, prediction in zip(todo, predictions):
                if prediction is None:
                    changes[i] = None
                    continue
                feature_differences = {g: prediction[g] - base[g] for g in base}
                changes[i] = {g: v + self.slope[g] * hertz[i][g] for g, v in feature_differences.items()}
                more = {g: self.of.hertz(v, g) for g, v in feature_differences.items()}
                if max(map(abs, more.values())) > FREQUENCY_TOLERANCE_HZ:
                    hertz[i] = {g: hertz[i][g] + v for g, v in more.items()}
                    remaining_indices.append(i)
            todo = remaining_indices
        return changes

    def _predict_points(self, points, conditions, hertz=None):
        """Features {group: values} of points in the averaged plant, None where it fails; hertz: see `of.smooth`."""
        of, models = self.of, []
        hertz = hertz or [dict.fromkeys(of.conditions, 0.0)] * len(points)
        for theta, effects in points:
            try:
                point_model = of.model_at(theta, effects)
                models.append(point_model._replace(config=disable_retiming(point_model.config)))
            except PredictionFailed:
                models.append(None)
        run_requests = [
            (m, of.use_record_settle(c, effects), 0, h[c.id])
            for m, h, (_, effects) in zip(models, hertz, points)
            if m is not None
            for c in conditions
        ]
        run_features, out = iter(of.smooth(run_requests)), []
        for m in models:
            values = None if m is None else {c.id: next(run_features) for c in conditions}
            out.append(None if values is None or any(v is None for v in values.values()) else values)
        return out

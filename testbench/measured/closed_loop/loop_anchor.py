"""The linear model of a closed loop about an anchor that the exact engine has computed: runs, anchor, certificates.

    mu_k(theta, c) = A_k + T_k (theta - theta_a) + L_k (c - c_a)
    A    mean over draws of the exact engine (lanes: to the bit) at the anchor, less that of the averaged plant with the
         same noise where the model began, so that most of it cancels, plus the mean of the averaged plant's draws
         there, each from power-on. What is left is `prediction_noise`, in units of a repeat's variance
    T L  differences of the averaged plant with the same noise on both sides (loop_tangents.py)
    place    mean and noise of the slips are others a few mHz further on. So every run of a condition is held at the
             drive frequency that was recorded there, and what a point does to the frequency is added: 1 Hz per Hz

Source    docs/measured.md, docs/tracing.md
"""

import copy
import hashlib

import numpy as np
from scipy.optimize import lsq_linear

from testbench import config as configuration
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_runs, loop_symmetries
from testbench.measured.closed_loop.loop_noise import LATER, NOISE_DRAWS, jitter_hz
from testbench.measured.closed_loop.loop_runs import EXACT, FAST, Model, Run
from testbench.measured.residual.parameters import WALL
from testbench.tracing.problem.problem import PredictionFailed, Problem

MIN_OFFSET_HZ = 2e-3  # from the model's drive frequency to the recorded one: what is less is scatter of the power-ons
PREVIEW_DRAWS, DRAWS = 5, 8  # of the exact engine at an anchor: for a first look, and later
FIRST_DRAW = 10**12  # seeds that no recording has
SETTLED = 200.0  # sigmas of all features together: so little needs no other anchor


class Anchored(Problem, adds="anchor linear_change_certificate check describe_prior_overrun at draws unidentifiable"):
    """A problem that is linear about an anchor, which the exact engine has computed with some `draws`."""

    def anchor(self, theta, effects):
        """Put the linear model's anchor at a point; PredictionFailed, and nothing moved, where the engine fails."""
        raise NotImplementedError

    def linear_change_certificate(self, theta, effects):
        """Certificate at a point near the anchor: what the linear model changes from there, as if none of it were so.

        At the anchor the model is the exact engine; `check` runs that again.
        """
        raise NotImplementedError

    def check(self, theta, effects):
        """Certificate at a point: exact engine less the linear model that was fitted, as a pseudo-effect.

        Its own noise, known from the draws, is taken out: the fit knows of it as `prediction_noise`.
        """
        raise NotImplementedError

    def describe_prior_overrun(self, theta):
        """Nuisances of a fitted point outside their wide priors, where the model stays at the edge; "" if none."""
        return ""

    def unidentifiable(self, fit):
        """Lines on what no record shows of the nuisances, with what it shows instead."""
        return ()


MEMBERS = (
    "recorded model parameters progress bench kept candidates conditions per_hz slope place anchors tangent tangents "
    "first starts base whiten_fit_rows model_at shift_drive_mode describe_run smooth key exact_engine_features "
    "hertz linear size column axis settle pseudo single_condition_problem after timed use_record_settle"
)


class AnchoredLoop(Anchored, adds=MEMBERS):
    """Runs of a closed loop, and the linear model about its anchor, see the module. What it is of: `LoopProblem`."""

    def model_at(self, theta, effects):
        """`loop_runs.Model` of a point; PredictionFailed outside the limits of a key."""
        values_by_key = {p.key: p.value_from_theta(float(t)) for p, t in zip(self.parameters, theta)}
        laws = []
        for name, value in effects.items():
            c = self.candidates[name]
            if c.key:
                section, _, field = c.key.partition(".")
                values_by_key[c.key] = float(value) + (getattr(self.model.plant, field) if section == "plant" else 0.0)
            else:
                laws += c.law_texts(float(value))
        try:
            return Model(configuration.changed(self.model, values_by_key), tuple(laws))
        except ConfigError as problem:
            raise PredictionFailed(str(problem)) from None

    def _set_frequency_offsets(self):
        """Places of the conditions, from the last bins of the recorded frequency words."""
        one = self._draws(1)
        for g, repeat_features in self.recorded.values.items():
            if np.any(repeat_features):
                hz = self.hertz(repeat_features.mean(axis=0) - one[g][0], g) + jitter_hz(0)
                self.place[g] = hz if abs(hz) > MIN_OFFSET_HZ else 0.0

    def shift_drive_mode(self, model, hz):
        """A model whose drive mode is moved by some Hz, by a stiffness."""
        return Model(model.config, (*model.laws, f"force_x = {-self.per_hz * hz!r} x"))

    def _run(self, run_requests, kind, power_on=False, smooth=False, take=None):
        """Features, or what `take` makes of the rows, of (model, condition, draw, Hz above where the problem began).

        All are held at the place of their condition. They begin from a locked state of the model where the problem
        began, so that edges slip at the same instants in all of them, or from power-on.
        """
        runs = [self.describe_run(*one, power_on, smooth) for one in run_requests]
        try:
            return self.bench.run(runs, kind, self.progress, True, smooth, take)
        except ConfigError as problem:
            raise PredictionFailed(str(problem)) from None

    def describe_run(self, model, condition, draw, drive_shift_hz=0.0, power_on=False, smooth=False):
        """`Run` of a model under a condition with a draw's noise, jitter and phase, see `_run`."""
        number, condition_offset_hz, start = list(self.conditions).index(condition.id), self.place[condition.id], None
        if not power_on:
            start = loop_runs.model_key(self.shift_drive_mode(Model(self.model), condition_offset_hz))
        shifted = self.shift_drive_mode(model, condition_offset_hz - drive_shift_hz + jitter_hz(draw))
        return Run(shifted, condition, FIRST_DRAW + 10_000 * number + draw, start, int(LATER[draw]), smooth)

    def use_record_settle(self, condition, effects):
        """A condition as long after power-on as in the record, if one of the effects asks for that time."""
        time_laws = self.timed & {name for name, value in effects.items() if value}
        return condition._replace(settle_s=self.after.get(condition.id, condition.settle_s)) if time_laws else condition

    def smooth(self, run_requests, take=None):
        """`_run` of the averaged plant without rounded codes, from the lock of the model where the problem began.

        None for what leaves its range.
        """
        return self._run(run_requests, FAST, smooth=True, take=take)

    def single_condition_problem(self, condition, template_id):
        """This problem under one other condition alone, with noise and bins of a recorded one, for its tangents."""
        out, name = copy.copy(self), condition.id
        out.conditions, out.place, out.slope = {name: condition}, {name: 0.0}, {name: self.slope[template_id]}
        out._rows, out._count, out.starts = {name: self._rows[template_id]}, {name: self._count[template_id]}, ()
        return out

    def key(self, *more):
        text = repr((self.model.model_dump_json(), *more))
        return hashlib.sha256(text.encode()).hexdigest()

    def _draws(self, count, power_on=False):
        """{condition: (count, n)} of the averaged plant where the model began, jitter and all."""
        spec, model = (count, power_on), Model(self.model)
        keys = {c.id: self.key("draws", spec, c._replace(role=""), self.place[c.id]) for c in self.recorded.conditions}
        todo = [c for c in self.recorded.conditions if keys[c.id] not in self.kept.noise]
        feature_rows = self._run([(model, c, k, 0.0) for c in todo for k in range(count)], FAST, power_on)
        for i, c in enumerate(todo):
            self.kept.noise[keys[c.id]] = np.array(feature_rows[count * i : count * (i + 1)])
        return {name: self.kept.noise[key] for name, key in keys.items()}

    def exact_engine_features(self, theta, effects, role=None):
        """{condition: (features of the exact engine at a point, each draw less its twin in the averaged plant)}.

        Of the conditions with a role, or of all. The drive frequency is held, so that edges slip at the same instants
        and the noise cancels.
        """
        model = self.model_at(theta, effects)
        key_prefix = "exact", model.config.model_dump_json(), model.laws
        chosen = [self.use_record_settle(c, effects) for c in self.recorded.conditions if role in (None, c.role)]
        keys = {c.id: self.key(*key_prefix, c._replace(role=""), self.place[c.id]) for c in chosen}
        drive_shifts_hz = self._drive_frequency_shifts_hz(theta, effects)
        # the averaged plant with the same noise, where the model began
        twins = self._draws(max(self.draws, DRAWS))
        cached = {c.id: self.kept.exact.get(keys[c.id], np.zeros((0, len(self.slope[c.id])))) for c in chosen}
        todo = [(model, c, k, drive_shifts_hz[c.id]) for c in chosen for k in range(len(cached[c.id]), self.draws)]
        run_results = iter(self._run(todo, EXACT, take=loop_runs.with_densities))
        out = {}
        for c in chosen:
            more = []
            for k in range(len(cached[c.id]), self.draws):
                run_features, densities = next(run_results)
                more.append(run_features - twins[c.id][k])
                self.kept.densities.setdefault(keys[c.id], []).append(densities)
            rows = self.kept.exact[keys[c.id]] = (
                np.concatenate([cached[c.id], np.array(more)]) if more else cached[c.id]
            )
            rows, self._densities[c.id] = rows[: self.draws], self.kept.densities[keys[c.id]][: self.draws]
            v = rows.mean(axis=0) + self._middle[c.id] + self.slope[c.id] * (drive_shifts_hz[c.id] - self.place[c.id])
            out[c.id] = v, rows[:, : self._sizes[c.id]]
        return out

    def _drive_frequency_shifts_hz(self, theta, effects):
        """{condition: change of the drive frequency from where the model began}, by the linear model.

        That by an engine is no better: the frequency word of a dwell has slips of its own, some 1e-5 Hz.
        """
        if self.tangent is None:
            return {c.id: 0.0 for c in self.recorded.conditions}
        return {
            c.id: self.hertz(self._change(theta, effects, self.first, {}, c.id), c.id) for c in self.recorded.conditions
        }

    def hertz(self, change, group):
        """Change of the drive frequency in a change of features, by the last bin of the frequency word."""
        return float(change[(loop_runs.NAMES.index("f_word") + 1) * self._count[group] - 1])

    def anchor(self, theta, effects):
        theta = [p.clip_theta(float(t)) for p, t in zip(self.parameters, theta)]
        anchor_point = np.array(theta), {name: float(v) for name, v in effects.items() if v}
        exact, self.at = self.exact_engine_features(*anchor_point), anchor_point
        self.base, self._draw_rows = {g: v for g, (v, _) in exact.items()}, {g: rows for g, (_, rows) in exact.items()}
        noise = [self.whiten(self._rows[g], rows.T).var(axis=1, ddof=1).mean() for g, rows in self._draw_rows.items()]
        self.prediction_noise = float(np.mean(noise)) / self.draws + 1 / NOISE_DRAWS
        self.anchors += 1
        self.hashes["anchor"] = self.key(self.at[0].tolist(), sorted(self.at[1].items()), self.draws)

    def linear(self, theta, effects, group):
        """Features of a group at a point, fine ones behind the others."""
        return self.base[group] + self._change(theta, effects, *self.at, group)

    def _change(self, theta, effects, theta0, effects0, group):
        """Change of a group's features from one point to another."""
        out = self.tangent[group] @ (np.asarray(theta, float) - theta0)
        # in one order: sums in another differ by their rounding, which is no signature of a law
        for name in sorted({*effects, *effects0}):
            change = effects.get(name, 0.0) - effects0.get(name, 0.0)
            if change:
                out = out + self.column(name, self.conditions[group].role)[group] * change
        return out

    def size(self, change):
        """Sigmas of a change of all conditions."""
        return np.sqrt(sum(float(np.sum(self.whiten(self._rows[g], v) ** 2)) for g, v in change.items()))

    def column(self, name, role="fit"):
        """{condition of a role: change of the features per unit of a nuisance or law}."""
        return self.tangents.column(name, role)

    def axis(self, name):
        """Axis of a law, by its port."""
        return self.candidates[name].law.port[-1] if name in self.candidates else ""

    def whiten_fit_rows(self, condition_rows):
        """{condition: (n, ...)} of the fitted conditions as stacked rows of unit variance, repeats counted."""
        groups = [c.id for c in self.recorded.conditions if c.role == "fit"]
        return np.concatenate(
            [np.sqrt(len(self.recorded.values[g])) * self.whiten(self._rows[g], condition_rows[g]) for g in groups]
        )

    def settle(self):
        """Anchor where the nuisances alone fit the data best: far from it no linear model holds."""
        sd = np.array([n.prior_sd for n in self.nuisances])
        for _ in range(2):
            j = self.whiten_fit_rows(self.tangent) * sd
            r = self.whiten_fit_rows({g: v.mean(axis=0) - self.base[g] for g, v in self.recorded.values.items()})
            prior_offset_sd = (np.array([n.value for n in self.nuisances]) - self.at[0]) / sd
            # wide priors: no board is beyond WALL sds, whatever the tangents say
            walls = WALL if self.starts else np.inf
            bounds = np.minimum(prior_offset_sd - walls, -1e-9), np.maximum(prior_offset_sd + walls, 1e-9)
            a, b = np.concatenate([j, np.eye(len(sd))]), np.concatenate([r, prior_offset_sd])
            u = lsq_linear(a, b, bounds=bounds).x
            if np.linalg.norm(j @ u) < SETTLED:
                return
            self.anchor(self.at[0] + sd * u, {})

    def pseudo(self, change):
        """(laws, m) sigmas of the effects that m differences of features, {condition: (n, m)}, would be taken for."""
        sd = np.array([n.prior_sd for n in self.nuisances])
        j = self.whiten_fit_rows(self.tangent) * sd
        q, _ = np.linalg.qr(np.concatenate([j, np.eye(len(sd))]) / np.linalg.norm(j, axis=0))
        s = np.stack([self.whiten_fit_rows(self.column(law.name)) for law in self.laws], axis=1)
        s = np.concatenate([s, np.zeros((len(sd), s.shape[1]))])
        s -= q @ (q.T @ s)
        size = np.linalg.norm(s, axis=0)
        s = s[: -len(sd), size > 0] / size[size > 0]
        return s.T @ self.whiten_fit_rows(change)

    def unidentifiable(self, fit):
        keys, n = [p.key for p in self.parameters], len(self.parameters)
        values = [p.value_from_theta(t) for p, t in zip(self.parameters, fit.point.theta)]
        return (
            loop_symmetries.identifiability_lines(keys, values, fit.interval_covariance[:n, :n]) if self.starts else ()
        )

    def describe_prior_overrun(self, theta):
        keys = ", ".join(p.key for p, t in zip(self.parameters, theta) if p.clip_theta(t) != t)
        return (
            f"the linear fit of {keys} ends more than {WALL:g} prior standard deviations from the prior" if keys else ""
        )

    def linear_change_certificate(self, theta, effects):
        change = {
            c.id: self._change(theta, effects, *self.at, c.id) for c in self.recorded.conditions if c.role == "fit"
        }
        return {
            "engines": "exact engine (lanes) at the anchor; the change from there to the fitted model counts as error",
            "sigma": float(np.max(np.abs(self.pseudo({g: v[:, None] for g, v in change.items()})))),
            "anchors": self.anchors,
            "draws": self.draws,
        }

    def check(self, theta, effects):
        exact_by_condition, theta = self.exact_engine_features(theta, effects, "fit"), np.asarray(theta, float)
        off = {g: (v - self.linear(theta, effects, g))[: self._sizes[g]] for g, (v, _) in exact_by_condition.items()}
        scaled = np.concatenate([v / self._noise[g].sigma for g, v in off.items()])
        pseudo_effects = self.pseudo({g: v[:, None] for g, v in off.items()})[:, 0]
        each = self.pseudo({g: (rows - self._draw_rows[g]).T for g, (_, rows) in exact_by_condition.items()})
        noise_variance = each.var(axis=1, ddof=1) / self.draws
        return {
            "engines": "exact engine (lanes) compared with the fitted model, same noise",
            "sigma": float(np.sqrt(max(np.max(pseudo_effects**2 - noise_variance), 0.0))),
            "sigma_with_noise": float(np.max(np.abs(pseudo_effects))),
            "feature_rms_sigma": float(np.sqrt(np.mean(scaled**2))),
            "anchors": self.anchors,
            "draws": self.draws,
        }

"""Features of the averaged plant at any point of wide priors, near the recorded drive frequencies.

    u        coordinates of the parameters, prior mean 0 and sd 1 (residual/parameters.py)
    mean     of some draws of the averaged plant or the exact engine, each from power-on; every condition is moved to
             its recorded drive frequency by a stiffness, because slips of re-timed edges are others a few mHz away;
             the shift is taken out again
    columns  dy/du by steps with the same noise and even references; those of held keys follow from their partners, and
             weak directions are measured (closed_loop/loop_symmetries.py)
Source    docs/wide_priors.md
"""

import numpy as np
from scipy.linalg import block_diag

from testbench import config as configuration
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_runs
from testbench.measured.closed_loop.loop_difference_plant import disable_retiming
from testbench.measured.closed_loop.loop_noise import JITTER, JITTER_HZ, LATER, NOISE_DRAWS, estimate_noise, jitter_hz
from testbench.measured.closed_loop.loop_runs import FAST, NAMES, Model, Run
from testbench.measured.closed_loop.loop_symmetries import active_symmetries, correct_columns, weak

DRAWS, SPARE = 24, 10  # least power-ons for a covariance, deviations beyond its size
SEED = 2 * 10**12  # that no recording and no draw of the linear model has
AIM = 300.0  # sigmas by which a step moves all features
FIRST_STEP, STEPS = 1e-2, (1e-6, 0.1)  # in u
LOGARITHMIC = ("amplitude", "v_q2")  # go with factors of Q, force and coupling


class AveragedLoop:
    """The fitted conditions of a recording (`loop_problem.Measured`) beside the averaged plant of a configuration."""

    def __init__(self, measured, model, parameters, bench):
        self.model, self.parameters, self.bench = model, tuple(parameters), bench
        self.conditions = [c for c in measured.conditions if c.role == "fit"]
        sizes = [loop_runs.feature_count(c) for c in self.conditions]
        self.recorded = [measured.values[c.id][:, :n] for c, n in zip(self.conditions, sizes)]
        self.features = np.concatenate([rows.mean(axis=0) for rows in self.recorded])
        self.repeats = np.repeat([len(rows) for rows in self.recorded], sizes)
        self.observable = np.concatenate([np.repeat(NAMES, n // len(NAMES)) for n in sizes])
        self.condition = np.repeat(np.arange(len(sizes)), sizes)
        self._word = self.observable == "f_word"
        ends = [np.flatnonzero(self._word & (self.condition == k))[-1] for k in range(len(sizes))]
        self._ends = np.array(ends)
        self._keys = [p.key for p in self.parameters]
        self._unit = np.eye(len(self._keys))
        self._steps = np.full(len(self._keys), FIRST_STEP)

    def values(self, u):
        """{key: value} at coordinates."""
        return {p.key: p.value(float(x)) for p, x in zip(self.parameters, u)}

    def config(self, u):
        """Configuration at coordinates; ConfigError outside the limits of a key."""
        return configuration.changed(self.model, self.values(u))

    def _rows(self, runs, kind=FAST):
        """(points, features) of runs, condition after condition; None for a point where one leaves its range."""
        run_features, n = self.bench.run(runs, kind, lenient=kind == FAST), len(self.conditions)
        parts = [run_features[i : i + n] for i in range(0, len(run_features), n)]
        return [None if any(v is None for v in rows) else np.concatenate(rows) for rows in parts]

    def _draws(self, cfg, condition_shifts_hz, count, kind=FAST):
        per_hz = 8 * np.pi**2 * cfg.plant.mass_kg * cfg.plant.fx_hz

        def run(k, draw):
            hz = float(condition_shifts_hz[k] + jitter_hz(draw))
            shifted_model = Model(cfg, (f"force_x = {-per_hz * hz!r} x",))
            return Run(shifted_model, self.conditions[k], SEED + 10_000 * k + draw, None, int(LATER[draw]))

        rows = self._rows([run(k, d) for d in range(count) for k in range(len(self.conditions))], kind)
        if any(v is None for v in rows):
            raise ConfigError("wide priors: the averaged plant leaves its valid range")
        jitter = np.mean([jitter_hz(d) for d in range(count)])
        return np.array(rows) - self._word * (np.asarray(condition_shifts_hz)[self.condition] + jitter)

    def power_ons(self, cfg, count):
        """[(count, features) of each condition] of the averaged plant of a configuration."""
        rows = self._draws(cfg, np.zeros(len(self.conditions)), count)
        return [rows[:, self.condition == k] for k in range(len(self.conditions))]

    def mean(self, u, count, kind=FAST):
        """(mean, sd) of draws of an engine at a point; None without lock or out of limits."""
        try:
            cfg = self.config(u)
            one = self._draws(cfg, np.zeros(len(self.conditions)), 1)[0]
            rows = self._draws(cfg, (self.features - one)[self._ends], count, kind)
        except (ConfigError, ValueError):
            return None
        return rows.mean(axis=0), rows.std(axis=0, ddof=1)

    def residual(self, predicted):
        """Recorded less predicted features; of LOGARITHMIC ones (y > 0) by the logarithm, linear far away too."""
        ratio = self.features / np.where(predicted == 0, np.inf, predicted)
        logarithmic = np.isin(self.observable, LOGARITHMIC) & (ratio > 0)
        return np.where(logarithmic, predicted * np.log(np.where(logarithmic, ratio, 1.0)), self.features - predicted)

    def sigma(self, sd):
        """Deviation of the recorded means by few draws: a single one is at least the median of its kind.

        At the end of a range nothing scatters: there it is that of the other conditions. ConfigError if there are none.
        """
        out = sd.copy()
        for name in NAMES:
            moving = sd[(self.observable == name) & (sd > 0)]
            if not moving.size:
                raise ConfigError(f"wide priors: {name} of the configured board is at its limit under all conditions")
            for k in range(len(self.conditions)):
                rows = (self.observable == name) & (self.condition == k)
                out[rows] = np.maximum(out[rows], np.median(out[rows]) or np.median(moving))
        out = np.where(self._word, np.hypot(out, JITTER_HZ), out)
        return out / np.sqrt(self.repeats)

    def whitening_matrix(self, u):
        """(sigma, matrix (n, n) that whitens the features) of the recorded means, by the covariance of power-ons.

        As many as the covariance needs. ConfigError where the board does not lock.
        """
        sizes = np.bincount(self.condition)
        shared = min(np.sum(sizes == n) for n in sizes)
        count = int(np.clip(np.ceil((sizes.max() + SPARE) / shared) + 1, DRAWS, NOISE_DRAWS))
        rows = dict(enumerate(self.power_ons(self.config(u), count)))
        sd = np.concatenate([of.std(axis=0, ddof=1) for of in rows.values()])
        sigma = self.sigma(sd)
        # at the end of a range nothing scatters
        if not np.all(sd):
            return sigma, np.diag(1 / sigma)
        slopes = {k: self._word[self.condition == k].astype(float) for k in rows}
        noise = estimate_noise({k: (rows[k], slopes[k]) for k in rows}, JITTER[:count])
        mean_sigma = np.concatenate([noise[k].sigma for k in rows]) / np.sqrt(self.repeats)
        return sigma, block_diag(*(np.linalg.inv(noise[k].chol) for k in rows)) / mean_sigma

    def slip_free_features(self, u):
        """Features with one noise, without slips of edges; None where the board does not lock."""
        point_features = self._predict_slip_free(u, [u])
        return point_features and point_features[0]

    def columns(self, u, which, sigma, measured=False):
        """(features, columns dy/du of the indices `which`, 0 elsewhere) with one noise, without slips of edges.

        measured  the weak directions by steps of their own.  None where the board does not lock
        """
        symmetry_by_key = active_symmetries([self._keys[k] for k in which])
        stepped_indices = [k for k in which if self._keys[k] not in symmetry_by_key]
        point_features = self._predict_slip_free(u, [u, *(u + self._steps[k] * self._unit[k] for k in stepped_indices)])
        if point_features is None:
            return None
        base, *stepped_features = point_features
        out = np.zeros((len(base), len(u)))
        for k, row in zip(stepped_indices, stepped_features):
            out[:, k] = (row - base) / self._steps[k]
            self._steps[k] = np.clip(AIM / max(np.linalg.norm(out[:, k] / sigma), 1e-9), *STEPS)
        out = self._tie(out, u, symmetry_by_key)
        return base, self._measure_weak_directions(u, out, sigma) if measured else out

    def _predict_slip_free(self, start, points):
        """Features of points with even references and one noise, from the lock of `start`; None if one fails."""
        try:
            first = self.config(start)
            models = [Model(disable_retiming(self.config(point))) for point in points]
            rows = self._rows(
                [Run(m, c, SEED + 10_000 * i, first, 0, True) for m in models for i, c in enumerate(self.conditions)]
            )
        except (ConfigError, ValueError):
            return None
        return None if any(row is None for row in rows) else rows

    def _measure_weak_directions(self, u, columns, sigma):
        """Columns with their weak directions measured; those whose steps fail stay as they are."""
        directions, changes = [], []
        for d, step in weak(columns / sigma[:, None]):
            side_features = self._predict_slip_free(u, [u + step * d, u - step * d])
            if side_features is not None:
                directions.append(d)
                changes.append((side_features[0] - side_features[1]) / (2 * step))
        return correct_columns(columns, directions, changes)

    def _tie(self, columns, u, symmetry_by_key):
        """Columns whose held ones follow from their partners. Mutates `columns`."""
        values = self.values(u)
        per_u = {p.key: p.sd(x, 1.0) for p, x in zip(self.parameters, u)}
        per_unit = {key: columns[:, k] / per_u[key] for k, key in enumerate(self._keys)}
        for key, symmetry in symmetry_by_key.items():
            columns[:, self._keys.index(key)] = symmetry.column(values, per_unit) * per_u[key]
        return columns

"""A model is a problem with some of its laws: residual and Jacobian at a point, and their projection.

    x = (theta, c)       cost(x) = |z(x)|^2 + sum_j ((theta_j - value_j) / prior_sd_j)^2
The coefficients of laws carry no prior here; evidence adds it afterwards, exactly.
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.problem.predictor import Failed
from testbench.tracing.problem.problem import all_laws

SMALL, LARGE, AIM = 1e-4, 10.0, 0.03  # sigmas by which a step may move the residual
DEFAULT_STEP = 1e-3  # of the prior sd or of a law's scale


class Point(NamedTuple):
    """Values of nuisances and of the coefficients of the model's laws."""

    theta: np.ndarray
    c: np.ndarray


class Model:
    """Laws that are switched on. Columns of Jacobians: nuisances, then laws."""

    def __init__(self, space, predictor, laws=()):
        self.space, self.predictor, self.problem = space, predictor, space.problem
        self.names, laws_by_name = tuple(laws), all_laws(space.problem)
        self.laws = tuple(laws_by_name[name] for name in self.names)
        self.value = np.array([n.value for n in self.problem.nuisances])
        self.sd = np.array([n.prior_sd for n in self.problem.nuisances])
        self.priors = np.flatnonzero(np.isfinite(self.sd))

    @property
    def columns(self):
        return [n.name for n in self.problem.nuisances] + list(self.names)

    def start(self):
        return Point(self.value.copy(), np.zeros(len(self.names)))

    def effects(self, point):
        return dict(zip(self.names, point.c.tolist()))

    def ask(self, points):
        """Predictions of the groups of this space at `Point`s."""
        return self.predictor([(p.theta, self.effects(p)) for p in points], self.space.which)

    def prior_rows(self, point):
        """What the priors say, as residuals of unit variance."""
        return (self.value - point.theta)[self.priors] / self.sd[self.priors]

    def prior_columns(self):
        """d(-prior_rows)/dx, (priors, parameters)."""
        out = np.zeros((len(self.priors), len(self.columns)))
        out[range(len(self.priors)), self.priors] = 1.0 / self.sd[self.priors]
        return out

    def steps(self, point):
        """First finite-difference steps of all columns, and whether they may be changed."""
        out, fixed = [], []
        for n, t in zip(self.problem.nuisances, point.theta):
            natural = n.prior_sd if np.isfinite(n.prior_sd) else max(abs(t), abs(n.value), 1e-6) * DEFAULT_STEP
            linear = n.name in self.problem.linear_in
            out.append(n.step or natural * (1.0 if linear else DEFAULT_STEP))
            fixed.append(bool(n.step) or linear)
        for law in self.laws:
            step, is_prescribed = law_step(law, self.problem)
            out.append(step)
            fixed.append(is_prescribed)
        return np.array(out), np.array(fixed, bool)

    def shift_point(self, point, column, step):
        theta, c = point.theta.copy(), point.c.copy()
        if column < len(theta):
            theta[column] += step
        else:
            c[column - len(theta)] += step
        return Point(theta, c)

    def jacobian(self, point, prediction):
        """Whitened d(prediction)/dx, (rows, columns), by steps that move the residual measurably but little."""
        steps, fixed = self.steps(point)
        return tangents(
            self.space,
            self.predictor,
            prediction,
            lambda j, step: ((s := self.shift_point(point, j, step)).theta, self.effects(s)),
            steps,
            fixed,
        )


def law_step(law, problem):
    """Step of a law's coefficient, on its allowed side, and whether it is prescribed."""
    side = -1.0 if law.sign < 0 else 1.0
    linear = law.name in problem.linear_in
    return side * (law.step or law.scale * (1.0 if linear else DEFAULT_STEP)), bool(law.step) or linear


def tangents(space, predictor, prediction, point_at, steps, fixed):
    """Columns (p(x + step) - p(x)) / step; nan where no step of either side could be predicted.

    A free step is taken again, up to three times, until it moves the residual by SMALL to LARGE sigmas: smaller is
    rounding, larger is curvature.
    """
    steps, out = np.array(steps, float), np.full((space.size, len(steps)), np.nan)
    todo = list(range(len(steps)))
    for attempt in range(4):
        if not todo:
            break
        shifted_predictions = predictor([point_at(j, steps[j]) for j in todo], space.which)
        again = []
        for j, other in zip(todo, shifted_predictions):
            if isinstance(other, Failed):
                if attempt < 3:
                    steps[j] *= -0.1 if not fixed[j] else 0.1
                    again.append(j)
                continue
            change = space.whitened_change(other, prediction)
            size = np.linalg.norm(change)
            out[:, j] = change / steps[j]
            if not fixed[j] and attempt < 3 and not SMALL <= size <= LARGE:
                steps[j] *= float(np.clip(AIM / max(size, 1e-300), 1e-6, 1e6))
                again.append(j)
        todo = again
    return out

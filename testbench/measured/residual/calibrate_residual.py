"""Calibration of declared nuisances: the model that is compared must first be the best of its kind, and say so.

    cost(u) = |whitened mean residual of R1, segments with the role fit|^2 + |u|^2      (maximum a posteriori)
    start     f_x from the recorded frequency word, everything else from its prior; further starts beside it
    steps     damped Gauss-Newton; sensitivities by finite steps that move the residual by about STEP_SIGMA
    floor     from the repeats, estimated again at the first solution

An engine with a converter's steps is not smooth: far smaller steps would measure its quantisation.
Source    docs/measured.md
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from testbench.config import changed
from testbench.errors import ConfigError
from testbench.measured.record import check_tables
from testbench.measured.record.sessions import segments
from testbench.measured.residual import parameters, residuals, simulator
from testbench.measured.residual.features import HZ, OBSERVABLES
from testbench.measured.residual.noise_floor import estimate_noise_floor

DRIVEN = [name for name, o in OBSERVABLES.items() if o.driven]
STEP_SIGMA, STEP_SPAN = 300.0, 4.0
LARGEST_STEP = 1.0  # in u
MOST_ITERATIONS, MOST_DAMPING = 10, 1e2
CONVERGED = 0.01  # decrease of the cost that a further step promises
AGREED = 0.1  # of the cost, between starts
UNSEEN = 1.0  # eigenvalue of the data's Fisher matrix, in units of the priors
START_SPREAD = 0.3  # of the further starts, in u


class Fit(NamedTuple):
    """Where a start has led."""

    u: np.ndarray
    cost: float
    decrement: float
    jacobian: np.ndarray
    evaluations: int


class Direction(NamedTuple):
    """An eigenvector of what the data alone can tell."""

    eigenvalue: float  # in units of the priors: below 1 the prior says more
    words: str


@dataclass
class Calibration:
    """The result, with its certificate."""

    parameters: tuple
    values: dict
    sd: dict
    config: object
    decrement: float
    costs: tuple
    at_bound: tuple
    directions: tuple
    evaluations: int
    before: residuals.Study
    after: residuals.Study

    @property
    def is_converged(self):
        spread = max(self.costs) - min(self.costs)
        return self.decrement < CONVERGED and spread < AGREED and not self.at_bound


class Problem:
    """The cost of a record as a function of u."""

    def __init__(self, record, config, fitted, engine, progress=None):
        self.record, self.config, self.fitted, self.engine = record, config, fitted, engine
        self.progress, self.evaluations, self.noise = progress, 0, None
        self.exact = residuals.sound(record)

    def model(self, u):
        """Configuration at u; None outside the limits of a parameter."""
        values = {p.key: p.value(x) for p, x in zip(self.fitted, u)}
        if any(not p.lo <= values[p.key] <= p.hi for p in self.fitted):
            return None
        return changed(self.config, values)

    def residual(self, u):
        """Whitened mean residuals of the fitted segments, or None outside the limits."""
        model = self.model(u)
        if model is None:
            return None
        self.evaluations += 1
        if self.progress:
            self.progress("calibration", self.evaluations, 0)
        predicted, _ = residuals.predict_sessions(self.record, model, "R1", self.engine, 0, exact=self.exact)
        groups, roles = residuals.differences(self.record, predicted, DRIVEN)
        groups = [g for g in groups if roles[g.name] == "fit"]
        if self.noise is None:
            self.noise = estimate_noise_floor(groups)
        white = [self.noise.whiten_group(g.name, g.values.mean(axis=0)) * np.sqrt(len(g.values)) for g in groups]
        return np.concatenate([w.ravel() for w in white])

    def jacobian(self, u, r):
        """Columns of d residual / d u; the steps are those that the residual shows clearly."""
        out = np.empty((len(r), len(u)))
        for k in range(len(u)):
            step = self.steps[k]
            for _ in range(4):
                shifted_u = u.copy()
                shifted_u[k] += step
                other = self.residual(shifted_u)
                if other is None:
                    step = -step
                    continue
                size = np.linalg.norm(other - r)
                enough = size > STEP_SIGMA / STEP_SPAN or abs(step) >= LARGEST_STEP
                if enough and size < STEP_SIGMA * STEP_SPAN:
                    break
                step = np.copysign(min(abs(step) * STEP_SIGMA / max(size, 1e-9), LARGEST_STEP), step)
            out[:, k] = (other - r) / step
            self.steps[k] = step
        return out

    def solve(self, u):
        """`Fit` from a start."""
        first, damping = self.evaluations, 1e-6
        self.steps = np.full(len(u), 1e-3)
        r = self.residual(u)
        if r is None:
            raise ConfigError("calibration: the starting point is outside the limits of a parameter")
        cost = r @ r + u @ u
        for _ in range(MOST_ITERATIONS):
            j = self.jacobian(u, r)
            hessian, gradient = j.T @ j + np.eye(len(u)), j.T @ r + u
            decrement = float(gradient @ np.linalg.solve(hessian, gradient))
            if decrement < CONVERGED:
                break
            accepted = False
            while not accepted and damping < MOST_DAMPING:
                delta = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), -gradient)
                other = self.residual(u + delta)
                if other is not None and other @ other + (u + delta) @ (u + delta) < cost:
                    u, r, accepted = u + delta, other, True
                    cost, damping = r @ r + u @ u, max(damping / 10, 1e-9)
                else:
                    damping *= 10
            if not accepted:
                break
        return Fit(u, float(cost), decrement, j, self.evaluations - first)


def start(record, fit_parameters):
    """Coordinates to begin with: f_x where the loop has locked, everything else in the middle of its prior."""
    u = np.zeros(len(fit_parameters))
    words = [
        record.streams["nco_fword"].data[s.first : s.first + s.frames].mean()
        for s in segments(record)
        if s.role == "fit"
    ]
    for k, p in enumerate(fit_parameters):
        if p.key == "plant.fx_hz" and words:
            u[k] = p.coordinate(float(np.mean(words)) * HZ * (1 + 1e-6 * record.clock_ppm))
    return u


def _combination_text(vector, fit_parameters):
    """A direction in words: the parameters that make it up."""
    order = np.argsort(-np.abs(vector))
    parts = [f"{vector[k]:+.2f} {fit_parameters[k].key}" for k in order if abs(vector[k]) > 0.2]
    return " ".join(parts)


def directions(jacobian, fit_parameters):
    """`Direction`s, the least seen first."""
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    return tuple(Direction(float(v), _combination_text(vectors[:, k], fit_parameters)) for k, v in enumerate(values))


def calibrate(record, starts=2, engine=None, progress=None, seed=0):
    """`Calibration` of a checked record.

    starts  how many; the further ones begin START_SPREAD priors beside the first
    """
    config = check_tables.stated_config(record)
    engine = engine or simulator.FrameSimulator()
    fit_parameters = parameters.read_parameters(record)
    problem = Problem(record, config, fit_parameters, engine, progress)
    begin, rng = start(record, fit_parameters), np.random.default_rng(seed)
    loose = problem.solve(begin)
    problem.noise = None  # of the repeats about the first solution
    fits = [problem.solve(loose.u)]
    locked = [p.key == "plant.fx_hz" for p in fit_parameters]
    for _ in range(starts - 1):
        fits.append(problem.solve(begin + np.where(locked, 0.0, START_SPREAD * rng.normal(size=len(fit_parameters)))))
    best = min(fits, key=lambda fit: fit.cost)
    model = problem.model(best.u)
    sd_u = np.sqrt(np.diag(np.linalg.inv(best.jacobian.T @ best.jacobian + np.eye(len(fit_parameters)))))
    values = {p.key: p.value(x) for p, x in zip(fit_parameters, best.u)}
    return Calibration(
        parameters=fit_parameters,
        values=values,
        sd={p.key: p.sd(x, s) for p, x, s in zip(fit_parameters, best.u, sd_u)},
        config=model,
        decrement=best.decrement,
        costs=tuple(fit.cost for fit in fits),
        at_bound=tuple(
            p.key for p in fit_parameters if min(values[p.key] - p.lo, p.hi - values[p.key]) < 1e-6 * (p.hi - p.lo)
        ),
        directions=directions(best.jacobian, fit_parameters),
        evaluations=problem.evaluations,
        before=residuals.study_residuals(record, "R1", config, engine),
        after=residuals.study_residuals(record, "R1", model, engine),
    )

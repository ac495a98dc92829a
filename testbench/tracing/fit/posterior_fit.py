"""Maximum a posteriori fit by Levenberg-Marquardt, with its certificate; "before" always means such a fit.

    minimise  cost(x)  (model.py)           certificate: promised decrease g' H^-1 g < 0.01, gradient, step, two starts
Thresholds are in units of cost / rows where that is above 1.
Steps come from a QR of the whitened Jacobian with scaled columns, the priors as rows: a gauge direction that only
its prior holds is no obstacle, one that nothing holds is left where it is.
Source    Nocedal & Wright, Numerical Optimization (2006), 10.3; docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.problem.model import Point
from testbench.tracing.problem.predictor import Failed
from testbench.tracing.problem.result import plain_value

ENOUGH, CONVERGED, AGREED = 1e-4, 0.01, 0.1  # of the cost
MOST_ITERATIONS = 40
DAMPINGS = (0.0, 1e-2, 1.0, 1e2, 1e4)
CHORD = 0.1  # share by which a step may miss what its Jacobian promised
SPREAD = 0.3  # of further starts, in prior sd
REACH = 30.0  # of further starts, in posterior sd: beyond, a start tests another question
BROKEN = 1e-10  # relative singular value below which nothing holds a direction


class Fit(NamedTuple):
    """Where a model has settled; `failed` says why it has not, and there is nothing but model and point then."""

    model: object
    point: Point
    prediction: list = ()
    z: np.ndarray = np.zeros(0)  # whitened residual (rows,)
    jacobian: np.ndarray = None  # (rows, columns)
    cost: float = np.inf
    decrement: float = np.inf
    gradient: float = np.inf  # largest component, of the scaled problem
    step: float = np.inf  # largest part of the promised step, in posterior sd
    iterations: int = 0
    covariance: np.ndarray = None  # (columns, columns); inf on the diagonal of what nothing holds
    bend: float = 0.0  # sigmas by which the prediction departs from the linear one of the fit it began at
    failed: str = ""

    @property
    def sd(self):
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval_covariance(self):
        """Covariance for intervals: that of the fit, if along what is fitted the rows have a variance s^2.

            s^2 = a max(1, z' z / (rows - tr(C J' J)))      C + (s^2 - 1) C J' J C
        Repeats may share what the model does not have, then their mean is not as good as their scatter says.
        a  `noise_along` of the problem: weights by an estimated covariance favour directions where it is too small
        """
        if not np.all(np.isfinite(self.covariance)):
            return self.covariance
        share = self.covariance @ (self.jacobian.T @ self.jacobian)
        scatter = self.z @ self.z / max(len(self.z) - np.trace(share), 1.0)
        return self.covariance + (self.model.problem.noise_along * max(scatter, 1.0) - 1.0) * share @ self.covariance


class Solver(NamedTuple):
    """The linear problem at a point, reduced by QR: columns scaled to unit length."""

    r: np.ndarray
    q_rhs: np.ndarray
    scale: np.ndarray

    @classmethod
    def from_jacobian(cls, model, point, z, jacobian):
        a = np.concatenate([jacobian, model.prior_columns()])
        b = np.concatenate([z, model.prior_rows(point)])
        scale = np.linalg.norm(a, axis=0)
        scale[scale == 0] = 1.0
        q, r = np.linalg.qr(a / scale)
        return cls(r, q.T @ b, scale)

    def svd(self):
        u, s, vt = np.linalg.svd(self.r)
        return u, s, vt, s > BROKEN * max(s.max(initial=0.0), 1e-300)

    def step(self, damping=0.0):
        u, s, vt, is_retained = self.svd()
        gain = np.where(is_retained, s / np.where(is_retained, s * s + damping, 1.0), 0.0)
        return (vt.T @ (gain * (u.T @ self.q_rhs))) / self.scale

    def decrement(self):
        u, _, _, is_retained = self.svd()
        return float(np.sum((u.T @ self.q_rhs)[is_retained] ** 2))

    def covariance(self):
        _, s, vt, is_retained = self.svd()
        v = vt.T / self.scale[:, None]
        out = (v[:, is_retained] / s[is_retained] ** 2) @ v[:, is_retained].T
        loose = np.abs(vt[~is_retained]).max(axis=0, initial=0.0) > 1e-3
        out[loose, loose] = np.inf
        return out


def residual_and_cost(model, point, prediction):
    z = model.space.residual(prediction)
    prior = model.prior_rows(point)
    return z, float(z @ z + prior @ prior)


def _add_step(model, point, step):
    """Point + step, coefficients kept on their allowed side."""
    m = len(point.theta)
    c = point.c + step[m:]
    for i, law in enumerate(model.laws):
        c[i] = max(c[i], 0.0) if law.sign > 0 else min(c[i], 0.0) if law.sign < 0 else c[i]
    return Point(point.theta + step[:m], c)


def _fresh(model, point, prediction):
    """(Jacobian, "") at a point, or (None, which columns cannot be had)."""
    jacobian = model.jacobian(point, prediction)
    if np.all(np.isfinite(jacobian)):
        return jacobian, ""
    lost = [name for name, bad in zip(model.columns, ~np.isfinite(jacobian).all(axis=0)) if bad]
    return None, f"no prediction for a small change of {', '.join(lost)}"


def _better(model, point, solver, cost, first):
    """Best of some damped steps, the undamped alone first: (point, prediction, z, cost, index of damping), or None."""
    for dampings in [DAMPINGS[:1], DAMPINGS[1:]] if first == 0 else [DAMPINGS[first - 1 :]]:
        points, better = [_add_step(model, point, solver.step(damping)) for damping in dampings], None
        for damping, other, prediction in zip(dampings, points, model.ask(points)):
            if not isinstance(prediction, Failed):
                z, lower = residual_and_cost(model, other, prediction)
                if lower < cost and (better is None or lower < better[3]):
                    better = (other, prediction, z, lower, DAMPINGS.index(damping))
        if better is not None:
            return better
    return None


def fit(model, start, jacobian=None):
    """`Fit` from a `Point`. A start that cannot be predicted is a fit that failed.

    jacobian  one from nearby: it is kept as long as steps gain what it promises (chord steps), which saves most
              predictions; the certificate is then its own. None: fresh ones, and a fresh one at the end
    """
    exact, fresh = jacobian is None, jacobian is None
    point, (prediction,) = start, model.ask([start])
    if isinstance(prediction, Failed):
        return Fit(model, start, failed=prediction.reason)
    z, cost = residual_and_cost(model, point, prediction)
    if fresh:
        jacobian, lost = _fresh(model, point, prediction)
        if lost:
            return Fit(model, point, failed=lost)
    first = 0  # index of the damping that worked last
    for iteration in range(MOST_ITERATIONS + 1):
        solver = Solver.from_jacobian(model, point, z, _free(model, point, z, jacobian))
        decrement = solver.decrement()
        if decrement < ENOUGH and exact and not fresh:
            keep, better = False, None
        elif decrement < ENOUGH or iteration == MOST_ITERATIONS:
            break
        else:
            better = _better(model, point, solver, cost, first)
            if better is None and fresh:
                break
            keep = better is not None and better[4] == 0 and abs(cost - better[3] - decrement) < CHORD * decrement
        gained = 0.0
        if better is not None:
            gained = cost - better[3]
            point, prediction, z, cost, first = better
        is_stalled = better is not None and fresh and gained < min(1e-9 * max(cost, 1.0), ENOUGH)
        fresh = fresh and better is None
        if not keep and not fresh:
            jacobian, lost = _fresh(model, point, prediction)
            if lost:
                return Fit(model, point, failed=lost)
            fresh = True
        if is_stalled:
            solver = Solver.from_jacobian(model, point, z, _free(model, point, z, jacobian))
            decrement = solver.decrement()
            break
    covariance = Solver.from_jacobian(model, point, z, jacobian).covariance()
    sd = np.sqrt(np.diag(covariance))
    step = np.abs(solver.step()) / np.where(sd > 0, sd, 1.0)
    gradient = float(np.max(np.abs(solver.r.T @ solver.q_rhs), initial=0.0))
    largest_step = float(step.max(initial=0.0))
    return Fit(model, point, prediction, z, jacobian, cost, decrement, gradient, largest_step, iteration, covariance)


def _free(model, point, z, jacobian):
    """Jacobian without the columns of coefficients that sit at 0 and would leave their allowed side."""
    out, m = jacobian.copy(), len(point.theta)
    for i, law in enumerate(model.laws):
        if law.sign and point.c[i] == 0.0 and law.sign * (jacobian[:, m + i] @ z) <= 0:
            out[:, m + i] = 0.0
    return out


class Calibration(NamedTuple):
    """The best fit of several starts."""

    fit: Fit
    costs: tuple  # of all starts, inf: failed
    converged: bool
    certificate: dict


def calibrate(model, starts=2, seed=0, begin=None, progress=None):
    """`Calibration`: first from `begin` (or the priors' middles), then from points displaced at random."""
    if progress:
        progress("calibrating", 0, starts)
    best = fit(model, begin or model.start())
    costs, rng = [best.cost], np.random.default_rng([seed, 1])
    spread = []
    while len(costs) < starts or (1 < starts <= len(costs) < starts + 3 and _count_agreeing_starts(costs, model) < 2):
        wide = np.where(np.isfinite(model.sd), SPREAD * model.sd, np.inf)
        reach = REACH * best.sd[: len(model.sd)] if not best.failed else wide
        width = np.minimum(wide, reach)
        width = np.where(np.isfinite(width), width, 0.0)
        origin = best.point if not best.failed else model.start()
        displaced = Point(origin.theta + width * rng.normal(size=len(width)), origin.c.copy())
        other = fit(model, displaced, None if best.failed else best.jacobian)
        if other.cost < best.cost - 1e-6:
            other = fit(model, other.point)
        spread.append(width)
        costs.append(other.cost)
        if other.cost < best.cost - 1e-6 or (best.failed and not other.failed):
            best = other
        if progress:
            progress("calibrating", min(len(costs), starts), starts)
    agreeing, unit = _count_agreeing_starts(costs, model), misfit_unit(best)
    converged = not best.failed and best.decrement < CONVERGED * unit and (agreeing >= 2 or starts == 1)
    certificate = {
        "converged": bool(converged),
        "decrement": best.decrement,
        "gradient": best.gradient,
        "step_sd": best.step,
        "cost": best.cost,
        "costs_of_starts": costs,
        "starts_agreeing": int(agreeing),
        "unit_of_cost": float(unit),
        "start_spread": [float(w) for w in spread[0]] if spread else [],
        "iterations": int(best.iterations),
        "failed": best.failed,
    }
    return Calibration(best, tuple(costs), bool(converged), plain_value(certificate))


def misfit_unit(best_fit):
    """Cost per row, at least 1: what a cost difference of 1 sigma^2 is where the model is wrong by many sigmas."""
    return max(1.0, best_fit.cost / max(best_fit.model.space.size, 1)) if np.isfinite(best_fit.cost) else 1.0


def _count_agreeing_starts(costs, model):
    width = AGREED * max(1.0, min(costs) / max(model.space.size, 1))
    return sum(cost <= min(costs) + width for cost in costs if np.isfinite(cost))

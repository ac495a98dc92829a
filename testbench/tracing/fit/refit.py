"""Full refits of a few sets of laws: nuisances and coefficients together, begun at the linear solution.

Along the line to the linear solution several points are tried, as it may lie where the model diverges. What diverges,
ends on the forbidden side, or does not come from nothing (a jump at coefficient 0+) is a fit that failed: never ranked.
"""

import numpy as np

from testbench.tracing.fit.posterior_fit import Solver, fit, residual_and_cost
from testbench.tracing.problem.model import Model, Point, law_step
from testbench.tracing.problem.predictor import Failed

SHARES = (1.0, 0.5, 0.2, 0.05)
JUMP, JUMP_SHARE = 0.5, 0.3  # sigmas and share of the change at the step of a tangent


def discontinuous(base, law):
    """True if the prediction jumps between coefficient 0 and a tiny one: 2 p(h) - p(2h) must come back to p(0)."""
    step, _ = law_step(law, base.model.problem)
    effects = base.model.effects(base.point)
    points = [(base.point.theta, effects | {law.name: k * step}) for k in (1.0, 2.0)]
    one_step_prediction, two_step_prediction = base.model.predictor(points, base.model.space.which)
    if isinstance(one_step_prediction, Failed) or isinstance(two_step_prediction, Failed):
        return False
    space = base.model.space
    small = space.whitened_change(one_step_prediction, base.prediction)
    jump = np.linalg.norm(2 * small - space.whitened_change(two_step_prediction, base.prediction))
    return bool(jump > JUMP and jump > JUMP_SHARE * np.linalg.norm(small))


def linear_start(base, model, columns):
    """(best of some points between the base fit and the linear solution, origin, linear Jacobian) of a bigger model."""
    added = [name for name in model.names if name not in base.model.names]
    old = base.model.effects(base.point)
    c = np.array([old.get(name, 0.0) for name in model.names])
    origin = Point(base.point.theta.copy(), c)
    n, jacobian = len(origin.theta), np.zeros((model.space.size, len(model.columns)))
    jacobian[:, :n] = base.jacobian[:, :n]
    for i, name in enumerate(model.names):
        at = base.model.names.index(name) if name in base.model.names else None
        jacobian[:, n + i] = columns[:, added.index(name)] if at is None else base.jacobian[:, n + at]
    step = Solver.from_jacobian(model, origin, base.z, jacobian).step()
    for i, law in enumerate(model.laws):
        c0 = origin.c[i]
        if law.sign and law.sign * (c0 + step[n + i]) < 0:
            step[n + i] = -c0
    best, lowest = origin, base.cost
    for shares in (SHARES[:1], SHARES[1:]):
        tried = [Point(origin.theta + share * step[:n], origin.c + share * step[n:]) for share in shares]
        for point, prediction in zip(tried, model.ask(tried)):
            if not isinstance(prediction, Failed):
                _, cost = residual_and_cost(model, point, prediction)
                if cost < lowest:
                    best, lowest = point, cost
        if best is not origin:
            break
    return best, origin, jacobian


def refit(base, names, table):
    """`Fit` of the model with the laws `names`, begun at `base` (a fit of fewer laws); table: `rank.Signatures`."""
    model = Model(base.model.space, base.model.predictor, names)
    added = [law for law in model.laws if law.name not in base.model.names]
    for law in added:
        if discontinuous(base, law):
            return _failed_fit(base, model, f"the prediction jumps where the coefficient of {law.name} is 0")
    columns = table.signature_columns(base, [law.name for law in added])
    if not np.all(np.isfinite(columns)):
        return _failed_fit(base, model, "the model gives no prediction")
    start, origin, jacobian = linear_start(base, model, columns)
    new_fit = fit(model, start, jacobian)
    if new_fit.failed:
        return new_fit
    stuck = [law.name for law, c in zip(model.laws, new_fit.point.c) if law.sign and c == 0.0]
    if stuck:
        return new_fit._replace(failed=f"the best coefficient of {', '.join(stuck)} has the forbidden sign")
    if new_fit.cost > base.cost + 0.1:
        return new_fit._replace(failed="diverged: the fit is worse than without the law")
    if not np.all(np.isfinite(new_fit.covariance)):
        return new_fit._replace(failed="the data do not determine the coefficient")
    point_change = np.concatenate([new_fit.point.theta - origin.theta, new_fit.point.c - origin.c])
    bend = float(np.linalg.norm(new_fit.z - base.z + jacobian @ point_change))
    return new_fit._replace(bend=base.bend + bend)


def _failed_fit(base, model, reason):
    return base._replace(model=model, failed=reason)

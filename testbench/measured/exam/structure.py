"""Laws of many coefficients (`part_problem.Family`): how well one explains what a fit leaves, all of it paid for.

    B      whitened columns of the members, nuisances projected out;   z likewise;   T: scale of the law, prior of each
    gain   ln of the evidence over that of none: -ln|1 + T^2 B'B| / 2 + b'(B'B + 1/T^2)^-1 b / 2,   b = B'z
    d      square root of the fall of chi2 beyond one for each member
Source    MacKay, Information Theory (2003), ch. 28
"""

import numpy as np

from testbench.tracing.fit.rank import Projection


def gains(tracer):
    """[(gain less ln of the number of laws, name, d, None)] of the families of a tracer's problem at its base fit."""
    problem, fit, out = tracer.problem, tracer.base.fit, []
    total = np.log(max(len(problem.laws_by_name()), 1))
    projection = Projection(fit.jacobian, fit.model.prior_columns()) if problem.families else None
    for name, family in problem.families.items():
        points = [(fit.point.theta, {})] + [(fit.point.theta, {member: 1.0}) for member in family.members]
        none, *member_features = problem.predict(points, list(tracer.space.which))
        b = projection.project_with_priors(
            np.stack([tracer.space.whitened_change(m, none) for m in member_features], axis=1)
        )
        z = projection.project_with_priors(fit.z[:, None], fit.model.prior_rows(fit.point)[:, None])[:, 0]
        gram, score, prior = b.T @ b, b.T @ z, np.eye(len(family.members)) / family.law.scale**2
        fitted_coefficients = np.linalg.solve(gram + prior, score)
        gain = (score @ fitted_coefficients - np.linalg.slogdet(np.eye(len(prior)) + gram * family.law.scale**2)[1]) / 2
        fall = 2 * score @ fitted_coefficients - fitted_coefficients @ gram @ fitted_coefficients
        out.append((float(gain - total), name, float(np.sqrt(max(fall - len(prior), 0.0))), None))
    return out


def strength(fit, members):
    """Sigmas of some nuisances of a fit together: |c| / sd of one, the root of chi2 beyond one each of many."""
    names = [n.name for n in fit.model.problem.nuisances]
    at = [names.index(m) for m in members]
    c, covariance = fit.point.theta[at], fit.covariance[np.ix_(at, at)]
    if len(at) == 1:
        return float(abs(c[0]) / max(np.sqrt(covariance[0, 0]), 1e-300))
    scale = np.sqrt(np.diag(covariance))
    chi2 = (c / scale) @ np.linalg.pinv(covariance / np.outer(scale, scale)) @ (c / scale)
    return float(np.sqrt(max(chi2 - len(at), 0.0)))

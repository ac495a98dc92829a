"""What the data can tell of the nuisances: directions in prior-sd units, least seen first, and the null ones in words.

    J_s = W dmu/dtheta * prior_sd       eigenvalues of J_s' J_s: below 1 the prior says more than the data
Source    docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

UNSEEN = 1.0
LEAST_COMPONENT = 0.15  # smallest component of a direction that is put in words


class Direction(NamedTuple):
    """A combination of nuisances; `fixed_by` is data, prior or nothing."""

    eigenvalue: float
    fixed_by: str
    vector: np.ndarray  # in units of `scale`
    words: str


class Identifiability(NamedTuple):
    """All directions, and which nuisances stay at their prior's width."""

    directions: tuple
    scale: np.ndarray
    at_prior: tuple  # names whose sd is above 0.7 prior sd


def identify(fit):
    """`Identifiability` of the nuisances of a fit."""
    model, n = fit.model, len(fit.point.theta)
    jacobian = fit.jacobian[:, :n]
    length = np.linalg.norm(jacobian, axis=0)
    scale = np.where(np.isfinite(model.sd), model.sd, 1e3 / np.where(length > 0, length, 1.0))
    if not n:
        return Identifiability((), scale, ())
    _, s, vt = np.linalg.svd(np.concatenate([np.linalg.qr(jacobian * scale, mode="r"), np.zeros((n, n))]))
    directions = []
    for k in range(n - 1, -1, -1):
        vector = vt[k] * (1.0 if vt[k][np.argmax(np.abs(vt[k]))] > 0 else -1.0)
        value = float(s[k] ** 2)
        if value >= UNSEEN:
            by = "data"
        else:
            free = np.abs(vector[~np.isfinite(model.sd)]).max(initial=0.0)
            by = "nothing" if free > LEAST_COMPONENT else "prior"
        directions.append(Direction(value, by, vector, _direction_text(model.problem.nuisances, vector, by)))
    sd = fit.sd[:n]
    wide = tuple(
        x.name for x, s_ in zip(model.problem.nuisances, sd) if not np.isfinite(s_) or s_ > 0.7 * x.prior_sd < np.inf
    )
    return Identifiability(tuple(directions), scale, wide)


def _direction_text(nuisances, vector, by):
    order = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > LEAST_COMPONENT]
    free = " (without a prior, scaled to 1e3 sigma)"
    combination_text = " ".join(
        f"{vector[k]:+.2f} {nuisances[k].name}{'' if np.isfinite(nuisances[k].prior_sd) else free}" for k in order
    )
    if by == "data":
        return f"the data determine {combination_text}"
    other = "only the prior does" if by == "prior" else "nothing does: add a prior or another experiment"
    single = len(order) == 1
    return f"the data do not determine {'' if single else 'the combination '}{combination_text} (in prior sd); {other}"


def unseen_directions(identifiability):
    """Vectors (columns, in physical units of the nuisances) of the directions that the data do not fix."""
    vectors = [d.vector * identifiability.scale for d in identifiability.directions if d.fixed_by != "data"]
    return np.array(vectors).T if vectors else np.zeros((len(identifiability.scale), 0))

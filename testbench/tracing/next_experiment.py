"""Which condition, measured next, would separate the rivals: T-optimal design on what the lab can do.

    D^2(c) = min over x of |[Delta; Delta_c] - [J; J_c] x|^2       Delta: rival A less rival B, whitened
J holds the nuisances and the coefficients of B (and the priors): B may adapt itself to A's data as well as it can. D is
how many sigmas apart the rivals are then; gain = D(c) / D(nothing). The worst pair of rivals counts (maximin).
Source    Atkinson & Fedorov, Biometrika 62 (1975); docs/tracing.md
"""

import itertools

import numpy as np

from testbench.tracing.problem.model import Model
from testbench.tracing.problem.predictor import Failed, Predictor
from testbench.tracing.problem.space import Space

MOST_RIVALS = 5
ENOUGH, MANY = 3.0, 100  # sigmas that separate two causes; repeats that nobody records


class _Pair:
    """Two fits, and the data that exist."""

    def __init__(self, a, b, space, predictor):
        self.a, self.b = Model(space, predictor, a.model.names), Model(space, predictor, b.model.names)
        self.points = (a.point, b.point)
        (mine,) = b.model.ask([b.point])
        (other,) = Model(b.model.space, b.model.predictor, a.model.names).ask([a.point])
        delta = b.model.space.whitened_change(other, mine)
        design_rows = np.concatenate([b.jacobian, b.model.prior_columns()])
        rhs = np.concatenate([delta, np.zeros(len(design_rows) - len(delta))])
        scale = np.linalg.norm(design_rows, axis=0)
        self.scale = np.where(scale > 0, scale, 1.0)
        q, self.r = np.linalg.qr(design_rows / self.scale)
        self.rhs = q.T @ rhs
        self.residual_square = max(0.0, float(rhs @ rhs - self.rhs @ self.rhs))

    def separation(self, delta=None, jacobian=None):
        """D with the rows of one more condition."""
        r, rhs = self.r, self.rhs
        if delta is not None:
            r, rhs = np.concatenate([r, jacobian / self.scale]), np.concatenate([rhs, delta])
        x = np.linalg.lstsq(r, rhs, rcond=1e-12)[0]
        return float(np.sqrt(self.residual_square + np.sum((rhs - r @ x) ** 2)))


def _repeat_advice(row):
    """(how often to record it, None if that is of no use; in one line how far apart the hardest pair is then)."""
    now, separation_after = row["separation"] / max(row["gain"], 1e-9), row["separation"]
    pair, where = " and ".join(row["pair"]), ", ".join(f"{k} {_text(v)}" for k, v in row["condition"].items())
    count, gained = row["repeats"], separation_after**2 - now**2
    if separation_after < ENOUGH:
        # the squares of what each repeat adds, as long as the nuisances are known
        count = int(np.ceil(count * (ENOUGH**2 - now**2) / max(gained, 1e-9)))
        if count > MANY:
            return None, f"no available condition separates {pair}; the best is {row['group']} ({where})"
        separation_after = ENOUGH
    return (
        count,
        f"{count} repeats of {row['group']} ({where}) would separate {pair} by {separation_after:.2g} sigma; now they "
        f"differ by {now:.2g}",
    )


def _text(value):
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def table(rivals, problem, options=None, count=MOST_RIVALS, store=None):
    """Rows {condition, group, separation, gain, hours, gain_per_hour, pair, wanted, words, text}, best first.

    rivals   fits, the most probable first; the first `count` (at most MOST_RIVALS) are told apart
    options  a Problem whose segments are the conditions on offer; None: those of `problem`, measured once more
    """
    offered = options or problem
    predictor = Predictor(offered, store)
    space = Space(offered, None)
    pairs = []
    for a, b in itertools.permutations(rivals[:count], 2):
        pair = _Pair(a, b, space, predictor)
        first, second = pair.a.ask([pair.points[0]])[0], pair.b.ask([pair.points[1]])[0]
        if isinstance(first, Failed) or isinstance(second, Failed):
            continue
        jacobian = pair.b.jacobian(pair.points[1], second)
        if np.all(np.isfinite(jacobian)):
            pairs.append((pair, space.whitened_change(first, second), jacobian))
    rows = []
    for group in space.groups if pairs else ():
        separations = []
        for pair, delta, jacobian in pairs:
            now = pair.separation()
            separation_after = pair.separation(delta[group.rows], jacobian[group.rows])
            separations.append((separation_after, separation_after / max(now, 1e-9), pair))
        worst = min(separations, key=lambda item: item[0])
        hours = float(group.condition.get("hours", 1.0))
        rows.append(
            {"group": group.name, "condition": dict(group.condition), "separation": worst[0], "gain": worst[1]}
            | {"hours": hours, "gain_per_hour": (worst[1] - 1) / hours, "repeats": len(group.members)}
            | {"pair": [" + ".join(fit.names) or "nothing" for fit in (worst[2].a, worst[2].b)]}
        )
        rows[-1]["wanted"], rows[-1]["words"] = _repeat_advice(rows[-1])
        rows[-1]["text"] = offered.condition_text(group.members[0]) if rows[-1]["wanted"] else ""
    return sorted(rows, key=lambda row: (-row["gain_per_hour"], row["group"]))

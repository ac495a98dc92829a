"""Trace a closed-loop problem: the core on the linear model, then the exact engine where the core has arrived.

Where the two differ by an effect of more than LIMIT sigmas, that point becomes the anchor and the core goes on.
Source    docs/measured.md, docs/tracing.md
"""

import numpy as np

from testbench.measured.loop_problem import DRAWS
from testbench.tracing.problem import PredictionFailed
from testbench.tracing.trace import Options, Tracer

LIMIT, ROUNDS = 0.5, 4  # sigmas
MORE = 2  # times the draws, from the third anchor on


def point_of(problem, result):
    """(theta, {law: coefficient}) that a result has come to."""
    known = {row["name"]: row["after"] for row in result.nuisances}
    theta = np.array([known.get(n.name, n.value) for n in problem.nuisances], float)
    return theta, {row["law"]: row["value"] for row in result.effects}


def run(problem, options=None, progress=None, checkpoint=None):
    """(Tracer, Result) of a problem; that of a closed loop is anchored until its certificate holds, or ROUNDS times."""
    for round_ in range(ROUNDS):
        tracer = Tracer(problem, options or Options(), progress, checkpoint)
        result = tracer.run()
        if not hasattr(problem, "anchor") or not result.nuisances:
            return tracer, result
        theta, effects = point_of(problem, result)
        try:
            certificate = problem.check(theta, effects)
        except PredictionFailed as reason:
            result.certificates["numerical"] = {"failed": str(reason), "holds": False}
            return tracer, result
        certificate["holds"] = certificate["sigma"] < LIMIT
        if not certificate["holds"] and round_ < ROUNDS - 1:
            if round_:
                # near the point already: what is left is mostly the noise of the draws
                problem.draws = MORE * DRAWS
            problem.anchor(theta, effects)
            continue
        if not certificate["holds"]:
            # the core names nothing on a model that is not the engine's
            problem.numerical_certificate = certificate
            tracer = Tracer(problem, options or Options(), progress, checkpoint)
            result = tracer.run()
        result.certificates["numerical"] = certificate
        break
    return tracer, result

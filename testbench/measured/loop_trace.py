"""Trace a closed-loop problem: the core on the linear model, then the exact engine where the core has arrived.

A first look, on an anchor of few draws, says where the anchor belongs: where it has arrived, if that is far. Then, as
long as the engine and the linear model differ by an effect of more than LIMIT sigmas, the point becomes the anchor and
the core goes on. Of a point whose whole way from the anchor is less, nothing else needs to be run.
Source    docs/measured.md, docs/tracing.md
"""

from testbench.measured.loop_problem import DRAWS
from testbench.tracing.problem import PredictionFailed
from testbench.tracing.trace import Options, Tracer

LIMIT, ROUNDS = 0.5, 5  # sigmas
MORE = 2  # times the draws, from the fourth anchor on


def run(problem, options=None, progress=None, checkpoint=None):
    """(Tracer, Result) of a problem; that of a closed loop is anchored until its certificate holds, or ROUNDS times."""
    for round_ in range(ROUNDS):
        tracer = Tracer(problem, options or Options(), progress, checkpoint)
        blocked = tracer.decide()
        if blocked or not hasattr(problem, "anchor"):
            return tracer, blocked or tracer.told()
        theta, effects = tracer.arrived()
        try:
            certificate = problem.distance(theta, effects)
            if not round_:
                problem.draws = DRAWS
                problem.anchor(*(problem.at if certificate["sigma"] < LIMIT else (theta, effects)))
                continue
            if certificate["sigma"] >= LIMIT:
                certificate = problem.check(theta, effects)
        except PredictionFailed as reason:
            result = tracer.told()
            result.certificates["numerical"] = {"failed": str(reason), "holds": False}
            return tracer, result
        certificate["holds"] = certificate["sigma"] < LIMIT
        if not certificate["holds"] and round_ < ROUNDS - 1:
            if round_ > 1:
                # near the point already: what is left is mostly the noise of the draws
                problem.draws = MORE * DRAWS
            problem.anchor(theta, effects)
            continue
        if not certificate["holds"]:
            # the core names nothing on a model that is not the engine's
            problem.numerical_certificate = certificate
            tracer = Tracer(problem, options or Options(), progress, checkpoint)
            blocked = tracer.decide()
        result = blocked or tracer.told()
        result.certificates["numerical"] = certificate
        break
    return tracer, result

"""Trace a closed-loop problem: the core on the linear model, then the exact engine where the core has arrived.

Where the two differ by an effect of more than LIMIT sigmas, that point becomes the anchor and the core goes on.
Source    docs/measured.md, docs/tracing.md
"""

from testbench.measured.loop_problem import DRAWS
from testbench.tracing.problem import PredictionFailed
from testbench.tracing.trace import Options, Tracer

LIMIT, ROUNDS = 0.5, 4  # sigmas
MORE = 2  # times the draws, from the third anchor on


def run(problem, options=None, progress=None, checkpoint=None):
    """(Tracer, Result) of a problem; that of a closed loop is anchored until its certificate holds, or ROUNDS times."""
    for round_ in range(ROUNDS):
        tracer = Tracer(problem, options or Options(), progress, checkpoint)
        blocked = tracer.decide()
        if blocked or not hasattr(problem, "anchor"):
            return tracer, blocked or tracer.told()
        theta, effects = tracer.arrived()
        try:
            certificate = problem.check(theta, effects)
        except PredictionFailed as reason:
            result = tracer.told()
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
            blocked = tracer.decide()
        result = blocked or tracer.told()
        result.certificates["numerical"] = certificate
        break
    return tracer, result

"""Trace a closed-loop problem: the core on the linear model, then the exact engine where the core has arrived.

A first look, on an anchor of few draws, says where the anchor belongs: where it has arrived, if that is far. Then, as
long as the engine and the linear model differ by an effect of more than LIMIT sigmas, the point becomes the anchor and
the core goes on. Of a point whose whole way from the anchor is less, nothing else needs to be run.
Source    docs/measured.md, docs/tracing.md
"""

from testbench.measured.closed_loop.loop_anchor import DRAWS, Anchored
from testbench.tracing.problem.problem import PredictionFailed
from testbench.tracing.trace import Options, Tracer

LIMIT, ROUNDS = 0.5, 5  # sigmas
MORE = 2  # times the draws, from the fourth anchor on


def _anchor_after_preview(problem, certificate, theta, effects):
    """Anchor for good, where a first look has arrived: where the engine fails there, or it is near, where it was."""
    problem.draws = DRAWS
    if certificate["sigma"] >= LIMIT:
        try:
            return problem.anchor(theta, effects)
        except PredictionFailed:
            pass
    return problem.anchor(*problem.at)


def _point_certificate(problem, theta, effects):
    """Certificate of a point: its way from the anchor, or the exact engine there."""
    certificate = problem.linear_change_certificate(theta, effects)
    return certificate if certificate["sigma"] < LIMIT else problem.check(theta, effects)


def run(problem, options=None, progress=None, checkpoint=None):
    """(Tracer, Result) of a problem; that of a closed loop is anchored until its certificate holds, or ROUNDS times."""

    def run_tracer():
        tracer = Tracer(problem, options or Options(), progress, checkpoint)
        return tracer, tracer.decide()

    for round_ in range(ROUNDS):
        tracer, blocked = run_tracer()
        if blocked or not isinstance(problem, Anchored):
            return tracer, blocked or tracer.conclude()
        theta, effects = tracer.final_estimate()
        if not round_:
            _anchor_after_preview(problem, problem.linear_change_certificate(theta, effects), theta, effects)
            continue
        try:
            certificate = _point_certificate(problem, theta, effects)
            meets_limit = certificate["sigma"] < LIMIT
            if meets_limit and problem.describe_prior_overrun(theta):
                # effects agree there, but the nuisances are those of no board
                certificate["failed"] = problem.describe_prior_overrun(theta)
            certificate["holds"] = meets_limit and "failed" not in certificate
            if meets_limit or round_ == ROUNDS - 1:
                break
            if round_ > 1:
                # near the point already: what is left is mostly the noise of the draws
                problem.draws = MORE * DRAWS
            problem.anchor(theta, effects)
        except PredictionFailed as reason:
            certificate = {"failed": str(reason), "holds": False}
            break
    if not certificate["holds"]:
        # the core names nothing on a model that is not the engine's
        problem.numerical_certificate = certificate
        tracer, blocked = run_tracer()
    result = blocked or tracer.conclude()
    result.certificates["numerical"] = certificate
    result.notes += [] if blocked else problem.unidentifiable(tracer.fits["after"])
    return tracer, result

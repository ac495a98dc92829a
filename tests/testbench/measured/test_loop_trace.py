"""Rounds of a closed-loop trace: where the anchor goes, when the engine is run, what a failure of it leaves."""

import pytest

from testbench.measured.closed_loop import loop_trace
from testbench.measured.closed_loop.loop_anchor import Anchored
from testbench.tracing import verdict
from testbench.tracing.problem.problem import PredictionFailed
from testbench.tracing.problem.result import Result


class _Loop(Anchored, adds="wall error anchored checked edge"):
    """A closed loop on one axis: the engine fails above `wall`, its check at a place says `error`."""

    def __init__(self, wall=9.0, error=0.0):
        self.wall, self.error, self.at, self.draws = wall, error, (0.0, {}), 5
        self.anchored, self.checked, self.numerical_certificate, self.edge = [], 0, None, 1e9

    def anchor(self, theta, effects):
        if theta > self.wall:
            raise PredictionFailed("beyond the wall")
        self.at = theta, effects
        self.anchored.append((theta, self.draws))

    def linear_change_certificate(self, theta, effects):
        return {"sigma": abs(theta - self.at[0])}

    def describe_prior_overrun(self, theta):
        return "plant.qy: beyond" if theta > self.edge else ""

    def check(self, theta, effects):
        if theta > self.wall:
            raise PredictionFailed("beyond the wall")
        self.checked += 1
        return {"sigma": self.error}


def _trace(monkeypatch, problem, arrived):
    """`loop_trace.run` with a core that arrives at these places, one after the other."""
    places = iter(arrived)

    class Tracer:
        def __init__(self, *_):
            self.where, self.fits = next(places), {"after": None}

        def decide(self):
            return None

        def final_estimate(self):
            return self.where, {"law": 1.0}

        def conclude(self):
            return Result("x", "unexplained" if verdict.naming_obstacle(problem, True) else "named", "")

    monkeypatch.setattr(loop_trace, "Tracer", Tracer)
    return loop_trace.run(problem)[1]


def test_the_anchor_goes_where_the_first_look_has_arrived(monkeypatch):
    problem = _Loop()
    result = _trace(monkeypatch, problem, [3.0, 3.2])
    assert problem.anchored == [(3.0, loop_trace.DRAWS)]
    assert problem.checked == 0
    assert result.verdict == "named"
    assert result.certificates["numerical"]["sigma"] == pytest.approx(0.2)


def test_it_stays_where_the_look_is_near_or_the_engine_fails(monkeypatch):
    for first in (0.3, 12.0):
        problem = _Loop()
        assert _trace(monkeypatch, problem, [first, 0.4]).verdict == "named"
        assert problem.anchored == [(0.0, loop_trace.DRAWS)]


def test_a_point_far_from_its_anchor_is_run_and_becomes_the_next(monkeypatch):
    problem = _Loop(error=0.4)
    assert _trace(monkeypatch, problem, [3.0, 4.0]).certificates["numerical"]["sigma"] == 0.4
    assert (problem.checked, len(problem.anchored)) == (1, 1)
    problem = _Loop(error=0.6)
    result = _trace(monkeypatch, problem, [3.0, 4.0, 5.0, 5.1])
    assert problem.anchored == [
        (3.0, loop_trace.DRAWS),
        (4.0, loop_trace.DRAWS),
        (5.0, loop_trace.MORE * loop_trace.DRAWS),
    ]
    assert result.certificates["numerical"]["holds"]


def test_what_the_engine_does_not_bear_out_is_not_named(monkeypatch):
    problem = _Loop(error=0.6)
    result = _trace(monkeypatch, problem, [3.0, 4.0, 5.0, 6.0, 7.0, 7.0])
    assert result.verdict == "unexplained"
    assert result.certificates["numerical"] == {"sigma": 0.6, "holds": False}
    problem = _Loop()
    result = _trace(monkeypatch, problem, [3.0, 12.0, 12.0])
    assert result.verdict == "unexplained"
    assert result.certificates["numerical"] == {"failed": "beyond the wall", "holds": False}


def test_a_fit_that_ends_outside_a_wide_prior_names_nothing_although_its_effects_agree(monkeypatch):
    problem = _Loop()
    problem.edge = 3.1
    result = _trace(monkeypatch, problem, [3.0, 3.2, 3.2])
    assert (result.verdict, result.certificates["numerical"]["holds"]) == ("unexplained", False)
    assert result.certificates["numerical"]["failed"] == "plant.qy: beyond"
    problem.edge = 3.3
    assert _trace(monkeypatch, problem, [3.0, 3.2]).certificates["numerical"]["holds"]

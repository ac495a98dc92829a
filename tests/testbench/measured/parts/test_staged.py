"""Pruning of laws that were added one by one: each goes for its own sake, whatever the others are called."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.measured.exam import exam_intervals, staged
from testbench.measured.models.linear_problem import Diagonal, LinearProblem, Stretch
from testbench.measured.models.part_problem import PartProblem
from testbench.tracing.problem.problem import Law, Nuisance, Observable, Segment
from testbench.tracing.trace import Tracer

PLAIN, LATE = "m: gain with temp", "m: gain with temp 1200 s late"


class _Problem(PartProblem):
    nuisances = ()
    laws = tuple(Law(name, "m", "gain", "1", 0.1) for name in (PLAIN, LATE))


def _fitted(monkeypatch, values):
    """Every fit of `_drop_weak_laws` finds these values, with deviations of 1."""

    class Tracer:
        def __init__(self, problem, *_):
            theta = np.array([values[n.name] for n in problem.nuisances])
            model = SimpleNamespace(problem=problem)
            point = SimpleNamespace(theta=theta)
            self.base = SimpleNamespace(fit=SimpleNamespace(model=model, point=point, covariance=np.eye(len(theta))))

        def calibrate(self):
            return True

    monkeypatch.setattr(staged, "Tracer", Tracer)


@pytest.mark.parametrize(
    ("values", "left"),
    [
        ({PLAIN: 9.0, LATE: 8.0}, [PLAIN, LATE]),
        ({PLAIN: 1.0, LATE: 8.0}, [LATE]),
        ({PLAIN: 9.0, LATE: 1.0}, [PLAIN]),
        ({PLAIN: 1.0, LATE: 1.0}, []),
    ],
)
def test_a_law_goes_for_its_own_size_and_takes_no_namesake_along(monkeypatch, values, left):
    _fitted(monkeypatch, values)
    assert staged._drop_weak_laws(_Problem(), [PLAIN, LATE], None) == left


def test_a_law_that_makes_held_out_data_worse_goes_and_another_stays():
    """Two laws fitted well: one is the same where judged, the other has the opposite sign there."""
    n, rng = 200, np.random.default_rng(1)
    x = np.linspace(-1, 1, n)
    shapes = {"good": (x, x), "bad": (x**2 - 1 / 3, 1 / 3 - x**2)}
    stretches = []
    for k, role in enumerate(("fit", "validate")):
        y = 3 * x + 2 * (x**2 - 1 / 3) + 0.1 * rng.normal(size=n)
        seen = (Observable("level", "V", slice(0, n)),)
        stretches.append(Stretch(Segment(role, {}, role, k, role, seen), y, Diagonal(np.full(n, 0.1))))
    laws = tuple(Law(name, "m", name, "V", 1.0) for name in shapes)
    nuisance = Nuisance("offset", "V", 0.0, np.inf, 1.0)
    columns = {name: list(pair) for name, pair in shapes.items()} | {"offset": [np.ones(n)] * 2}
    problem = LinearProblem("two laws", (nuisance,), laws, stretches, columns, {})
    rounds = [
        staged.Round(name, True, 9.0, 1.0, 9.0, (), {"level": (1.0, share)})
        for name, share in (("good", 0.9), ("bad", 1.1))
    ]
    quick = staged.Options(max_laws=1, n_null=199, power=False, experiments=False)
    assert staged._drop_harmful_laws(problem, ["bad"], rounds, quick) == []
    assert staged._drop_harmful_laws(problem, ["good"], rounds, quick) == ["good"]


def test_stated_deviations_know_a_rest_that_is_no_noise():
    """A slope fitted to white noise and to noise that wanders: the second is stated to be less certain."""
    n, rng, out = 400, np.random.default_rng(2), []
    x = np.linspace(-1, 1, n)
    for walk in (0.0, 0.1):
        y = rng.normal(size=n) + walk * np.cumsum(rng.normal(size=n))
        seen = (Observable("level", "V", slice(0, n)),)
        stretch = Stretch(Segment("fit", {}, "fit", 0, "fit", seen), y, Diagonal(np.ones(n)))
        nuisances = (Nuisance("offset", "V", 0.0, np.inf, 1.0), Nuisance("slope", "V", 0.0, np.inf, 1.0))
        problem = LinearProblem("slope", nuisances, (), [stretch], {"offset": [np.ones(n)], "slope": [x]}, {})
        tracer = Tracer(problem, staged.Options(max_laws=1, n_null=199, power=False, experiments=False), None, None)
        assert tracer.calibrate()
        out.append(exam_intervals.stated_sd(tracer.base.fit)[1] / tracer.base.fit.sd[1])
    assert out[0] < 1.5
    assert out[1] > 2.0

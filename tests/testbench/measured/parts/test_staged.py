"""Pruning of laws that were added one by one: each goes for its own sake, whatever the others are called."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.measured.exam import staged
from testbench.measured.models.part_problem import PartProblem
from testbench.tracing.problem.problem import Law

PLAIN, LATE = "m: gain with temp", "m: gain with temp 1200 s late"


class _Problem(PartProblem):
    nuisances = ()
    laws = tuple(Law(name, "m", "gain", "1", 0.1) for name in (PLAIN, LATE))


def _fitted(monkeypatch, values):
    """Every fit of `_pruned` finds these values, with deviations of 1."""

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
    assert staged._pruned(_Problem(), [PLAIN, LATE], None) == left

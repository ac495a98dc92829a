"""Calibration: the certificate, two starts, gauges and their words, steps of finite differences."""

import dataclasses
import math

import numpy as np
import pytest

from testbench.tracing.fit import identify, posterior_fit
from testbench.tracing.problem.model import Model, Point
from testbench.tracing.problem.predictor import Predictor
from testbench.tracing.problem.problem import Law, Nuisance, Observable, PredictionFailed, Problem, Segment
from testbench.tracing.problem.space import Space
from testbench.tracing.trace import Options, trace
from tests.testbench.tracing.toys import Toy


class Gauge(Problem, adds="t sd"):
    """y = a b exp(-t / tau) + c: a and b only by their product, sd of the noise 0.01."""

    name, laws, hashes = "gauge", (), {}

    def __init__(self, prior=(0.5, 0.5), seed=0):
        t = np.linspace(0, 1, 40)
        self.t, self.sd = t, 0.01
        self.nuisances = (
            Nuisance("a", "N/V", 1.0, prior[0]),
            Nuisance("b", "V/m", 1.0, prior[1]),
            Nuisance("ln_tau", "", -1.0, 0.5),
            Nuisance("c", "V", 0.0, math.inf),
        )
        clean = np.array([1.3 * 0.9 * math.exp(-x / math.exp(-1.2)) + 0.4 for x in t])
        rng = np.random.default_rng(seed)
        self._y = [clean + self.sd * rng.normal(size=40) for _ in range(2)]
        whole = (Observable("y", "V", slice(0, 40)),)
        self.segments = tuple(Segment(f"s{r}", {}, "s", r, "fit", whole) for r in range(2))

    def observed_features(self, k):
        return self._y[k]

    def predict(self, points, which):
        out = []
        for (a, b, ln_tau, c), _ in points:
            if abs(ln_tau) > 50:
                raise PredictionFailed("tau")
            out.append([a * b * np.exp(-self.t * np.exp(-ln_tau)) + c for _ in which])
        return out

    def whiten(self, k, v):
        return v / self.sd

    def noise_draw(self, k, rng):
        return self.sd * rng.normal(size=40)

    def repeatability_rms(self, k):
        return {"y": self.sd}


def model(problem):
    return Model(Space(problem, "fit"), Predictor(problem))


def test_two_starts_agree_and_the_truth_is_covered():
    problem = Toy(11)
    found = posterior_fit.calibrate(model(problem), starts=3)
    assert found.converged
    assert found.fit.decrement < posterior_fit.CONVERGED
    assert max(found.costs) - min(found.costs) < posterior_fit.AGREED
    pull = (found.fit.point.theta - problem.theta) / found.fit.sd
    assert np.abs(pull).max() < 4.5
    assert np.abs(pull).max() > 0.01  # sd that are far too wide would hide everything


def test_pulls_have_unit_width():
    pulls = []
    for seed in range(25):
        problem = Toy(seed)
        fit = posterior_fit.fit(model(problem), model(problem).start())
        pulls.append((fit.point.theta - problem.theta) / fit.sd)
    assert 0.8 < np.std(pulls) < 1.2  # 125 pulls: 0.063 a sigma


@pytest.mark.parametrize(("shared", "narrow"), [(0.0, 1.0), (1.0, 1.7)])
def test_intervals_know_of_what_repeats_share(shared, narrow):
    off = []
    for seed in range(40):
        problem, rng = Toy(seed, {"duffing": 0.3}), np.random.default_rng([seed, 7])
        common = {s.group: np.sqrt(shared) * problem.noise_draw(0, rng) for s in problem.segments}
        problem._y = [y + common[s.group] for y, s in zip(problem._y, problem.segments)]
        asked = Model(Space(problem, "fit"), Predictor(problem), ("duffing",))
        fit = posterior_fit.fit(asked, asked.start())
        off.append((fit.point.c[0] - 0.3) / np.sqrt([fit.covariance[-1, -1], fit.interval_covariance[-1, -1]]))
    # repeats' own and shared variance are alike: their mean has 1.5 of it, their scatter says 0.5
    fitted, told = np.std(off, axis=0)
    assert fitted == pytest.approx(narrow, rel=0.25)  # 40 pulls: 0.11 a sigma
    assert 0.75 < told < 1.25


def test_a_fit_that_stops_early_is_not_certified_and_nothing_is_named(monkeypatch):
    monkeypatch.setattr(posterior_fit, "MOST_ITERATIONS", 0)
    result = trace(Toy(5, {"feed": 0.4}), Options(n_null=299, power=False, experiments=False))
    assert not result.certificates["calibration"]["converged"]
    assert result.verdict != "named"


def test_a_gauge_direction_does_not_stop_the_fit_and_is_named_in_words():
    problem = Gauge()
    found = posterior_fit.calibrate(model(problem))
    assert found.converged
    a, b = found.fit.point.theta[:2]
    assert a * b == pytest.approx(1.17, abs=0.02)
    directions = identify.identify(found.fit).directions
    assert directions[0].fixed_by == "prior"
    assert directions[0].eigenvalue < 1e-3
    assert "a" in directions[0].words
    assert "the prior does" in directions[0].words
    assert all(d.fixed_by == "data" for d in directions[1:])


def test_what_nothing_fixes_is_said_and_has_no_finite_error():
    problem = Gauge(prior=(math.inf, math.inf))
    found = posterior_fit.calibrate(model(problem))
    assert found.fit.point.theta[:2].prod() == pytest.approx(1.17, abs=0.02)
    assert np.isinf(found.fit.sd[:2]).all()
    assert identify.identify(found.fit).directions[0].fixed_by == "nothing"


@pytest.mark.parametrize("sd", [1e-2, 1.0, 1e3])
def test_steps_of_finite_differences_suit_any_prior(sd):
    problem = Gauge(prior=(sd, 0.5))
    m = model(problem)
    point = Point(np.array([1.3, 0.9, -1.2, 0.4]), np.zeros(0))
    jacobian = m.jacobian(point, m.ask([point])[0])
    shape = np.exp(-problem.t * np.exp(1.2)) * np.sqrt(2) / problem.sd
    assert jacobian[:, 0] == pytest.approx(0.9 * shape, rel=1e-3)


def test_a_law_within_a_direction_that_only_a_prior_holds_is_not_named():
    problem = Gauge(prior=(0.002, 0.002))  # so tight that a b seems known; the data ask for 17 % more
    problem.laws = (Law("gain", "cv", "one more gain", "", 1.0),)
    plain = problem.predict
    problem.predict = lambda points, which: [
        [y * (1 + c.get("gain", 0.0)) - c.get("gain", 0.0) * theta[3] for y in plain([(theta, {})], which)[0]]
        for theta, c in points
    ]
    result = trace(problem, Options(n_null=299, power=False, experiments=False))
    assert result.effects[0]["d"] > 10
    assert result.effects[0]["d_without_priors"] < 3
    assert "confounded with nuisance parameters" in result.sentence
    assert result.verdict == "candidate"  # nothing was held out
    words = [d["words"] for d in result.to_json()["identifiability"]["directions"] if d["fixed_by"] == "prior"]
    assert any("a" in w and "b" in w for w in words)


def test_a_start_that_cannot_be_predicted_is_a_failed_fit():
    problem = Gauge()
    bad = Point(np.array([1.0, 1.0, 90.0, 0.0]), np.zeros(0))
    assert posterior_fit.fit(model(problem), bad).failed == "tau"


def test_options_are_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Options().alpha = 0.5

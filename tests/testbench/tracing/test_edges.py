"""Problems at the edge: nothing to calibrate, nothing to blame, one group, few rows, refusals."""

import json
import math

import numpy as np
import pytest

from testbench.errors import ConfigError
from testbench.tracing.figures import all_figures
from testbench.tracing.problem.problem import Law, Nuisance, Observable, Problem, Segment
from testbench.tracing.trace import Options, Tracer, trace
from testbench.tracing.trace_report import html
from tests.testbench.tracing.toys import LAWS, Toy

QUICK = Options(n_null=199)


class Line(Problem):
    """y = c x in groups of few rows; sd 1; the simplest problem there is."""

    name, hashes = "line", {}
    linear_in = frozenset({"slope", "level"})

    def __init__(self, slope=0.0, rows=3, groups=6, repeats=3, nuisances=(), laws=(), roles=("fit",), seed=0):
        rng = np.random.default_rng(seed)
        self.nuisances, self.laws, self._y, self._x, self.segments = nuisances, laws, [], [], ()
        for g in range(groups):
            role = roles[g % len(roles)]
            x = np.arange(rows) + g
            for r in range(repeats):
                whole = (Observable("y", "V", slice(0, rows)),)
                self.segments += (Segment(f"s{g}.{r}", {"g": float(g)}, f"s{g}", r, role, whole),)
                self._y.append(slope * x + rng.normal(size=rows))
                self._x.append(x)

    def observed_features(self, k):
        return self._y[k]

    def predict(self, points, which):
        return [[c.get("slope", 0.0) * self._x[k] + np.sum(theta) for k in which] for theta, c in points]

    def whiten(self, k, v):
        return v

    def noise_draw(self, k, rng):
        return rng.normal(size=len(self._x[k]))

    def repeatability_rms(self, k):
        return {"y": 1.0}


SLOPE = (Law("slope", "out", "c x", "V", 1.0),)


def whole(problem, page=False):
    tracer = Tracer(problem, QUICK, None, None)
    result = tracer.run()
    json.dumps(result.to_json(), allow_nan=False)
    assert not page or html(result, all_figures(tracer))
    return result


def test_nothing_to_calibrate():
    result = whole(Line(0.5, laws=SLOPE))
    assert result.verdict == "candidate"  # nothing was held out
    assert result.effects[0]["value"] == pytest.approx(0.5, abs=4 * result.effects[0]["sd"])


def test_nothing_to_blame():
    result = whole(Line(0.5))
    assert result.verdict == "unexplained"
    assert result.effects == []


@pytest.mark.parametrize(("rows", "groups", "repeats"), [(1, 5, 2), (2, 1, 4), (40, 1, 2), (1, 1, 1)])
def test_few_of_everything_ends_in_a_verdict_without_nan(rows, groups, repeats):
    level = (Nuisance("level", "V", 0.0, math.inf),)
    result = whole(Line(0.0, rows, groups, repeats, level, SLOPE), page=rows == 1)
    assert result.verdict in ("none", "noise-model")


def test_a_validate_group_of_its_own_and_a_level():
    level = (Nuisance("level", "V", 0.0, math.inf),)
    result = whole(Line(0.5, 8, 9, 2, level, SLOPE, ("fit", "fit", "validate")))
    assert result.verdict == "named"
    assert result.heldout["y"]["after"] < result.heldout["y"]["before"]


def test_coefficient_and_sd_of_a_linear_problem_are_those_of_least_squares():
    problem = Line(0.5, laws=SLOPE)
    x, y = np.concatenate(problem._x), np.concatenate(problem._y)
    (effect,) = trace(problem, QUICK).effects
    assert effect["value"] == pytest.approx(x @ y / (x @ x), rel=1e-6)
    means = y.reshape(6, 3, 3).mean(axis=1) - effect["value"] * x.reshape(6, 3, 3)[:, 0]
    scatter = np.sqrt(3 * np.sum(means**2) / (means.size - 1))
    assert scatter > 1  # of means about the fit, in what three repeats allow: the interval has it
    assert effect["sd"] == pytest.approx(scatter * (x @ x) ** -0.5, rel=1e-6)


def test_firmware_comes_first():
    problem = Line(0.5, laws=SLOPE)
    problem.firmware = "R0 differs: agc_acc at tick 26000"
    result = trace(problem, QUICK)
    assert (result.verdict, result.sentence) == ("firmware", "R0 differs: agc_acc at tick 26000")


def test_what_is_implausible_about_the_data_is_the_first_note_of_every_outcome():
    problem = Toy(3, {})
    problem.warnings = ("R26 /stimulus/rate expected 100 deg/s, found 57 in row 3",)
    assert trace(problem, QUICK).notes[0] == problem.warnings[0]
    problem.firmware = "R0 differs: agc_acc at tick 26000"
    assert trace(problem, QUICK).notes == list(problem.warnings)


def test_a_model_that_cannot_be_predicted_is_a_verdict_not_a_crash():
    problem = Line(0.5, laws=SLOPE)
    problem.predict = lambda points, which: [[np.full(3, np.nan) for _ in which] for _ in points]
    result = trace(problem, QUICK)
    assert result.verdict == "unexplained"
    assert "cannot be calibrated" in result.sentence


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"laws": (*LAWS, LAWS[0])}, "duplicate law duffing"),
        ({"laws": (LAWS[0]._replace(scale=0.0),)}, r"law duffing: scale 0\.0 Hz"),
        ({"nuisances": (Nuisance("f0", "Hz", math.nan, 1.0),)}, "nuisance f0: value nan"),
        ({"segments": ()}, "toy: no segment with the role fit"),
    ],
)
def test_a_problem_that_contradicts_itself_is_refused(change, text):
    problem = Toy(0)
    for name, value in change.items():
        setattr(problem, name, value)
    with pytest.raises(ConfigError, match=text):
        trace(problem, QUICK)


def test_repeats_of_a_group_must_share_role_and_length():
    problem = Toy(0)
    problem.segments = (problem.segments[0]._replace(role="validate"), *problem.segments[1:])
    with pytest.raises(ConfigError, match=r"segment fit0\.1: repeats of group fit0 differ"):
        trace(problem, QUICK)


class Bent(Line, adds="shape"):
    """A line whose library has a law that is hardly another, and one that is."""

    library = (Law("bent", "out", "c x^1.02", "V", 1.0), Law("wave", "out", "c cos x", "V", 1.0))
    linear_in = frozenset({"slope", "level", "bent", "wave"})

    def shape(self, name, k):
        return {"bent": self._x[k] ** 1.02, "wave": np.cos(self._x[k])}.get(name, self._x[k])

    def predict(self, points, which):
        return [[sum((v * self.shape(n, k) for n, v in c.items()), 0.0 * self._x[k]) for k in which] for _, c in points]


def test_a_law_of_the_library_that_does_as_well_is_of_the_class_with_its_chi2():
    """chi2 by plain least squares on all repeats; the other law is not there, and the data cannot tell."""
    problem = Bent(0.5, laws=SLOPE)
    result = whole(problem, page=True)
    assert result.verdict == "candidate"
    assert {c["laws"][0] for c in result.causes} == {"slope", "bent"}
    one, two = ((c["laws"][0], c["effects"][0], c["chi2"]) for c in result.causes)
    y = np.concatenate(problem._y)

    def least(name):
        s = np.concatenate([problem.shape(name, k) for k in range(len(problem._y))])
        return s @ y / (s @ s), np.sum((y - s * (s @ y) / (s @ s)) ** 2)

    for name, effect, _ in (one, two):
        assert (effect["value"], effect["unit"]) == (pytest.approx(least(name)[0]), "V")
    assert (one[2], two[2]) == (0.0, pytest.approx(least(two[0])[1] - least(one[0])[1]))
    assert result.next_experiment[0]["words"].startswith(
        "no available condition separates slope and bent; the best is s"
    )


def test_a_misspelt_member_is_an_error():
    with pytest.raises(TypeError, match=r"Spelt.noise_gian is not a member of a problem; did you mean noise_gain\?"):
        type("Spelt", (Line,), {"noise_gian": 1.2})
    with pytest.raises(TypeError, match=r"Bowed.bow is not a member of a problem and is not named in adds"):
        type("Bowed", (Line,), {"bow": lambda self: 1.0})
    problem = Line()
    with pytest.raises(AttributeError, match="did you mean numerical_certificate"):
        problem.numerical_certficate = {"sigma": 0.1}
    assert problem.numerical_certificate is None

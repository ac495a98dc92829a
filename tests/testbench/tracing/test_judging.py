"""Held-out errors, power, discovery, next experiment, page: against direct calculations."""

import re
import tomllib

import numpy as np
import pytest
from scipy.stats import binom, multivariate_normal

from testbench.tracing import trace_report
from testbench.tracing.figures import all_figures
from testbench.tracing.fit import discover, heldout
from testbench.tracing.fit.heldout import FLOOR_FACTOR, bootstrap, mean_square_p, predictive_log_odds
from testbench.tracing.fit.rivals import change_noise_sd
from testbench.tracing.noise.power import clopper_pearson
from testbench.tracing.problem.problem import PortForce
from testbench.tracing.problem.result import plain_value
from testbench.tracing.problem.space import Block
from testbench.tracing.trace import Options, Tracer, trace
from tests.testbench.tracing.toys import BINS, FIT, Toy

QUICK = Options(n_null=299, power=False, experiments=False)


def test_held_out_errors_are_the_rms_of_single_repeats():
    problem = Toy(5, {"feed": 0.2})
    tracer = Tracer(problem, QUICK, None, None)
    result = tracer.run()
    held = [k for k, s in enumerate(problem.segments) if s.role == "validate"]
    for label, fit in (("before", tracer.fits["before"]), ("after", tracer.fits["after"])):
        predicted = problem.predict([(fit.point.theta, fit.model.effects(fit.point))], held)[0]
        errors = np.concatenate([problem.observed_features(k)[BINS:] - p[BINS:] for k, p in zip(held, predicted)])
        assert result.heldout["a"][label] == pytest.approx(np.sqrt(np.mean(errors**2)))
    row = result.heldout["a"]
    assert row["before_ci"][0] < row["before"] < row["before_ci"][1]
    assert row["gain_ci"][0] > 0
    assert row["gain_most"] > row["gain_ci"][1], "as wide as all observables together ask for"
    assert 0.7 < row["excess_removed"] < 1.3


def test_quiet_contrasts_do_not_make_the_held_out_limit_smaller():
    """What repeats have in common is not in their contrasts: octaves are louder than declared there, or as declared."""
    tracer = Tracer(Toy(5, noise=0.5), QUICK, None, None)
    tracer.calibrate()
    assert min(o.f for o in tracer.noise.octaves) < 0.7
    assert {o.f for o in tracer.held_noise.octaves} == {1.0}
    louder = tracer.noise._replace(octaves=tuple(o._replace(f=4 * o.f) for o in tracer.noise.octaves)).loud()
    assert [o.f for o in louder.octaves] == [max(1.0, 4 * o.f) for o in tracer.noise.octaves]


def test_bootstrap_intervals_cover():
    rng, inside = np.random.default_rng(0), 0
    for _ in range(150):
        pieces = [((b, 0), np.array([np.sum(rng.normal(size=20) ** 2)]), 20) for b in range(24)]
        _, draws = bootstrap(pieces, rng)
        low, high = np.quantile(draws[:, 0], [0.025, 0.975])
        inside += low <= 1.0 <= high
    assert 0.85 <= inside / 150 <= 0.99  # percentile bootstrap of 24 blocks: somewhat below 95 %


def test_the_expected_error_is_that_of_the_noise_and_of_what_the_fit_does_not_know():
    problem = Toy(5, {"feed": 0.2})
    tracer = Tracer(problem, QUICK, None, None)
    result = tracer.run()
    fit, n = tracer.fits["after"], 5
    names, x = fit.model.names, np.concatenate([fit.point.theta, fit.point.c])
    held = [k for k, s in enumerate(problem.segments) if s.role == "validate"]

    def predicted(x):
        return np.concatenate(problem.predict([(x[:n], dict(zip(names, x[n:])))], held)[0])

    steps = np.diag(1e-4 * np.sqrt(np.diag(fit.covariance)))
    j = np.stack([(predicted(x + s) - predicted(x - s)) / (2 * s.max()) for s in steps], axis=1)
    unknown = np.einsum("ri,ij,rj->r", j, fit.covariance, j).reshape(len(held), 2, BINS)
    for i, name in enumerate(("f", "a")):
        row = result.heldout[name]
        # a thousand simulated sets
        assert row["expected"] ** 2 == pytest.approx(row["floor"] ** 2 + unknown[:, i].mean(), rel=0.02)
        assert row["expected"] > row["floor"]


@pytest.mark.parametrize(("rows", "bad", "seen"), [(4, 1.3, False), (400, 1.3, True)])
def test_an_error_above_the_floor_is_seen_if_the_rows_suffice_and_not_called_so_if_not(rows, bad, seen):
    rng = np.random.default_rng(4)
    mix = np.exp(-np.abs(np.subtract.outer(np.arange(rows), np.arange(rows))) / 2.0)  # rows of one dwell are alike
    root = np.linalg.cholesky(mix)
    sets = np.mean((root @ rng.normal(size=(rows, 1000))) ** 2, axis=0)
    tried = np.mean((root @ rng.normal(size=(rows, 600))) ** 2, axis=0)
    p = np.array([mean_square_p(FLOOR_FACTOR**2 * v, sets) for v in tried])
    assert binom.ppf(1e-3, 600, 0.05) <= np.sum(p < 0.05) <= binom.ppf(1 - 1e-3, 600, 0.06)
    share = np.mean([mean_square_p(bad**2 * v, sets) < 0.01 for v in tried])
    assert share > 0.9 if seen else share < 0.1


def test_few_held_out_rows_have_wide_intervals():
    """One condition in four stretches: a bootstrap of so few says nothing, simulated sets do."""
    problem = Toy(5, {"feed": 0.2})
    kept = [k for k, s in enumerate(problem.segments) if s.role == "fit" or s.group == "validate1"]
    problem._y, problem._conditions = [problem._y[k] for k in kept], [problem._conditions[k] for k in kept]
    problem.segments = tuple(problem.segments[k] for k in kept)
    row = trace(problem, QUICK).heldout["a"]
    assert row["blocks"] == 4
    assert row["after_ci"][0] < 0.9 * row["after"] < row["after"] < 1.1 * row["after"] < row["after_ci"][1]
    assert row["before_ci"][0] < row["before"] < row["before_ci"][1]
    assert row["gain_ci"][0] < row["gain"] < row["gain_ci"][1]


class _Space:
    blocks = tuple(Block(g, "a", slice(40 * g, 40 * g + 40)) for g in range(5))


@pytest.mark.parametrize("truth", [0.0, 4.0])
@pytest.mark.parametrize("size", [0.5, 4.0, 8.0])
def test_held_out_odds_are_those_of_two_predictive_densities(size, truth):
    """Whole Gaussian densities of all rows, where what the fits do not know lies along the change."""
    rng, rows = np.random.default_rng(3), 200
    along = rng.normal(size=rows)
    along /= np.linalg.norm(along)
    outer, without, with_law = np.outer(along, along), 0.3, 0.7  # sigmas that each fit does not know
    first = rng.normal(size=rows) + truth * along
    last = first - size * along
    noise = np.eye(rows) + (change_noise_sd(_Space, size * along, last) ** 2 - 1) * outer
    one, two = (multivariate_normal(np.zeros(rows), noise + sd**2 * outer) for sd in (without, with_law))
    found = predictive_log_odds(_Space, first, last, without * along[:, None], with_law * along[:, None])
    assert found == pytest.approx(two.logpdf(last) - one.logpdf(first), abs=1e-9)
    if size == 4.0:
        assert found > 3 if truth else found < -3
    assert predictive_log_odds(_Space, first, last, None, along[:, None]) == 0.0


@pytest.mark.parametrize(
    ("log_odds", "listed", "named"), [(1.1, True, True), (0.9, True, False), (-1000.0, False, False)]
)
def test_a_law_that_held_out_data_do_not_support_is_not_named(monkeypatch, log_odds, listed, named):
    judged = heldout.compute_fit_errors
    monkeypatch.setattr(heldout, "compute_fit_errors", lambda *args: judged(*args)._replace(log_odds=log_odds))
    result = trace(Toy(5, {"feed": 0.1}), QUICK)
    assert [row["law"] for row in result.effects] == ["feed"] * listed
    assert result.verdict == ("named" if named else "unexplained")
    assert ("ln odds 0.9, 1 needed" in result.sentence) == (log_odds == 0.9)
    assert not listed or not result.notes
    assert listed or ("feed" in result.sentence and "-1000.0 from held-out data" in result.notes[-1])
    assert listed or result.heldout["a"]["after"] == result.heldout["a"]["before"]


def test_held_out_groups_can_be_rows_of_the_table():
    problem = Toy(5, {"feed": 0.2})
    problem.heldout_by = "group"
    assert "validate0 a" in trace(problem, QUICK).heldout


def test_power_of_the_record_is_what_pseudo_experiments_say():
    result = trace(Toy(7), Options(n_null=999, experiments=False))
    check, null = result.null["check"], result.null["null"]
    assert check["ci"][1] >= 0.9  # d_90 is an upper limit of the true one
    assert null["ci"][0] <= null["alpha"]
    sizes = [v["d"] for v in result.power_d90.values()]
    assert 3.5 < min(sizes) < max(sizes) < 12
    low, high = (result.null["limits"]["feed"][k] for k in ("low", "high"))
    assert low < 0 < high


@pytest.mark.slow
def test_an_effect_of_the_size_of_the_power_is_found_as_often_as_it_says():
    feed = trace(Toy(7), Options(n_null=999, experiments=False)).power_d90["feed"]
    found = [trace(Toy(s, {"feed": feed["value"]}), QUICK).verdict != "none" for s in range(20)]
    assert sum(found) >= 14  # 90 % of 20 is 18; fewer than 14 has a chance of 0.2 %


def test_exact_intervals_of_rates():
    assert clopper_pearson(0, 160) == [0.0, pytest.approx(0.0228, abs=1e-4)]
    assert clopper_pearson(118, 118)[0] == pytest.approx(0.969, abs=1e-3)


def force(rng, law, size, colour=1.0):
    """x^3 among look-alikes along a trajectory, in 40 blocks; noise of unit variance once whitened."""
    x = np.cos(np.linspace(0, 60, 800)) * np.linspace(0.3, 1.5, 800)
    v = np.gradient(x)
    weight = np.where(np.arange(800) < 400, 1.0, 1.0 / colour)
    columns = {"x^2": x**2, "x^3": x**3, "x^5": x**5, "x|x|": x * np.abs(x), "v|v|": v * np.abs(v) * 100}
    whitened = {k: c * weight for k, c in columns.items()}
    nuisance = np.stack([x, v, np.ones(800)], axis=1) * weight[:, None]
    values = size * whitened[law] + nuisance @ np.array([3.0, -40.0, 5.0]) + rng.normal(size=800)
    return PortForce("force_x", "m/s2", values, whitened, nuisance, np.arange(800) // 20)


@pytest.mark.parametrize("law", ["x^2", "x^3", "v|v|", "x|x|"])
def test_the_law_of_a_missing_force_is_selected(law):
    found = discover.select(force(np.random.default_rng(3), law, 3.0), np.random.default_rng(0), 40)
    assert found.laws == (law,)
    assert found.coefficients[law] == pytest.approx(3.0, rel=0.15)
    assert found.inclusion[law] > 0.8
    assert (law,) in discover.proposals([found])


def test_no_law_is_selected_from_noise():
    chosen = [
        discover.select(force(np.random.default_rng(s), "x^3", 0.0), np.random.default_rng(0), 2).laws
        for s in range(60)
    ]
    assert sum(bool(c) for c in chosen) <= 3


def test_a_lifted_law_is_a_file_that_says_what_and_where_from():
    result = trace(Toy(3, {"friction": 0.15}), QUICK)
    (effect,) = tomllib.loads(result.discovery["files"]["friction"])["effects"]
    assert effect["law"] == "friction"
    assert effect["port"] == "force_x"
    assert effect["coefficient"] == result.effects[0]["value"]
    assert effect["term"] == {"sgn v": 1.0}
    assert effect["found_in"]["toy"] == result.hashes["toy"]


def test_input_estimates_of_the_problem_are_used():
    problem = Toy(4, {"step": 0.5})
    asked = []

    def force_at(theta, effects):
        asked.append(effects)
        made = force(np.random.default_rng(0), "x^3", 0.0)
        return [made._replace(columns={"friction": made.columns["x^2"]})]

    problem.force_at = force_at
    assert [p["unit"] for p in trace(problem, QUICK).discovery["ports"]] == ["m/s2"]
    assert asked


@pytest.mark.slow
def test_the_page_is_whole_and_needs_nothing_else():
    tracer = Tracer(Toy(5, {"feed": 0.2}), Options(n_null=299), None, None)
    result = tracer.run()
    page = trace_report.html(result, all_figures(tracer))
    assert page.count("data:image/png;base64,") == 7
    assert not re.search(r"(src|href)=\"http", page)
    assert "<script" not in page
    for text in (
        "named",
        "feed",
        "Error on held-out data, before and after",
        "Smallest effect that this record detects",
    ):
        assert text in page


def test_plain_numbers_only():
    data = plain_value(
        {"a": np.float64("nan"), "b": [np.int64(3), np.bool_(True)], "c": np.array([1.0, np.inf]), 4: (1,)}
    )
    assert data == {"a": None, "b": [3, True], "c": [1.0, None], "4": [1]}


def heldout_p(problem):
    """(p of the noise test, p of the held-out chi2, that of the declared noise alone) without any law."""
    tracer = Tracer(problem, QUICK, None, None)
    tracer.calibrate()
    fits = {"after": tracer.base.fit}
    alone = heldout.compute_fit_errors(problem, tracer.held, tracer.predictor, fits)
    return tracer.noise.p, tracer.heldout_result(fits).p, alone.p


@pytest.mark.parametrize(("seed", "how"), [(1033, {"noise": 1.2}), (1061, {"noise": 1.2}), (1041, {"flicker": 1.5})])
def test_held_out_data_are_judged_by_the_noise_that_repeats_bear_out(seed, how):
    """Noise that the repeats do not reject, and that is louder all the same: the declared one would make it physics."""
    rejected, p, alone = heldout_p(Toy(seed, **how))
    assert rejected > 0.01
    assert alone < 0.002
    assert p > 0.01
    at_rest = [(a, t, 0.0) for a, t, _ in FIT]
    assert heldout_p(Toy(seed, {"centrifugal": 0.4}, conditions=at_rest, **how))[1] < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"noise": 1.2}, {"flicker": 1.5}, {"flicker": 3.0}])
def test_the_chance_of_a_held_out_chi2_is_its_chance(how):
    p = np.array([heldout_p(Toy(seed, **how))[1] for seed in range(30000, 30200)])
    below = {level: int(np.sum(p < level)) for level in (0.1, 0.01, 0.002)}
    print("held-out p", how, below)
    assert all(binom.sf(count - 1, len(p), level) > 0.01 for level, count in below.items())


def test_noise_without_any_scatter_has_a_chance_all_the_same():
    same, some = np.full(100, 2.0), np.random.default_rng(0).chisquare(20, 100)
    assert [mean_square_p(square, same) for square in (2.0, 2.2, 2.4)] == [1.0, 1.0, 0.0]  # 1.06^2 times 2 is 2.25
    assert heldout.p_floor(500.0, some, 0.0, np.zeros(100)) == mean_square_p(500.0, some) < 1e-6
    # repeats that differ, by a noise of which repeats are the same: that noise judges nothing
    assert heldout.p_floor(500.0, some, 3.0, np.zeros(100)) == 1.0


@pytest.mark.parametrize(("louder", "misfit", "seen"), [(1.0, 0.0, False), (1.25, 0.0, False), (1.25, 1.0, True)])
def test_noise_that_is_louder_than_declared_is_no_error_of_the_model(louder, misfit, seen):
    """Held-out rms of four repeats, against sets of the declared noise: a misfit repeats, noise does not."""
    rng, rows = np.random.default_rng(5), 200

    def squares(count, sd, shape):
        y = shape + sd * rng.normal(size=(count, 4, rows))
        return np.mean(y**2, axis=(1, 2)), np.mean((y - y.mean(axis=1, keepdims=True)) ** 2, axis=(1, 2))

    sets, tried = squares(1000, 1.0, 0.0), squares(300, louder, misfit * np.sin(np.arange(rows)))
    p = [heldout.p_floor(square, sets[0], apart, sets[1]) < 0.01 for square, apart in zip(*tried)]
    alone = [mean_square_p(square, sets[0]) < 0.01 for square in tried[0]]
    assert np.mean(alone) > 0.9 or louder == 1.0
    assert np.mean(p) > 0.9 if seen else np.mean(p) < 0.03

"""The traps that were met when the method was worked out, one test each; those of calibration are in test_calibrate."""

import numpy as np
import pytest

from testbench.errors import ConfigError
from testbench.tracing.fit import posterior_fit, rank
from testbench.tracing.fit.refit import discontinuous, refit
from testbench.tracing.noise import alarms, noise_model
from testbench.tracing.problem.model import Model
from testbench.tracing.problem.predictor import Predictor
from testbench.tracing.problem.problem import Law, Nuisance, PredictionFailed
from testbench.tracing.problem.space import Space
from testbench.tracing.trace import Options, trace
from tests.testbench.tracing.toys import BINS, FIT, LAWS, Toy

QUICK = Options(n_null=299, power=False, experiments=False)


def base(problem):
    m = Model(Space(problem, "fit"), Predictor(problem))
    return posterior_fit.fit(m, m.start())


class Extended(Toy):
    """A toy with one more law, given as a function of the condition and the coefficient."""

    def __init__(self, law, shape, **how):
        super().__init__(**how, laws=(*LAWS, law))
        self._law, self._shape = law.name, shape

    def predict(self, points, which):
        out = super().predict(points, which)
        for (_, c), arrays in zip(points, out):
            for k, a in zip(which, arrays):
                a += self._shape(c.get(self._law, 0.0), *self._conditions[k])
        return out


def test_a_bin_without_variance_is_refused_by_name():
    problem = Toy(0)
    problem.whiten = lambda k, v: v / np.zeros(1)
    with np.errstate(all="ignore"), pytest.raises(ConfigError, match=r"fit0\.0: whitened features are not finite"):
        trace(problem, QUICK)


def test_an_engine_that_is_not_exact_enough_names_nothing():
    problem = Toy(5, {"feed": 0.4})
    problem.numerical_certificate = {"sigma": 1.9}
    result = trace(problem, QUICK)
    assert result.verdict == "unexplained"
    assert "1.9 sigma" in result.sentence
    problem.numerical_certificate = {"sigma": 0.1}
    assert trace(problem, QUICK).verdict == "named"


def jump(c, A, T, rate):
    """An effect that does not begin at nothing: 0.03 V at any coefficient but 0."""
    out = np.zeros(2 * BINS)
    out[BINS:] = (0.03 + c) / (0.3 + A) if c else 0.0
    return out


def test_an_effect_that_jumps_at_zero_is_never_ranked():
    law = Law("jumping", "cv_y", "jump", "V", 0.5)
    problem = Extended(law, jump, seed=5, effects={"feed": 0.1})
    fit = base(problem)
    assert discontinuous(fit, law)
    assert not discontinuous(fit, LAWS[-1])
    result = trace(problem, QUICK)
    assert [e["law"] for e in result.effects] == ["feed"]
    assert {
        "laws": ["jumping"],
        "failed": "the prediction jumps where the coefficient of jumping is 0",
    } in result.models


def test_a_start_that_diverges_is_shortened_and_what_stays_diverged_has_failed():
    def steep(limit):
        def shape(c, A, T, rate):
            if abs(c) > limit:
                raise PredictionFailed("blown up")
            out = np.zeros(2 * BINS)
            out[BINS:] = (c + 30 * c**3) / (0.3 + A)
            return out

        return shape

    law = Law("steep", "cv_y", "hardening", "V", 0.5)
    clean = Extended(law, steep(0.17), seed=5, effects={"feed": 0.2})  # the linear solution, 0.2, cannot be predicted
    start = base(clean)
    found = refit(start, ["steep"], rank.Signatures(start))
    assert not found.failed
    c = found.point.c[0]
    assert c + 30 * c**3 == pytest.approx(0.2, abs=4 * 0.0089)
    blown = Extended(law, steep(0.0), seed=5, effects={"feed": 0.2})
    result = trace(blown, QUICK)
    assert all("steep" not in m["laws"] for m in result.models if "failed" not in m)
    assert {"law": "steep", "list": "catalogue", "failed": "cannot be predicted"} in result.ranking


def test_ranking_without_projection_or_weights_is_wrong_where_the_projected_one_is_right():
    right, frozen = 0, 0
    for seed in range(12):
        problem = Toy(100 + seed, {"selfheat": 0.0148 * 25})
        fit = base(problem)
        ranking = rank.rank(fit, [law.name for law in LAWS], rank.signatures(fit, [law.name for law in LAWS]))
        right += ranking.names[int(np.argmax(np.abs(ranking.t)))] == "selfheat"
        model = fit.model
        nothing = Model(model.space, model.predictor).start()
        (prediction,) = model.ask([nothing])
        z = model.space.residual(prediction)
        raw = np.abs(ranking.signatures.T @ z) / np.linalg.norm(ranking.signatures, axis=0)
        frozen += ranking.names[int(np.argmax(raw))] == "selfheat"
    assert right == 12
    assert frozen <= 6


def test_the_forbidden_sign_is_one_sided_in_p_and_never_named():
    problem = Toy(5, {"latency": -0.3})
    fit = base(problem)
    ranking = rank.rank(fit, [law.name for law in LAWS], rank.signatures(fit, [law.name for law in LAWS]))
    k = ranking.index("latency")
    assert ranking.t[k] < -20
    assert rank.one_sided(ranking, {law.name: law for law in LAWS})[k] == 0.0
    result = trace(problem, QUICK)
    assert result.verdict == "unexplained"
    assert "latency" not in [e["law"] for e in result.effects]


def test_one_sided_p_is_half_the_two_sided_one():
    free = tuple(law._replace(sign=0) for law in LAWS if law.name == "latency")
    bound = tuple(law for law in LAWS if law.name == "latency")
    p = []
    for laws in (free, bound):
        problem = Toy(5, {"latency": 0.018}, laws=laws, library=())
        p.append(
            trace(problem, Options(n_null=1999, power=False, experiments=False)).alarms["declared"]["p"]["catalogue"]
        )
    assert p[1] == pytest.approx(p[0] / 2, rel=0.5)


def test_scanning_more_laws_widens_the_look_elsewhere():
    def p_of(count):
        rng = np.random.default_rng(1)
        shapes = rng.normal(size=(count, len(Toy(0).segments), 2 * BINS)) * 0.02
        laws = tuple(Law(f"law{i}", "any", "random", "V", 1.0) for i in range(count))
        problem = Toy(5, {"feed": 0.035}, laws=(LAWS[-1], *laws), library=())
        plain = problem.predict

        def predict(points, which):
            out = plain(points, which)
            for (_, c), arrays in zip(points, out):
                for k, a in zip(which, arrays):
                    a += sum(c.get(f"law{i}", 0.0) * shapes[i, 2 * (k // 2)] for i in range(count))
            return out

        problem.predict = predict
        result = trace(problem, QUICK)
        return result.alarms["declared"]["p"]["catalogue"], result.looks["laws"]

    (few, n_few), (many, n_many) = p_of(0), p_of(60)
    assert (n_few, n_many) == (1, 61)
    assert many > 5 * few


def test_declared_looks_widen_every_p():
    once = trace(Toy(5, {"feed": 0.035}), QUICK).p_global
    often = trace(Toy(5, {"feed": 0.035}), Options(looks=50, n_null=299, power=False, experiments=False)).p_global
    assert often == pytest.approx(1 - (1 - once) ** 50)


def test_a_covariance_from_too_few_draws_is_corrected_or_refused():
    problem = Toy(0)
    problem.noise_estimated_from = (20, 32)
    with pytest.raises(
        ConfigError, match="noise of 32 features is estimated from 20 deviations, at least 35 are needed"
    ):
        trace(problem, QUICK)
    rng = np.random.default_rng(0)
    features, deviations, chi2 = 32, 64, []
    for _ in range(60):
        sample = rng.normal(size=(deviations, features))
        factor = np.linalg.cholesky(sample.T @ sample / deviations)
        fresh = np.linalg.solve(factor, rng.normal(size=(features, 20)))
        chi2.append(np.mean(fresh**2))
    problem.noise_estimated_from = (deviations, features)
    assert np.mean(chi2) > 1.7  # what an uncorrected covariance would say of pure noise
    assert np.mean(chi2) * Space(problem, "fit").gain ** 2 == pytest.approx(1.0, abs=0.08)


def test_noise_that_repeats_do_not_share_is_not_physics():
    """A jump in one repeat only: found in the contrasts, told with its place, never named."""
    problem = Toy(5)
    problem._y[2] = problem._y[2].copy()
    problem._y[2][5:BINS] += 0.6
    result = trace(problem, QUICK)
    assert result.verdict == "noise-model"
    assert "f of fit1" in result.certificates["noise"]["jump"]
    assert not result.effects


def test_repeats_that_agree_by_chance_make_no_misfit():
    """The declared noise is rejected, because one octave is too quiet: that octave must not become all that counts."""
    problem = Toy(5, {"duffing": 0.2})
    chol = np.linalg.cholesky(problem.declared["f"])
    for k in range(0, len(FIT) * 2, 2):
        pair = np.array([problem._y[k][:BINS], problem._y[k + 1][:BINS]])
        contrast = np.linalg.solve(chol, pair[0] - pair[1])
        quiet = chol @ (contrast - 0.9 * contrast.mean())
        problem._y[k][:BINS], problem._y[k + 1][:BINS] = pair.mean(axis=0) + quiet / 2, pair.mean(axis=0) - quiet / 2
    result = trace(problem, QUICK)
    assert result.certificates["noise"]["p"] < 0.01
    assert "f, the mean" in result.certificates["noise"]["worst"]
    assert result.verdict == "named", result.sentence
    assert [e["law"] for e in result.effects] == ["duffing"]


def test_the_rotation_alarm_keeps_its_level_under_any_noise_colour():
    """Residuals and contrasts of a noise unlike the declared one: p of the rotation test stays uniform or above."""
    problem = Toy(1)
    fit = base(problem)
    space, rng = fit.model.space, np.random.default_rng(0)
    laws = {"catalogue": rank.rank(fit, [law.name for law in LAWS], rank.signatures(fit, [law.name for law in LAWS]))}
    projection = rank.Projection(fit.jacobian, fit.model.prior_columns())
    ramp = np.exp(rng.normal(size=space.size))  # another variance for every row
    low, trials = 0, 120
    for _ in range(trials):
        prior = rng.normal(size=(projection.priors, 1))
        z = projection((ramp * rng.normal(size=space.size))[:, None], prior)[:, 0]
        space.contrasts = [(ramp[g.rows] * rng.normal(size=g.rows.stop - g.rows.start))[None] for g in space.groups]
        again = fit._replace(z=z, point=fit.model.start())
        test = alarms.rotation_test(space, laws, again, 99, rng)
        low += test.p_global <= 0.05
    assert low <= 13  # 6 expected, 13 has a chance of 0.4 %


def test_refined_noise_finds_the_flicker_and_where():
    space = Space(Toy(2, flicker=3.0, repeats=4), "fit")
    found = noise_model.estimate_octave_noise([space], np.random.default_rng(0))
    assert found.p < 1e-6
    slow = [o for o in found.octaves if o.first == 0]
    fast = [o for o in found.octaves if o.first >= 3]
    assert min(o.ratio for o in slow) > 2
    assert max(o.ratio for o in fast) < 1.6


def test_an_unknown_nuisance_width_is_refused():
    problem = Toy(0)
    problem.nuisances = (Nuisance("f0", "Hz", 1.0, 0.0), *problem.nuisances[1:])
    with pytest.raises(ConfigError, match=r"nuisance f0: value 1\.0, sd 0\.0 Hz"):
        trace(problem, QUICK)

"""Level of the 1/f noise from repeats: on drawn rows of known covariances, and on power-ons of the averaged plant."""

from pathlib import Path

import numpy as np
import pytest

from testbench import config as configuration
from testbench.measured.closed_loop import loop_problem, loop_runs
from testbench.measured.record.recording_plan import Condition
from testbench.measured.wide import noise_levels
from testbench.measured.wide.averaged_loop import AveragedLoop

N, CONDITIONS = 6, 4
WHITE, SLOW = np.stack([np.eye(N)] * CONDITIONS), np.stack([np.ones((N, N))] * CONDITIONS)


def _rows(rng, level, count):
    """Contrasts with unit noise of their own and a common one of a level."""
    return [rng.normal(size=(count, N)) + level * rng.normal(size=(count, 1)) for _ in range(CONDITIONS)]


@pytest.mark.parametrize("true", [1.0, 2.0, 4.0])
def test_many_repeats_tell_the_level(true):
    level, gain = noise_levels.likeliest(_rows(np.random.default_rng(1), true, 200), WHITE, SLOW)
    assert level == pytest.approx(true, rel=0.1)
    assert (gain > noise_levels.REPORT_GAIN) == (true > 1)


def test_few_repeats_tell_a_level_in_the_mean_and_nothing_is_told_where_there_is_none():
    rng = np.random.default_rng(2)
    high = [noise_levels.likeliest(_rows(rng, 3.0, 1), WHITE, SLOW) for _ in range(200)]
    low = [noise_levels.likeliest(_rows(rng, 1.0, 1), WHITE, SLOW) for _ in range(200)]
    assert np.median([level for level, _ in high]) == pytest.approx(3.0, rel=0.2)
    assert np.median([level for level, _ in low]) < 1.2
    assert sum(gain > noise_levels.REPORT_GAIN for _, gain in low) <= 1


def test_without_repeats_and_with_a_code_that_does_not_scatter_the_level_is_the_declared_one():
    assert noise_levels.likeliest([np.zeros((0, N))] * CONDITIONS, WHITE, SLOW) == (1.0, 0.0)
    assert noise_levels.likeliest([np.ones((1, N))] * CONDITIONS, 0 * WHITE, SLOW) == (1.0, 0.0)


def test_the_moments_are_those_of_the_draws_and_the_conditions_share_correlations():
    rng = np.random.default_rng(3)
    mix = np.array([[1.0, 0.0], [0.8, 0.6]])
    draws = np.stack([scale * rng.normal(size=(4000, 2)) @ mix.T for scale in (1.0, 5.0)])
    one, other = noise_levels.covariances(draws)
    assert one == pytest.approx(mix @ mix.T, abs=0.06)
    assert other == pytest.approx(25 * mix @ mix.T, abs=1.5)
    assert np.all(noise_levels.covariances(np.zeros((1, 3, 2))) == 0)


def test_the_page_has_these_numbers():
    page = (Path(__file__).resolve().parents[3] / "docs" / "wide_priors.md").read_text()
    first, last = noise_levels.LEVELS[[0, -1]]
    assert f"(ln s / ln {np.exp(noise_levels.PRIOR):g})^2,  {first:g} <= s <= {last:g}" in page
    words = {3: "three longest bins", 4: "four sigmas"}
    assert words[noise_levels.BINS] in page
    assert words[np.sqrt(noise_levels.REPORT_GAIN)] in page


def _loop(rows, conditions, model):
    measured = loop_problem.Measured("x", conditions, dict(zip([c.id for c in conditions], rows)), {})
    return AveragedLoop(measured, model, (), loop_runs.Bench(2))


def test_a_record_without_repeats_and_a_model_without_the_noise_stay_as_they_are():
    model, condition = configuration.Config(), Condition("one", 5.0, 0.0, 0.0, 25.0, 0.0, 1.5, 0.6, "fit")
    rows = np.ones((2, loop_runs.feature_count(condition)))
    assert noise_levels.fit_flicker_level(_loop([rows[:1]], (condition,), model), model) == (model, ())
    for key, value in ((noise_levels.KEY, 0.0), ("noise.flicker", False)):
        quiet = configuration.changed(model, {key: value})
        assert noise_levels.fit_flicker_level(_loop([rows], (condition,), quiet), quiet) == (quiet, ())


@pytest.mark.slow
@pytest.mark.parametrize("true", [1.0, 4.0])
def test_repeats_of_the_product_s_own_plant_tell_its_level_and_an_effect_in_all_of_them_does_not(true):
    """Four conditions in six repeats; then with an offset of a hundred sigmas in all repeats alike."""
    model = configuration.Config()
    conditions = tuple(
        Condition(str(k), a_um, rate, 0.0, degc, 0.0, 1.5, 0.6, "fit")
        for k, (a_um, rate, degc) in enumerate(
            [(7.0, 0.0, 25.0), (5.0, 100.0, 25.0), (7.0, 0.0, -20.0), (6.0, -80.0, 60.0)]
        )
    )
    empty = _loop([np.ones((1, loop_runs.feature_count(c))) for c in conditions], conditions, model)
    noisy = configuration.changed(model, {noise_levels.KEY: true * model.plant.sid_flicker_v_per_rthz})
    # other draws than those that the level is made of
    rows = [v[noise_levels.DRAWS :] for v in empty.power_ons(noisy, noise_levels.DRAWS + 6)]
    found = []
    for offset in (0.0, 100.0):
        moved = [v + offset * v.std(axis=0) for v in rows]
        cfg, told = noise_levels.fit_flicker_level(_loop(moved, conditions, model), model)
        found.append(cfg.plant.sid_flicker_v_per_rthz / model.plant.sid_flicker_v_per_rthz)
        print(f"level {true:g}: found {found[-1]:.2f}, told: {told}")
        assert bool(told) == (true > 1)
    assert found[0] == pytest.approx(true, rel=0.5)
    assert found[1] == pytest.approx(found[0], rel=1e-6)

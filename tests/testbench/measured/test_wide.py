"""Wide priors: sheet, tangent of a prior, exact symmetries of the plant, and the stages on a board in closed form."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from testbench import config as configuration
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_laws, loop_problem, loop_runs
from testbench.measured.closed_loop.loop_difference_plant import disable_retiming
from testbench.measured.closed_loop.loop_noise import JITTER
from testbench.measured.closed_loop.loop_runs import FAST, Model, Run
from testbench.measured.closed_loop.loop_symmetries import (
    SYMMETRIES,
    active_symmetries,
    correct_columns,
    identifiability_lines,
    weak,
)
from testbench.measured.record.recording_plan import Condition
from testbench.measured.residual.parameters import Parameter
from testbench.measured.wide import data_sheet, estimate
from testbench.measured.wide.averaged_loop import AveragedLoop
from tests.sealed import strata
from tests.testbench.measured import wide_trials


def test_the_sheet_has_the_tolerances_of_a_data_sheet_about_the_configured_board():
    model = configuration.Config()
    found = {p.key: p for p in data_sheet.parameters(model, data_sheet.read(data_sheet.BUNDLED_PATH))}
    assert found["plant.fx_hz"].scale == pytest.approx(1e-3 * model.plant.fx_hz)
    assert found["plant.qx"].scale == pytest.approx(math.log(2))
    assert found["plant.tcf_per_k"].scale == pytest.approx(0.1 * abs(model.plant.tcf_per_k))
    assert data_sheet.wide(found.values())
    mine = Parameter("plant.qx", "1", 2e5, 2e-5, True, 100.0, 1e8)
    assert not data_sheet.wide([mine])
    assert data_sheet.parameters(model, {"plant.qx": ("factor", 2.0)}, [mine]) == (mine,)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[factor]\n"plant.qx" = 0.5', "plant.qx: 0.5, expected a number above 1 and at most 10"),
        ('[relative]\n"plant.qz" = 0.5', "plant.qz: not a key of"),
        ('[relative]\n"plant.qx" = true', "plant.qx: True"),
        ('[relative]\n"plant.qx" = 0.1\n[factor]\n"plant.qx" = 2.0', "duplicate"),
        ("[sd]\na = 1", "expected the tables relative and factor"),
        ("relative = 1", "expected the tables"),
    ],
)
def test_a_wrong_sheet_is_one_line(tmp_path, text, said):
    path = tmp_path / "sheet.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=said) as error:
        data_sheet.read(path)
    assert "\n" not in str(error.value)


def test_a_tolerance_of_nothing_is_refused():
    with pytest.raises(ConfigError, match="sid_leakage_a = 0"):
        data_sheet.parameters(configuration.Config(), {"plant.sid_leakage_a": ("relative", 0.1)})


def test_the_tangent_prior_pulls_as_the_logarithmic_one_does():
    p = Parameter("plant.qx", "1", 2e5, 0.7, True, 0.0, 1e9, 3.1e5)
    mean, sd = p.normal()
    step = 1e-4 * p.start
    pull = [p.coordinate(p.start + s) ** 2 for s in (-step, step)]
    assert (pull[1] - pull[0]) / (2 * step) == pytest.approx(2 * (p.start - mean) / sd**2, rel=1e-6)
    narrow = Parameter("plant.qx", "1", 2e5, 2e-5, True, 0.0, 1e9)
    assert narrow.normal() == (2e5, 4.0)


def test_the_coordinate_of_the_linear_model_has_the_logarithmic_prior_and_no_negative_value():
    p = Parameter("plant.mass_kg", "kg", 2e5, 0.7, True, 0.0, 1e9, 3.1e5)
    mean, sd = p.normal()
    for theta in (-3e5, 1e5, 3.1e5, 5e5):
        assert p.value_from_theta(theta) > 0
        assert p.coordinate(p.value_from_theta(theta)) == pytest.approx((theta - mean) / sd)
        assert p.theta(p.value_from_theta(theta)) == pytest.approx(theta)
    assert p._replace(start=None).value_from_theta(-1.0) == -1.0


def test_a_quality_factor_is_straight_in_its_inverse():
    p = Parameter("plant.qy", "1", 2e5, 0.7, True, 0.0, 1e9, 1.6e5)
    for theta in (1e5, 1.6e5, 2.3e5):
        assert p.theta(p.value_from_theta(theta)) == pytest.approx(theta)
        assert 1 / p.value_from_theta(theta) == pytest.approx((1 - (theta - 1.6e5) / 1.6e5) / 1.6e5)
    assert p.coordinate(p.value_from_theta(1e9)) == pytest.approx(2.5)
    assert p.coordinate(p.value_from_theta(-1e9)) == pytest.approx(-2.5)
    assert (p.value_from_theta(1.6001e5) - p.value_from_theta(1.5999e5)) / 20 == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("logarithmic", [True, False])
def test_the_linear_model_ends_at_two_and_a_half_sds_of_a_wide_prior_and_at_the_limits_of_the_key(logarithmic):
    p = Parameter("plant.mass_kg", "kg", 2e5, 0.7 if logarithmic else 4e4, logarithmic, 100.0, 1e8, 2.1e5)
    mean, sd = p.normal()
    for side in (-1, 1):
        edge = mean + side * 2.5 * sd
        assert p.clip_theta(mean + side * 2.4 * sd) == mean + side * 2.4 * sd
        assert p.clip_theta(mean + side * 1e6 * sd) == pytest.approx(edge)
        assert p.coordinate(p.value_from_theta(mean + side * 1e6 * sd)) == pytest.approx(side * 2.5)
    assert p._replace(lo=1.9e5, hi=2.5e5).value_from_theta(-1e9) == 1.9e5
    assert p._replace(lo=1.9e5, hi=2.5e5).value_from_theta(1e9) == 2.5e5


CONDITION = Condition("one", 5.0, 100.0, -50.0, 40.0, 15.0, settle_s=1.5, seconds=0.3, role="fit")


def _features(model, values):
    changed = disable_retiming(configuration.changed(model, values))
    run = Run(Model(changed), CONDITION, 3, None, 0, True)
    return loop_runs.Bench(1).run([run], FAST)[0]


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=lambda s: s.name)
def test_a_symmetry_leaves_all_features_and_a_part_of_it_does_not(symmetry):
    """A change of 2 % (scale) or 2 ns (delay), against the same change of the held parameter alone."""
    model = configuration.Config()
    value = {key: getattr(model.plant, key.partition(".")[2]) for key in (symmetry.dependent_key, *symmetry.partners)}
    if symmetry.delay:
        moved = {key: v + 2e-9 for key, v in value.items()}
    else:
        moved = {symmetry.dependent_key: 1.02 * value[symmetry.dependent_key]}
        moved |= {key: value[key] * 1.02**power for key, power in symmetry.partners.items()}
    base, whole = _features(model, {}), _features(model, moved)
    alone = _features(model, {symmetry.dependent_key: moved[symmetry.dependent_key]})
    changes = np.abs(np.array([whole - base, alone - base])).reshape(2, len(loop_runs.NAMES), -1).max(axis=2)
    for name in ("v_q2", "adc_yQ"):
        both, one = changes[:, loop_runs.NAMES.index(name)]
        assert both < 0.02 * one


def test_the_columns_of_q_and_drive_force_hold_where_their_product_is_kept():
    """Against a finite difference of 3 % along that change, 50 times smaller than either factor's own."""
    model, condition = configuration.Config(), CONDITION._replace(rate_dps=-240.0, from_dps=0.0)
    keys = ("plant.qx", "plant.k_vf_drive_n_per_v")
    wanted = tuple(p for p in data_sheet.parameters(model, data_sheet.read(data_sheet.BUNDLED_PATH)) if p.key in keys)
    order = [keys.index(p.key) for p in wanted]

    def features(share):
        changed = {"plant.qx": model.plant.qx * share}
        changed["plant.k_vf_drive_n_per_v"] = model.plant.k_vf_drive_n_per_v / share
        run = Run(Model(disable_retiming(configuration.changed(model, changed))), condition, 3, model, 0, True)
        return loop_runs.Bench(1).run([run], FAST)[0]

    rows = np.array([features(math.exp(-0.03)), features(1.0), features(math.exp(0.03))])
    measured = loop_problem.Measured("x", (condition,), {condition.id: rows[1:2]}, {})
    loop = AveragedLoop(measured, model, wanted, loop_runs.Bench(1))
    sigma = loop.sigma(loop.mean(np.zeros(2), 8)[1])
    _, columns = loop.columns(np.zeros(2), [0, 1], sigma, measured=True)
    change = np.array([(0.03, -0.03)[k] for k in order]) / [p.scale for p in wanted]
    told, seen = columns @ change / sigma, (rows[2] - rows[0]) / 2 / sigma
    assert np.linalg.norm(told - seen) < 0.1 * np.linalg.norm(seen)


def test_an_observable_at_the_end_of_its_range_has_the_deviation_of_the_others():
    """V_q at the end of its span under one of two conditions, then under both."""
    model, conditions = configuration.Config(), [CONDITION, CONDITION._replace(id="two")]
    rows = np.ones((1, loop_runs.feature_count(CONDITION)))
    measured = loop_problem.Measured("x", tuple(conditions), {c.id: rows for c in conditions}, {})
    loop = AveragedLoop(measured, model, (), loop_runs.Bench(1))
    sd, v_q2 = np.ones(2 * rows.size), loop.observable == "v_q2"
    sd[v_q2] = 3.0
    sd[v_q2 & (loop.condition == 0)] = 0.0
    assert np.all(loop.sigma(sd)[v_q2] == 3.0)
    sd[v_q2] = 0.0
    with pytest.raises(ConfigError, match="v_q2 of the configured board is at its limit under all conditions"):
        loop.sigma(sd)


def test_features_are_whitened_by_the_covariance_of_power_ons():
    """Draws whose features share a noise: alone each has an sd of 1, and no direction has more than its part."""
    rng, n = np.random.default_rng(5), len(loop_runs.NAMES)
    loop = AveragedLoop.__new__(AveragedLoop)
    loop.observable, loop.condition = np.tile(loop_runs.NAMES, 2), np.repeat([0, 1], n)
    loop._word, loop.repeats, loop.conditions = loop.observable == "f_word", np.full(2 * n, 2), (0, 1)
    shared = np.linalg.cholesky(0.1 * np.eye(n) + 0.9)

    def power_ons(cfg, count):
        jitter = np.outer(JITTER[:count], loop._word[:n])
        return [rng.normal(size=(count, n)) @ shared.T + jitter for _ in range(2)]

    loop.power_ons, loop.config = power_ons, lambda u: None
    sigma, white = loop.whitening_matrix(None)
    assert sigma == pytest.approx(np.sqrt(0.5), rel=0.6)
    z = white @ np.kron(np.eye(2), shared) @ rng.normal(size=(2 * n, 20_000)) / np.sqrt(2)
    assert 0.7 < np.std(z, axis=1).min()
    assert np.std(z, axis=1).max() < 1.5
    assert np.abs(np.corrcoef(z) - np.eye(2 * n)).max() < 0.6
    # where nothing scatters, such as V_q at the end of its span, no feature is infinitely well known
    moving = loop.observable[:n] != "v_q2"
    loop.power_ons = lambda cfg, count: [power_ons(cfg, count)[0] * m for m in (1.0, moving)]
    assert np.abs(loop.whitening_matrix(None)[1]).max() < 100


def test_a_direction_in_which_large_columns_cancel_has_the_change_that_is_measured_there():
    """Two columns of 1000 that differ by 2 %, known to 5 %: the change along their difference, beside the true one."""
    rng = np.random.default_rng(0)
    one, other, third = np.linalg.qr(rng.normal(size=(50, 3)))[0].T
    true = np.stack([1000 * one, 1000 * one + 20 * other, 5 * third], axis=1)
    made = true + rng.normal(size=true.shape) * 0.05 * np.linalg.norm(true, axis=0) / math.sqrt(50)
    ((direction, step),) = weak(made)
    assert abs(direction @ [1, -1, 0]) == pytest.approx(math.sqrt(2), rel=0.01)
    assert step == pytest.approx(min(30 / np.linalg.norm(made @ direction), 0.5))
    better, apart = correct_columns(made, [direction], [true @ direction]), np.array([1.0, -1.0, 0.0])

    wrong, left = (
        np.linalg.norm((columns - true) @ apart) / np.linalg.norm(true @ apart) for columns in (made, better)
    )
    assert wrong > 1.0
    assert left < 0.2
    assert correct_columns(made, [], []) is made
    assert not weak(np.eye(3))


class _Loop:
    """A board in closed form: amplitude ~ 1 / (q k), frequency, force ~ 1 / k; 4 features of each of 3 observables."""

    def __init__(self, truth, parameters):
        self.parameters, self.truth = parameters, truth
        self.observable = np.repeat(["f_word", "amplitude", "force"], 4)
        self.features = self._at(truth)
        self.sigma = lambda sd: sd

    def _at(self, v):
        angle = np.tan(np.radians([-20.0, -5.0, 10.0, 25.0]))
        word = v["plant.fx_hz"] + v["plant.fx_hz"] / (2 * v["plant.qx"]) * angle
        amplitude = 1e9 / (v["plant.qx"] * v["plant.k_vf_drive_n_per_v"]) * np.hypot(1, angle)
        return np.concatenate([word, amplitude, np.full(4, 1e-7 / v["plant.k_vf_drive_n_per_v"])])

    def values(self, u):
        return {p.key: p.value(x) for p, x in zip(self.parameters, u)}

    def residual(self, predicted):
        return self.features - predicted

    def mean(self, u, count, kind=None):
        return self._at(self.values(u)), np.array([1e-6] * 4 + [1e-3] * 4 + [1e-6] * 4)

    def whitening_matrix(self, u):
        sd = self.mean(u, 0)[1]
        return sd, np.diag(1 / sd)

    def slip_free_features(self, u):
        return self._at(self.values(u))

    def columns(self, u, which, sigma, measured=False):
        base, out = self.slip_free_features(u), np.zeros((len(self.features), len(u)))
        for k in which:
            # a word of 11 kHz has 2e-12 Hz of rounding: 1e-4 from both sides leave it 1e-6 of the column of Q
            step = 1e-4 * (np.arange(len(u)) == k)
            out[:, k] = (self._at(self.values(u + step)) - self._at(self.values(u - step))) / 2e-4
        return base, out

    recorded = (np.ones((1, len(loop_runs.NAMES))),)  # no repeats: the noise stays as it is declared

    def config(self, u):
        return configuration.Config()


def test_the_stages_find_a_board_a_factor_away_and_say_that_they_have(monkeypatch):
    parameters = (
        Parameter("plant.fx_hz", "Hz", 11000.0, 11.0, False, 1e3, 5e4),
        Parameter("plant.qx", "1", 2e5, math.log(2), True, 100.0, 1e8),
        Parameter("plant.k_vf_drive_n_per_v", "N/V", 2.7e-7, 0.1, True, 1e-9, 1e-4),
    )
    truth = {"plant.fx_hz": 11009.0, "plant.qx": 3.7e5, "plant.k_vf_drive_n_per_v": 2.5e-7}
    monkeypatch.setattr(estimate, "AveragedLoop", lambda *_: _Loop(truth, parameters))
    names = ("f_word", "amplitude", "force")
    monkeypatch.setattr(estimate, "NAMES", names)
    stages = (*estimate.STAGES[:2], *(stage._replace(observables=names) for stage in estimate.STAGES[-2:]))
    monkeypatch.setattr(estimate, "STAGES", stages)
    found = estimate.estimate(None, None, parameters, None)
    assert found.converged
    assert found.rms < 1e-3
    assert not found.at_wall
    for p in found.parameters:
        assert p.start == pytest.approx(truth[p.key], rel=1e-6)
    assert "3 parameters estimated from the record" in found.lines()[0]


class _Ring(_Loop):
    """A loop gain ~ dC/dy / split, and the phases of a ring at the split at four instants."""

    def _at(self, v):
        split = 11002.0 - v["plant.fy_hz"]
        gain = v["plant.dcdy_f_per_m"] / split * np.ones(4)
        return np.concatenate([gain, np.cos(2 * np.pi * split * np.array([0.08, 0.081, 0.12, 0.121]))])

    def __init__(self, truth, parameters):
        super().__init__(truth, parameters)
        self.observable = np.repeat(["force", "adc_yI"], 4)

    def mean(self, u, count, kind=None):
        return self.slip_free_features(u), np.array([1e-14] * 4 + [1e-3] * 4)


def test_another_well_along_the_split_is_found(monkeypatch):
    """The board is 10 Hz away; a ring of 0.08 s has several minima between. Without the search it is missed."""
    parameters = (
        Parameter("plant.fy_hz", "Hz", 10863.0, 10.9, False, 1e3, 5e4),
        Parameter("plant.dcdy_f_per_m", "F/m", 1e-7, 0.1, True, 1e-9, 1e-4),
    )
    truth = {"plant.fy_hz": 10853.0, "plant.dcdy_f_per_m": 1.05e-7}
    monkeypatch.setattr(estimate, "AveragedLoop", lambda *_: _Ring(truth, parameters))
    monkeypatch.setattr(estimate, "NAMES", ("force", "adc_yI"))
    monkeypatch.setattr(
        estimate, "STAGES", tuple(s._replace(observables=("force", "adc_yI")) for s in estimate.STAGES[-2:])
    )
    found = estimate.estimate(None, None, parameters, None)
    assert {p.key: pytest.approx(p.start, rel=1e-6) for p in found.parameters} == truth
    monkeypatch.setattr(estimate, "FITTED", np.inf)
    missed = estimate.estimate(None, None, parameters, None)
    assert abs(missed.parameters[0].start - truth["plant.fy_hz"]) > 3


def test_no_step_makes_the_cost_larger(monkeypatch):
    """Columns of the wrong sign: every step is refused, the region shrinks, and the stages do not call that an end."""

    class Wrong(_Loop):
        def columns(self, u, which, sigma, measured=False):
            base, out = super().columns(u, which, sigma)
            return base, -out

    parameters = (Parameter("plant.fx_hz", "Hz", 11000.0, 11.0, False, 1e3, 5e4),)
    truth = {"plant.fx_hz": 11009.0, "plant.qx": 2e5, "plant.k_vf_drive_n_per_v": 2.7e-7}

    class Board(Wrong):
        def values(self, u):
            return truth | super().values(u)

    monkeypatch.setattr(estimate, "AveragedLoop", lambda *_: Board(truth, parameters))
    monkeypatch.setattr(estimate, "NAMES", ("f_word",))
    monkeypatch.setattr(estimate, "STAGES", tuple(s._replace(observables=("f_word",)) for s in estimate.STAGES[-2:]))
    found = estimate.estimate(None, None, parameters, None)
    assert not found.converged
    assert found.parameters[0].start == 11000.0
    assert {step.radius for step in found.steps} != {estimate.REGION}


def test_a_quality_factor_of_a_weak_mode_is_found_though_each_feature_tells_little(monkeypatch):
    """Two features share a noise of 1 and differ by 0.01 / Q: their covariance alone shows it."""

    class Weak(_Loop):
        def __init__(self, truth, parameters):
            super().__init__(truth, parameters)
            self.observable, self.features = np.array(["force"] * 2), self._at(truth)

        def _at(self, v):
            return np.array([1e5 / v["plant.qy"], -1e5 / v["plant.qy"]])

        def mean(self, u, count, kind=None):
            return self.slip_free_features(u), np.ones(2)

        def whitening_matrix(self, u):
            return np.ones(2), np.linalg.inv(np.linalg.cholesky(np.array([[1.0, 0.9999], [0.9999, 1.0]])))

    parameters = (Parameter("plant.qy", "1", 2e5, math.log(2), True, 100.0, 1e8),)
    monkeypatch.setattr(estimate, "AveragedLoop", lambda *_: Weak({"plant.qy": 0.9e5}, parameters))
    monkeypatch.setattr(estimate, "NAMES", ("force",))
    monkeypatch.setattr(estimate, "STAGES", tuple(s._replace(observables=("force",)) for s in estimate.STAGES[-2:]))
    found = estimate.estimate(None, None, parameters, None)
    assert found.parameters[0].start == pytest.approx(0.9e5, rel=0.01)


def test_a_memory_longer_than_what_the_dwells_show_is_supported_by_none_of_them():
    """lag(3) from dwells of 0.6 s, and where a later dwell of the power-on ends 3 s after the first began."""
    board = configuration.Config()
    of = SimpleNamespace(model=board, after={"a": 2.0, "b": 2.0})
    of.candidates = {c.law.name: c for c in (*loop_laws.from_catalogue(), *loop_laws.from_grammar())}
    of.conditions = {name: Condition(name, settle_s=2.0, seconds=0.6) for name in of.after}
    told = loop_problem.LoopProblem.insufficient_data_reason
    assert told(of, "force_x: lag(3) vx") == (
        "its time constant is 3 s, but the dwells cover 0.6 s of the time from power-on"
    )
    assert told(of, "force_x: temp vx") == told(of, "duffing_k3_per_um2") == told(of, "plant.sid_switch_s") == ""
    of.after["b"] = 4.4
    assert told(of, "force_x: lag(3) vx") == ""


def test_an_effect_of_promised_size_is_large_enough_to_be_named_beside_a_sheet():
    assert norm.sf(loop_problem.WIDE_LEAST_D - strata.read().effect["d"][0]) > 0.975


def test_what_no_record_tells_is_printed_beside_the_products_and_their_intervals():
    parameters = data_sheet.parameters(configuration.Config(), data_sheet.read(data_sheet.BUNDLED_PATH))
    text = "\n".join(estimate.Estimate(parameters, None, (), ("plant.qy",), 1.0, False).lines())
    for said in ("NOT converged", "plant.qy is at the edge"):
        assert said in text
    keys = ["plant.dcdx_f_per_m", "plant.dcdy_f_per_m", "plant.k_vf_drive_n_per_v", "plant.k_vf_sense_n_per_v"]
    theta = np.array([1e-7, 2e-7, 3e-7, 4e-7])
    # 10 % in common, and 1e-4 of each of their own
    common = np.outer(*2 * [theta * np.array([0.1, 0.1, -0.1, -0.1])])
    told = identifiability_lines(keys, theta, common + np.diag((1e-4 * theta) ** 2))
    assert len(told) == 2
    assert "dcdy_f_per_m / dcdx_f_per_m = 2 +- 0.00028" in told[0]
    assert "k_vf_sense_n_per_v * dcdx_f_per_m = 4e-14 +- 5.7e-18" in told[0]
    assert "mass" in told[1]
    assert not active_symmetries(keys[:3])
    assert identifiability_lines(keys[:3], theta[:3], np.eye(3)) == ()


def test_trials_count_the_products_and_not_the_keys_that_a_prior_holds():
    """Motion off by 10 %, which no record shows, and one force by 3 of its own sds, which it does."""
    truth = {"plant.dcdx_f_per_m": 1e-7, "plant.dcdy_f_per_m": 2e-7}
    truth |= {"plant.k_vf_drive_n_per_v": 3e-7, "plant.k_vf_sense_n_per_v": 4e-7, "plant.qx": 2e5}
    keys, theta = list(truth), np.array(list(truth.values()))
    found = theta * np.array([1.1, 1.1, 1 / 1.1, (1 + 3e-4) / 1.1, 1.0])
    common, own = found * np.array([0.1, 0.1, -0.1, -0.1, 0.0]), found * np.array([0.0, 1e-4, 1e-4, 1e-4, 1e-4])
    told = wide_trials.products(keys, found, np.outer(common, common) + np.diag(own**2), truth)
    off = wide_trials.identifiable(dict.fromkeys(keys, 1.0), told)
    assert list(off) == ["plant.qx", *told]
    assert [abs(x) > 2 for x in off.values()] == [False, False, False, True]
    assert told["k_vf_sense_n_per_v * dcdx_f_per_m"] == pytest.approx(3.0, rel=1e-3)
    assert wide_trials.inside({"identifiable": off}) == (3, 4)

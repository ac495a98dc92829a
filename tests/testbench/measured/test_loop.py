"""The closed loop as a tracing problem: tangents, noise, and trials with something hidden, or nothing.

Two conditions, two nuisances and a few laws prove what twelve trials on the whole bank (marked slow) prove again.
"""

import copy
import json
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numba import config as numba_config
from scipy.stats import binom

from analog_frontend import top as plant
from analog_frontend.effects import law
from fpga_model import references
from fpga_model.rates import FRAME_TICKS
from testbench import config as configuration
from testbench import flatten
from testbench.config import law_file
from testbench.engines import baseband, engine
from testbench.errors import ConfigError
from testbench.golden.bundles import bundle, effect
from testbench.measured.closed_loop import (
    loop_anchor,
    loop_laws,
    loop_noise,
    loop_problem,
    loop_runs,
    loop_tangents,
    loop_trace,
)
from testbench.measured.closed_loop.loop_runs import EXACT, FAST, Model, Run
from testbench.run import build, simulate
from testbench.run.simulation import Simulation
from testbench.tracing.problem.result import Result
from testbench.tracing.problem.space import Space
from tests.testbench.measured import loop_rates, loop_trials

pytestmark = pytest.mark.skipif(numba_config.DISABLE_JIT, reason="hours without the compiler")


GRAMMAR_LAW = "force_x: vx^3"
FEW_LAWS = ("damping_cubic", "pickoff_cubic_x", "bias_cubic", GRAMMAR_LAW)
FEW_PRIORS = tuple(row for row in loop_trials.PRIORS if row[0] in ("plant.fx_hz", "plant.kxy_n_per_m"))
FEW_CONDITIONS = tuple(c._replace(seconds=0.3, settle_s=1.0) for c in loop_trials.QUICK if c.id in ("large", "held"))


@pytest.fixture(scope="module")
def bank():
    return loop_trials.Bank(FEW_CONDITIONS, priors=FEW_PRIORS, only=FEW_LAWS)


@pytest.fixture(scope="module")
def blank(bank):
    return bank.blank()


@pytest.fixture(scope="module")
def whole_bank():
    return loop_trials.Bank(loop_trials.QUICK)


@pytest.fixture(scope="module")
def whole_blank(whole_bank):
    return whole_bank.blank()


# ---- candidates ------------------------------------------------------------------------------------------------------


def test_candidates_have_one_name_and_one_law_each():
    everything = (*loop_laws.from_catalogue(), *loop_laws.from_grammar())
    names = [c.law.name for c in everything]
    assert len(set(names)) == len(names)
    for c in everything:
        assert bool(c.key) != bool(c.factors)
        for text in c.law_texts(1.5):
            assert law.parse(text).coefficient == 1.5


# ---- engines ---------------------------------------------------------------------------------------------------------


def test_a_coefficient_of_zero_is_the_model_itself(bank, blank):
    c = bank.conditions[0]
    theta = np.array([n.value for n in blank.nuisances])
    told = [blank.model_at(theta, {}), blank.model_at(theta, {"bias_cubic": 0.0})]
    for kind in (EXACT, FAST):
        a, b = bank.bench.run([Run(m, c, 5, bank.model) for m in told], kind)
        assert (a == b).all()


@pytest.mark.slow
def test_the_averaged_plant_moves_as_the_exact_one_does(whole_bank, whole_blank):
    """The fast engine gives the change by an effect to a few percent: tangents are made of it.

    Not of laws that move the frequency: they also move slips of the reference edges, in each engine at its own ticks
    (measured for Duffing: 17 % of the change at 45 degC); anchors in the exact engine take care of them.
    """
    bank, blank = whole_bank, whole_blank
    names = [
        "damping_cubic",
        "pickoff_cubic_x",
        "feedthrough_y",
        "bias_cubic",
        "quadrature_cubic",
    ]
    names += ["coulomb_friction", "feedthrough_x", "sense_cubic"]
    size = loop_trials.lengths(blank, names)
    theta = np.array([n.value for n in blank.nuisances])
    c = bank.conditions[3]
    # what the tangents do not see is tried at its largest
    most = {n: blank.tangents.largest(n) for n in names}
    tried = {n: min(300.0 / size[n], most[n]) if size[n] else most[n] for n in names}
    models = [Model(bank.model)] + [blank.model_at(theta, {n: tried[n]}) for n in names]
    # a change of frequency moves the slips of the reference edges, in each engine at its own instants: so draws
    runs = [Run(m, c, 60 + k, bank.model) for m in models for k in range(16)]
    k, moved = blank._rows[c.id], {}
    for kind in (EXACT, FAST):
        rows = np.array(bank.bench.run(runs, kind)).reshape(len(models), 16, -1)
        moved[kind] = [blank.whiten(k, (row - rows[0]).T) for row in rows[1:]]
    for name, a, b in zip(names, *moved.values()):
        noise = np.sqrt((a - b).var(axis=1, ddof=1).sum() / 16)
        a, b = a.mean(axis=1), b.mean(axis=1)
        # of 48 features the norm of their noise hardly scatters
        assert np.linalg.norm(a - b) < 0.05 * np.linalg.norm(a) + 2 * noise, name
        assert noise < 2.0, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fixture", "law"),
    [("bank", "damping_cubic"), ("whole_bank", "damping_coupling"), ("whole_bank", "pickoff_drift")],
)
def test_the_way_from_an_anchor_bounds_what_the_engine_differs_by(request, fixture, law):
    """The certificate takes a whole way for an error: the exact engine at its end finds a fifth of it and less."""
    problem = request.getfixturevalue(fixture).blank()
    looked = problem.hashes["anchor"]
    problem.draws = loop_anchor.DRAWS
    problem.anchor(problem.first, {})
    # what a checkpoint keeps of a first look must not serve this anchor
    assert problem.hashes["anchor"] != looked
    effects = {law: problem.candidates[law].law.scale}
    effects[law] *= 5.0 / problem.linear_change_certificate(problem.first, effects)["sigma"]
    way = problem.linear_change_certificate(problem.first, effects)
    assert way["sigma"] == pytest.approx(5.0, rel=1e-6)
    assert problem.check(problem.first, effects)["sigma"] < way["sigma"] / 5
    assert problem.linear_change_certificate(*problem.at)["sigma"] == 0.0


RESPONDED = (
    "damping_quadratic",
    "parasitic_mode",
    "drive_cubic_per_v2",
    "force_x: vx^3",
    "force_x: rate x",
    "force_y: abs(x) x",
    "force_y: x^2 w",
    "force_y: lag(3) vx",
)
RESPONDED += ("cv_x: cx^5", "cv_x: w", "cv_y: sgn(cx)", "cv_y: rate u", "cv_y: u^3")


def test_a_few_responses_give_the_columns_of_all_laws(bank):
    """Each law run by itself, to both sides, gives the column that the responses of the ports give."""
    other = loop_trials.Bank(bank.conditions, priors=FEW_PRIORS, only=RESPONDED)
    other.bench, other.kept = bank.bench, bank.kept
    problem = other.blank()
    for name in RESPONDED:
        (own,), (given,) = problem.tangents.column_from_runs(name).values(), problem.column(name).values()
        k = problem._rows["large"]
        own, given = problem.whiten(k, own), problem.whiten(k, given)
        assert np.linalg.norm(own) > 0, name
        assert np.linalg.norm(given - own) < 0.05 * np.linalg.norm(own), name


def test_a_parameter_of_a_part_is_a_law_and_becomes_a_key(bank):
    """The phase of a path: a change of the model's value, unless it is a nuisance; found, it is a configuration."""
    key = "plant.sense_dac_delay_s"
    other = loop_trials.Bank(bank.conditions, priors=FEW_PRIORS, only=(key,))
    other.bench, other.kept = bank.bench, bank.kept
    problem, own_s = other.blank(), bank.model.plant.sense_dac_delay_s
    (column,) = problem.column(key).values()
    assert np.isfinite(column).all()
    assert np.any(column)
    text = problem.law_file(problem.library[0], 5e-9, 1e-10, {})
    assert tomllib.loads(text)["plant"]["sense_dac_delay_s"] == pytest.approx(own_s + 5e-9, rel=1e-12)
    other.priors = (*FEW_PRIORS, (key, "s", own_s, 1e-9))
    assert other.blank().library == ()


def test_columns_of_held_out_conditions_are_made_by_themselves(bank):
    problem = bank.blank()
    name = problem.laws[0].name
    fitted, held = (problem.column(name, role) for role in ("fit", "validate"))
    assert set(fitted) | set(held) == set(problem.conditions)
    assert {problem.conditions[g].role for g in fitted} == {"fit"}
    assert problem.column(name, "nothing") == {}


def test_a_first_step_far_beyond_what_the_plant_bears_is_shortened_until_it_runs(monkeypatch):
    name = "force_y: y^3"
    problem = loop_trials.Bank(FEW_CONDITIONS, priors=FEW_PRIORS, only=(name,)).blank()
    first = problem.tangents._first_step(name)
    monkeypatch.setattr(problem.tangents, "_first_step", lambda name: 1e7 * first)
    column = problem.column(name)
    assert all(np.isfinite(v).all() for v in column.values())
    assert problem.tangents._change_sigmas(column) * problem.tangents.steps[name] > loop_tangents.MIN_LAW_SIGMAS


@pytest.mark.slow
def test_a_law_that_the_data_do_not_see_changes_no_bit_of_a_prediction(whole_blank):
    """Sums are in one order, whatever is named beside: their rounding was taken for the signature of such a law."""
    blank = whole_blank
    zero = next(n for n, step in sorted(blank.tangents.steps.items()) if step == 0.0)
    others = {n: blank.candidates[n].law.scale for n in ("damping_coupling", "pickoff_drift", "bias_cubic", zero)}
    (without,), (beside,) = (
        blank.predict([(blank.first * (1 + 1e-7), {n: others[n] for n in names})], [0])
        for names in (list(others)[:3], list(others)[::-1])
    )
    assert (without[0] == beside[0]).all()


def test_a_board_with_even_references_goes_on_from_any_tick_of_one_without():
    """An edge between both boards' pins is not missed: 45 ticks are half a period. On its own nothing changes."""
    own = configuration.Config()
    boards = [build.params(c, 25.0, 25.0) for c in (own, loop_tangents.disable_retiming(own))]
    sim = Simulation(own, 25.0, 25.0)
    assert simulate.start(own, sim, 0.0, 25.0) is not None
    differ, rate, temp = 0, np.zeros(17), np.full(17, 25.0)
    for _ in range(46):
        sim.advance(1, 0.0, 25.0)
        pins = [references.pins(p.fpga.references, sim.state.fpga.references) for p in boards]
        differ += pins[0] != pins[1]
        before = sim.state.plant.switch.copy()
        loop_runs.sync_switches(boards[0], sim.state)
        np.testing.assert_array_equal(sim.state.plant.switch, before)
        s = sim.state._replace(plant=plant.copy(sim.state.plant))
        out = engine.streams(0, 17, 0, 0, 0)
        s = loop_runs.sync_switches(boards[1], s)
        # raises where a reference is not what the clocked engine makes of it
        baseband.run(boards[1], s, 2000, rate, temp, engine.NO_WRITE, engine.Faults(), out)
    assert differ >= 2


def test_boards_power_on_side_by_side_as_alone(bank):
    c = bank.conditions[0]
    told = [loop_runs.seeded_config(problem, k) for k, problem in enumerate([Model(bank.model)] * 3)]
    ticks = 400 * FRAME_TICKS
    together = loop_runs.power_on([loop_runs.switched_on(cfg, c) for cfg in told], ticks)
    alone = [loop_runs.power_on([loop_runs.switched_on(cfg, c)], ticks)[0] for cfg in told]
    for a, b in zip(together, alone):
        assert a.tick == b.tick == ticks
        assert list(flatten.leaves(a.fpga)) == list(flatten.leaves(b.fpga))
        assert (a.plant.z == b.plant.z).all()
    assert (alone[0].plant.z != alone[1].plant.z).any()


def test_without_noise_laws_of_the_drive_are_those_of_the_exact_engine(bank):
    """Damping to a percent, at any phase of the drive; what has no damping gives none.

    The drive's rounded codes are counted by both engines, and signs change where their states do.
    """
    names = ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")
    quiet = configuration.changed(bank.model, {f"noise.{n}": False for n in names})
    laws = ("force_x = -1e-10 sgn(vx)", "force_x = -50.0 x^2 vx", "force_x = -1e-10 sgn(x)")
    models = [Model(quiet), *(Model(quiet, (law,)) for law in laws)]
    for detune in (0.0, 15.0):
        c = bank.conditions[0]._replace(a_um=5.0, rate_dps=0.0, from_dps=0.0, detune_deg=detune)
        runs = [Run(m, c, 1, quiet) for m in models]
        n = len(loop_runs.bins(c)) - 1
        rows = slice(n * loop_runs.NAMES.index("amplitude") + n - 1, n * (loop_runs.NAMES.index("amplitude") + 1))
        exact, fast = (np.array(bank.bench.run(runs, kind))[:, rows] for kind in (EXACT, FAST))
        exact, fast = (exact - exact[0])[1:, 0], (fast - fast[0])[1:, 0]
        assert fast[:2] == pytest.approx(exact[:2], rel=1e-2)
        assert np.abs([exact[2], fast[2]]).max() < 0.005 * exact[0]


def test_laws_of_one_first_harmonic_are_one_law(blank):
    """x^2 vx and vx^3 differ by w^2 and a factor: what else their tangents differ by is slips of edges."""
    names = ("damping_cubic", GRAMMAR_LAW)
    left = loop_trials.Left(blank)
    a, b = (left.rest(blank.column(name)) for name in names)
    same = {blank.candidates[name].law.same for name in names}
    assert len(same) == 1
    assert same != {""}
    assert abs(a @ b) > 0.9995 * np.linalg.norm(a) * np.linalg.norm(b)


@pytest.mark.slow
def test_whitened_noise_is_white(bank, blank):
    """Power-ons of the exact engine, with frequencies and phases of their own, have one sigma per feature."""
    c, rng = bank.conditions[1], np.random.default_rng(9)
    models = [blank.shift_drive_mode(Model(bank.model), loop_noise.JITTER_HZ * rng.normal()) for _ in range(16)]
    runs = [
        Run(m, c, 900 + k, delay_frames=int(rng.integers(loop_runs.MOST_DELAY_FRAMES))) for k, m in enumerate(models)
    ]
    rows = np.array(bank.bench.run(runs, EXACT))
    gain = Space(blank, "fit").gain * np.sqrt(16 / 15)
    z = gain * np.array([blank.whiten(blank._rows[c.id], row - rows.mean(axis=0)) for row in rows])
    n = z.size - z.shape[1]
    # chi2 of n rows has a relative sd of sqrt(2 / n); the covariance is an estimate too
    assert abs(np.mean(z**2) - 1) < 4 * np.sqrt(2 / n) + 0.1


# ---- trials ----------------------------------------------------------------------------------------------------------

TWELVE = ("none", "one", "two", "in", "out", "flicker", "one", "one", "two", "none", "one", "one")
KEYS = "verdict effects heldout p_global looks power_d90 certificates hashes"
OF_EFFECT, OF_OBSERVABLE = "law port value sd unit d", "unit floor before after before_ci after_ci gain_ci expected"


class _Bank:
    """Gives the seed of a board back as its problem."""

    def problem(self, name, values, hashes, densities):
        return values


@pytest.mark.parametrize(("lost", "board"), [(0, 7), (2, 7 + 2 * loop_trials.REDRAWN)])
def test_a_board_that_loses_its_lock_is_drawn_again(monkeypatch, lost, board):
    """A trial's record is that of the first board that keeps its lock; too many that do not are an error."""
    seeds = []

    def recorded(bank, problem, kind, seed, theta, effects, texts):
        if len(seeds) <= lost:
            raise ConfigError("no lock")
        return theta, {}

    monkeypatch.setattr(loop_trials, "drawn", lambda _, __, kind, seed, d: seeds.append(seed) or (seed, {}, (), ()))
    monkeypatch.setattr(loop_trials, "recorded", recorded)
    monkeypatch.setattr(loop_trace, "run", lambda asked, options: (None, Result("x", "none", str(asked))))
    row, _ = loop_trials.trial(_Bank(), None, "none", 7)
    assert (row["sentence"], row["seed"]) == (str(board), 7)
    assert seeds[-1] == board
    lost = loop_trials.REDRAWS
    seeds.clear()
    with pytest.raises(ConfigError):
        loop_trials.trial(_Bank(), None, "none", 7)


@pytest.mark.slow
def test_fresh_draws_scatter_along_the_laws_as_draws_left_out_do(whole_blank, monkeypatch):
    fresh = copy.copy(whole_blank)
    fresh.kept = loop_problem.LoopCache()
    monkeypatch.setattr(loop_anchor, "FIRST_DRAW", 2 * loop_anchor.FIRST_DRAW)
    rows = fresh._draws(loop_noise.NOISE_DRAWS, power_on=True)
    fitted = {c.id: loop_runs.feature_count(c) for c in whole_blank.recorded.conditions if c.role == "fit"}
    one = {
        g: loop_noise.deviations(rows[g][:, :size]).T / np.sqrt(len(whole_blank.recorded.values[g]))
        for g, size in fitted.items()
    }
    along = np.mean(whole_blank.pseudo(one) ** 2) / np.mean(whole_blank.whiten_fit_rows(one) ** 2)
    assert along == pytest.approx(whole_blank.noise_along, rel=0.2)
    assert along > 1.1


@pytest.fixture(scope="module", params=["two", pytest.param("twelve", marks=pytest.mark.slow)])
def trials(request):
    """[(what is known of a trial, its Result)]: two on the few laws, or twelve of all kinds on the whole bank."""
    if request.param == "two":
        bank, blank, kinds, least = *(request.getfixturevalue(n) for n in ("bank", "blank")), ("none", "one"), 30.0
    else:
        bank, blank = (request.getfixturevalue(n) for n in ("whole_bank", "whole_blank"))
        kinds, least = TWELVE, 12.0
    return [loop_trials.trial(bank, blank, kind, 100 + k, d_range=(least, 60.0)) for k, kind in enumerate(kinds)]


def test_what_was_hidden_is_told_and_nothing_else(trials):
    """Verdicts by kind; one of the twelve may be missed, none may name what is not there."""
    rows = [row for row, _ in trials]
    assert not [row for row in rows if row["false_name"]]
    assert not [row for row in rows if row["kind"] in ("none", "flicker") and row["found"]]
    assert sum(row["right"] for row in rows) >= len(rows) - len(rows) // 12, [row for row in rows if not row["right"]]
    assert "named" in [row["verdict"] for row in rows]


def test_the_fitted_model_is_the_exact_engine(trials):
    """But for what jumps: no linear model about any anchor is that, and nothing is named on it."""
    for row, result in trials:
        certificate = result.certificates["numerical"]
        assert certificate["holds"] == (certificate["sigma"] < 0.5)
        assert certificate["holds"] or row["verdict"] != "named"
    sigma = [row["numerical"] for row, _ in trials if row["kind"] != "out"]
    assert all(s < 0.5 for s in sigma), sigma


def test_held_out_errors_of_named_effects_are_at_the_floor(trials):
    """Ratios of single observables scatter as their intervals say; those of all together do not."""
    named = [row for row, _ in trials if row["verdict"] == "named"]
    ratio, _, every = loop_rates.pooled(named)
    assert ratio <= 1.06
    # simulated intervals hold the floor that the model expects
    # where the repeats reject the declared noise nothing is simulated
    inside = [h[3] <= h[5] <= h[4] for row in named for h in row["heldout"].values() if h[5] is not None]
    # eight observables of one trial: not significantly (1 %) fewer than four in five
    assert binom.cdf(sum(inside), len(inside), 0.8) > 0.01
    assert len(every) >= len(inside) > 0


def test_the_json_of_a_trace_has_every_key(trials):
    for row, result in trials:
        data = json.loads(result.text())
        assert set(KEYS.split()) <= set(data)
        assert data["verdict"] in ("named", "confounded", "unexplained", "none", "noise-model")
        assert data["hashes"]["trial"] == str(row["seed"])
        assert all(set(OF_EFFECT.split()) <= set(e) for e in data["effects"])
        assert set(data["heldout"]) == set(loop_runs.NAMES)
        for table in data["heldout"].values():
            assert set(OF_OBSERVABLE.split()) <= set(table)
        assert {"calibration", "numerical"} <= set(data["certificates"])


def becomes_vectors(text, value, folder):
    """Asserts that the file of a found law is one that golden vectors are made of."""
    (folder / "found.toml").write_text(text)
    (told,) = law_file.read(folder / "found.toml").laws
    assert law.parse(told).coefficient == value
    made, manifest = effect.export("found", effect.case([folder / "found.toml"], frames=24), folder / "out")
    assert bundle.verify(made) == manifest


def test_a_law_of_the_grammar_becomes_golden_vectors(blank, tmp_path):
    text = blank.law_file(blank.candidates[GRAMMAR_LAW].law, 2.5e-4, 1e-6, {"record": "0"})
    becomes_vectors(text, 2.5e-4, tmp_path)


@pytest.mark.parametrize("trials", [pytest.param("twelve", marks=pytest.mark.slow)], indirect=True)
def test_a_law_that_was_found_becomes_golden_vectors(trials, tmp_path):
    (found,) = [result for row, result in trials if row["kind"] == "in"]
    ((name, text),) = found.discovery["files"].items()
    assert found.effects[0]["law"] == name
    becomes_vectors(text, found.effects[0]["value"], tmp_path)


@pytest.mark.slow
def test_a_hundred_trials(tmp_path):
    """Rates over a hundred trials of every kind, with the grammar beyond the catalogue."""
    path = Path(os.environ.get("GYRO_TRIALS", tmp_path / "trials.jsonl"))
    loop_rates.main(["100", "--first", "12000", "--keep", str(path)])
    done = loop_rates.kept(path)
    assert len(done) == 100
    quiet = [t for t in done if t["kind"] in ("none", "flicker")]
    assert not [t for t in quiet if loop_rates.false_effect(t)]
    seen = [t for t in done if t["kind"] in ("one", "two", "in") and t["detected"]]
    assert sum(t["right"] for t in seen) >= 0.7 * len(seen)
    assert sum(t["false_name"] for t in done) <= 2
    # no linear model about any anchor is what jumps, and nothing is named on it
    known = [t["numerical"] for t in done if t["kind"] != "out" or t["verdict"] == "named"]
    assert all(sigma is not None and sigma < 0.5 for sigma in known)

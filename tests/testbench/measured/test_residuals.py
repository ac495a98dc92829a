"""R1 and R2: exact where model and noise are those of the board, the noise for the true model, far off for another."""

import copy
import itertools

import numpy as np
import pytest

from testbench.config import changed
from testbench.errors import ConfigError
from testbench.measured.record import produce, recording_plan
from testbench.measured.record.sessions import sessions
from testbench.measured.residual import residuals, simulator
from testbench.measured.residual.features import FIRST_BIN, OBSERVABLES, bins, features
from testbench.measured.residual.noise_floor import Group, estimate_noise_floor
from testbench.run import build

TRANSIENT_FRAMES = 400  # power-on; the first microseconds are those of the frame engine's clocked ticks
CODES = ("adc_xI", "adc_xQ", "adc_yI", "adc_yQ")


def recorded(record, session):
    return np.stack([record.streams[name].data[session.rows] for name in CODES], axis=1)


@pytest.fixture(scope="module")
def model(tree):
    return recording_plan.from_dict(tree).model


@pytest.mark.slow
@pytest.mark.parametrize("exact", [True, False], ids=["replayed words", "recorded words"])
def test_the_true_plant_with_its_own_noise_gives_the_recorded_codes(small, tree, model, exact):
    engine, firmware = simulator.FrameSimulator(), build.firmware(model)
    for k, session in enumerate(sessions(small)[:2]):
        drive = simulator.drive(small, session, firmware, exact)
        codes = engine.driven_codes(changed(model, {"noise.seed": tree["seed"] + k}), drive)
        wrong = np.flatnonzero((codes[:, :4] != recorded(small, session)).any(axis=1))
        wrong = wrong[wrong > TRANSIENT_FRAMES]
        assert not len(wrong)


def test_another_seed_does_not(small, model):
    session = sessions(small)[0]
    drive = simulator.drive(small, session, build.firmware(model))
    codes = simulator.FrameSimulator().driven_codes(changed(model, {"noise.seed": 999}), drive)
    assert not np.array_equal(codes[TRANSIENT_FRAMES:, 0], recorded(small, session)[TRANSIENT_FRAMES:, 0])


def test_the_free_loop_with_its_own_noise_gives_every_recorded_stream(small, tree, model):
    session = sessions(small)[1]
    free = simulator.FrameSimulator().free(
        changed(model, {"noise.seed": tree["seed"] + 1}), simulator.task(small, session)
    )
    assert len(free) == 18
    for name, values in free.items():
        assert np.array_equal(values, small.streams[name].data[session.rows]), name


def test_a_phase_word_in_the_middle_is_refused(small, model):
    record = copy.deepcopy(small)
    table = record.tables["registers"]
    for key, value in (("edge", 20_000_000), ("name", "phase_drive_sine"), ("raw", 5)):
        data = table[key].data.astype(object)
        data[1] = value
        table[key] = table[key]._replace(data=np.array(data.tolist()))
    with pytest.raises(ConfigError, match="phase_drive_sine is written at edge 20000000"):
        simulator.drive(record, sessions(record)[0], build.firmware(model))


# ---- features and noise ----------------------------------------------------------------------------------------------


def test_bins_cover_a_segment_and_grow():
    for frames in (1, 15, 16, 17, 100, 3200, 99_999):
        edges = bins(frames)
        widths = np.diff(edges)
        assert (edges[0], edges[-1]) == (0, frames)
        assert (widths > 0).all()
        assert (np.diff(widths) >= 0).all()
        assert widths[0] < 3 * FIRST_BIN or len(widths) == 1


def test_a_feature_is_the_mean_of_its_bin():
    rng = np.random.default_rng(0)
    codes = rng.integers(-1000, 1000, 5000) + 7_000_000
    have = features({"adc_xQ": codes}, {"adc_xQ": 2.0}, ["adc_xQ"], 100, 777)[0]
    edges = bins(777) + 100
    want = [2.0 * codes[a:b].mean() for a, b in itertools.pairwise(edges)]
    assert np.allclose(have, want, rtol=1e-14)


def test_the_floor_is_the_sigma_of_repeats_and_whitens_them():
    rng = np.random.default_rng(1)
    widths = np.diff(bins(1000))
    sigma = 0.3 / np.sqrt(widths)
    groups = [
        Group(f"g{k}", k + sigma * rng.normal(size=(8, 2, len(widths))) * [[[1.0], [5.0]]], widths) for k in range(40)
    ]
    noise = estimate_noise_floor(groups)
    assert noise.dof == 40 * 7
    assert np.allclose(noise.sigma["g3"], [sigma, 5 * sigma], rtol=0.2)
    white = [noise.whiten_group(g.name, g.values[0] - k) for k, g in enumerate(groups)]
    assert np.mean(np.square(white)) == pytest.approx(1.0, abs=0.1)


def test_correlated_bins_are_whitened():
    rng = np.random.default_rng(2)
    widths = np.diff(bins(1000))
    common = rng.normal(size=(30, 20, 1, 1))
    values = common + 0.5 * rng.normal(size=(30, 20, 1, len(widths)))
    groups = [Group(f"g{k}", v, widths) for k, v in enumerate(values)]
    noise = estimate_noise_floor(groups)
    chi2 = [np.mean(noise.whiten_group("g0", value) ** 2) for g in groups for value in g.values]
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.1)
    plain = np.mean((values / noise.sigma["g0"]) ** 2, axis=(2, 3))
    assert np.std(plain) > 1.5 * np.std(chi2), "without it, one common deviation would count once per bin"


def test_an_observable_without_noise_has_a_floor():
    widths = np.diff(bins(200))
    values = np.zeros((3, 2, len(widths)))
    values[:, 1] = np.random.default_rng(3).normal(size=(3, len(widths)))
    noise = estimate_noise_floor([Group("a", values, widths)])
    assert (noise.sigma["a"] > 0).all()
    assert np.isfinite(noise.whiten_group("a", values[0])).all()


def test_without_repeats_there_is_no_floor():
    with pytest.raises(ValueError, match="needs a condition with 2 repeats or more"):
        estimate_noise_floor([Group("a", np.zeros((1, 2, 3)), np.array([16, 32, 64]))])


# ---- studies ---------------------------------------------------------------------------------------------------------

CONDITIONS = [
    {"id": "a", "rate_dps": 100.0, "seconds": 0.3, "settle_s": 0.1},
    {"id": "b", "rate_dps": 150.0, "from_dps": -50.0, "a_um": 4.0, "seconds": 0.3, "settle_s": 0.1, "role": "validate"},
]


@pytest.fixture(scope="module")
def bench():
    return produce.record(recording_plan.from_dict({"repeats": 4, "seed": 50, "condition": CONDITIONS}))


def chi2(study):
    return {(row.group, row.observable): row.chi2_per_bin for row in study.rows}


@pytest.mark.parametrize("kind", ["R1", "R2"])
def test_the_true_model_leaves_the_noise(bench, kind):
    study = residuals.study_residuals(bench, kind)
    found = chi2(study)
    assert study.draws == (4 if kind == "R2" else 0)
    assert len(found) == 2 * (4 if kind == "R1" else len(OBSERVABLES))
    assert study.dof == 6
    assert study.exact_words == (kind == "R1")
    assert 0.3 < np.median(list(found.values())) < 3
    assert max(found.values()) < 12


@pytest.mark.parametrize(
    ("kind", "values", "seen"),
    [
        ("R1", {"plant.fx_hz": 11002.3005}, "adc_xI"),
        pytest.param("R1", {"plant.qx": 200200.0}, "adc_xQ", marks=pytest.mark.slow),
        ("R1", {"plant.kxy_n_per_m": 0.0562}, "adc_yQ"),
        ("R2", {"plant.fx_hz": 11002.3015}, "f_word"),
        pytest.param("R2", {"plant.qx": 200200.0}, "amplitude", marks=pytest.mark.slow),
        pytest.param("R2", {"plant.kxy_n_per_m": 0.0562}, "v_q2", marks=pytest.mark.slow),
        ("R2", {"plant.k_vf_sense_n_per_v": 1.001}, "force"),
    ],
)
def test_another_plant_is_seen_where_it_acts(bench, model, kind, values, seen):
    base = residuals.check_tables.stated_config(bench)
    if "plant.k_vf_sense_n_per_v" in values:
        values = {"plant.k_vf_sense_n_per_v": base.plant.k_vf_sense_n_per_v * 1.001}
    found = chi2(residuals.study_residuals(bench, kind, changed(base, values), draws=1 if kind == "R2" else 0))
    for group in ("a", "b"):
        assert found[group, seen] > 100
        assert found[group, seen] > 0.9 * max(value for key, value in found.items() if key[0] == group)


def test_without_noise_the_free_loop_locks_another_way(bench):
    """A negative result: why R2 is predicted with noise."""
    quiet, drawn = (chi2(residuals.study_residuals(bench, "R2", draws=draws)) for draws in (0, 4))
    assert quiet["a", "f_word"] > 2 * drawn["a", "f_word"]


def test_other_kinds_are_refused(bench):
    with pytest.raises(ValueError, match="R3"):
        residuals.study_residuals(bench, "R3")

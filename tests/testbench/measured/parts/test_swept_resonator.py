"""Sweeps: the envelope against scipy's integrator; memory of a fast sweep and a spring that bends are told apart."""

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.measured.exam import exam
from testbench.measured.parts import swept_mode, swept_resonator
from tests.testbench.measured.parts import recordings

F = 1e6 + 20.0 * np.arange(120)
F0, G = 1e6 + 900.0, 2 * np.pi * 60.0


@pytest.mark.parametrize("more", [{}, {"stiff": 40.0}, {"damp": 300.0}])
def test_the_envelope_is_the_integrated_one(more):
    """Four substeps of second order: better than a thousandth of the response."""
    expected = recordings.swept(F, F0, G, 1.0, 0.0, 1000.0, **more)
    effects = {"sweep_rate": 1000.0, "duffing": more.get("stiff", 0.0), "damping_cubic": more.get("damp", 0.0)}
    found = swept_mode.envelope(F, F0, G, effects) * G / 2
    assert np.max(np.abs(found - expected)) < 1e-3 * np.max(np.abs(expected))


def test_a_slow_sweep_is_the_settled_response():
    slow = swept_mode.envelope(F, F0, G, {"sweep_rate": 0.5})
    still = swept_mode.envelope(F, F0, G, {})
    assert np.max(np.abs(slow - still)) < 5e-3 * np.max(np.abs(still))
    bent = swept_mode.envelope(F, F0, G, {"duffing": 20.0}) * G / 2
    np.testing.assert_allclose(bent, recordings.swept(F, F0, G, 1.0, 0.0, stiff=20.0), atol=1e-6)


def sweeps(folder, names, seed, **law):
    rng = np.random.default_rng(seed)
    out = []
    for k, name in enumerate(names):
        s = recordings.swept(F, F0 + 137.0 * k, G * (1 + 0.1 * k), 0.3 * np.exp(1j), 0.02 - 0.01j, **law)
        s = s + 2e-5 * (rng.normal(size=len(F)) + 1j * rng.normal(size=len(F)))
        out.append(recordings.touchstone(folder / name, F, s, date=f"2025-01-0{k + 1} 10:00"))
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "name", "value"),
    [
        ({"points_per_s": 800.0}, "sweep_rate", 800.0),
        ({"stiff": 30.0}, "duffing", 30.0),
        ({"damp": 200.0}, "damping_cubic", 200.0),
    ],
)
def test_a_planted_law_is_found_under_any_file_name(tmp_path, law, name, value):
    found = exam.run_staged_search(swept_resonator.opener(sweeps(tmp_path, ("q.s2p", "no_name"), 3, **law), {}), 1)
    (effect,) = found.json["effects"]
    assert effect["law"] == name
    assert abs(effect["value"] - value) < 0.01 * value
    assert all(r["after"] < 3 * r["floor"] < r["before"] for r in found.json["heldout"].values())


def test_nothing_is_found_where_nothing_is(tmp_path):
    for seed in range(4):
        folder = tmp_path / str(seed)
        folder.mkdir()
        found = exam.run_staged_search(swept_resonator.opener(sweeps(folder, ("a", "b"), seed), {}), 1)
        assert found.json["effects"] == []


def test_sweeps_of_other_frequencies_are_refused(tmp_path):
    a = recordings.touchstone(tmp_path / "a", F, np.full(len(F), 0.1 + 0j))
    b = recordings.touchstone(tmp_path / "b", F + 1e6, np.full(len(F), 0.1 + 0j))
    with pytest.raises(FileError, match="frequencies differ"):
        swept_resonator.opener([a, b], {})


def test_a_step_of_the_analyser_is_seen_in_s11():
    s11 = np.full(120, 0.01 + 0j) + 1e-6 * np.random.default_rng(0).normal(size=120)
    assert swept_resonator.analyser_step(s11) is None
    s11[60:] += 1e-3
    assert swept_resonator.analyser_step(s11) == 60


def test_images_of_a_peak_are_told_from_a_rest_without():
    rng = np.random.default_rng(5)
    f = np.arange(-6000.0, 9000.0, 10.0)
    slope = 1.0 / (1.0 + (f / 1000.0) ** 2)  # the rest falls with the distance from the peak
    noise = rng.exponential(size=len(f))
    comb = 1.0 + 3.0 * (np.abs((f / 1059.0 + 0.5) % 1.0 - 0.5) < 0.08)
    ratio, p = swept_mode.images(f, slope * noise * comb, 1059.0)
    assert ratio > 2.0
    assert p < 0.05
    ratio, p = swept_mode.images(f, slope * noise, 1059.0)
    assert ratio < 1.3
    assert p > 0.05


def test_a_rest_across_the_response_is_its_phase():
    rng = np.random.default_rng(6)
    response = 700.0 * np.exp(-np.linspace(0, 6, 400) + 1j * np.linspace(0, 90, 400))
    noise = 0.5 * (rng.normal(size=400) + 1j * rng.normal(size=400))
    walk = 1e-3 * np.cumsum(rng.normal(size=400))
    share, p, phase = swept_mode.across(1j * walk * response + noise, response)
    assert share > 0.8
    assert p < 0.01
    strong = np.abs(response) > 0.1 * np.abs(response).max()
    weight = np.abs(response[strong]) ** 2
    assert phase == pytest.approx(np.sqrt(np.sum(walk[strong] ** 2 * weight) / weight.sum()), rel=0.1)
    assert swept_mode.across(noise, response)[1] > 0.05


@pytest.mark.parametrize("phase", [0.0, 3e-3])
def test_what_two_sweeps_do_not_share_is_their_repeatability(tmp_path, phase):
    """Level, path and 0.05 Hz differ, which is no lack of repeats; noise and a phase that jumps from row to row are."""
    rng, paths, apart = np.random.default_rng(7), [], []
    for n in range(2):
        s = recordings.swept(F, F0 + 0.05 * n, G, 0.3 * np.exp(1j + 0.1j * n), 0.0, 800.0)
        added = s * (np.exp(1j * phase * rng.normal(size=len(F))) - 1)
        added += 2e-5 * (rng.normal(size=len(F)) + 1j * rng.normal(size=len(F)))
        apart.append(np.mean(np.abs(added[1::2]) ** 2))
        s = s + added + 0.02 - 0.01 * n
        paths.append(recordings.touchstone(tmp_path / str(n), F, s, date=f"2025-01-0{n + 1} 10:00"))
    problem = swept_resonator.opener(paths, {})
    values = problem.nuisance_values(exam.fit_nested_laws(problem, ["sweep_rate"])[-1].point.theta)
    (found,) = problem.repeatability(values, {"sweep_rate": 800.0}).values()
    expected = pytest.approx(1e3 * np.sqrt(np.mean(apart) / 2), rel=0.25)
    assert found == expected
    judged = problem.pieces[1]
    assert problem.any_waveform(judged, values, {"sweep_rate": 800.0}) == expected, "it changes from step to step"
    if not phase:  # a receiver that misses the first half of each step does not: a waveform takes that
        late = problem.predict_rows(judged, values, {"sweep_rate": 800.0, "receiver_wait": 0.5})
        rest = (late - problem.predict_rows(judged, values, {"sweep_rate": 800.0}))[judged.scored]
        moved = judged._replace(rows=judged.rows + late - problem.predict_rows(judged, values, {"sweep_rate": 800.0}))
        assert problem.any_waveform(moved, values, {"sweep_rate": 800.0}) < 0.1 * rest.std()
    a, b = sweeps(tmp_path, ("a", "b"), 3), sweeps(tmp_path, ("c", "d"), 3)
    assert swept_resonator.opener([a[0], b[0]], {}).repeatability(values, {"sweep_rate": 800.0}) == {}

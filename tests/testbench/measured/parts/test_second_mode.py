"""A second resonance in a sweep's window: sweeps are sums of Lorentzians and noise, written here."""

import numpy as np
import pytest

from testbench.measured.exam import exam
from testbench.measured.parts import second_mode, swept_resonator
from tests.testbench.measured.parts import recordings

SD = 2e-5


def simulated(folder, seed, sigmas=0.0, names=("a", "b")):
    """(paths, f2, full width w2; Hz): two sweeps of one peak; places, widths, phases and noise are drawn.

    sigmas   of the second mode by itself: root of the sum of its squares over the noise of one part
    """
    rng = np.random.default_rng([seed, 26])
    n, step = int(rng.integers(100, 240)), 20.0
    f = 1e6 + step * np.arange(n)
    w1, w2 = rng.uniform(2, 6) * step, rng.uniform(3, 8) * step
    f1 = f[0] + rng.uniform(0.3, 0.45) * n * step
    f2 = f1 + rng.uniform(3, 5) * (w1 + w2) / 2
    first, second = 0.03 * np.exp(2j * np.pi * rng.random()), np.exp(2j * np.pi * rng.random())
    paths = []
    for k, name in enumerate(names):
        moved = rng.uniform(-1, 1) * step if k else 0.0
        peak, other = (1 / (1 + 2j * (f - at - moved) / w) for at, w in ((f1, w1), (f2, w2)))
        size = sigmas * SD / np.linalg.norm(other)
        s = 0.02 - 0.01j + 1e-3 * (f - f[0]) / np.ptp(f) + first * peak + size * second * other
        s = s + SD * (rng.normal(size=n) + 1j * rng.normal(size=n))
        paths.append(recordings.touchstone(folder / f"{seed}{name}", f, s, date=f"2025-01-0{k + 1} 10:00"))
    return paths, f2, w2


def opened(folder, seed, sigmas=0.0):
    return swept_resonator.opener(simulated(folder, seed, sigmas)[0], {})


def test_a_mode_of_20_sigma_is_found_with_its_frequency_and_width(tmp_path):
    """40 numbers with intervals of 95 %: 90 % of them hold the truth."""
    z = []
    for seed in range(20):
        paths, f2, w2 = simulated(tmp_path, seed, 20.0)
        second = swept_resonator.opener(paths, {}).second
        assert second is not None, seed
        z += [(second.f_hz - f2) / second.sd[0], (second.ln_g - np.log(2 * np.pi * w2)) / second.sd[1]]
    assert np.mean(np.abs(z) < 1.96) >= 0.9


def test_with_the_mode_nothing_is_missing_and_without_it_something_is(tmp_path, monkeypatch):
    problem = opened(tmp_path, 3, 20.0)
    assert any("a second mode at" in note for note in problem.notes)
    found = exam.run_staged_search(problem, 1).json
    assert (found["verdict"], found["effects"]) == ("none", [])
    monkeypatch.setattr(second_mode, "ALPHA", 1e-200)
    blind = opened(tmp_path, 3, 20.0)
    assert blind.second is None
    assert exam.run_staged_search(blind, 1).json["p_global"] < 0.01


def test_one_file_chooses_on_the_rows_that_are_fitted(tmp_path):
    paths, f2, _ = simulated(tmp_path, 5, 40.0, ("a",))
    problem = swept_resonator.opener(paths, {})
    assert abs(problem.second.f_hz - f2) < 4 * problem.second.sd[0]
    n = len(problem.pieces[0].rows) // 2
    rows = problem.pieces[0].rows.copy()
    rows[problem.pieces[1].scored] = 0.0  # what judges
    s = 1e-3 * (rows[:n] + 1j * rows[n:])
    used = problem.pieces[0].scored[problem.pieces[0].scored < n]
    sd = 1e-3 * problem.pieces[0].floor
    again = second_mode.choose(problem.columns, problem.pieces[0], s, used, problem.second.q[:2], sd)
    assert again.f_hz == pytest.approx(problem.second.f_hz, abs=0.1 * problem.second.sd[0])


def test_single_modes_have_no_second(tmp_path):
    assert [seed for seed in range(100, 120) if opened(tmp_path, seed).second] == []


@pytest.mark.parametrize(
    "law", [{"points_per_s": 300.0}, {"stiff": 0.03}, {"stiff": 1.0}, {"damp": 0.3}, {"damp": 10.0}]
)
def test_what_the_first_mode_does_is_no_second(tmp_path, law):
    f, rng = 1e6 + 20.0 * np.arange(120), np.random.default_rng(1)
    s = recordings.swept(f, 1e6 + 900.0, 2 * np.pi * 60.0, 0.3 * np.exp(1j), 0.02 - 0.01j, **law)
    s = s + SD * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f)))
    assert swept_resonator.opener([recordings.touchstone(tmp_path / "a", f, s)], {}).second is None


@pytest.mark.slow
def test_40_single_modes_raise_no_alarm(tmp_path):
    """At most 2 % of them: of 40, none."""
    for seed in range(40):
        problem = opened(tmp_path, seed)
        found = exam.run_staged_search(problem, 1).json
        assert (problem.second, found["verdict"], found["effects"]) == (None, "none", []), seed

"""Driven resonators: free run against scipy-free Runge-Kutta, repeats as noise, planted laws under any file name."""

import numpy as np
import pytest

from testbench.errors import ConfigError
from testbench.measured.exam import exam
from testbench.measured.formats import input_output
from testbench.measured.models import mode, splits
from testbench.measured.parts import driven_resonator
from tests.testbench.measured.parts import recordings

FS = recordings.FS_HZ


def free_run(u, f, q, effects):
    n = driven_resonator.TICKS
    wide = mode.upsample(u, n)
    laws = mode.laws(effects, f, driven_resonator.TERMS)
    return mode.run(f, q, (2 * np.pi * f) ** 2, wide, laws, 1 / (FS * n), n, (0.0, 0.0))


@pytest.mark.parametrize(
    ("effects", "force"),
    [
        ({}, lambda x, v: 0.0),
        ({"duffing": 4.0}, lambda x, v: 4.0 * x**3),
        ({"damping_quadratic": 0.3}, lambda x, v: 0.3 * v * abs(v)),
    ],
)
def test_the_plants_mode_runs_free_like_an_integrator(effects, force):
    """The rest is the interpolation of the input: straight between eighths of a sample, 0.6 % of a force at 200 Hz."""
    u = recordings.multisine(800, np.random.default_rng(0), 200)
    u[:100] *= np.linspace(0, 1, 100) ** 2  # begins at rest
    expected = recordings.driven(u, 69.0, 10.0, force, np.random.default_rng(0), 0.0, 8)
    found = free_run(u, 69.0, 10.0, effects)
    middle = slice(20, 780)
    assert np.std((found - expected)[middle]) < 3e-3 * np.std(expected)


def test_repeats_of_the_input_are_found_and_give_the_noise():
    rng = np.random.default_rng(1)
    period = recordings.multisine(1024, rng, 160)
    u = np.concatenate([0.02 * rng.normal(size=3000), np.tile(period, 6), 0.02 * rng.normal(size=3000)])
    ((first, length, count),) = driven_resonator.periodic(u)
    assert length in (512, 1024)
    assert 3000 - 512 < first < 3000 + 512
    assert count >= 4
    y = np.convolve(u, [1, 0.5], "same") + 3e-4 * rng.normal(size=len(u))
    record = input_output.InputOutput("", u, y, FS, False)
    noise = np.concatenate(driven_resonator.repeated_noise(record))
    assert abs(np.std(noise) - 0.3) < 0.05
    assert driven_resonator.periodic(rng.normal(size=20000)) == []


def test_an_unknown_record_is_split_in_time_and_the_official_split_goes_by_bytes():
    plan = splits.split("00", 1000)
    assert (plan.fit, plan.validate, plan.exam) == ({"first": (0, 600)}, {"then": (600, 800)}, {"last": (800, 1000)})
    (digest,) = splits.OFFICIAL
    official = splits.split(digest, 131072)
    used = [*official.fit.values(), *official.validate.values()]
    tests = list(official.exam.values())
    assert all(b <= c or d <= a for a, b in used for c, d in tests)
    assert all(40650 <= a < b <= 105712 for a, b in used)
    assert set(official.exam) == {"multisine", "arrow_full", "arrow_no_extrapolation"}


def record(folder, name, force, seed, samples=7000):
    rng = np.random.default_rng(seed)
    u = recordings.multisine(samples, rng, 400, 0.03) + 0.004
    y = recordings.driven(u, 68.0, 10.0, force, rng, 1.5e-4, 4) + 0.002
    return recordings.matlab(folder / name, u, y)


@pytest.mark.parametrize(
    ("force", "law", "value"),
    [
        (lambda x, v: 3.0 * x**3, "duffing", 3.0),
        pytest.param(lambda x, v: 0.5 * abs(v) * v, "damping_quadratic", 0.5, marks=pytest.mark.slow),
    ],
)
def test_a_planted_law_is_found_under_any_file_name(tmp_path, force, law, value):
    problem = driven_resonator.opener([record(tmp_path, "anything", force, 2)], {})
    found = exam.run_staged_search(problem, 1)
    (effect,) = found.json["effects"]
    assert effect["law"] == law
    assert abs(effect["value"] - value) < 0.05 * value


def test_other_files_and_rates(tmp_path):
    path = record(tmp_path, "x", lambda x, v: 0.0, 3, 5000)
    assert driven_resonator.opener([path], {"fs_hz": "1000"}).fs_hz == 1000
    with pytest.raises(ConfigError, match="fs_hz"):
        driven_resonator.opener([path], {"fs_hz": "-1"})
    (tmp_path / "t").write_text("no")
    assert driven_resonator.opener([tmp_path / "t"], {}) is None
    assert driven_resonator.jobs([path, tmp_path / "t"]) == [("free run", [path], {})]

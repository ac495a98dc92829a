"""Ring-downs: the averaged laws are the plant's, planted laws are found whatever files are called, nulls stay nulls."""

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.measured.exam import exam
from testbench.measured.models import mode
from testbench.measured.parts import ringdown, ringdown_stretch
from tests.testbench.measured.parts import recordings

T = np.arange(600) * 0.12
LAWS = {
    "damping_cubic": lambda c: lambda p: c * p**2,
    "damping_quadratic": lambda c: lambda p: c * p**1.5,
    "coulomb_friction": lambda c: lambda p: c * np.sqrt(max(p, 0.0)),
}


def runs(folder, names, law, seed, rate=0.08):
    """Files of one sample, excited to different powers (uW)."""
    rng = np.random.default_rng(seed)
    out = []
    for k, (name, start) in enumerate(zip(names, (4.0, 2.5, 3.2, 5.0))):
        p = recordings.decay(T, start, rate, law, rng)
        out.append(recordings.ring(folder / name, "sample", k + 1, T, p))
    return out


@pytest.mark.parametrize(
    ("text", "name", "exponent"), [("x^2 vx", "damping_cubic", 2.0), ("abs(vx) vx", "damping_quadratic", 1.5)]
)
def test_the_envelope_is_the_plants_mode_with_the_same_law(text, name, exponent):
    """F = -k c x^2 v/w gives dP/dt = -(c w/4) P^2 with P = A^2; |v| v/w^2 gives (8 c w/(3 pi)) P^1.5."""
    f, q, ticks, fs, n = 100.0, 300.0, 64, 2000.0, 8000
    c = 0.02
    laws = mode.laws({"law": c}, f, {"law": text})
    zero = np.zeros(n * ticks)
    x = mode.run(f, q, 0.0, zero, laws, 1.0 / (fs * ticks), ticks, (1.0, 0.0))
    w = 2 * np.pi * f
    v = np.gradient(x, 1.0 / fs) / w  # the amplitude needs no better derivative: it is averaged over a period
    period = int(fs / f)
    power = np.convolve(x * x + v * v, np.ones(period) / period, "valid")
    rate = {2.0: c * w / 4, 1.5: 8 * c * w / (3 * np.pi)}[exponent]
    t = np.arange(len(power)) / fs
    level = ringdown.UW_DBM + 10 * np.log10(power[0])
    expected = ringdown.power_dbm(t, level, w / q, {name: rate})
    measured = ringdown.UW_DBM + 10 * np.log10(power)
    linear = ringdown.power_dbm(t, level, w / q, {})
    assert np.max(np.abs(measured - expected)) < 0.03 * np.max(np.abs(linear - expected))


@pytest.mark.parametrize(
    ("law", "c"),
    [
        ("damping_cubic", 0.06),
        pytest.param("damping_quadratic", 0.06, marks=pytest.mark.slow),
        pytest.param("coulomb_friction", 0.01, marks=pytest.mark.slow),
    ],
)
def test_a_planted_law_is_found_under_any_file_name(tmp_path, law, c):
    names = ("b.txt", "no_name", "a.dat", "measID_9_sampleID_else.txt")
    paths = runs(tmp_path, names, LAWS[law](c), 5)
    found = exam.run_staged_search(ringdown.opener(paths, {}))
    assert [e["law"] for e in found.json["effects"]][:1] == [law]
    effect = found.json["effects"][0]
    assert abs(effect["value"] - c) < 5 * effect["sd"]
    row = found.json["heldout"]
    assert all(r["after"] < 0.5 * r["before"] for r in row.values())


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is(tmp_path):
    """Six recordings of a linear mode: none has an effect."""
    for seed in range(6):
        folder = tmp_path / str(seed)
        folder.mkdir()
        paths = runs(folder, ("a", "b", "c", "d"), lambda p: 0.0 * p, 100 + seed)
        assert exam.run_staged_search(ringdown.opener(paths, {})).json["effects"] == []


def clean(folder, seed):
    t, p = recordings.clean_ring_down(np.random.default_rng([26, seed]))
    return recordings.ring(folder / f"clean {seed}", "s", 1, t, p)


@pytest.mark.parametrize("seed", range(6))
def test_an_ordinary_clean_ring_down_is_accepted(tmp_path, seed):
    problem = ringdown.opener([clean(tmp_path, seed)], {})
    assert all(len(p.scored) >= ringdown.FEWEST // 3 for p in problem.pieces)


@pytest.mark.slow
def test_of_fifty_clean_ring_downs_nearly_all_are_accepted_and_hardly_one_alarms(tmp_path):
    accepted, alarmed, named = 0, [], []
    for seed in range(50):
        try:
            problem = ringdown.opener([clean(tmp_path, seed)], {})
        except FileError:
            continue
        found = exam.run_staged_search(problem).json
        accepted += 1
        alarmed += [seed] if found["verdict"] != "none" else []
        named += found["effects"]
    print(f"{accepted} of 50 accepted, alarms: {alarmed}")
    assert accepted >= 0.95 * 50
    assert len(alarmed) <= 0.02 * 50
    assert named == []


def test_noise_of_a_decay_has_level_and_colour_of_what_was_drawn():
    rng, n, rate = np.random.default_rng(3), 2000, 0.01
    t, level = np.arange(n) * 0.1, 0.02 * 10 ** (rate * np.arange(n) / 10)
    colour = np.zeros(n)
    for i in range(1, n):
        colour[i] = 0.7 * colour[i - 1] + np.sqrt(1 - 0.49) * rng.normal()
    found = ringdown_stretch.noise(t, -20 - rate * np.arange(n) + np.sqrt(level) * colour)
    assert found.sd[-1] == pytest.approx(np.sqrt(level[-1]), rel=0.1)
    assert found.sd[0] == pytest.approx(np.sqrt(level[0]), rel=0.3)
    assert found.a[0] == pytest.approx(0.7, abs=0.08)


def test_drive_floor_and_steps_of_the_receiver_are_left_out():
    rng = np.random.default_rng(1)
    t = np.arange(900) * 0.1
    p = np.where(t < 5, -20.0, np.maximum(-20.0 - 1.2 * (t - 5), -58.0)) + 0.05 * rng.normal(size=900)
    p[(t > 60) & (t < 65)] = -21.0
    a, b = ringdown_stretch.stretch(p)
    assert abs(t[a] - 5.0) < 1.0
    assert abs(t[b - 1] - (5 + 38 / 1.2)) < 1.5


def test_what_is_no_decay_is_refused(tmp_path):
    flat = recordings.ring(tmp_path / "f", "s", 1, T, -20 + 0.01 * np.random.default_rng(0).normal(size=len(T)))
    with pytest.raises(FileError, match="samples decay by"):
        ringdown.opener([flat], {})
    two = [recordings.ring(tmp_path / n, n, 1, T, -20 - T) for n in ("g", "h")]
    with pytest.raises(FileError, match="2 samples"):
        ringdown.opener(two, {})
    assert [len(paths) for _, paths, _ in ringdown.jobs(two)] == [1, 1]

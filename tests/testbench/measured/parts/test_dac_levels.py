"""Levels of a DAC: the plant's table against a formula, and what is found in sessions made by another formula."""

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from analog_frontend import dac_levels as kernel
from testbench.measured.exam.staged import add_in_stages
from testbench.measured.nulls import nulls
from testbench.measured.openers import open_problem
from testbench.measured.parts import dac_levels
from tests.testbench.measured.parts import made


def test_the_plants_table_is_ramps_steps_and_weights():
    code = np.arange(1 << 12)
    found = kernel.errors(["element 5/8 = -2.2", "step 3/4 = 0.5", "bit 7 = 0.1"], 12)
    wanted = -2.2 * np.clip(code / 512 - 4, 0, 1) + 0.5 * (code >= 2048) + 0.1 * (code >> 7 & 1)
    np.testing.assert_allclose(found, wanted, atol=1e-14)


def test_no_texts_are_bit_for_bit_nothing():
    assert kernel.design([], 16, 3e-4) is kernel.OFF
    assert not kernel.errors([], 12).any()


@pytest.mark.parametrize(
    "text", ["element 9/8 = 1", "element 1/3 = 1", "bit 12 = 1", "bit 1 = 100", "steps", "bit 1 = nan", 3]
)
def test_what_is_no_error_of_a_level_is_refused(text):
    with pytest.raises(ValueError, match="dac levels"):
        kernel.table([text], 12)


def sessions(folder, seed, **law):
    rng = np.random.default_rng(seed)
    return [made.levels(folder / f"any {k} {seed}.bin", rng, **law) for k in range(2)]


SEGMENTED = {
    "elements": [(k, 8, lsb) for k, lsb in enumerate((0.3, -0.4, 0.2, 0.5, -1.5, 0.3, 0.1, 0.4), 1)],
    "steps": [(k, 8, lsb) for k, lsb in enumerate((-0.2, 0.3, -0.25, 0.2, -0.3, 0.2, -0.2), 2)],
    "bits_lsb": [(4, 0.15), (3, -0.1)],
}


def off(coefficients, elements, bits_lsb, steps):
    """Largest distance of a step from the truth in sigmas, and rms (LSB) of the whole structure's from it."""
    place, code, truth = np.arange(512) / 64, np.arange(512), np.zeros(512)
    for k, _, lsb in elements:
        truth += lsb * np.clip(place - (k - 1), 0, 1)
    for k, _, lsb in steps:
        truth += lsb * (place >= k - 1)
    for b, lsb in bits_lsb:
        truth += lsb * (code >> b & 1)
    found = kernel.errors(dac_levels.levels_texts({n: c["value"] for n, c in coefficients.items()}, 9, 9), 9)
    # the ladder is cleared at a border: what its bits are too heavy by together is lost there
    cleared = sum(lsb for _, lsb in bits_lsb)
    sigmas = [
        abs(coefficients[f"step {k - 1}/8"]["value"] - (lsb - cleared)) / coefficients[f"step {k - 1}/8"]["sd"]
        for k, _, lsb in steps
    ]
    return max(sigmas), float(np.std(dac_levels.fit_line(found - truth)[0]))


def test_a_segmented_converter_is_one_law_whatever_the_files_are_called(tmp_path):
    problem = open_problem(sessions(tmp_path, 1, **SEGMENTED), {})
    found = add_in_stages(problem, most=1).json
    first = found["effects"][0]
    assert (found["verdict"], first["law"], first["port"]) == ("named", "8 segments above a ladder", "dac")
    sigmas, rms = off(first["coefficients"], **SEGMENTED)
    assert sigmas < 4
    assert rms < found["heldout"]["level"]["floor"]
    row = found["heldout"]["level"]
    assert row["after"] < 1.5 * row["floor"] < row["before"]


def alone(what, place, lsb, segments, names):
    """{coefficient: LSB} of one wrong weight, worked out by hand: errors at both sides of each border, less the line.

    bit        weighs too much: the carry into it is too large, those out of it into higher ones too small by as much
    segment    all later borders are off, less the line; nothing jumps
    border     jumps; those later are off, less the line
    """
    out = {}
    for name in names:
        kind, where = name.split()
        k = int(where.split("/")[0])
        if kind == "carry":
            out[name] = (lsb * ((k == place) - (k > place))) if what == "bits_lsb" else 0.0
            continue
        before, after = {
            "bits_lsb": (lsb, 0.0),
            "elements": (lsb * (k >= place * segments / 8),) * 2,
            "steps": tuple(lsb * (k + side > (place - 1) * segments / 8) for side in (-0.5, 0.5)),
        }[what]
        out[name] = (before + after) / 2 - lsb * k / segments if kind == "tap" else after - before
    return out


def one_wrong_weight_is_told(folder, what, place, lsb):
    entry = (place, lsb) if what == "bits_lsb" else (place, 8, lsb)
    found = add_in_stages(open_problem(sessions(folder, 1, **{what: [entry]}), {}), most=1).json
    law = found["effects"][0]
    assert (found["verdict"], law["law"].split(" ", 1)[1]) == ("named", "segments above a ladder")
    c, segments = law["coefficients"], int(law["law"].split()[0])
    wanted = alone(what, place, lsb, segments, c)
    assert sum(abs(v) > 0 for v in wanted.values()) < len(c), "some coefficients say that there is nothing else"
    z = {name: (c[name]["value"] - v) / c[name]["sd"] for name, v in wanted.items()}
    assert max(map(abs, z.values())) < 4, z
    # and no other weight says the same: each of them is refuted by these coefficients
    for other in range(1, 9):
        if other != place and (what != "bits_lsb" or other < 7):
            rival = alone(what, other, lsb, segments, c)
            if rival != wanted:
                assert max(abs(c[n]["value"] - v) / c[n]["sd"] for n, v in rival.items()) > 10, other


@pytest.mark.parametrize(("what", "place", "lsb"), [("bits_lsb", 4, 0.4), ("elements", 5, 0.6), ("steps", 5, -0.6)])
def test_one_wrong_weight_is_told_at_its_coefficient_and_only_there(tmp_path, what, place, lsb):
    one_wrong_weight_is_told(tmp_path, what, place, lsb)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "place", "lsb"),
    [("bits_lsb", b, -0.4) for b in (2, 3, 5)] + [("elements", k, -0.6) for k in (1, 3, 8)] + [("steps", 4, 0.6)],
)
def test_one_wrong_weight_at_other_places(tmp_path, what, place, lsb):
    one_wrong_weight_is_told(tmp_path, what, place, lsb)


def test_two_sessions_agree_on_every_coefficient(tmp_path):
    """Each session chooses once: 90 % of the coefficients within the stated intervals of both."""
    files = sessions(tmp_path, 6, **SEGMENTED)
    one, two = (
        add_in_stages(open_problem(files, {"fit": k}), most=1).json["effects"][0]["coefficients"] for k in ("1", "2")
    )
    z = [(one[n]["value"] - two[n]["value"]) / np.hypot(one[n]["sd"], two[n]["sd"]) for n in one]
    print(f"{np.mean(np.abs(z) < 1.96):.2f} of {len(z)} coefficients agree")
    assert np.mean(np.abs(z) < 1.96) >= 0.9


def test_the_texts_of_a_structure_are_the_sum_of_its_coefficients():
    rng = np.random.default_rng(0)
    values = {name: float(rng.normal()) for name in dac_levels.members(8, 12)}
    whole = kernel.errors(dac_levels.levels_texts(values, 12, 12), 12)
    code = np.arange(1 << 12)
    place, hand = code / 512, np.zeros(1 << 12)
    for name, lsb in values.items():
        kind, where = name.split()
        k = int(where.split("/")[0])
        tent = np.clip(1 - np.abs(place - k), 0, None)
        if kind == "tap":
            hand += lsb * tent
        elif kind == "step":
            hand += lsb * np.where(place < k, -0.5, 0.5) * tent
        else:
            hand += lsb * ((code >> k & 1) - (code % (2 << k)) / (2 << k))
    np.testing.assert_allclose(whole, hand, atol=1e-3)


def test_sessions_without_an_effect_gain_none(tmp_path):
    problem = open_problem(sessions(tmp_path, 3), {})
    assert nulls(problem, 4) == [[]] * 4


def test_one_session_alone_is_traced_by_turns_and_names_candidates(tmp_path):
    found = add_in_stages(open_problem(sessions(tmp_path, 4, **SEGMENTED)[:1], {}), most=1).json
    assert found["verdict"] == "candidate"
    assert "segments above a ladder" in found["effects"][0]["law"]
    assert found["effects"][0]["status"] == "candidate"


def test_the_session_that_chooses_can_be_said(tmp_path):
    problem = open_problem(sessions(tmp_path, 5), {"fit": "2"})
    assert [s.role for s in problem.segments] == ["validate", "fit"]
    assert dac_levels.jobs(sessions(tmp_path, 5))[0][2]["fit"] == "2"


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("printed_lsb", [0.25, 0.7])
def test_the_floor_of_levels_is_never_below_their_print(tmp_path, count, printed_lsb):
    """20 V of 13 bits: means of eight levels would average a print that they share."""
    paths, step_v = [], printed_lsb * 20 / (1 << 13)
    for k in range(count):
        path = made.levels(tmp_path / f"{k}.mat", np.random.default_rng(k), bits=13, noise_lsb=0.3, drift_lsb=0.01)
        savemat(path, {"A": np.round(loadmat(path)["A"] / step_v) * step_v})
        paths.append(path)
    problem = open_problem(paths, {})
    floors = [problem.repeatability_rms(k)["level"] for k in range(len(problem.segments))]
    assert min(floors) >= printed_lsb / np.sqrt(12) * (1 - 1e-3)  # the slope of the line is not exactly 1 LSB
    assert max(floors) < 3 * printed_lsb

"""Levels of a DAC: the plant's table against a formula, and what is found in sessions made by another formula."""

import numpy as np
import pytest

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


def test_an_element_is_named_whatever_the_files_are_called(tmp_path):
    problem = open_problem(sessions(tmp_path, 1, elements=[(3, 8, 1.5)]), {})
    found = add_in_stages(problem, most=4).json
    first = found["effects"][0]
    assert (found["verdict"], first["law"], first["port"]) == ("named", "element 3/8", "dac")
    assert abs(first["value"] - 1.5) < 4 * first["sd"] + 0.02
    row = found["heldout"]["level"]
    assert row["after"] < 1.5 * row["floor"] < row["before"]


def test_another_effect_is_another_name(tmp_path):
    found = add_in_stages(open_problem(sessions(tmp_path, 2, bits_lsb=[(7, 0.8)], variable="B"), {}), most=4).json
    assert found["effects"][0]["law"] == "bit 7"


def test_sessions_without_an_effect_gain_none(tmp_path):
    problem = open_problem(sessions(tmp_path, 3), {})
    assert nulls(problem, 4) == [[]] * 4


def test_one_session_alone_is_traced_by_turns(tmp_path):
    found = add_in_stages(open_problem(sessions(tmp_path, 4, elements=[(3, 8, 1.5)])[:1], {}), most=2).json
    assert found["effects"][0]["law"] == "element 3/8"


def test_the_session_that_chooses_can_be_said(tmp_path):
    problem = open_problem(sessions(tmp_path, 5), {"fit": "2"})
    assert [s.role for s in problem.segments] == ["validate", "fit"]
    assert dac_levels.jobs(sessions(tmp_path, 5))[0][2]["fit"] == "2"

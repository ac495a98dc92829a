"""Whole traces of toy problems: verdicts, numbers, no NaN."""

import json

import pytest

from testbench.tracing.trace import Options, trace
from tests.testbench.tracing.toys import Toy

QUICK = Options(n_null=499)


def test_the_cause_is_named_and_the_held_out_error_falls_to_the_floor():
    result = trace(Toy(5, {"feed": 0.2}), QUICK)
    data = result.to_json()
    json.dumps(data, allow_nan=False)
    assert data["verdict"] == "named"
    (effect,) = data["effects"]
    assert effect["law"] == "feed"
    assert effect["value"] == pytest.approx(0.2, abs=4 * effect["sd"])
    row = data["heldout"]["a"]
    assert row["after"] < 1.06 * row["floor"] < row["before"]

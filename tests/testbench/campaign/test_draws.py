"""Values of axes: exact ends, draws that depend on their own number alone, laws of the draws, one line per mistake."""

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbench.campaign.plan.draws import FORMS, Spec, draw_value, uniform
from testbench.errors import ConfigError


def values(spec, count=None, seed=1):
    return Spec("plant.fx_hz", spec, "here").values(count, seed)


def test_lists_and_ranges():
    assert values([3, 1, 2]) == [3, 1, 2]
    assert values({"range": [1, 4]}) == [1, 2, 3, 4]
    assert values({"range": [10, 1, -4]}) == [10, 6, 2]
    assert values({"range": [5, 5]}) == [5]


def test_even_spacing_is_decimal():
    assert values({"linspace": [0, 1, 11]})[3] == 0.3, "0 + 3 * 0.1 is 0.30000000000000004"
    assert values({"linspace": [-40, 85, 6]}) == [-40.0, -15.0, 10.0, 35.0, 60.0, 85.0]
    assert values({"linspace": [7, 9, 1]}) == [7.0]
    assert values({"logspace": [1e-3, 10, 5]}) == [0.001, 0.01, 0.1, 1.0, 10.0]
    assert values({"logspace": [2, 9, 1]}) == [2.0]


@given(
    st.sampled_from(["normal", "uniform", "lognormal"]), st.integers(0, 2**60), st.integers(1, 50), st.integers(0, 49)
)
def test_a_draw_depends_on_its_own_number_alone(kind, seed, count, k):
    spec = {kind: [1.5, 2.5]}
    more = values(spec, count + 20, seed)
    assert values(spec, count, seed) == more[:count]
    if k < count:
        assert more[k] == draw_value(kind, 1.5, 2.5, seed, "plant.fx_hz", k)


def test_parameters_and_seeds_are_different_draws():
    drawn_values = {uniform(seed, path, k) for seed in range(5) for path in ("a.b", "a.c") for k in range(50)}
    assert len(drawn_values) == 500


def test_laws_of_the_draws():
    n = 4000
    normal = values({"normal": [10.0, 2.0]}, n)
    assert abs(statistics.fmean(normal) - 10) < 4 * 2 / math.sqrt(n)
    assert abs(statistics.stdev(normal) / 2 - 1) < 4 / math.sqrt(2 * n)
    flat = values({"uniform": [-1, 3]}, n)
    assert -1 < min(flat) < -1 + 40 / n < 3 - 40 / n < max(flat) < 3
    assert abs(statistics.fmean(flat) - 1) < 4 * 4 / math.sqrt(12 * n)
    logs = [math.log(v / 5) for v in values({"lognormal": [5, 0.2]}, n)]
    assert abs(statistics.fmean(logs)) < 4 * 0.2 / math.sqrt(n)
    assert abs(statistics.stdev(logs) / 0.2 - 1) < 4 / math.sqrt(2 * n)
    assert set(values({"integers": [3, 6]}, n)) == {3, 4, 5, 6}
    assert values({"normal": [5, 0]}, 2) == [5.0, 5.0]
    assert values({"lognormal": [5, 0]}, 2) == [5.0, 5.0]


def test_limits_draw_again_and_change_no_other():
    free, kept = values({"normal": [0, 1]}, 300), values({"normal": [0, 1], "limits": [-1, 1]}, 300)
    assert all(-1 <= v <= 1 for v in kept)
    assert all(b == a for a, b in zip(free, kept) if -1 <= a <= 1)
    assert any(not -1 <= a <= 1 for a in free)


MISTAKES = [
    ([], "has no values"),
    (5, "is not a list of values"),
    ({"linspce": [1, 2, 3]}, "linspce is not one of"),
    ({}, "give exactly one of"),
    ({"normal": [0, 1], "uniform": [0, 1]}, "give exactly one of"),
    ({"linspace": [1, 2]}, f"linspace = {FORMS['linspace']}"),
    ({"normal": [1, 2, 3]}, f"normal = {FORMS['normal']}"),
    ({"normal": ["1 kHz", 2]}, "is not a number"),
    ({"normal": [math.inf, 2]}, "is not finite"),
    ({"normal": [1, -2]}, "spread -2 is below 0"),
    ({"uniform": [2, 1]}, "low is above high"),
    ({"lognormal": [0, 1]}, "median 0 is not above 0"),
    ({"logspace": [0, 1, 3]}, "both ends above 0"),
    ({"linspace": [0, 1, 2**31]}, "count 2147483648 is not an integer in 1 .. 1000000"),
    ({"range": [0, 2**31]}, "has more than 1000000 values"),
    ({"linspace": [0, 1, 0]}, "count 0 is not an integer in 1 .. 1000000"),
    ({"linspace": [0, 1, 2.5]}, "count 2.5 is not an integer in 1 .. 1000000"),
    ({"range": [1, 2.5]}, "2.5 is not an integer"),
    ({"range": [3, 1]}, "has no values"),
    ({"range": [1, 3, 0]}, "has no values"),
    ({"integers": [1.0, 3]}, "1.0 is not an integer"),
    ({"range": [1, 3], "limits": [0, 1]}, "limits apply to draws only"),
    ({"normal": [0, 1], "limits": [0]}, "limits must be a list [low, high]"),
    ({"normal": [0, 1], "limits": [50, 60]}, "gave no value within limits"),
]


@pytest.mark.parametrize(("spec", "text"), MISTAKES)
def test_one_line_for_a_mistake(spec, text):
    with pytest.raises(ConfigError) as caught:
        values(spec, 3)
    assert str(caught.value).startswith("here ")
    assert text in str(caught.value)

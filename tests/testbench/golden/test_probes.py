"""Probes: a probed step is the step, and each kind of place tells its outcomes apart."""

import importlib
from types import SimpleNamespace

import pytest

from fpga_model.fixed import clamp, floor, half_up, wrap, wrap_unsigned
from testbench.flatten import leaves
from testbench.golden.coverage import probes
from testbench.golden.stimulus import blocks
from tests.testbench.golden.benching import made, one_case

CASES = [(stem, case) for stem, block in blocks.BLOCKS.items() for case in block.cases]


@pytest.mark.parametrize(("stem", "case"), one_case(CASES))
def test_a_probed_step_gives_the_registers_of_the_compiled_one(stem, case):
    block = blocks.BLOCKS[stem]
    rows, _ = made(stem, case)
    rows = rows[:: max(1, len(rows) // 1500)]
    regs, _ = blocks.run(block, case, rows)
    found = probes.build_probed_step(block, case)
    state = block.state
    for n, row in enumerate(rows.tolist()):
        assert [int(value) for _, value in leaves(state)] == regs[n].tolist(), f"row {n}"
        state = probes.follow(block, case, found, [row], state)


def _toy(p, a, b):
    if p > 3:
        c = a if a < b else b
    elif p == 2 and b:
        c = half_up(a, p)
    else:
        c = _helper(a, p) + _helper(b, p)
    return clamp(c, -5, 5) if not a == b else wrap(c, 4) + wrap_unsigned(c, 4)


def _helper(x, n):
    return x >> n if x & 1 else floor(x, n)


def toy(p):
    """The toy as a module of the firmware: its helpers are copied as those of the firmware are."""
    module = SimpleNamespace(step=_toy, __name__="fpga_model.toy")
    _toy.__module__ = _helper.__module__ = "fpga_model.toy"
    return probes.Probed(module, {"p": p})


@pytest.mark.parametrize("p", [1, 2, 5])
def test_a_probed_function_gives_the_same_values(p):
    found = toy(p)
    for a in range(-9, 10):
        for b in range(-9, 10):
            assert found.step(p, a, b) == _toy(p, a, b)
    assert found.reached_goals() <= set(found.goals())


def test_a_branch_on_parameters_is_no_place_and_its_dead_side_neither():
    names = set(toy(5).sites)
    assert any("a < b" in name for name in names)
    assert not any("p > 3" in name or "half_up" in name or "_helper" in name for name in names)
    names = set(toy(2).sites)
    assert {"toy: b", "toy: half_up(a, p)"} <= names
    assert not any("a < b" in name or "p == 2" in name for name in names)


def test_each_call_has_places_of_its_own():
    found = toy(1)
    assert {"toy > _helper: x >> n", "toy > _helper#2: x >> n"} <= set(found.sites)
    found.step(1, 1, 2)
    assert found.sites["toy > _helper: x & 1"].reached_outcomes == {"yes"}
    assert found.sites["toy > _helper#2: x & 1"].reached_outcomes == {"no"}


ROUNDED = {
    0: {"zero"}, 1: {"one"}, 7: {"half-1"}, 8: {"tie+even"}, 9: {"half+1"}, 15: {"ones"}, 24: {"tie+odd"},
    -8: {"tie-odd"}, -24: {"tie-even"}, 5: set(), -16: {"zero"}, -1: {"ones"},
}  # fmt: skip


def outcomes(kind, call, *operands):
    seen = set()
    note = probes.PROBE_BY_FUNCTION[call][2](seen)
    note(*operands)
    assert probes.PROBE_BY_FUNCTION[call][0] == kind
    assert seen <= set(probes.PROBE_BY_FUNCTION[call][1])
    return seen


@pytest.mark.parametrize(("x", "expected"), ROUNDED.items())
def test_a_rounding_tells_its_edges_and_its_ties_apart(x, expected):
    assert outcomes("round", "half_up", x, 4) == expected


def test_one_bit_rounding_has_a_tie_at_1():
    assert outcomes("round", "half_up", 1, 1) == {"tie+even", "ones"}
    assert outcomes("round", "half_up", 6, 0) == set()


def test_a_clamp_tells_one_lsb_beyond_its_limits():
    found = {x: outcomes("clamp", "clamp", x, -3, 9) for x in range(-6, 13)}
    met = {x: names for x, names in found.items() if names}
    assert met == {-4: {"lo-1"}, -3: {"lo"}, -2: {"lo+1"}, 8: {"hi-1"}, 9: {"hi"}, 10: {"hi+1"}}


def test_a_wrap_tells_one_lsb_beyond_its_ends():
    found = {x: outcomes("wrap", "wrap", x, 3) for x in range(-7, 8)}
    assert {x: names for x, names in found.items() if names} == {-5: {"under"}, -4: {"lo"}, 3: {"hi"}, 4: {"over"}}
    found = {x: outcomes("wrap", "wrap_unsigned", x, 3) for x in range(-7, 12)}
    assert {x: names for x, names in found.items() if names} == {-1: {"under"}, 0: {"lo"}, 7: {"hi"}, 8: {"over"}}


def test_the_nearest_miss_of_a_watched_goal_is_kept():
    block = blocks.BLOCKS["isqrt"]
    goal = ("compare", "isqrt: pair >= trial", "0")
    found = probes.build_probed_step(block, "default", watched=goal)
    probes.follow(block, "default", found, [[0, 1, 9 << 28], [0, 0, 0]])
    assert found.nearest == 1
    found.clear()
    assert (found.nearest, found.reached_goals()) == (None, set())
    assert goal in found.goals()


def test_every_rounding_of_the_firmware_is_half_up_or_a_cut():
    """Another rule in a block would need a place of its own; today there is none."""
    for stem in blocks.BLOCKS:
        module = importlib.import_module(f"fpga_model.{stem}")
        others = {"ceil", "toward_zero", "half_down", "half_even", "half_away", "half_zero"}
        assert not others & set(vars(module)), stem

"""Planted faults are called by their name, and nothing else is: the diagnosis against designs that it did not build."""

import collections

import numpy as np
import pytest

from fpga_model.design_record import DEFAULT, Design
from testbench.golden.check.diagnose import Rows, diagnose
from testbench.golden.diagnosis.perturb import CAUSES
from testbench.golden.stimulus import blocks
from tests.testbench.golden import planted
from tests.testbench.golden.benching import made

SEEDS = (1, 2)


class Golden(dict):
    """{(block, seed): (names, rows)} of the right designs, each made when first asked for."""

    def __missing__(self, key):
        self[key] = planted.simulate(key[0], *planted.stimulus(*key), planted.NONE)
        return self[key]


@pytest.fixture(scope="module")
def golden():
    return Golden()


def rows_of(a, got=None):
    """`Rows` of a planted case, all rows counted."""
    got = a["got"] if got is None else got
    care = {name: np.ones(len(column), bool) for name, column in got.items()}
    return Rows(a["block"], a["params"], a["inputs"], a["expected"], got, care, design=a["design"])


def differs(a):
    return any(np.any(a["got"][name] != column) for name, column in a["expected"].items())


@pytest.mark.parametrize("block", planted.STEPS)
def test_the_planted_designs_without_a_fault_are_the_models(golden, block):
    """The oracle of this file is right: its rows are those of the golden step, register by register."""
    a = planted.case(block, 1, planted.NONE, golden[block, 1])
    assert diagnose(rows_of(a)) == []
    np.testing.assert_array_equal(golden[block, 1][1], planted.model_rows(block, 1))


# Faults that change a row, over both seeds: a stimulus that no longer shows a fault changes the number
PLANTED = {
    "modulator": 66,
    "pi": 78,
    "sine": 58,
    "dds": 76,
    "references": 36,
    "delay": 34,
    "spi_dac": 28,
    "spi_adc": 30,
}
QUICK = ("dds",)
EVERY = [block if block in QUICK else pytest.param(block, marks=pytest.mark.slow) for block in PLANTED]
# A register that is two clocks early lacks two registers: not one mistake of the list
LEFT_OUT = [("early", 2)]


def named(block, seed, golden, d=DEFAULT):
    """Counter of the planted faults that show: right, unknown, doubtful or left out; no wrong name may be certain."""
    count = collections.Counter()
    for fault in planted.faults(block, seed):
        a = planted.case(block, seed, fault, golden, d)
        if not differs(a):
            continue
        if (fault[0], fault[2]) in LEFT_OUT:
            count["left out"] += 1
            continue
        found = diagnose(rows_of(a))
        right = bool(found) and found[0].cause == fault[0]
        count["right" if right else "doubtful" if found else "unknown"] += 1
        assert right or not found or not found[0].sure, (seed, fault, found)
        if right and fault[0] == "rounding":
            assert fault[2] in found[0].what, (seed, fault, found)
    return count


@pytest.mark.slow
@pytest.mark.parametrize("block", PLANTED)
def test_planted_faults_are_named(golden, block):
    """At least 90 % right, and never a wrong name for certain."""
    count = sum((named(block, seed, golden[block, seed]) for seed in SEEDS), collections.Counter())
    assert count.total() == PLANTED[block]
    assert count["right"] >= 0.9 * (PLANTED[block] - count["left out"]), count


OTHER = Design(
    dds_bits=36,
    sine_address_bits=8,
    sine_fraction_bits=7,
    sine_bits=15,
    accumulator_fraction_bits=13,
    adc_divider=4,
    adc_word_bits=18,
    adc_channels=5,
    adc_tail_clocks=30,
)
# Faults of the first seed that change a row, in blocks whose formats follow the design
PLANTED_OTHER = {"pi": 39, "sine": 29, "dds": 38, "spi_adc": 15}


@pytest.mark.parametrize(
    "block", [pytest.param(b, marks=() if b in QUICK else pytest.mark.slow) for b in PLANTED_OTHER]
)
def test_planted_faults_are_named_in_another_design(block):
    golden = planted.simulate(block, *planted.stimulus(block, 1, OTHER), planted.NONE, OTHER)
    np.testing.assert_array_equal(golden[1], planted.model_rows(block, 1, OTHER))
    count = named(block, 1, golden, OTHER)
    assert count.total() == PLANTED_OTHER[block]
    assert count["right"] >= 0.9 * (PLANTED_OTHER[block] - count["left out"]), count


def test_the_planted_kinds_are_causes_of_the_list():
    kinds = {fault[0] for block in planted.STEPS for seed in SEEDS for fault in planted.faults(block, seed)}
    assert len(kinds) == 10
    assert kinds <= set(CAUSES)


@pytest.mark.parametrize("block", EVERY)
def test_faults_without_a_name_are_unknown(golden, block):
    """Glitches, a gain of 3/4, and a shift that begins half-way."""
    for seed in SEEDS:
        for what, got in planted.strangers(block, seed, golden[block, seed]):
            a = planted.case(block, seed, planted.NONE, golden[block, seed])
            found = diagnose(rows_of(a, dict(zip(golden[block, seed][0], got.T.copy()))))
            assert not any(cause.sure for cause in found) or what == "stuck", (seed, what, found)


def test_causes_that_give_the_same_rows_share_them():
    """A counter whose bit 2 is stuck at 0 is one of two bits: both are named, none for certain."""
    stim, _ = made("watchdog", "default")
    block = blocks.BLOCKS["watchdog"]
    inputs = dict(zip([p.name for p in block.columns], stim.T.copy()))
    params = {name: raw for name, raw, _ in blocks.case_parameters(block, "default")}
    registers, _ = blocks.run(block, "default", stim)
    expected = dict(zip([p.name for p in block.registers], registers.T.copy()))
    got = {name: np.zeros_like(column) for name, column in expected.items()}
    for n in range(len(stim) - 1):
        age = got["age"][n] + inputs["ce_1m"][n]
        cleared = inputs["rst"][n] or inputs["frame"][n]
        got["age"][n + 1] = 0 if cleared else age & ~4
        got["stale"][n + 1] = 0 if cleared else got["stale"][n] or age > params["limit"]
    care = {name: np.ones(len(stim), bool) for name in got}
    found = diagnose(Rows("watchdog", params, inputs, expected, got, care))
    assert {"stuck", "width"} <= {cause.cause for cause in found}
    assert {cause.register for cause in found} == {"age"}
    assert not any(cause.sure for cause in found)
    assert sum(cause.share for cause in found) <= 1.0


def test_rows_that_do_not_count_hide_nothing(golden):
    """As those of a reset that comes at once: with hidden registers they may hold anything."""
    a = planted.case("pi", 1, next(f for f in planted.faults("pi", 1) if f[0] == "rounding"), golden["pi", 1])
    rows = rows_of(a, {"y": a["got"]["y"].copy()})
    away = np.arange(5, len(rows.got["y"]), 50)
    rows.got["y"][away] += 1
    rows.care["y"][away] = False
    assert [cause.cause for cause in diagnose(rows)] == ["rounding"]


def test_a_log_of_one_register_gives_no_wrong_name(golden):
    for fault in planted.faults("dds", 1)[::9]:
        a = planted.case("dds", 1, fault, golden["dds", 1])
        last = list(a["got"])[-1]
        found = diagnose(rows_of(a, {last: a["got"][last]}))
        assert not found or found[0].cause == fault[0] or not found[0].sure, (fault, found)


def test_a_block_without_a_model_is_diagnosed_from_its_rows(golden):
    a = planted.case("dds", 1, ("late", "all", 2), golden["dds", 1]) | {"block": "somebody_else"}
    (found,) = diagnose(rows_of(a))
    assert (found.cause, found.what) == ("late", "all ports by 2 clocks")

"""Planted faults are called by their name, and nothing else is: the diagnosis against designs that it did not build."""

import collections

import numpy as np
import pytest

from fpga_model import fixed
from fpga_model.block import keys
from fpga_model.design_record import DEFAULT, Design
from testbench.golden.check import diagnose_nodes
from testbench.golden.check.diagnose import CAUSES, UNKNOWN, diagnose
from testbench.golden.check.diagnose_model import Model
from testbench.golden.check.diagnose_nodes import rounded
from testbench.golden.stimulus import blocks, stimulus
from tests.testbench.golden import planted
from tests.testbench.golden.benching import but_counting, made

SEEDS = (1, 2)


@pytest.fixture(scope="module")
def golden():
    """{(block, seed): (names, rows)} of the right designs."""
    out = {}
    for block in planted.STEPS:
        for seed in SEEDS:
            p, rows = planted.stimulus(block, seed)
            out[block, seed] = planted.simulate(block, p, rows, planted.NONE)
    return out


@pytest.mark.parametrize("block", planted.STEPS)
def test_the_planted_designs_without_a_fault_are_the_models(golden, block):
    """The oracle of this file is right: its rows are those of the golden step, register by register."""
    a = planted.case(block, 1, planted.NONE, golden[block, 1])
    assert diagnose(**a) is None
    model = planted.model_rows(block, 1)
    np.testing.assert_array_equal(golden[block, 1][1], model)


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


def test_enough_faults_are_planted():
    assert set(PLANTED) == set(planted.STEPS)
    assert sum(PLANTED.values()) >= 400


QUICK = ("dds", "delay")
EVERY = [block if block in QUICK else pytest.param(block, marks=pytest.mark.slow) for block in PLANTED]


def named(block, seed, golden, d=DEFAULT):
    """Counter of the planted faults that show, by whether they are named; none may have a wrong name."""
    count = collections.Counter()
    for fault in planted.faults(block, seed):
        found = diagnose(**planted.case(block, seed, fault, golden, d))
        if found is None:
            continue
        count[found.cause == fault[0]] += 1
        if found.cause == UNKNOWN:
            continue
        assert found.cause == fault[0], (seed, fault, found)
        if fault[0] == "rounding":
            assert fault[2] in found.what, (seed, fault, found)
        if fault[0] in ("late", "early"):
            assert found.what.startswith(f"{fault[2]} clock"), (seed, fault, found)
    return count


@pytest.mark.parametrize("block", EVERY)
def test_planted_faults_are_named(golden, block):
    """At least 95 % right, and never a wrong name."""
    count = sum((named(block, seed, golden[block, seed]) for seed in SEEDS), collections.Counter())
    assert count.total() == PLANTED[block]
    assert count[True] >= 0.95 * PLANTED[block], count


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
    assert count[True] >= 0.95 * PLANTED_OTHER[block], count


@pytest.mark.parametrize("stem", but_counting(blocks.BLOCKS))
def test_the_golden_step_on_exported_rows_is_golden(stem):
    """Also across the resets in the middle of a bundle, and for pins."""
    block = blocks.BLOCKS[stem]
    case = next(iter(block.cases))
    stim, _ = made(stem, case)
    inputs = {p.name: column for p, column in zip(block.columns, stim.T)}
    assert inputs["rst"].any()
    rows, pins = blocks.run(block, case, stim)
    expected = {p.name: column for p, column in zip(block.registers, rows.T)}
    params = {name: raw for name, raw, _ in blocks.params_of(block, case)}
    found, found_pins = Model.of(stem, params, inputs, expected).run(inputs, expected)
    for name, column in expected.items():
        np.testing.assert_array_equal(found[name][:-1], column[1:], name)
    for p, column in zip(block.pins, pins.T):
        np.testing.assert_array_equal(found_pins[p.name], column, p.name)


KEYED = [stem for stem in diagnose_nodes.NODES if keys(blocks.declared()[stem])]
NARROW = OTHER._replace(cordic_iterations=17, cordic_guard_bits=3)


@pytest.mark.parametrize(
    ("stem", "d"), [(stem, None) for stem in diagnose_nodes.NODES] + [(stem, NARROW) for stem in KEYED]
)
def test_every_node_is_the_register_of_the_model(stem, d):
    """Sum, rounding and overflow as declared give every golden row, so that a variant of them is a fault."""
    block = blocks.of_record(d)[stem] if d else blocks.BLOCKS[stem]
    for case in block.cases:
        stim, _ = stimulus.make(block, case) if d else made(stem, case)
        rows, _ = blocks.run(block, case, stim)
        inputs = {p.name: column for p, column in zip(block.columns, stim.T)}
        registers = {p.name: column for p, column in zip(block.registers, rows.T)}
        c = {**{f"in_{name}": column for name, column in inputs.items()}, **inputs, **registers}
        params = {name: raw for name, raw, _ in blocks.params_of(block, case)}
        free = inputs["rst"][:-1] == 0
        fmts = {p.name: p.fmt for p in block.registers}
        for name, found in diagnose_nodes.NODES[stem](c, params, fmts, block.record).items():
            held = registers[name]
            for node in diagnose_nodes.parts(found):
                column = node.of(rounded(node.rounding, sum(node.terms.values()), node.shift))
                enable = np.ones(len(stim), bool) if node.enable is None else node.enable
                held = np.where(enable, diagnose_nodes.wrapped(column, node.fmt), held)
                assert np.any(enable[:-1] & free), (case, name)
            np.testing.assert_array_equal(held[:-1][free], registers[name][1:][free], f"{case} {name}")


def test_every_kind_of_fault_is_planted():
    kinds = {fault[0] for block in planted.STEPS for seed in SEEDS for fault in planted.faults(block, seed)}
    assert kinds == set(CAUSES) - {UNKNOWN}


@pytest.mark.parametrize("block", EVERY)
def test_faults_without_a_name_are_unknown(golden, block):
    """Glitches, stuck bits, a gain of 3/4, and a shift that begins half-way."""
    for seed in SEEDS:
        for what, got in planted.strangers(block, seed, golden[block, seed]):
            a = planted.case(block, seed, planted.NONE, golden[block, seed])
            a["got"] = dict(zip(golden[block, seed][0], got.T.copy()))
            found = diagnose(**a)
            assert found is None or found.cause == UNKNOWN, (seed, what, found)


@pytest.mark.parametrize("block", EVERY)
def test_a_log_of_one_register_gives_no_wrong_name(golden, block):
    for fault in planted.faults(block, 1):
        a = planted.case(block, 1, fault, golden[block, 1])
        last = list(a["got"])[-1]
        a["got"] = {last: a["got"][last]}
        found = diagnose(**a)
        assert found is None or found.cause in (fault[0], UNKNOWN), (fault, found)


def test_rounding_of_columns_is_that_of_the_model():
    x = np.arange(-600, 600)
    for rule, function in fixed.ROUNDINGS.items():
        for n in (0, 1, 2, 5):
            assert rounded(rule, x, n).tolist() == [function(int(v), n) for v in x], (rule, n)


def test_a_block_without_a_model_is_diagnosed_from_its_rows(golden):
    a = planted.case("dds", 1, ("late", "sense_ref", 2), golden["dds", 1]) | {"block": "somebody_else"}
    found = diagnose(**a)
    assert (found.cause, found.port, found.what) == ("late", "sense_ref", "2 clocks")


def test_an_aliased_rounding_rule_is_named_with_its_names_elsewhere(golden):
    found = diagnose(**planted.case("modulator", 1, ("rounding", "code", "half_even"), golden["modulator", 1]))
    assert found.what.startswith("half_even (")
    assert "fixed_pkg:fixed_round" in found.what

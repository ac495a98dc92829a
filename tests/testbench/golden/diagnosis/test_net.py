"""The graph of a block is its step: the same registers and pins on golden rows, and operations that are the model's."""

import inspect

import numpy as np
import pytest

from fpga_model import fixed
from fpga_model.block import python_function
from testbench.golden.diagnosis import elaborate, net, node_rows, simulate_faults
from testbench.golden.stimulus import blocks
from tests.testbench.golden.benching import made

QUICK = ("pi", "spi_dac", "cordic", "rate_output")


@pytest.mark.parametrize(
    "stem", [stem if stem in QUICK else pytest.param(stem, marks=pytest.mark.slow) for stem in blocks.BLOCKS]
)
def test_the_graph_of_a_block_gives_every_golden_row(stem):
    block = blocks.BLOCKS[stem]
    case = list(block.cases)[-1]
    stim, _ = made(stem, case)
    registers, pins = blocks.run(block, case, stim)
    graph = elaborate.block_net(stem, {name: raw for name, raw, _ in blocks.case_parameters(block, case)}, block.record)
    leaves = {("in", p.name): column for p, column in zip(block.columns, stim.T)}
    leaves |= {("reg", p.name): column for p, column in zip(block.registers, registers.T)}
    found = node_rows.Rows(graph, leaves, len(stim))
    assert leaves["in", "rst"].any()
    assert set(graph.roots) == {p.name for p in (*block.registers, *block.pins)}
    for p, column in zip(block.registers, registers.T):
        np.testing.assert_array_equal(found.node_column(graph.roots[p.name])[:-1], column[1:], p.name)
    for p, column in zip(block.pins, pins.T):
        np.testing.assert_array_equal(found.node_column(graph.roots[p.name]), column, p.name)
    for node in graph.nodes:
        column = found.node_column(node)
        assert node.lo <= column.min(), node
        assert column.max() <= node.hi, node


@pytest.mark.parametrize("name", [*fixed.ROUNDINGS, "clamp", "wrap", "wrap_unsigned"])
def test_an_operation_on_columns_is_the_function_of_the_model(name):
    function = python_function(getattr(fixed, name))
    of, _ = net.OPERATIONS["wrapu" if name == "wrap_unsigned" else name]
    x = np.arange(-300, 300)
    for given in [(-7, 11), (0, 5)] if name == "clamp" else [(n,) for n in (1, 2, 5, 8)]:
        assert len(inspect.signature(function).parameters) == 1 + len(given)
        np.testing.assert_array_equal(of(x, *given), [function(int(v), *given) for v in x])


@pytest.mark.parametrize("op", ["shl", "shr", "wrap", "wrapu", *net.ROUNDINGS])
def test_the_source_of_a_shift_by_any_amount_is_its_column(op):
    """A hypothesis may shift by any word of the block: without a bound a Python number would fill the memory."""
    graph = net.Net()
    amount, x = graph.leaf("in", "amount", fixed.signed_bits(48)), graph.leaf("in", "x", fixed.signed_bits(2))
    graph.close()
    node = graph.node(op, (x, amount))
    columns = {"amount": [-3, 1, 5, 62, 1 << 40], "x": [1, -1, 1, -1, 1]}
    leaves = {("in", name): np.array(column) for name, column in columns.items()}
    by = simulate_faults.compile_node(graph, node)
    found = [by((), given) for given in zip(columns["amount"], columns["x"])]
    assert found == node_rows.Rows(graph, leaves, 5).node_column(node).tolist()


def test_a_held_node_is_a_register_with_enable_and_reset():
    graph = net.Net()
    load, x = graph.leaf("in", "load", fixed.bits(1)), graph.leaf("in", "x", fixed.signed_bits(8))
    graph.leaf("in", "rst", fixed.bits(1))
    columns = {"load": [1, 0, 1, 1, 0, 1], "x": [3, 4, 5, 6, 7, 8], "rst": [0, 0, 0, 1, 0, 0]}
    leaves = {("in", name): np.array(column) for name, column in columns.items()}
    register = graph.enabled_register(load, x, -1)
    assert node_rows.Rows(graph, leaves, 6).node_column(register).tolist() == [-1, 3, 3, 5, -1, -1]


def test_an_odd_node_changes_with_each_load_and_a_late_reset_has_no_reset():
    graph = net.Net()
    load = graph.leaf("in", "load", fixed.bits(1))
    rst = graph.leaf("in", "rst", fixed.bits(1))
    columns = {"load": [1, 0, 1, 1, 0, 1], "rst": [0, 0, 0, 1, 0, 0]}
    leaves = {("in", name): np.array(column) for name, column in columns.items()}
    found = node_rows.Rows(graph, leaves, 6)
    assert found.node_column(graph.odd(load)).tolist() == [0, 1, 1, 0, 0, 0]
    assert found.node_column(graph.delayed_reset(rst, 1)).tolist() == [1, 0, 0, 0, 1, 0]


def test_registers_of_channels_are_siblings():
    graph, sums = net.Net(), []
    rst = graph.leaf("in", "rst", fixed.bits(1))
    for k in (0, 1):
        acc, x = graph.leaf("reg", f"acc_{k}", fixed.signed_bits(9)), graph.leaf("in", f"x_{k}", fixed.signed_bits(8))
        sums.append(graph.node("add", (acc, x)))
        chosen = graph.node("mux", (rst, graph.const(0), sums[k]), acc.value)
        graph.roots[acc.value] = graph.node("next", (chosen,), acc.value)
    graph.close()
    first = sums[0]
    assert [n.value for n in graph.siblings[first.id, 1].values()] == ["x_1"]
    # what a hypothesis adds knows the nodes of the model alone
    added = graph.node("neg", (first,))
    assert added.cone == first.cone
    assert graph.cone_nodes(added) == graph.cone_nodes(first)


def test_what_a_kernel_never_uses_is_refused_by_name():
    with pytest.raises(elaborate.Unsupported, match="while"):
        elaborate.Elaborator(net.Net()).call(_loops, [1], {})


def _loops(x):
    while x:
        x -= 1
    return x

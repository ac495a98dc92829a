"""The registry of golden blocks against the firmware: nothing missing, every port in its format, the runners right."""

import importlib
import inspect
import pkgutil

import numpy as np
import pytest

import fpga_model
from fpga_model import sine
from fpga_model.block import python_function
from fpga_model.design_record import DEFAULT
from testbench import flatten
from testbench.golden.stimulus import blocks, stimulus
from tests.testbench.golden.benching import made, one_case

CASES = [(stem, case) for stem, block in blocks.BLOCKS.items() for case in block.cases]


def module_of(stem):
    return importlib.import_module(f"fpga_model.{stem}")


def arguments(stem):
    return list(inspect.signature(python_function(module_of(stem).step)).parameters)


def slow_step(stem, params, state, values):
    """One edge by the step function itself, interpreted, its inputs put together by hand."""
    module, values = module_of(stem), list(values)
    if blocks.BLOCKS[stem].runtime_params:
        count = len(module.Params._fields)
        params, values = module.Params(*values[:count]), values[count:]
    if stem == "sequencer":
        values = [values[0], module.Inputs(*values[1:])]
    if stem == "fault_monitor":
        values = [*values[:3], tuple(values[3:7]), *values[7:]]
    structure = {"d": DEFAULT, "rom": sine.ROM}
    own = {"p": params, "s": state}
    before = [(structure | own)[name] for name in arguments(stem) if name in structure or name == "s"]
    if params is not None:
        before.insert(-1, params)
    return python_function(module.step)(*before, *values)


def test_every_block_of_the_firmware_is_there():
    stems = {info.name for info in pkgutil.iter_modules(fpga_model.__path__) if hasattr(module_of(info.name), "step")}
    assert stems - {"top", "control", "host", "host_axi"} == set(blocks.BLOCKS)


def test_the_pi_has_the_gains_of_the_loops_made_of_it():
    cases = module_of("pi").BLOCK.cases
    loops = {"rate": "rate_loop", "frequency": "frequency_tracker"}
    assert {case: cases[case] for case in loops} == {
        case: module_of(stem).design().loop for case, stem in loops.items()
    }


def parameter_names(stem):
    block = blocks.BLOCKS[stem]
    return {name for name, _, _ in blocks.case_parameters(block, next(iter(block.cases)))}


@pytest.mark.parametrize("stem", blocks.BLOCKS)
def test_parameters_and_ports_have_names_of_their_own(stem):
    """A module has one name space for both, and VHDL knows no case."""
    block = blocks.BLOCKS[stem]
    ports = ["clk", *(port.name for port in block.columns), *(f"r_{port.name}" for port in block.registers)]
    names = [*ports, *(f"o_{port.name}" for port in block.pins), *parameter_names(stem)]
    assert len({name.lower() for name in names}) == len(names)


@pytest.mark.parametrize("stem", blocks.BLOCKS)
def test_inputs_are_the_arguments_of_step(stem):
    block = blocks.BLOCKS[stem]
    names = [name for name in arguments(stem) if name not in ("d", "rom", "p", "s")]
    found = [port.name for port in block.inputs]
    if block.runtime_params:
        names = list(module_of(stem).Params._fields) + names
    given = parameter_names(stem)
    expected = []
    for name in names:
        if name == "i":
            expected += [f"i_{field}" for field in module_of(stem).Inputs._fields]
        elif name == "codes":
            expected += [f"codes_{k}" for k in range(4)]
        else:
            expected.append(f"i_{name}" if name in given else name)
    assert found == expected


@pytest.mark.parametrize("stem", blocks.BLOCKS)
def test_every_register_has_its_format_and_reset(stem):
    block, module = blocks.BLOCKS[stem], module_of(stem)
    assert [p.name for p in block.registers] == [n.replace(".", "_") for n in flatten.names(module.State())]
    assert [p.fmt for p in block.registers] == [fmt for _, fmt in flatten.format_leaves(module.STATE_FMT)]
    assert [p.reset for p in block.registers] == [value for _, value in flatten.leaves(module.State())]
    names = [p.name for p in (*block.columns,)] + [f"r_{p.name}" for p in block.registers]
    names += [f"o_{p.name}" for p in block.pins]
    assert len(set(names)) == len(names)
    assert set(block.strobes) <= {p.name for p in block.inputs if p.width == 1}
    assert set(block.rules) == {"rounding", "overflow"}


@pytest.mark.parametrize("stem", [s for s, b in blocks.BLOCKS.items() if hasattr(module_of(s), "LATENCY")])
def test_the_longest_latency_is_that_of_the_block(stem):
    whole = [k for k in blocks.BLOCKS[stem].latency.values() if isinstance(k, int)]
    if whole and stem != "quadrature_loop":
        assert max(whole) == module_of(stem).LATENCY


@pytest.mark.parametrize(("stem", "case"), one_case(CASES))
def test_runner_equals_the_step_function(stem, case):
    block = blocks.BLOCKS[stem]
    rows, _ = made(stem, case)
    random = stimulus.Random(7)
    begin = random.draw_integer(len(rows) - 100)
    rows = np.vstack([rows[:60], rows[begin : begin + 60], rows[-60:]])
    regs, _ = blocks.run(block, case, rows)
    state = block.state
    for n, row in enumerate(rows.tolist()):
        assert [int(v) for _, v in flatten.leaves(state)] == regs[n].tolist(), f"row {n}"
        state = block.state if row[0] else slow_step(stem, block.cases[case], state, row[1:])


@pytest.mark.parametrize(("stem", "case"), CASES)
def test_parameters_hold_their_formats(stem, case):
    for name, raw, fmt in blocks.case_parameters(blocks.BLOCKS[stem], case):
        assert fmt.holds(raw), name


def test_a_value_outside_its_format_is_refused():
    block = blocks.BLOCKS["sine"]
    with pytest.raises(ValueError, match=r"stimulus phase: 0 \.\. 281474976710656 is outside format"):
        blocks.run(block, "default", np.array([[0, 0], [0, 1 << 48]]))
    with pytest.raises(ValueError, match="expected 2 columns"):
        blocks.run(block, "default", np.zeros((3, 3), np.int64))

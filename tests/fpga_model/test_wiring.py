"""Wires derived from the source of control and top: all of them, and a refusal of every pair of formats that differ."""

import random
import re

import pytest

from fpga_model import agc, block, control, pi, rate_loop, references, spi_dac, top, wiring
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt
from testbench.config import Config
from testbench.run import build

MODULES = {"control": control, "top": top}
CHANGES = {
    "width": lambda fmt: Fmt(fmt.s, fmt.i + 1, fmt.f),
    "sign": lambda fmt: Fmt(1 - fmt.s, fmt.i - 1 + 2 * fmt.s, fmt.f),
    "binary point": lambda fmt: Fmt(fmt.s, fmt.i - 1, fmt.f + 1),
}
DRAWS = 40


@pytest.fixture(autouse=True)
def fresh():
    """No trace of a planted format is remembered."""
    yield
    wiring.trace.cache_clear()
    wiring.check.cache_clear()


def places(name):
    """[(wire, dictionary, key)] of the wires of a module, and where the format of its far end is declared.

    A parameter has the type that its block declares, as has the bank in control: those have one declaration for both
    ends. A condition is one bit by rule; there it is the near end that is declared.
    """
    found, module = [], MODULES[name]
    instances = wiring.trace(module).instances
    for wire in wiring.trace(module).wires:
        function = wire.instance.rpartition(".")[2]
        if wire.instance in instances:
            target = instances[wire.instance][0]
            if target is control:
                if wire.port in control.Inputs._fields:
                    found.append((wire, control.Inputs.__annotations__, wire.port))
            elif wire.port in target.BLOCK.inputs:
                found.append((wire, target.BLOCK.inputs, wire.port))
            elif wire.port.startswith("i_"):
                found.append((wire, target.Inputs.__annotations__, wire.port[2:]))
        elif wire.instance == "pins":
            found.append((wire, top.Pins.__annotations__, wire.port))
        elif function in ("frame", "negated"):
            target = block.block_modules()["spi_dac" if function == "frame" else "cordic"]
            found.append((wire, target.BLOCK.functions[function][0], wire.port))
        elif wire.port.startswith("if o.fix"):
            found.append((wire, control.sequencer.Outputs.__annotations__, wire.port.partition(".")[2]))
    return found


def plant(monkeypatch, table, key, change):
    """Another format at one end."""
    fmt = table[key]
    fmt = fmt if isinstance(fmt, Fmt) else eval(fmt.__forward_arg__, vars(control if "stale" in table else top))
    monkeypatch.setitem(table, key, change(fmt))
    wiring.trace.cache_clear()
    wiring.check.cache_clear()


def test_every_wire_of_the_firmware_has_one_format():
    assert wiring.mismatches(control) == wiring.mismatches(top) == []
    wiring.check(DEFAULT)


def test_every_input_of_every_block_is_a_wire():
    for module in MODULES.values():
        ends = {(wire.instance, wire.port) for wire in wiring.trace(module).wires}
        for instance, (target, _) in wiring.trace(module).instances.items():
            if target is not control:
                wanted = [*block.inputs(target), *block.parameters(target).items()]
                assert {(instance, name) for name, _ in wanted} <= ends, instance
    blocks = {path for path, _ in wiring.nested_blocks(top.State) if path.count(".") == path.startswith("control.")}
    assert set(wiring.instances()) == blocks - {"control.notch"}
    whole = wiring.trace(control, all_parts=True)
    assert set(whole.instances) - set(wiring.trace(control).instances) == {"notch"}
    ends = {(wire.target, leaf.name) for wire in whole.wires for leaf in wire.signal.leaves}
    assert {("notch.x", "rate_loop.loop.y"), ("rate_output.word", "notch.out"), ("notch.g", "notch.g")} <= ends


DRAWN = [(list(CHANGES)[k % 3], k) for k in range(DRAWS)]


@pytest.mark.parametrize(("what", "draw"), DRAWN)
def test_a_planted_mismatch_is_refused_at_build_time_with_both_ends(monkeypatch, what, draw):
    found = [*places("control"), *places("top")]
    assert len(found) > 80
    wire, table, key = random.Random(1000 + draw).choice(found)
    before = wire.fmt
    plant(monkeypatch, table, key, CHANGES[what])
    with pytest.raises(ValueError, match="wiring: formats differ: ") as error:
        build.firmware(Config())
    for leaf in wire.signal.leaves:
        if leaf.kind != "constant":
            assert any(leaf.name in text and f"-> {wire.target} [" in text for text in str(error.value).split("; "))
    changed = CHANGES[what](before)
    assert (changed.width != before.width) == (what == "width")
    assert str(changed) in str(error.value)


def test_the_draws_reach_many_wires():
    found = [*places("control"), *places("top")]
    drawn = {random.Random(1000 + draw).choice(found)[0].target for draw in range(DRAWS)}
    assert len(drawn) >= 25


def test_the_message_names_block_port_and_both_formats(monkeypatch):
    plant(monkeypatch, references.BLOCK.inputs, "sense_ref", CHANGES["binary point"])
    text = "wiring: formats differ: dds.sense_ref [0,0,48] -> references.sense_ref [0,-1,49]"
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        wiring.check()


def test_a_declared_difference_is_bound_to_its_two_formats(monkeypatch):
    targets = [cast.target for cast in (*control.CASTS, *top.CASTS)]
    assert targets == ["rate_output.word", "rate_output.word", "quadrature_dac.frame.code"]
    plant(monkeypatch, rate_loop.BLOCK.holds, "loop.y", CHANGES["width"])
    with pytest.raises(ValueError, match=r"rate_loop\.loop\.y \[1,1,23\] -> rate_output\.word \[1,23,0\]"):
        wiring.check()


def test_what_a_register_holds_here_is_proven():
    from testbench.golden.ranges import ranges

    ((name, fmt),) = rate_loop.BLOCK.holds.items()
    (found,) = [
        one for one in ranges.analyse_case("rate_loop", "default").registers if one.name == block.port_name(name)
    ]
    assert fmt.holds(found.proven[0])
    assert fmt.holds(found.proven[1])
    assert not fmt.holds(pi.OUT.hi)


def _wired(p, s, x):
    total = s.error + x
    return total


def test_arithmetic_in_the_wiring_is_refused():
    with pytest.raises(wiring.Unsupported, match=r"test_wiring\._wired: s\.error \+ x is not understood as wiring"):
        wiring.trace(control).function(_wired, {"p": 0, "s": agc.State(), "x": 1})


def test_the_frame_takes_every_code():
    """The declared extension of the V_q code loses nothing."""
    make = block.python_function(spi_dac.frame)
    assert [make(spi_dac.DAC82002, code, 0) & 0xFFFF for code in (0, 1, 65535)] == [0, 1, 65535]

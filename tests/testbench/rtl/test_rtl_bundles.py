"""What a bundle's bench cannot see of the reference RTL, because it connects any width to any other.

The ports, no warning of a linter, no latch and no undriven net. Every register and pin of every row under Icarus and
Verilator: `golden/test_benches.py`. Blocks that `test_rtl.py` tries with stimulus of its own are left out.
"""

import pytest

from testbench.golden.bundles import benches
from testbench.golden.stimulus import blocks
from tests.testbench.rtl.test_rtl import RTL, VERILOG, declared, icarus, ran, verilator, yosys

STEMS = [stem for stem in blocks.BLOCKS if stem not in VERILOG and (RTL / f"{stem}.v").is_file()]
CASES = [
    pytest.param(stem, case, marks=pytest.mark.slow if k else ())
    for stem in STEMS
    for k, case in enumerate(blocks.BLOCKS[stem].cases)
]


def sources(stem):
    """The block's file and those of the blocks in it."""
    return [RTL / f"{name}.v" for name in (stem, *benches.PARTS.get(stem, ()))]


def given(stem, case):
    """(name, width, raw bits) of the case's parameters."""
    listed = blocks.case_parameters(blocks.BLOCKS[stem], case)
    return [(name, fmt.width, raw & ((1 << fmt.width) - 1)) for name, raw, fmt in listed]


@pytest.mark.parametrize("stem", STEMS)
def test_ports_are_those_of_the_model(stem):
    block, text = blocks.BLOCKS[stem], (RTL / f"{stem}.v").read_text()
    case = next(iter(block.cases))
    found = benches.result_port_pairs(block)
    parameters = [(name, fmt.width, bool(fmt.s)) for name, _, fmt in blocks.case_parameters(block, case)]
    wanted = {
        "input": [("clk", 1, False), *((port.name, port.width, port.signed) for port in block.columns)],
        "output": [(name, port.width, port.signed) for name, port in found],
        "parameter": parameters + ([("ROM_FILE", 1, False)] if block.roms else []),
    }
    for kind, ports in wanted.items():
        assert declared(text, kind, "v") == ports, kind


@icarus
@pytest.mark.parametrize("stem", STEMS)
def test_icarus_has_no_warning(stem, tmp_path):
    ran(["iverilog", "-g2005", "-Wall", "-o", "lint.vvp", *sources(stem)], tmp_path, silent=True)


@verilator
@pytest.mark.parametrize(("stem", "case"), CASES)
def test_verilator_has_no_warning(stem, case, tmp_path):
    values = [f"-G{name}={width}'h{raw:x}" for name, width, raw in given(stem, case)]
    ran(["verilator", "--lint-only", "-Wall", "--top-module", f"gyro_{stem}", *values, *sources(stem)], tmp_path, True)


@yosys
@pytest.mark.slow  # the whole design is synthesised in tests/testbench/golden/test_synthesis.py
@pytest.mark.parametrize(("stem", "case"), CASES)
def test_yosys_synthesises_without_latches(stem, case, tmp_path):
    block = blocks.BLOCKS[stem]
    values = "".join(f" -chparam {name} {width}'h{raw:x}" for name, width, raw in given(stem, case))
    top, *parts = (path.name for path in sources(stem))
    for path in sources(stem):
        # this front end takes no text as a parameter from outside: the table's name is put in place of the empty one
        name = benches.rom_name(block)
        (tmp_path / path.name).write_text(path.read_text().replace('ROM_FILE = ""', f'ROM_FILE = "{name}"'))
    for name, text in benches.rom_files(block).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    steps = (
        *(f"read_verilog {part}" for part in parts),
        f"read_verilog -defer {top}",
        f"hierarchy -check -top gyro_{stem}{values}",
        "proc; flatten; opt; check -assert",
        "select -assert-none t:$dlatch t:$adff t:$dffsr",
        f"synth -top gyro_{stem} -run coarse:fine",
        "check -assert",
    )
    ran(["yosys", "-q", "-p", "; ".join(steps)], tmp_path)

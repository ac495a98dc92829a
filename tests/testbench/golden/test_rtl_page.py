"""docs/rtl.md: its figures and lists are those of the code."""

import re
from pathlib import Path

from fpga_model import registers, wiring
from fpga_model.block import block_modules, keys
from fpga_model.rates import MASTER_HZ
from testbench.golden.loop import library, run
from testbench.golden.proofs import formal
from tests.testbench.rtl.test_rtl import RTL

PAGE = " ".join((RTL.parents[1] / "docs" / "rtl.md").read_text().split())


def says(*texts):
    for text in texts:
        assert text in PAGE, text


def test_rows_and_clock():
    says(f"A row is {len(library.REGISTERS)} registers and {len(library.PINS)} pins.")
    says(f"{1e9 / MASTER_HZ:.2f} ns", f"({5e8 / MASTER_HZ:.2f} ns)")


def test_parameters_of_the_design():
    """The table of keys, row by row; what is not in it depends on none."""
    table = (RTL.parents[1] / "docs" / "rtl.md").read_text().partition("| block | parameters |")[2].partition("\n\n")[0]
    rows = [[re.findall(r"`(\w+)`", cell) for cell in line.split("|")[1:3]] for line in table.splitlines()[2:]]
    found = {stem: [name.lower() for name in names] for stems, names in rows for stem in stems}
    modules = {stem: keys(module) for stem, module in block_modules().items()}
    assert found.pop("top") == [], "all of these"
    parts = {module for role, (module, _) in wiring.instances().items() if role.startswith("control.")}
    assert set(found.pop("control")) == {key for module in parts for key in keys(module)}
    assert found == {stem: list(names) for stem, names in modules.items() if names}


def test_the_story():
    begin, turn, end = run.STEPS_S
    step = f"{run.STEP_DPS:g} deg/s"
    says(f"the run is {run.SECONDS:g} s long", f"+{step} from {begin:g} s, -{step} from {turn:g} s, 0 from {end:g} s")
    says(f"silent for {run.FAULT_LENGTH_S * 1e3:g} ms at {run.FAULT_S:g} s")
    # ticks of the story, one for each register that the configuration writes, and the row behind the last edge
    assert run.SECONDS * MASTER_HZ <= int(re.search(r"([\d,]+) rows, no difference", PAGE)[1].replace(",", ""))


def test_every_block_with_properties_is_listed():
    for stem in formal.CASES:
        says(f"| `{stem}` |")


def test_files_that_the_page_names_exist():
    for name in re.findall(r"(?:tests/)?testbench/[\w/]+\.\w+", PAGE):
        assert (RTL.parents[1] / name).is_file(), name


def test_the_register_map_of_the_rtl_is_that_of_the_model():
    """Every register that a host writes, at its address, in the RTL's own decoder."""
    text = (RTL / "registers.v").read_text()
    found = dict(re.findall(r"8'h([0-9A-Fa-f]+): r_(\w+) ", text))
    assert {int(address, 16): name for address, name in found.items()} == {
        r.address: r.name for r in registers.WRITABLE
    }
    assert Path(registers.__file__).name in PAGE.replace("fpga_model/", "")

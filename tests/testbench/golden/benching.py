"""Running the benches of a bundle as their user does: make, a simulator's name, a folder of RTL."""

import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from testbench.golden.stimulus import stimulus
from testbench.golden.stimulus.blocks import BLOCKS

RTL = Path(__file__).resolve().parents[3] / "testbench" / "rtl"
VERILOG = [stem for stem in BLOCKS if (RTL / f"{stem}.v").is_file()]
VHDL = [stem for stem in BLOCKS if (RTL / f"{stem}.vhd").is_file()]
NEEDS = {
    "icarus": ("iverilog",),
    "verilator": ("verilator", "g++"),
    "ghdl": ("ghdl",),
    "cocotb": ("iverilog",),
    "cocotb-verilator": ("verilator", "g++"),
    "vunit": ("ghdl",),
}


# Blocks that count frames have long vectors, whose proofs take seconds: the fast set runs them in the whole design
COUNTING = {"fault_monitor", "frequency_tracker", "lock_monitor", "sequencer"}


def but_counting(which):
    """Blocks, or (block, case), as parameters; slow if the block counts frames."""
    rows = [(one,) if isinstance(one, str) else one for one in which]
    return [pytest.param(*row, marks=[pytest.mark.slow] * (row[0] in COUNTING)) for row in rows]


def one_case(cases):
    """(block, case) as parameters, slow but for the first case of each block."""
    first = dict(reversed(cases))
    return [pytest.param(*row, marks=[pytest.mark.slow] * (first[row[0]] != row[1])) for row in cases]


@functools.cache
def made(stem, case):
    """`stimulus.make`, once for all tests of a process: nobody writes into the rows."""
    return stimulus.make(BLOCKS[stem], case)


def need(*tools):
    absent = [tool for tool in ("make", *tools) if shutil.which(tool) is None]
    if absent:
        pytest.skip(f"not installed, so these benches were NOT run: {', '.join(absent)}")


def make(folder, *goals, **environment):
    """Finished `make check` in a folder; its output is one text."""
    command = ["make", "-s", "-C", str(folder), "check", f"PYTHON={sys.executable}", *goals]
    return subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        env=environment or os.environ,
        cwd="/",
    )


def check(folder, sim="", rtl=None):
    """`make check` with one simulator (skipped if it is not installed), or with every one."""
    need(*NEEDS.get(sim, ()))
    return make(folder, f"SIM={sim}", *([f"RTL={rtl}"] if rtl else []))


def seed(build, verilated):
    """Put Verilator's compiled library where a bench looks for the one it kept; returns options that leave it so."""
    if verilated is not None and not build.exists():
        shutil.copytree(verilated, build)
    return "".join(f" -o {path.name}" for path in sorted(build.glob("verilated*.o")))

"""Running the benches of a bundle as their user does: make, a simulator's name, a folder of RTL."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from testbench.golden.blocks import BLOCKS

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


def keep_objects(folder, store):
    """Put Verilator's compiled library of an earlier bench where the next one looks for its own, or store it."""
    build = folder / "build" / "verilator"
    if not build.exists() and store.exists():
        shutil.copytree(store, build)
    elif build.exists() and not store.exists():
        store.mkdir()
        for path in (*build.glob("verilated*.o"), build / "version"):
            shutil.copy2(path, store)

"""`make check` of a bundle: every simulator that is installed and has a design, and a line for each that has not.

The work is in check.sh, plain POSIX shell, so that a flow without make can call it too; it writes into build/ only.
Source  docs/golden.md (exit codes)
"""

from testbench.golden.bundles.benches.layout import PARTS, block_levels, rom_parameters
from testbench.golden.bundles.benches.template import fill_template
from testbench.golden.stimulus.levels import LEVELS

PINS = LEVELS[0]  # folder in a bundle of the whole design
SIMS = ("icarus", "verilator", "ghdl", "cocotb", "vunit")


def makefile(block, case):
    """`make check [SIM=...] RTL=folder`."""
    return f"""# {block.stem}/{case}: make check RTL=folder runs every simulator that is here and has a design
# SIM=icarus|verilator|ghdl|cocotb|cocotb-verilator|vunit runs that one. check.sh tells what a folder must hold.
# FILES="a.sv b.sv" or FILES=my.f: the design's files, seen from the folder. LEVEL=pins|outputs|registers
SIM ?=
RTL ?=
FILES ?=
LEVEL ?=
TIMEOUT ?=
PYTHON ?= python3
export RTL FILES LEVEL TIMEOUT PYTHON

check:
	@sh ./check.sh $(SIM)

# plain commands for simulators that nobody has run with this bundle: make -s questa RTL=folder | sh
questa riviera xcelium vcs:
	@sh ./check.sh commands $@

clean:
	rm -rf build{f" {PINS}/build" if block.stem == "top" and block.registers else ""}

.PHONY: check questa riviera xcelium vcs clean
"""


def core_name(block, case):
    """Name of a bundle's core, of its own for `pins/`: FuseSoC finds both in one tree."""
    return f"{block.stem}_{case}" + (f"_{PINS}" if block.stem == "top" and not block.registers else "")


def core(block, case, words=("stim", "exp", "mask")):
    """FuseSoC core of a bundle: `fusesoc run --target sim`, with the design as the core gyro:design:BLOCK.

    words  hex files that the bench opens
    """
    stem = block.stem
    opened = [*(f"{word}.hex" for word in words), *rom_parameters(block).values()]
    copied = "".join(f"      - {path}: {{file_type: user, copyto: {path}}}\n" for path in opened)
    kinds = {f"LEVEL_{level.upper()}": "bool, paramtype: vlogdefine" for level in block_levels(block)[:-1]}
    if "mask" not in words:
        kinds = {"FRAMES": "int, paramtype: plusarg"}
    core_parameter_lines = "".join(f"  {name}: {{datatype: {kind}}}\n" for name, kind in kinds.items())
    return f"""CAPI=2:
name: gyro:golden:{core_name(block, case)}:1.0.0
description: golden vectors of {stem}/{case}; the design is the core gyro:design:{stem}
filesets:
  bench:
    files:
      - params.vh: {{file_type: verilogSource, is_include_file: true}}
      - tb_{stem}.v: {{file_type: verilogSource-2005}}
{copied}    depend: [gyro:design:{stem}]
{"parameters:" + chr(10) + core_parameter_lines if core_parameter_lines else ""}targets:
  default: &default
    filesets: [bench]
  sim:
    <<: *default
    toplevel: tb_{stem}
    default_tool: icarus
{f"    parameters: [{', '.join(kinds)}]" + chr(10) if kinds else ""}    tools:
      icarus:
        iverilog_options: [-g2012]
      verilator:
        mode: binary
        verilator_options: [--timing, -Wno-fatal, -Wno-lint, -Wno-style]
"""


def _frames(defaults):
    """Shell text of benches that may stop early; `defaults` are {simulator: frames, 0 for all}."""
    lines = "\n".join(f"    {sim}) echo ${{FRAMES:-{count}}} ;;" for sim, count in defaults.items())
    return f"""
# A bench stops after so many frames, 0 is all of them; FRAMES=n in the environment is for every simulator
frames() {{
    case $1 in
{lines}
    esac
}}
"""


def check_script(block, case, frames=None):
    """`RTL=folder sh check.sh [SIM ...]`; exit code 0: nothing failed, 1: a bench failed, 2: nothing could be run.

    frames  {simulator: frames} after which the benches of the whole design stop unless told otherwise; None for blocks
    """
    stem = block.stem
    optimised = "optimised: running takes longer than compiling"
    pins_only = frames and not block.registers
    levels = block_levels(block)[: 2 if pins_only else None]
    why = optimised if frames else "not optimised: compiling takes longer than running"
    return fill_template(
        "check.sh.in",
        stem=stem,
        title=f"{stem}/{case}",
        parts=" ".join(PARTS.get(stem, ())),
        frames=_frames(frames) if frames else "",
        plus=" +FRAMES=$(frames $1)" if frames else "",
        generic=" -gFRAMES=$(frames $1)" if frames else "",
        exported='FRAMES=$(frames "$1") ' if frames else "",
        module=block.module,
        levels=" ".join(levels),
        default=levels[0] if pins_only else "registers",
        elsewhere="" if pins_only or not frames else f'[ $LEVEL = registers ] || exec sh {PINS}/check.sh "$@"\n',
        level=2 if frames else 0,
        why=why,
        sims=" ".join(SIMS),
    )

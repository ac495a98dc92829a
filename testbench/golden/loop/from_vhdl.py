"""Verilog of a design in VHDL, by the synthesis of GHDL.

    synthesise_vhdl(vhdl_sources, name, folder, what)  the file; `vhdl_sources` are `rtl_sources.Sources`
    repair_netlist(verilog, vhdl)                        without two faults of GHDL 2.0, which make it another design

Source  docs/rtl.md
"""

import re
import shutil
from pathlib import Path

from testbench.errors import ConfigError, FileError
from testbench.storage.files import write_text
from testbench.tool import run_tool

BITS = re.compile(r'"([01XZ]+)"')
CASE = re.compile(r"^    case \((\w+)\)\n((?:      .*\n)+)    endcase\n", re.M)
SELECT_PATTERN = re.compile(r"^  with (\w+) select (\w+) <=\n(?:    .*,\n)*    (.+) when others;\n", re.M)


def _verilog_literal(text):
    """A literal or a net of VHDL in Verilog; None for anything else."""
    literal = re.fullmatch("(?:'(.)'|\"(.+)\")", text)
    if literal is None:
        return text if re.fullmatch(r"\w+", text) else None
    bits = re.sub("[^01Z]", "X", literal[1] or literal[2])
    return f"{len(bits)}'b{bits}"


def repair_netlist(verilog, vhdl):
    """The Verilog of a netlist with sized constants, and with the `when others` that each `case` has in the VHDL of it.

    GHDL 2.0 writes constants of more than 32 bits as text, and leaves `when others` out (its issues 2002 and 2041).
    ValueError if both texts are not of one netlist
    """
    default_branches = iter(SELECT_PATTERN.findall(vhdl))

    def complete_case(case_match):
        selector, branches = case_match[1], case_match[2]
        if "      default:" in branches:
            return case_match[0]
        net = branches.split(" <= ")[0].split()[-1]
        *names, value = next(default_branches, (None, None, ""))
        if names != [selector, net] or _verilog_literal(value) is None:
            raise ValueError(f"no `when others` of {net} is known")
        return f"    case ({selector})\n{branches}      default: {net} <= {_verilog_literal(value)};\n    endcase\n"

    return CASE.sub(complete_case, BITS.sub(lambda bits: f"{len(bits[1])}'b{bits[1]}", verilog))


def synthesise_vhdl(vhdl_sources, name, folder, what):
    """Verilog of `rtl_sources.Sources` in VHDL, of the entity `name`: a file in `folder`."""
    if shutil.which("ghdl") is None:
        raise ConfigError("ghdl: not installed; the loop needs its synthesis for a design in VHDL")
    if name != name.lower():
        raise FileError(f"{what}: {name}: GHDL writes names in lower case; rename the top to {name.lower()}")
    work_folder = Path(folder).resolve() / "vhdl"
    shutil.rmtree(work_folder, ignore_errors=True)
    work_folder.mkdir(parents=True)
    libraries = [library or "work" for library in vhdl_sources.libraries]
    for path, library in zip(vhdl_sources.files, libraries, strict=True):
        run_tool(["ghdl", "-a", "--std=08", f"--work={library}", path], work_folder, what)
    # an entity that is missing would be a module whose outputs rest
    command = f"ghdl --synth --std=08 -Werror=binding --work={libraries[-1]}".split()
    verilog, vhdl = (run_tool([*command, f"--out={form}", name], work_folder, what) for form in ("verilog", "raw-vhdl"))
    try:
        write_text(work_folder / "design.v", repair_netlist(verilog, vhdl))
    except ValueError as problem:
        raise FileError(
            f"{what}: {name}: the Verilog of GHDL's synthesis has a case without default: {problem}"
        ) from None
    return work_folder / "design.v"

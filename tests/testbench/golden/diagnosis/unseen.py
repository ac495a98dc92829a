"""What a fault is that no row of its bundle shows: killed by another bundle, alive, equivalent, or undecided.

    1. the other cases of the block     the first one with a row that differs
    2. both designs from reset          bounded search, then property-directed reachability, then search further

Both share what they compute from the same values: the proof is of the rest.
"""

import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from fpga_model import rate_output
from testbench.golden.bundles.benches import PARTS
from testbench.golden.mutation import judge, mutate
from tests.testbench.golden.diagnosis import first_row, rtl_faults

CPU_S = 15  # of each step of ABC
# Inputs that stand while a register is not 0: {block: (register, inputs)}
STEADY = {"rate_output": ("r_stage", rate_output.Params._fields)}
MAP = (
    "memory_map; opt_clean; wreduce t:$mul; techmap; opt_clean; dffunmap; setundef -undriven -zero; aigmap; opt_clean; "
    "write_aiger -zinit both.aig"
)


def design(place, fault, rom=None):
    """Write the files of the design with the fault, and those of the sound one with another name of the module."""
    for part in PARTS.get(fault.stem, ()):
        shutil.copy(rtl_faults.RTL / f"{part}.v", place)
    for name, text in (("gate", fault.text), ("gold", rtl_faults.source(fault.stem))):
        text = text.replace(f"module gyro_{fault.stem} ", f"module {name} ")
        Path(place, f"{name}.v").write_text(text.replace('ROM_FILE = ""', f'ROM_FILE = "{rom}"') if rom else text)


def top(manifest):
    """Both designs on the same inputs, reset in the first clock; `bad`: an output has differed within the contract."""
    given = [(p["name"], p["width"]) for p in manifest["inputs"]]
    found = [f"r_{p['name']}" for p in manifest["registers"]] + [f"o_{p['name']}" for p in manifest["outputs"]]
    widths = [p["width"] for p in manifest["registers"] + manifest["outputs"]]
    lines = []
    for name in ("gold", "gate"):
        ports = ", ".join(
            [f".{n}({n if n != 'rst' else 'reset'})" for n, _ in given] + [f".{n}({name}_{n})" for n in found]
        )
        lines += [f"wire [{w - 1}:0] {name}_{n};" for n, w in zip(found, widths)] + [
            f"{name} u_{name} (.clk(clk), {ports});"
        ]
    broken = "1'b0"
    if manifest["block"] in judge.CONTRACTS:
        strobe, register = judge.CONTRACTS[manifest["block"]]
        broken = f"({strobe} && gold_{register} != 0)"
    if manifest["block"] in STEADY:
        register, names = STEADY[manifest["block"]]
        for n, w in given:
            if n in names:
                lines.append(f"reg [{w - 1}:0] last_{n} = 0; always @(posedge clk) last_{n} <= {n};")
                broken += f" || (gold_{register} != 0 && {n} != last_{n})"
    differ = " || ".join(f"gold_{n} != gate_{n}" for n in found)
    inputs = "".join(f", input [{w - 1}:0] {n}" for n, w in given)
    return f"""module both(input clk{inputs}, output bad);
reg ran = 0, left = 0;
wire reset = rst | ~ran;
{chr(10).join(lines)}
always @(posedge clk) begin ran <= 1; left <= left | (ran & {broken}); end
assign bad = ran & ~left & ({differ});
endmodule
"""


def abc(commands, place):
    done = subprocess.run(
        ["sh", "-c", f'ulimit -t {CPU_S}; exec yosys-abc -c "$0"', "; ".join(commands)],
        cwd=place,
        capture_output=True,
        text=True,
    )
    return done.stdout


def yosys(steps, place):
    subprocess.run(["yosys", "-q", "-p", "; ".join(steps)], cwd=place, check=True, capture_output=True, text=True)


def proved(manifest, fault, rom):
    """(equivalent, alive or undecided; why)."""
    with tempfile.TemporaryDirectory() as place:
        design(place, fault, rom)
        given = "".join(f" -chparam {name} {width}'h{raw:x}" for name, width, raw in mutate.parameters(manifest))
        for name in ("gold", "gate"):
            read = [f"read_verilog -sv {part}.v" for part in PARTS.get(fault.stem, ())]
            read += [f"read_verilog -sv -defer {name}.v", f"hierarchy -check -top {name}{given}"]
            flat = "proc; flatten; opt -nodffe -nosdff; memory -nomap -nordff; opt -full -nodffe -nosdff"
            yosys([*read, flat, f"rename -top {name}", f"write_rtlil {name}.il"], place)
        Path(place, "both.v").write_text(top(manifest))
        read = [
            "read_rtlil gold.il; read_rtlil gate.il; read_verilog -sv both.v; hierarchy -top both; proc; flatten; opt"
        ]
        yosys([*read, MAP], place)
        clear = 0
        for way in (judge.NEAR, judge.PROOF, judge.FAR):
            said = abc(["read_aiger both.aig", "strash", way], place)
            if found := re.search(r"asserted in frame (\d+)", said):
                return "alive", f"differs {found[1]} clocks after reset"
            if "Property proved" in said or "all reachable states" in said:
                return "equivalent", "in every state that can be reached"
            clear = max([clear, *map(int, re.findall(r"No output asserted in (\d+) frames", said))])
        return "undecided", f"no difference within {clear} clocks from reset, and no proof"


def fate(bundles, fault):
    """Words for what became of a fault that the bundle of its block does not show."""
    block = Path(bundles) / fault.stem
    for case in sorted(path.parent for path in block.glob("*/manifest.json")):
        if case.name == rtl_faults.CASES[fault.stem]:
            continue
        with tempfile.TemporaryDirectory() as place:
            for part in PARTS.get(fault.stem, ()):
                shutil.copy(rtl_faults.RTL / f"{part}.v", place)
            Path(place, f"{fault.stem}.v").write_text(fault.text)
            row, _ = first_row.first(case, place)
        if row is not None:
            return f"killed by case {case.name}, row {row}"
    folder = block / rtl_faults.CASES[fault.stem]
    roms = sorted(folder.resolve().glob("rom/*.hex"))
    return ": ".join(proved(json.loads((folder / "manifest.json").read_text()), fault, roms[0] if roms else None))

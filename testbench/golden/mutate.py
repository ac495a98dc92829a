"""Mutation score of a bundle: what share of small faults in a design its vectors see.

    read, flatten        yosys, with the parameters of the case; registers as plain flip-flops, enables as multiplexers
    choose               `mutate -list`: evenly over the netlist, by seed; every fault switched on by one input
    run                  one Verilator program: fault 0 (none) must pass, then each fault until the first row differs
    judge the survivors  `judge`: equivalent (proved), alive (a trace that shows it), or undecided

    score = killed / (mutants - equivalent)

Each run begins in the reset state of the sound design. Faults on clock pins are left out: vectors have one clock.
Source  docs/golden.md; yosys manual, `mutate`
"""

import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

from testbench.errors import ConfigError, FileError
from testbench.files import write_text
from testbench.golden import benches, bundle, judge

COUNT, SEED = 150, 1
MAX_COUNT, MAX_JOBS = 10_000, 64
SURPLUS = 3  # faults asked for per fault wanted: those on clock pins are dropped
TOOL_S = 1800  # a tool that runs longer than this has hung
SELECT = "gyro_mutant"
TOOLS = (*judge.TOOLS, "verilator", "make")


class Mutant(NamedTuple):
    """A fault: its number, the yosys options that make it, and where in the RTL it sits."""

    number: int
    options: str
    source: str


class Outcome(NamedTuple):
    """What became of the faults of a bundle; `survivors` are dictionaries, ready for JSON."""

    block: str
    case: str
    seed: int
    mutants: int
    killed: int
    equivalent: int
    undecided: int
    survivors: list

    @property
    def score(self):
        """Killed over those not proved equivalent; 1 when there is none."""
        real = self.mutants - self.equivalent
        return self.killed / real if real else 1.0

    def to_dict(self):
        return {**self._asdict(), "score": self.score}

    def text(self):
        title = f"{self.block}/{self.case}: {self.mutants} mutants, seed {self.seed}: {self.killed} killed, "
        title += f"{self.equivalent} equivalent, {self.undecided} undecided; score {100 * self.score:.2f} %"
        rows = [f"  {s['verdict']}: {s['fault']} at {s['source']}: {s['why']}" for s in self.survivors]
        return "\n".join([title, *(row for row, s in zip(rows, self.survivors) if s["verdict"] != "equivalent")])


# ---- tools ---------------------------------------------------------------------------------------------------------


def run_tool(command, folder, what):
    """Standard output of a tool; FileError with its last words if it fails."""
    try:
        done = subprocess.run(
            [str(word) for word in command], cwd=folder, capture_output=True, text=True, timeout=TOOL_S
        )
    except subprocess.TimeoutExpired:
        raise FileError(f"{what}: {command[0]} did not end within {TOOL_S} s") from None
    if done.returncode:
        said = "\n".join((done.stdout + done.stderr).strip().splitlines()[-8:])
        raise FileError(f"{what}: {command[0]} failed with {done.returncode}:\n{said}")
    return done.stdout


def sources(manifest, rtl):
    """Files of the design: parts first, the block last; raises FileError if one is missing."""
    stem = manifest["block"]
    found = []
    for name in (*benches.PARTS.get(stem, ()), stem):
        path = Path(rtl).resolve() / f"{name}.v"
        if not path.is_file():
            raise FileError(f"{path}: no such file; the design of {stem} needs it")
        found.append(path)
    return found


def parameters(manifest):
    """[(name, width, raw bits)] of the case."""
    listed = []
    for entry in manifest["params"]:
        width = sum(entry["fmt"])
        listed.append((entry["name"], width, entry["raw"] & ((1 << width) - 1)))
    return listed


def prepare(folder, manifest, files, work):
    """Write base.il: the design of the case, flat, with `$dff` and multiplexers alone."""
    stem = manifest["block"]
    for path in files:
        # this front end takes no text as a parameter from outside: the table's name is put in place of the empty one
        text = path.read_text()
        for rom in sorted((folder / "rom").glob("*.hex")) if (folder / "rom").is_dir() else ():
            text = text.replace('ROM_FILE = ""', f'ROM_FILE = "{rom.resolve()}"')
        (work / path.name).write_text(text)
    given = "".join(f" -chparam {name} {width}'h{raw:x}" for name, width, raw in parameters(manifest))
    *parts, top = (path.name for path in files)
    steps = [f"read_verilog {name}" for name in parts]
    steps += [
        f"read_verilog -defer {top}",
        f"hierarchy -check -top gyro_{stem}{given}",
        "proc; flatten; opt -nodffe -nosdff; memory -nomap -nordff; opt -full -nodffe -nosdff; check -assert",
        "select -assert-none t:$dlatch t:$adff t:$dffsr t:$aldff t:$sdff t:$dffe t:$sdffe t:$sdffce",
        "rename -top mutable",
        "write_ilang base.il",
    ]
    run_tool(["yosys", "-q", "-p", "; ".join(steps)], work, f"{stem}: the design")


def choose(work, count, seed, what):
    """`count` faults of base.il, or all there are."""
    steps = f"read_ilang base.il; mutate -list {SURPLUS * count} -seed {seed} -o list.txt"
    run_tool(["yosys", "-q", "-p", steps], work, what)
    mutants, seen = [], set()
    for line in (work / "list.txt").read_text().splitlines():
        options = re.sub(r"^mutate | -(src|wire|wirebit) \S+", "", line).strip()
        if " -port CLK" in options or options in seen:
            continue
        seen.add(options)
        places = re.findall(r"-src (\S+)", line)
        mutants.append(Mutant(len(mutants) + 1, options, places[-1] if places else "?"))
        if len(mutants) == count:
            break
    return mutants


# ---- simulation ----------------------------------------------------------------------------------------------------


def _wrapper(manifest, bits):
    """Verilog: the faulted design with the vectors around it; C++ has only to count rows."""
    inputs = manifest["inputs"]
    found = [f"r_{p['name']}" for p in manifest["registers"]] + [f"o_{p['name']}" for p in manifest["outputs"]]
    results = manifest["registers"] + manifest["outputs"]
    wide, out, rows = bundle.total(inputs), bundle.total(results), manifest["n"]
    nets = "\n".join(f"    wire [{p['width'] - 1}:0] {n};" for n, p in zip(found, results, strict=True))
    left, ports = wide, [".clk(clk)", f".{SELECT}(chosen)"]
    for port in inputs:
        piece = f"now[{left - 1}:{left - port['width']}]"
        ports.append(f".{port['name']}({piece + ' | clear' if port['name'] == 'rst' else piece})")
        left -= port["width"]
    ports += [f".{name}({name})" for name in found]
    return f"""module bench (
    input wire clk,
    input wire clear,
    input wire [{bits - 1}:0] chosen,
    input wire [31:0] row,
    output wire bad
);
    reg [{wide - 1}:0] stim [0:{rows - 1}];
    reg [{out - 1}:0] exp [0:{rows - 1}];
    reg [{out - 1}:0] mask [0:{rows - 1}];
    initial begin
        $readmemh("stim.hex", stim);
        $readmemh("exp.hex", exp);
        $readmemh("mask.hex", mask);
    end
    wire [{wide - 1}:0] now = stim[row];
{nets}
    mutable dut ({", ".join(ports)});
    assign bad = |(({{{", ".join(found)}}} ^ exp[row]) & mask[row]);
endmodule
"""


def _driver(count, rows, reset_cycles):
    """C++: every fault from the reset state of the unfaulted design to the first row that differs."""
    return f"""#include <cstdio>
#include "Vbench.h"
#include "verilated.h"
int main() {{
    VerilatedContext context;
    Vbench top(&context);
    for (unsigned m = 0; m <= {count}; m++) {{
        top.chosen = 0; top.clear = 1; top.row = 0;
        for (int k = 0; k < {reset_cycles}; k++) {{
            top.clk = 0; top.eval(); top.clk = 1; top.eval();
        }}
        top.clk = 0; top.eval();
        top.clear = 0; top.chosen = m;
        long first = -1;
        for (unsigned n = 0; n < {rows} && first < 0; n++) {{
            top.row = n; top.clk = 0; top.eval();
            if (top.bad) first = n;
            top.clk = 1; top.eval();
        }}
        std::printf("%u %ld\\n", m, first);
    }}
    return 0;
}}
"""


def simulate(folder, manifest, mutants, work):
    """{number: first row that differs, or -1} of every fault; FileError if the design fails without one."""
    what = f"{manifest['block']}/{manifest['case']}"
    bits = max(1, len(mutants).bit_length())
    lines = [f"mutate -ctrl {SELECT} {bits} {m.number} {m.options}" for m in mutants]
    if not lines:
        lines = [f"mutate -mode none -ctrl {SELECT} {bits} 1"]
    script = ["read_ilang base.il", *lines, "opt_clean", "write_verilog -noattr design.v"]
    (work / "mutants.ys").write_text("\n".join(script) + "\n")
    run_tool(["yosys", "-q", "mutants.ys"], work, what)
    (work / "bench.v").write_text(_wrapper(manifest, bits))
    (work / "main.cpp").write_text(_driver(len(mutants), manifest["n"], manifest["reset"]["cycles"]))
    for name in bundle.WORDS:
        shutil.copyfile(folder / f"{name}.hex", work / f"{name}.hex")
    build = ["verilator", "--cc", "--exe", "--build", "-Wno-fatal", "-Wno-lint", "-Wno-style", "--x-initial", "0"]
    build += [
        "--top-module",
        "bench",
        "-MAKEFLAGS",
        "OPT_FAST=-O1 OPT_SLOW=-O0 OPT_GLOBAL=-O0",
        "--Mdir",
        "sim",
        "bench.v",
        "design.v",
        "main.cpp",
    ]
    run_tool(build, work, what)
    said = run_tool([work / "sim" / "Vbench"], work, what)
    first = {int(m): int(row) for m, row in (line.split() for line in said.splitlines())}
    if first[0] >= 0:
        raise FileError(f"{what}: the design differs from the bundle at row {first[0]}: a failing design has no score")
    return first


# ---- all together --------------------------------------------------------------------------------------------------


def score(folder, rtl, count=COUNT, seed=SEED, jobs=1, keep=None):
    """Outcome of a bundle for the design in the folder `rtl`.

    count  faults wanted; a small design may have fewer
    seed   of the choice, >= 0
    jobs   survivors judged at a time
    keep   folder for the intermediate files, or None
    Raises ConfigError for a bad number or a missing tool, FileError for a bad bundle, a missing or a failing design.
    """
    if not 1 <= count <= MAX_COUNT:
        raise ConfigError(f"count: {count} is outside 1 .. {MAX_COUNT} mutants")
    if not 0 <= seed < 1 << 31:
        raise ConfigError(f"seed: {seed} is outside 0 .. 2**31 - 1")
    if not 1 <= jobs <= MAX_JOBS:
        raise ConfigError(f"jobs: {jobs} is outside 1 .. {MAX_JOBS}")
    for name in TOOLS:
        if shutil.which(name) is None:
            raise ConfigError(f"{name}: not installed; a mutation score needs {', '.join(TOOLS)}")
    folder = Path(folder)
    manifest = bundle.verify(folder)
    files = sources(manifest, rtl)
    what = f"{manifest['block']}/{manifest['case']}"
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(keep or temporary).resolve()
        work.mkdir(parents=True, exist_ok=True)
        prepare(folder, manifest, files, work)
        mutants = choose(work, count, seed, what)
        first = simulate(folder, manifest, mutants, work)
        alive = [m for m in mutants if first[m.number] < 0]
        verdicts = judge.judge(manifest, alive, work, jobs)
    survivors = [
        {"mutant": m.number, "fault": m.options, "source": m.source, **verdict._asdict()}
        for m, verdict in zip(alive, verdicts, strict=True)
    ]
    kinds = [s["verdict"] for s in survivors]
    return Outcome(
        block=manifest["block"],
        case=manifest["case"],
        seed=seed,
        mutants=len(mutants),
        killed=len(mutants) - len(alive),
        equivalent=kinds.count("equivalent"),
        undecided=kinds.count("undecided"),
        survivors=survivors,
    )


def record(folder, outcome):
    """Write the outcome into the provenance of the bundle's manifest, which no hash covers."""
    path = Path(folder) / bundle.MANIFEST
    manifest = bundle.verify(folder)
    kept = {k: v for k, v in outcome.to_dict().items() if k not in ("block", "case")}
    manifest["provenance"]["mutation"] = kept
    write_text(path, json.dumps(manifest, indent=1, ensure_ascii=True) + "\n")

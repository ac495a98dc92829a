"""Is a fault that no vector saw a fault at all? Judged by the SAT solvers of yosys' own ABC.

    differs    an output or a next register of the faulted design is not that of the sound one, which stands in the
               same state and has the same inputs: the first difference of the two begins in a common state
    1. once    `differs` is impossible in every state, reachable or not: equivalent, without any bound
    2. search  else from reset, 1, 2, .. clocks: a trace that ends in `differs`: alive
    3. proof   else property-directed reachability finds an invariant without `differs`, equivalent, or a trace, alive
    4. search  else as 2., further
    otherwise  undecided, with the number of clocks that were searched

Inputs that the contract of a block forbids, such as a start within the wait of the last one, are left out.
Source  docs/golden.md; Een, Mishchenko, Brayton, FMCAD 2011 (PDR)
"""

import json
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from testbench.errors import FileError

ONCE_S, NEAR_S, PROOF_S, FAR_S = 60, 5, 20, 20
NEAR_CLOCKS, FAR_CLOCKS = 16, 600
HANGS_S = 1200
CLOCK, RESET = "clk", "rst"
TOOLS = ("yosys", "yosys-abc")
# Inputs that a block need not stand: a condition on inputs and registers that holds at every edge, in Verilog
CONTRACTS = {"rate_output": "!(en && r_stage != 5'd0)"}


class Verdict(NamedTuple):
    """equivalent, alive or undecided; why; and for a living fault the inputs (hex) of each clock from reset.

    An output differs in the last clock of the trace, or a register after it.
    """

    verdict: str
    why: str
    trace: list


def _run(command, folder, what, limit_s=HANGS_S):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=limit_s)
    if done.returncode:
        said = "\n".join((done.stdout + done.stderr).strip().splitlines()[-6:])
        raise FileError(f"{what}: {command[0]} failed with {done.returncode}:\n{said}")
    return done.stdout


# ---- netlists ------------------------------------------------------------------------------------------------------


def _opened(path):
    """(module, registers) of a flat JSON netlist with its flip-flops cut out: `q_k` are inputs, `d_k` outputs.

    registers  [(name of the cell, width)] in the order of k
    """
    (module,) = json.loads(path.read_text())["modules"].values()
    kept, ports, registers = {}, dict(module["ports"]), []
    ports.pop(CLOCK, None)
    for cell_name, cell in sorted(module["cells"].items()):
        if cell["type"] != "$dff":
            kept[cell_name] = cell
            continue
        k, pins = len(registers), cell["connections"]
        ports[f"q_{k}"] = {"direction": "input", "bits": pins["Q"]}
        ports[f"d_{k}"] = {"direction": "output", "bits": pins["D"]}
        registers.append((cell_name, len(pins["Q"])))
    return {"attributes": {}, "ports": ports, "cells": kept, "netnames": {}}, registers


def _initial(manifest, sound, registers):
    """Reset value of each register as binary text; one that is no port has none that the bundle knows: 0."""
    values = {}
    for port in manifest["registers"]:
        for k, bit in enumerate(sound["ports"][f"r_{port['name']}"]["bits"]):
            values[bit] = port["reset"] >> k & 1
    columns = (reversed(sound["ports"][f"q_{k}"]["bits"]) for k in range(len(registers)))
    return ["".join(str(values.get(bit, 0)) for bit in column) for column in columns]


def _top(manifest, registers, initial, count):
    """Verilog: `once`, one clock from any state, and `ever`, from reset; `bad[k]` is the difference of fault k."""
    outs = [(f"r_{p['name']}", p["width"]) for p in manifest["registers"]]
    outs += [(f"o_{p['name']}", p["width"]) for p in manifest["outputs"]]
    state = [(f"q_{k}", width) for k, (_, width) in enumerate(registers)]
    following = [(f"d_{k}", width) for k, (_, width) in enumerate(registers)]
    inputs = [(port["name"], port["width"]) for port in manifest["inputs"]]
    given = [f".{name}({name})" for name, _ in inputs + state]
    lines = []
    for kind, module in (("g", "sound"), *((f"f{k}", f"faulted_{k}") for k in range(count))):
        lines += [f"    wire [{width - 1}:0] {kind}_{name};" for name, width in outs + following]
        pins = [*given, *(f".{name}({kind}_{name})" for name, _ in outs + following)]
        lines.append(f"    {module} {kind} ({', '.join(pins)});")
    right = ", ".join(f"g_{name}" for name, _ in outs + following)
    for k in range(count):
        wrong = ", ".join(f"f{k}_{name}" for name, _ in outs + following)
        lines.append(f"    assign bad[{k}] = kept && {{{right}}} != {{{wrong}}};")
    contract = re.sub(r"\b([ro]_\w+)", r"g_\1", CONTRACTS.get(manifest["block"], "1'b1"))
    ports = [f"    input wire [{width - 1}:0] {name}," for name, width in inputs]
    held = [f"    input wire [{width - 1}:0] {name}," for name, width in state]
    moved = [f"    output wire [{width - 1}:0] n_{name}," for name, width in following]
    regs = [f"    reg [{w - 1}:0] {name} = {w}'b{bits};" for (name, w), bits in zip(state, initial, strict=True)]
    nets = [f"    wire [{width - 1}:0] n_{name};" for name, width in following]
    steps = [f"        {q} <= n_{d};" for (q, _), (d, _) in zip(state, following, strict=True)]
    pins = [*given, *(f".n_{name}(n_{name})" for name, _ in following), ".bad(differs)", ".kept(kept)"]
    text = [
        "module once (",
        *ports,
        *held,
        *moved,
        f"    output wire [{count - 1}:0] bad,",
        "    output wire kept",
        ");",
    ]
    text += lines + [f"    assign n_{name} = g_{name};" for name, _ in following]
    text += [f"    assign kept = {contract};", "endmodule"]
    text += ["module single (", *ports, *held, f"    output wire [{count - 1}:0] bad", ");"]
    text += [f"    once both ({', '.join([*given, '.bad(bad)'])});", "endmodule"]
    text += ["module ever (", f"    input wire {CLOCK},", *ports, f"    output wire [{count - 1}:0] bad", ");"]
    text += [*regs, *nets, "    reg broken = 1'b0;", f"    wire [{count - 1}:0] differs;", "    wire kept;"]
    text += [f"    once both ({', '.join(pins)});", f"    assign bad = broken ? {count}'d0 : differs;"]
    text += [
        f"    always @(posedge {CLOCK}) begin",
        "        broken <= broken || !kept;",
        *steps,
        "    end",
        "endmodule",
    ]
    return "\n".join(text) + "\n"


def _netlists(manifest, faults, work, what):
    """Write single.aig and ever.aig, with one output per fault; what the designs share is there once."""
    steps = ["read_ilang base.il", "memory_map", "opt_clean", "write_json sound.json"]
    for k, fault in enumerate(faults):
        steps += ["design -reset", "read_ilang base.il", f"mutate {fault.options}", "memory_map", "opt_clean"]
        steps += [f"write_json faulted_{k}.json"]
    (work / "netlists.ys").write_text("\n".join(steps) + "\n")
    _run(["yosys", "-q", "netlists.ys"], work, what)
    sound, registers = _opened(work / "sound.json")
    modules = {"sound": sound}
    for k, fault in enumerate(faults):
        modules[f"faulted_{k}"], found = _opened(work / f"faulted_{k}.json")
        if found != registers:
            raise FileError(f"{what}: mutant {fault.number} has other registers than the design")
    (work / "opened.json").write_text(json.dumps({"modules": modules}))
    initial = _initial(manifest, sound, registers)
    (work / "top.v").write_text(_top(manifest, registers, initial, len(faults)))
    for top in ("single", "ever"):
        steps = ["read_json opened.json", "read_verilog top.v", f"hierarchy -top {top}", "proc", "flatten", "opt -full"]
        steps += ["setundef -undriven -zero", "opt -full", "techmap", "opt -full", "dffunmap", "setundef -zero"]
        steps += ["aigmap", "opt_clean", f"write_aiger -zinit -symbols {top}.aig"]
        _run(["yosys", "-q", "-p", "; ".join(steps)], work, what)


# ---- solvers -------------------------------------------------------------------------------------------------------


def _abc(commands, work, what, limit_s=HANGS_S):
    """What ABC said, or nothing when the time was up."""
    try:
        return _run(["yosys-abc", "-c", "; ".join(commands)], work, what, limit_s)
    except subprocess.TimeoutExpired:
        return ""


def _trace(path, inputs):
    """[{input: hex}] of each clock from a counterexample with names: `name[bit]@clock=value`."""
    clocks = {}
    for name, bit, clock, value in re.findall(r"(\w+)(?:\[(\d+)\])?@(\d+)=(\d)", path.read_text()):
        words = clocks.setdefault(int(clock), {})
        words[name] = words.get(name, 0) | int(value) << int(bit or 0)
    return [{name: f"{word:x}" for name, word in clocks[n].items() if name in inputs} for n in sorted(clocks)]


def _verdict(k, inputs, work, what):
    """Verdict on fault k."""
    said = _abc(["read_aiger single.aig", f"cone -O {k}", "strash", "iprove"], work, what, ONCE_S)
    if re.search(r"\bUNSATISFIABLE", said):
        return Verdict("equivalent", "in every state", [])
    ready, found = ["read_aiger ever.aig", f"cone -s -O {k}", "strash"], work / f"trace_{k}.txt"
    clear = 0
    for way in (f"bmc3 -F {NEAR_CLOCKS} -T {NEAR_S}", f"scorr; pdr -T {PROOF_S}", f"bmc3 -F {FAR_CLOCKS} -T {FAR_S}"):
        said = _abc([*ready, way, f"write_cex -n {found.name}"], work, what)
        if "was asserted in frame" in said:
            trace = _trace(found, inputs)
            return Verdict("alive", f"differs {len(trace)} clocks after reset", trace)
        if "Property proved" in said or "all reachable states" in said:
            return Verdict("equivalent", "in every state that can be reached", [])
        clear = max([clear, *map(int, re.findall(r"No output asserted in (\d+) frames", said))])
    return Verdict("undecided", f"no difference within {clear} clocks from reset, and no proof", [])


def judge(manifest, faults, work, jobs=1):
    """Verdict of each fault, `jobs` at a time; base.il must stand in `work`."""
    if not faults:
        return []
    what = f"{manifest['block']}/{manifest['case']}"
    _netlists(manifest, faults, work, what)
    inputs = {port["name"] for port in manifest["inputs"]}
    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(lambda k: _verdict(k, inputs, work, what), range(len(faults))))

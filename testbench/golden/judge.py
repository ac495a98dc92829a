"""Is a fault that no vector saw a fault at all? Judged by the SAT solvers of yosys' own ABC.

    differs    an output or a next register of the faulted design is not that of the sound one, which stands in the
               same state and has the same inputs: the first difference of the two begins in a common state
    1. once    `differs` is impossible in every state, reachable or not: equivalent, without any bound
    2. search  else from reset, 1, 2, .. clocks: the shortest trace that ends in `differs`: alive
    3. proof   else property-directed reachability finds an invariant without `differs`: equivalent
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

ONCE_S, SEARCH_S, PROOF_S = 30, 30, 60
SEARCH_CLOCKS = 600
HANGS_S = 1200
CLOCK, RESET = "clk", "rst"
TOOLS = ("yosys", "yosys-abc")
# Inputs that a block need not stand: a condition on inputs and registers that holds at every edge, in Verilog
CONTRACTS = {"rate_output": "!(en && r_stage != 5'd0)"}


class Verdict(NamedTuple):
    """equivalent, alive or undecided; why; and for a living fault the inputs (hex) of each clock from reset."""

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


def _opened(path, name):
    """(JSON netlist, registers) of a flat design with its flip-flops cut out: `q_k` are inputs, `d_k` outputs.

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
    opened = {"attributes": {}, "ports": ports, "cells": kept, "netnames": {}}
    return {"modules": {name: opened}}, registers


def _reset_values(path, manifest):
    """{bit: 0 or 1} of every register port, from the manifest."""
    (module,) = json.loads(path.read_text())["modules"].values()
    values = {}
    for port in manifest["registers"]:
        for k, bit in enumerate(module["ports"][f"r_{port['name']}"]["bits"]):
            values[bit] = port["reset"] >> k & 1
    return values


def _top(manifest, registers, initial):
    """Verilog: `once`, one clock from any state, and `ever`, from reset; `bad` is the difference."""
    inputs = manifest["inputs"]
    outs = [(f"r_{p['name']}", p["width"]) for p in manifest["registers"]]
    outs += [(f"o_{p['name']}", p["width"]) for p in manifest["outputs"]]
    state = [(f"q_{k}", width) for k, (_, width) in enumerate(registers)]
    following = [(f"d_{k}", width) for k, (_, width) in enumerate(registers)]
    wires = [f"    wire [{width - 1}:0] {kind}_{name};" for name, width in outs + following for kind in ("g", "f")]
    given = [f".{p['name']}({p['name']})" for p in inputs] + [f".{name}({name})" for name, _ in state]

    def instance(kind, module):
        pins = [*given, *(f".{name}({kind}_{name})" for name, _ in outs + following)]
        return f"    {module} {kind} ({', '.join(pins)});"

    every = {kind: ", ".join(f"{kind}_{name}" for name, _ in outs + following) for kind in ("g", "f")}
    contract = re.sub(r"\b([ro]_\w+)", r"g_\1", CONTRACTS.get(manifest["block"], "1'b1"))
    ports = [f"    input wire [{p['width'] - 1}:0] {p['name']}" for p in inputs]
    ports_state = [f"    input wire [{width - 1}:0] {name}" for name, width in state]
    results = [f"    output wire [{width - 1}:0] n_{name}" for name, width in following]
    once = ",\n".join([*ports, *ports_state, *results, "    output wire bad", "    output wire kept"])
    nexts = "\n".join(f"    assign n_{name} = g_{name};" for name, _ in following)
    regs = "\n".join(
        f"    reg [{width - 1}:0] {name} = {width}'b{value};\n    wire [{width - 1}:0] n_d_{name[2:]};"
        for (name, width), value in zip(state, initial, strict=True)
    )
    moves = "\n".join(f"        {name} <= n_d_{name[2:]};" for name, _ in state)
    pins = [*given, *(f".n_{name}(n_{name})" for name, _ in following), ".bad(differs)", ".kept(kept)"]
    return f"""module once (
{once}
);
{chr(10).join(wires)}
{instance("g", "sound")}
{instance("f", "faulted")}
{nexts}
    assign kept = {contract};
    assign bad = kept && {{{every["g"]}}} != {{{every["f"]}}};
endmodule
module single (
{",".join(chr(10) + line for line in [*ports, *ports_state])},
    output wire bad
);
    once both ({", ".join([*given, ".bad(bad)"])});
endmodule
module ever (
    input wire {CLOCK},
{",".join(chr(10) + line for line in ports)},
    output wire bad
);
{regs}
    reg broken = 1'b0;
    wire differs, kept;
    once both ({", ".join(pins)});
    assign bad = differs && !broken;
    always @(posedge {CLOCK}) begin
        broken <= broken || !kept;
{moves}
    end
endmodule
"""


def _open(manifest, faults, work, what):
    """Write sound_open.json, faulted_k.json and top.v."""
    steps = ["read_ilang base.il", "memory_map", "opt_clean", "write_json sound.json"]
    for k, fault in enumerate(faults):
        steps += ["design -reset", "read_ilang base.il", f"mutate {fault.options}", "memory_map", "opt_clean"]
        steps += [f"write_json faulted_{k}.json"]
    (work / "netlists.ys").write_text("\n".join(steps) + "\n")
    _run(["yosys", "-q", "netlists.ys"], work, what)
    reset = _reset_values(work / "sound.json", manifest)
    sound, registers = _opened(work / "sound.json", "sound")
    ports = sound["modules"]["sound"]["ports"]
    initial = []
    for k in range(len(registers)):
        # a register that is no port has no reset value that the bundle knows: it starts at 0
        initial.append("".join(str(reset.get(bit, 0)) for bit in reversed(ports[f"q_{k}"]["bits"])))
    (work / "sound_open.json").write_text(json.dumps(sound))
    (work / "top.v").write_text(_top(manifest, registers, initial))
    for k, fault in enumerate(faults):
        faulted, found = _opened(work / f"faulted_{k}.json", "faulted")
        if found != registers:
            raise FileError(f"{what}: mutant {fault.number} has other registers than the design")
        (work / f"faulted_{k}.json").write_text(json.dumps(faulted))


def _aiger(top, k, work, what):
    """Write TOP_k.aig of fault k: what both designs share is merged before it is mapped to gates."""
    steps = ["read_json sound_open.json", f"read_json faulted_{k}.json", "read_verilog top.v", f"hierarchy -top {top}"]
    steps += ["proc", "flatten", "opt -full", "setundef -undriven -zero", "opt -full", "techmap", "opt -full"]
    steps += ["dffunmap", "setundef -zero", "aigmap", "opt_clean", f"write_aiger -zinit -symbols {top}_{k}.aig"]
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
    _aiger("single", k, work, what)
    said = _abc([f"read_aiger single_{k}.aig", "strash", "iprove"], work, what, ONCE_S)
    if re.search(r"\bUNSATISFIABLE", said):
        return Verdict("equivalent", "in every state", [])
    _aiger("ever", k, work, what)
    ready, found = [f"read_aiger ever_{k}.aig", "strash"], work / f"trace_{k}.txt"
    said = _abc([*ready, f"bmc3 -F {SEARCH_CLOCKS} -T {SEARCH_S}", f"write_cex -n {found.name}"], work, what)
    if "was asserted in frame" in said:
        trace = _trace(found, inputs)
        return Verdict("alive", f"differs {len(trace)} clocks after reset", trace)
    clear = re.search(r"No output asserted in (\d+) frames", said)
    said = _abc([*ready, "scorr", f"pdr -T {PROOF_S}"], work, what)
    if "Property proved" in said:
        return Verdict("equivalent", "in every state that can be reached", [])
    searched = clear.group(1) if clear else 0
    return Verdict("undecided", f"no difference within {searched} clocks from reset, and no proof", [])


def judge(manifest, faults, work, jobs=1):
    """Verdict of each fault, `jobs` at a time; base.il must stand in `work`."""
    if not faults:
        return []
    what = f"{manifest['block']}/{manifest['case']}"
    _open(manifest, faults, work, what)
    inputs = {port["name"] for port in manifest["inputs"]}
    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(lambda k: _verdict(k, inputs, work, what), range(len(faults))))

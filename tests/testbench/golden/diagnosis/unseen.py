"""What a fault is that no row of its bundle shows: killed by another bundle, alive, equivalent, or undecided.

    1. the other cases of the block     the first one with a row that differs
    2. the judge of mutation scores     both designs on the same registers: `testbench/golden/mutation/judge.py`

Registers that only the design with the fault has are its own.
"""

import json
import shutil
import tempfile
from pathlib import Path

import numpy as np

from fpga_model import rate_output
from testbench.golden.bundles.benches import PARTS
from testbench.golden.mutation import aig, mutant_judge, mutate
from testbench.golden.mutation.miter import Net
from testbench.tool import run_tool
from tests.testbench.golden.diagnosis import first_row, rtl_faults

# Inputs that stand while a register is not 0: {block: (register, inputs)}
STEADY = {"rate_output": ("r_stage", rate_output.Params._fields)}


def graph_of(folder, manifest, text, work):
    """`aig.Graph` of a design of a block, flat, with the parameters of the bundle."""
    work.mkdir()
    files = [work / f"{part}.v" for part in PARTS.get(manifest["block"], ())]
    for path in files:
        shutil.copy(rtl_faults.RTL / path.name, path)
    files.append(work / f"{manifest['block']}.v")
    files[-1].write_text(text)
    mutate.prepare(folder, manifest, files, work)
    run_tool(["yosys", "-q", "-p", f"read_ilang base.il; {aig.STEPS} design.aag"], work, manifest["block"])
    return aig.read(work / "design.aag")


def registers(graph):
    """[what each flip-flop is: the bits of registers that show it, each with whether it is inverted]."""
    shown = [[] for _ in graph.latches]
    for name, places in graph.outputs.items():
        for bit, place in enumerate(places):
            literal = int(graph.out_literals[place])
            if 0 <= (literal >> 1) - 1 - graph.in_count < len(shown):
                shown[(literal >> 1) - 1 - graph.in_count].append((name, bit, literal & 1))
    return list(map(tuple, shown))


def joined(gold, gate, steady=None):
    """(graph with the fault at the input `mutate.SELECT`, reset state) of two designs with the same ports.

    steady  (register, inputs): once an input has changed while the register was not 0, the fault is off
    """
    have = registers(gold)
    places = {shown: k for k, shown in enumerate(have) if shown}
    own = [k for k, shown in enumerate(registers(gate)) if shown not in places]
    held = [place for name in steady[1] for place in gold.inputs[name]] if steady else []
    count = gold.in_count + 1
    latches = len(have) + len(own) + len(held) + bool(held)
    net = Net(count + latches)
    leaf = [2 * (k + 1) for k in range(count + latches)]
    select, state = leaf[gold.in_count], leaf[count:]
    last, over = state[len(have) + len(own) :], state[-1]

    given = [0] * gate.in_count
    for name, found in gate.inputs.items():
        for bit, place in enumerate(found):
            given[place] = leaf[gold.inputs[name][bit]]
    at = [places.get(shown, -1) for shown in registers(gate)]
    for k, latch in enumerate(own):
        at[latch] = len(have) + k

    outs, following = net.copy(gold, [*leaf[: gold.in_count], *state[: len(have)]])
    theirs, next_of_gate = net.copy(gate, given + [state[k] for k in at])
    on, tail = select, []
    if held:
        busy = net.any(outs[place] for place in gold.outputs[steady[0]])
        moved = net.any(net.differ(leaf[place], before) for place, before in zip(held, last))
        over = net.either(over, net.both(busy, moved))
        on, tail = net.both(select, over ^ 1), [*(leaf[place] for place in held), over]

    def chosen(a, b):
        return net.either(net.both(on, b), net.both(on ^ 1, a))

    outputs = [0] * len(outs)
    for name, found in gold.outputs.items():
        for bit, place in enumerate(found):
            outputs[place] = chosen(outs[place], theirs[gate.outputs[name][bit]])
    gates_next = dict(zip(at, next_of_gate, strict=True))
    ahead = [chosen(x, gates_next.get(k, x)) for k, x in enumerate(following)]
    ahead += [gates_next[len(have) + k] for k in range(len(own))] + tail

    graph = aig.Graph(
        gold.inputs | {mutate.SELECT: [gold.in_count]},
        gold.outputs,
        count,
        np.array(outputs),
        np.array(ahead),
        np.array(net.ands, np.int64).reshape(-1, 2),
    )
    return graph, after_reset(graph)


def after_reset(graph, clocks=2):
    """State after some clocks of reset, all else 0, from all 0."""
    state, (reset,) = [0] * len(graph.latches), graph.inputs["rst"]
    for _ in range(clocks):
        given = [int(place == reset) for place in range(graph.in_count)]
        _, state = Net(0).copy(graph, [*given, *state])
    return np.array(state)


def proved(folder, manifest, text):
    """`mutant_judge.Verdict` on a design of a block, with the parameters of the bundle."""
    with tempfile.TemporaryDirectory() as place:
        work, stem = Path(place), manifest["block"]
        gold, gate = (
            graph_of(folder, manifest, source, work / name)
            for name, source in (("gold", rtl_faults.source(stem)), ("gate", text))
        )
        graph, reset = joined(gold, gate, STEADY.get(stem))
        judged = mutant_judge.Judge(
            graph, mutate.SELECT, reset, stem, work, lambda: mutate.proven_register_ranges(manifest)
        )
        return judged.verdict(1)


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
    verdict = proved(folder, json.loads((folder / "manifest.json").read_text()), fault.text)
    return f"{verdict.verdict}: {verdict.why}"

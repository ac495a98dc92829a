"""How far a certain name hangs on one class: each class is left out, and its own hypotheses are the faults.

    python -m tests.testbench.golden.diagnosis.left_out --per-class 1 --seed 7 dds sine pi

A fault is the model with a hypothesis, run on the stimulus of a bundle. It prints a line for each fault for which
another class is certain while the right one is left out, and one where it is certain beside the right one.
"""

import argparse
import collections
import contextlib
import random
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.golden.bundles import bundle, export
from testbench.golden.check import diagnose
from testbench.golden.diagnosis import condition_hypotheses, elaborate, perturb, simulate_faults, value_hypotheses
from testbench.golden.diagnosis.node_rows import Rows
from tests.testbench.golden.diagnosis import rtl_faults

TRIED = 6  # hypotheses that are run for one that shows


class Block(NamedTuple):
    """A block, its graph and its golden rows."""

    stem: str
    net: object
    params: dict
    inputs: dict
    expected: dict

    @property
    def leaves(self):
        registers = {("reg", name): self.expected[name] for name in self.net.reset}
        return {("in", name): column for name, column in self.inputs.items()} | registers


class Counted(NamedTuple):
    """Faults, and of how many another class is certain: without the right one, and beside it; right and certain."""

    faults: int = 0
    without: int = 0
    beside: int = 0
    certain: int = 0


def read(folder, stem):
    """`Block` of a bundle."""
    found = bundle.read(folder)
    names = [p["name"] for p in found.manifest["registers"] + found.manifest["outputs"]]
    inputs = dict(zip([p["name"] for p in found.manifest["inputs"]], found.stim.T.copy()))
    params = {p["name"]: p["raw"] for p in found.manifest["params"]}
    net = elaborate.block_net(stem, params, DEFAULT)
    return Block(stem, net, params, inputs, dict(zip(names, found.exp.T.copy())))


def columns(block, h):
    """{register or pin: column} of the block with a hypothesis."""
    net, rows = block.net, []
    with mock.patch.object(simulate_faults, "_differs", lambda shown, _: rows.append(shown)):
        if simulate_faults.adds_a_register(net, h.by):
            by, (run, held) = None, simulate_faults.compile_block(net, h.site, h.by, list(net.roots))
        else:
            by = simulate_faults.compile_node(net, h.by)
            run, held = simulate_faults.compile_block(net, h.site, None, list(net.roots))
    count, golden = len(block.inputs["rst"]), Rows(net, block.leaves, len(block.inputs["rst"]))
    given = np.stack([block.inputs[n.value] for n in inputs_of(net)], axis=1).tolist()
    state = tuple(int(block.expected[name][0]) for name, root in net.roots.items() if root.op == "next")
    run(by, state, [int(golden.node_column(node)[0]) for node in held], given, 0, count, [None] * count)
    return {
        name: column for name, column in zip(net.roots, np.array(rows, np.int64).T.copy()) if name in block.expected
    }


def inputs_of(net):
    return sorted({n.value: n for n in net.nodes[: net.model_size] if n.op == "in"}.values(), key=lambda n: n.value)


def of_classes(block):
    """{class: hypotheses}; not those that read the next row."""

    def ahead(node):
        return node.op == "ahead" or (node.id >= block.net.model_size and any(ahead(a) for a in node.args))

    seen, found = Rows(block.net, block.leaves, len(block.inputs["rst"])).observed_range, collections.defaultdict(list)
    for node in block.net.nodes[: block.net.model_size]:
        for h in perturb.node_hypotheses(block.net, node, seen) if node.args or node.op in ("reg", "in") else ():
            if not ahead(h.by):
                found[h.cause].append(h)
    return found


@contextlib.contextmanager
def left_out(cause):
    """Diagnose without a class."""

    def others(function):
        return lambda *given: [h for h in function(*given) if h.cause != cause]

    with contextlib.ExitStack() as stack:
        for module, name in (
            (perturb, "node_hypotheses"),
            (value_hypotheses, "hypotheses"),
            (condition_hypotheses, "hypotheses"),
        ):
            stack.enter_context(mock.patch.object(module, name, others(getattr(module, name))))
        yield


def counted(block, per_class, draw, say=print):
    """`Counted` of a block."""
    total = Counted()
    for cause, hypotheses in of_classes(block).items():
        shown = 0
        for h in draw.sample(hypotheses, min(len(hypotheses), per_class * TRIED)):
            got = columns(block, h)
            if shown == per_class or all(np.array_equal(got[name], block.expected[name]) for name in got):
                continue
            shown += 1
            care = {name: np.ones(len(column), bool) for name, column in got.items()}
            rows = diagnose.Rows(block.stem, block.params, block.inputs, block.expected, got, care)
            with left_out(cause):
                without = [c for c in diagnose.diagnose(rows)[:1] if c.sure]
            best = [c for c in diagnose.diagnose(rows)[:1] if c.sure]
            beside = [c for c in best if c.cause != cause]
            for c, said in [*((c, "left out") for c in without), *((c, "beside it") for c in beside)]:
                say(f"{block.stem}: {cause}, {h.what}, {said}: {c.text()}")
            right = len(best) - len(beside)
            total = Counted(*(a + b for a, b in zip(total, (1, len(without), len(beside), right))))
    return total


def main(words):
    options = argparse.ArgumentParser()
    options.add_argument("--per-class", type=int, default=1)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--bundles", type=Path)
    options.add_argument("blocks", nargs="+", choices=rtl_faults.CASES)
    given = options.parse_args(words)
    total = Counted()
    with tempfile.TemporaryDirectory() as place:
        out = given.bundles or Path(place)
        for stem in given.blocks:
            if not (out / stem / "Makefile").exists():
                export.export(stem, out)
            block = read(out / stem / rtl_faults.CASES[stem], stem)
            found = counted(block, given.per_class, random.Random(given.seed))
            total = Counted(*map(sum, zip(total, found)))
            print(f"{stem}: {found}", flush=True)
    print(f"all: {total}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

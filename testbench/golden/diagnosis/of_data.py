"""Hypotheses with numbers that are read off the rows, reset values, limits, words of tables; and those in no class.

    in no class: an operation without one of its operands; a shift that is left out, or binds before the sum; a product
    before it; what is loaded with the old value, by three or five quarters, as sign and magnitude, or at least 0

Source  docs/diagnosis.md
"""

import numpy as np

from testbench.golden.diagnosis.net import ROUNDINGS
from testbench.golden.diagnosis.perturb import FAR, Hypothesis, with_argument
from testbench.golden.diagnosis.perturb_control import is_reset_choice

BEYOND = ""  # class of what is in none
MOST_WORDS = 2  # of a table that may be wrong
COST = 4
FLAGS = 8  # bits up to which a word may be of flags
FEW = 40  # rows that are compared first


def hypotheses(net, rows, target, inside, wrong):
    """Hypotheses on a target from its `wrong` rows; `inside` are the nodes of its root."""
    pattern = np.unique((target.got ^ target.sound)[wrong] & ((1 << target.fmt.width) - 1))
    found = [h for node in inside for h in _of_node(net, rows, target, node, wrong, pattern)]
    loaded = _values(net, rows, target, wrong)
    return found + [h for node in inside for h in _of_loads(net, target, node, loaded)]


def _values(net, rows, target, wrong):
    """[(cause, node)] of what has the design's value in all wrong rows: a number, a register, an input, a parameter."""
    got, own = target.got[wrong], net.nodes[: net.own]
    found = [("constant", net.const(got[0]))] if np.all(got == got[0]) else []
    for leaf in own:
        named = leaf.op == "param" or (leaf.op in ("reg", "in") and leaf.value not in (target.name, "rst"))
        if named and np.array_equal(target.as_held(rows.plain(leaf, wrong[:FEW])), got[:FEW]):
            if np.array_equal(target.as_held(rows.plain(leaf, wrong) + np.zeros(len(wrong), np.int64)), got):
                found.append(("operand", leaf))
    return found


def _of_loads(net, target, node, loaded):
    """Another number, register or input in the place of what a branch loads: rivals of what moves or keeps a value."""
    for k, child in enumerate(node.args if not is_reset_choice(node) else ()):
        if net.loads.get((node.id, k)) == target.name and child.op != "mux":
            for cause, value in loaded:
                if value is not child:
                    by = with_argument(net, node, k, value)
                    yield Hypothesis(cause, f"{value!r} in the place of {child!r}", node, by, FAR)


def _renumbered(net, node, old, new):
    """A choice with another number in the place of one, in all of its branches."""
    ways = [new if a is old else _renumbered(net, a, old, new) if a.op == "mux" else a for a in node.args[1:]]
    return net.node("mux", (node.args[0], *ways), node.value)


def _plain(pattern, width):
    """Whether inverted bits are those of one mistake: one bit, all, or any in a word of flags."""
    return int(pattern).bit_count() in (1, width) or width <= FLAGS


def _of_node(net, rows, target, node, wrong, pattern):
    if is_reset_choice(node):
        seen = np.unique(target.got[wrong[rows.full(node.args[0])[wrong] != 0]])
        if len(seen) == 1:
            value = net.const(seen[0])
            yield Hypothesis("reset", f"{value!r} for {node.args[1]!r}", node, with_argument(net, node, 1, value), 0)
            everywhere = _renumbered(net, node, node.args[1], value)
            yield Hypothesis("reset", f"{value!r} for {node.args[1]!r} wherever it is cleared", node, everywhere, 0)
    for k, child in enumerate(node.args):
        if net.loads.get((node.id, k)) == target.name and len(pattern) == 1 and _plain(pattern[0], target.fmt.width):
            by = with_argument(net, node, k, net.node("xor", (child, net.const(pattern[0]))))
            yield Hypothesis("sign", f"bits {int(pattern[0]):#x} inverted", node, by, 5)
    if node.op == "clamp":
        for value in {int(target.got[wrong].min()), int(target.got[wrong].max())}:
            for k, name in ((1, "lo"), (2, "hi")):
                by = with_argument(net, node, k, net.const(value))
                yield Hypothesis("limit", f"{name} is {value}", node, by, COST)
    if node.op == "table":
        places = np.unique(np.clip(rows.full(node.args[0])[wrong], 0, len(node.value) - 1))
        for place in places if len(places) <= MOST_WORDS else ():
            for bit in range(int(max(node.value)).bit_length()):
                for step in (1 << bit, -(1 << bit)):
                    words = list(node.value)
                    words[place] += step
                    by = net.node("table", node.args, tuple(words))
                    yield Hypothesis("constant", f"word {place} {step:+d}", node, by, COST)


def beyond(net, inside):
    """Hypotheses of mistakes in no class at the nodes inside of a target: never named, they make a name uncertain."""
    for node in inside:
        for what, by in _without_class(net, node):
            if by is not node:
                yield Hypothesis(BEYOND, what, node, by, FAR)


def _without_class(net, node):
    op, a = node.op, node.args
    if op in ("add", "sub", "mul"):
        yield f"without {a[1]!r}", a[0]
        yield f"without {a[0]!r}", net.node("neg", a[1:]) if op == "sub" else a[1]
    if op in ("shl", "shr", *ROUNDINGS):
        yield "without the shift", a[0]
    if op in ("shl", "shr", "mul", *ROUNDINGS):
        for k, sum_of in enumerate(a[:2]):
            if sum_of.op in ("add", "sub"):
                for j in (0, 1):
                    part = with_argument(net, node, k, sum_of.args[j])
                    yield f"{op} before {sum_of.op}", with_argument(net, sum_of, j, part)
    for k, child in enumerate(a):
        if (node.id, k) in net.loads and child.op not in ("const", "mux"):
            for what, new in _loaded_otherwise(net, child, net.loads[node.id, k]):
                yield what, with_argument(net, node, k, new)


def _loaded_otherwise(net, x, name):
    if name in net.reset:
        old = net.node("reg", (), name)
        total = net.node("add", (x, old))
        yield f"{x!r} and the old value", total
        yield f"mean of {x!r} and the old value", net.node("shr", (total, net.const(1)))
        yield f"{x!r} xor the old value", net.node("xor", (x, old))
        yield f"{x!r} from the old value", net.node("sub", (old, x))
        yield f"the old value from {x!r}", net.node("sub", (x, old))
    quarter = net.node("shr", (x, net.const(2)))
    yield f"5/4 {x!r}", net.node("add", (x, quarter))
    yield f"3/4 {x!r}", net.node("sub", (x, quarter))
    if net.fmts[name].s:
        top = net.const(1 << (net.fmts[name].width - 1))
        below = net.node("lt", (x, net.const(0)))
        yield f"{x!r} as sign and magnitude", net.node("mux", (below, net.node("sub", (top, x)), x))
        yield f"{x!r}, at least 0", net.node("mux", (below, net.const(0), x))
        yield f"amount of {x!r}", net.node("abs", (x,))

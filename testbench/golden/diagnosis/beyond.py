"""Mistakes that are in no class of the list: hypotheses that are never named, but may give the rows of one that is.

    an operation without one of its operands; a shift that is left out, or binds before the sum; a product before it
    what is loaded with the old value, by three or five quarters, as sign and magnitude, or at least 0

Source  docs/diagnosis.md
"""

from testbench.golden.diagnosis.net import ROUNDINGS
from testbench.golden.diagnosis.perturb import FAR, Hypothesis, with_argument

BEYOND = ""  # their class


def hypotheses(net, inside):
    """Hypotheses at the nodes inside of a target."""
    for node in inside:
        for what, by in _at(net, node):
            if by is not node:
                yield Hypothesis(BEYOND, what, node, by, FAR)


def _at(net, node):
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
            for what, new in _loaded(net, child, net.loads[node.id, k]):
                yield what, with_argument(net, node, k, new)


def _loaded(net, x, name):
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

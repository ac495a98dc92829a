"""What could be built wrongly at a node of the model: hypotheses, each a node in the place of another.

    node_hypotheses(net, node, observed_range) --> Hypothesis(cause, what, site, by, cost)     site is the node itself

`observed_range` gives that of a node on the rows. An operand is varied in the node that uses it, so that other uses
keep it; a node with several uses is varied for all of them where it is the site. `cost` orders what explains the same
rows.
Source  docs/diagnosis.md
"""

import itertools
from typing import NamedTuple

from testbench.golden.diagnosis import perturb_arithmetic, perturb_bits, perturb_control, perturb_loads
from testbench.golden.diagnosis.elaborate import static
from testbench.golden.diagnosis.net import COMPARED, Node

# the causes that can be named: docs/diagnosis.md says what belongs to each; in order of preference
WORDS = {
    "reset": "another reset value",
    "no_reset": "a register without reset",
    "async_reset": "an asynchronous reset",
    "condition": "the condition of a branch is missing, inverted or a different one",
    "priority": "the order of two branches is exchanged",
    "late": "an extra register delays the value",
    "early": "a register is missing: its new value is read instead of the old one",
    "rounding": "another rounding rule",
    "wrap": "the value wraps where it should saturate",
    "saturate": "the value saturates where it should wrap",
    "limit": "another limit of a saturation",
    "comparison": "a comparison is off by one",
    "bit_order": "the order of the bits is reversed",
    "sign": "the sign is wrong, or a flag is inverted",
    "complement": "~x instead of -x",
    "signedness": "a signed value is read as unsigned, or an unsigned one as signed",
    "gain": "a shift is one bit off",
    "width": "an intermediate value has too few bits",
    "constant": "a constant, a parameter or a word of a table is off by one LSB",
    "operand": "another register or input instead of an operand",
    "operator": "another bitwise operation",
    "bit_swap": "two bits are exchanged",
    "stuck": "a bit is stuck",
}
CAUSES = tuple(WORDS)
RANK = {cause: k for k, cause in enumerate(CAUSES)}


class Hypothesis(NamedTuple):
    """One fault: its cause, in words what, the node at fault, the node that stands there instead.

    `fitted`: read off the rows among so many others that the rows do not tell its class.
    """

    cause: str
    what: str
    site: Node
    by: Node
    cost: int
    fitted: bool = False


def with_argument(net, node, k, new):
    """The node with another argument k."""
    return net.node(node.op, (*node.args[:k], new, *node.args[k + 1 :]), node.value, "")


MOST_INSIDE = 40  # nodes of what is loaded, beyond which a leaf is only varied use by use
SOURCES = (perturb_arithmetic.arithmetic_operands, perturb_control.control_operands, perturb_bits.bit_operands)


BIT_TEST_COST = 2  # what another bit in a condition does goes by that name: docs/diagnosis.md
NO_TEST = ("condition", "comparison", "priority", "late", "early", "signedness")


FAR = 12  # cost from which a hypothesis is no cause by itself: it only makes a name uncertain
PARAMETER_TEST_COST = 2  # a comparison of parameters alone is right or wrong in every row


def _compares_parameters(node):
    """Whether a node is a comparison of parameters alone, or a choice by one."""
    chosen = node.args[0] if node.op == "mux" else node
    return chosen.op in (*COMPARED, "not", "land", "lor") and static(chosen) is not None


def _reads_a_bit(net, node):
    """Whether a node is one bit of a word, or the shift below it, or compares a register or input with a number."""
    if node.op == "shr":
        users = net.users.get(node.id, ())
        return bool(users) and all(_reads_a_bit(net, user) for user, _ in users)
    if node.op == "and":
        return node.args[1].op == "const" and node.args[1].value > 0 and node.args[1].value.bit_count() == 1
    return node.op in COMPARED and node.args[0].op in ("reg", "in")


def _operations(net, node, observed_range):
    yield from perturb_arithmetic.arithmetic_operation_variants(net, node, observed_range)
    yield from perturb_control.control_operation_variants(net, node)
    yield from perturb_bits.bit_operation_variants(net, node)


def _all_variants(net, node, observed_range):
    """(cause, what, node, extra cost) in the place of `node`."""
    yield from _operations(net, node, observed_range)
    for k, child in enumerate(node.args if node.op != "next" else ()):
        if len(net.users[child.id]) > 1 and child.args:
            for cause, what, new, cost in _operations(net, child, observed_range):
                yield cause, what, with_argument(net, node, k, new), cost
        for source in SOURCES:
            for cause, what, new, cost in source(net, node, k, child, observed_range):
                yield cause, what, with_argument(net, node, k, new), cost
        if perturb_loads.keeps_register(net, node, k):
            for cause, what, new, cost in perturb_loads.hold_variants(net, child):
                yield cause, what, with_argument(net, node, k, new), cost
        for cause, what, new, cost in perturb_control.channel_variants(net, node, k, child):
            yield cause, what, with_argument(net, node, k, new), cost
        if (node.id, k) in net.loads:
            for cause, what, new, cost in perturb_control.load_alternatives(net, node, child, net.loads[node.id, k]):
                yield cause, what, with_argument(net, node, k, new), cost
            conditions = net.load_conditions.get((node.id, k), ())
            for cause, what, new, cost in perturb_loads.load_variants(net, node, k, child, conditions):
                yield cause, what, with_argument(net, node, k, new), cost
            for cause, what, new, cost in _leaf_variants(net, child, observed_range):
                yield cause, what, with_argument(net, node, k, new), cost + 1
    for root in net.roots_by_value.get(node.id, ()):
        yield from perturb_loads.leaf_exchanges(net, root)
        yield from _repeated_load_variants(net, root, node, observed_range)
        yield from _twin_variants(net, root, node, observed_range)
    users = net.users.get(node.id, ())
    if len(users) > 1:
        for source in SOURCES:
            for cause, what, new, cost in source(net, *users[0], node, observed_range):
                yield cause, what, new, cost + 1


def _repeated_load_variants(net, root, node, observed_range):
    """What several branches of a register load, varied in all of them."""
    for loaded, choice, k in perturb_loads.repeated_loads(net, root):
        ways = [source(net, choice, k, loaded, observed_range) for source in SOURCES]
        ways.append(_operations(net, loaded, observed_range) if loaded.args else ())
        for cause, what, new, cost in itertools.chain(*ways):
            by = perturb_loads.in_all_branches(net, node, loaded, new)
            yield cause, f"{what} in all branches", by, cost


def _twin_variants(net, root, node, observed_range):
    """The same mistake in each place of an expression that the model calls several times."""
    for twin_nodes in perturb_loads.twins(net, root):
        variants_per_twin = []
        for twin in twin_nodes:
            if twin.id not in net.node_variants:
                net.node_variants[twin.id] = list(_single_twin_variants(net, twin, observed_range))
            variants_per_twin.append(net.node_variants[twin.id])
        for ways in zip(*variants_per_twin, strict=False):
            if len({way[0] for way in ways}) == 1:
                swaps = {twin.id: way[2] for twin, way in zip(twin_nodes, ways)}
                yield ways[0][0], f"{ways[0][1]} in all calls", net.substitute(node, swaps), ways[0][3]


def _single_twin_variants(net, node, observed_range):
    """What `_twin_variants` tries at a node: another operation, or another value of an operand."""
    yield from _operations(net, node, observed_range)
    for k, child in enumerate(node.args):
        for cause, what, new, cost in perturb_arithmetic.arithmetic_operands(net, node, k, child, observed_range):
            yield cause, what, with_argument(net, node, k, new), cost


def _leaf_variants(net, loaded, observed_range):
    """A register or input varied wherever what is loaded uses it: more than once, or in what others use as well."""
    inside = net.cone_nodes(loaded)
    for leaf in inside if len(inside) <= MOST_INSIDE else ():
        uses = [(n, n.args.index(leaf)) for n in inside if leaf in n.args]
        shared = len(uses) > 1 or any(len(net.users.get(n.id, ())) > 1 for n, _ in uses)
        if leaf.op in ("reg", "in") and shared:
            for source in SOURCES:
                for cause, what, new, cost in source(net, *uses[0], leaf, observed_range):
                    yield cause, f"{what} wherever it is used", net.substitute(loaded, {leaf.id: new}), cost


def node_hypotheses(net, node, observed_range):
    """Hypotheses at one node, without doubles: two causes may stand for the same node."""
    perturb_loads.prepare(net)
    cheapest_by_key, reads_a_bit = {}, _reads_a_bit(net, node)
    parameter_test_cost = PARAMETER_TEST_COST if _compares_parameters(node) else 0
    for cause, what, by, cost in _all_variants(net, node, observed_range):
        if by is node:
            continue
        rare = parameter_test_cost + (BIT_TEST_COST if cause not in NO_TEST and reads_a_bit else 0)
        hypothesis = Hypothesis(cause, what, node, by, 4 * (cost + rare) + RANK[cause] // 8)
        key = cause, by.id
        if key not in cheapest_by_key or hypothesis.cost < cheapest_by_key[key].cost:
            cheapest_by_key[key] = hypothesis
    return list(cheapest_by_key.values())

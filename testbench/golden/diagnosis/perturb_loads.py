"""Wrong loads: what a register loads, with two of its operands exchanged, or with one of the load before.

    paths(net)           each load of each register: the condition under which it is taken, the choice and its argument
    load_variants(...)   an operand late by one load, or by one clock wherever the load uses it; two operands exchanged
    leaf_exchanges(...)  two registers, inputs or parameters exchanged wherever a register or a pin reads them

Each function yields (cause, what, node, cost) as those of `perturb_arithmetic`.
Source  docs/diagnosis.md
"""

import itertools

from testbench.golden.diagnosis.net import COMPARED
from testbench.golden.diagnosis.perturb_arithmetic import is_flag
from testbench.golden.diagnosis.perturb_control import decides, is_reset_choice, loadable_values

MOST_INSIDE = 40  # nodes of what is loaded, beyond which only leaves are varied
MOST_OPERANDS = 10  # of a load that are exchanged, each with each
MOST_EXCHANGED = 150  # pairs of a root
MOST_TWINS = 8  # calls of one expression


def unreset_value(root):
    """What a register takes without its reset, or the node of a pin."""
    node = root.args[0]
    return node.args[2] if is_reset_choice(node) else node


def paths(net):
    """{(id of a choice, argument): [condition of the load]}; a choice that several registers share has several."""
    conditions_by_load = {}
    for root in net.roots.values():
        pending_paths = [(unreset_value(root), net.const(1))] if root.op == "next" else []
        while pending_paths:
            node, path_condition = pending_paths.pop()
            if node.op != "mux" or is_reset_choice(node):
                continue
            for k, flag in ((1, node.args[0]), (2, net.node("not", node.args[:1]))):
                branch_condition = flag if path_condition.op == "const" else net.node("land", (path_condition, flag))
                ways = conditions_by_load.setdefault((node.id, k), [])
                if branch_condition not in ways:
                    ways.append(branch_condition)
                pending_paths.append((node.args[k], branch_condition))
    return conditions_by_load


def prepare(net):
    """Find the loads of a net, once."""
    if net.load_conditions is None:
        net.load_conditions, net.roots_by_value = paths(net), {}
        for root in net.roots.values():
            net.roots_by_value.setdefault(unreset_value(root).id, []).append(root)


def _operands(net, loaded):
    """Nodes in what is loaded that carry a number or a flag that varies."""
    inside = net.cone_nodes(loaded)
    few = len(inside) <= MOST_INSIDE
    return [n for n in inside if n.op not in ("const", "param") and n.value != "rst" and (few or not n.args)]


def load_variants(net, node, k, loaded, load_conditions):
    """A loaded value in which one operand is late, or two are exchanged; `load_conditions` are those of the load."""
    if loaded.op == "mux":
        return
    operands = _operands(net, loaded)
    for child in operands:
        for load_condition in load_conditions:
            was = net.enabled_register(load_condition, child, 0)
            yield "late", f"{child!r} of the load before", net.substitute(loaded, {child.id: was}), 1
        if child.args:
            delayed_load = net.substitute(loaded, {child.id: net.delayed_node(child)})
            yield "late", f"{child!r} by 1 clock wherever it is loaded", delayed_load, 1
    for a, b in itertools.combinations([n for n in operands if not is_flag(n)][:MOST_OPERANDS], 2):
        if not (a.cone >> b.id & 1 or b.cone >> a.id & 1):
            by = net.substitute(loaded, {a.id: b, b.id: a})
            yield "operand", f"{a!r} and {b!r} exchanged", by, 1


def hold_variants(net, child):
    """What else a register takes in one branch where it should hold."""
    name = child.value
    for other in (*loadable_values(net, name), net.const(net.reset[name])):
        if other is not child:
            yield "condition", f"{other!r} where {name} is held", other, 1


def keeps_register(net, node, k):
    """Whether a choice keeps a register in one of its branches."""
    child = node.args[k]
    if node.op != "mux" or k == 0 or is_reset_choice(node) or child.op != "reg":
        return False
    return child.value in net.roots and bool(net.roots[child.value].cone >> node.id & 1)


def repeated_loads(net, root):
    """[(loaded value, a choice that loads it, argument)] of the values that several branches of a register load."""
    loads_by_value, pending_nodes = {}, [unreset_value(root)]
    while pending_nodes:
        node = pending_nodes.pop()
        for k in (1, 2) if node.op == "mux" else ():
            child = node.args[k]
            if child.op == "mux":
                pending_nodes.append(child)
            elif child.op != "const":
                loads_by_value.setdefault(child.id, []).append((child, node, k))
    return [ways[0] for ways in loads_by_value.values() if len(ways) > 1]


def in_all_branches(net, node, old, new):
    """A choice with another value in the place of one, in all of its branches."""
    if node.op != "mux":
        return new if node is old else node
    ways = [in_all_branches(net, way, old, new) for way in node.args[1:]]
    return net.node("mux", (node.args[0], *ways), node.value)


def twins(net, root):
    """Lists of nodes that are one expression of the model, in a function that it calls several times."""
    nodes_by_expression = {}
    after = unreset_value(root)
    for n in net.cone_nodes(after):
        text = n.args[0].text if n.op == "mux" else n.text
        if n.args and text and n is not after:
            nodes_by_expression.setdefault((n.op, text), []).append(n)
    return [twin_nodes for twin_nodes in nodes_by_expression.values() if 2 <= len(twin_nodes) <= MOST_TWINS]


def value_node_ids(net, root):
    """Ids of the nodes that a root reads as values, not in conditions."""
    ids, pending_nodes = set(), [unreset_value(root)]
    while pending_nodes:
        node = pending_nodes.pop()
        if node.id not in ids:
            ids.add(node.id)
            pending_nodes += [a for k, a in enumerate(node.args) if not decides(node, k)]
    return ids


def leaf_exchanges(net, root):
    """What a register or pin takes, with two leaves exchanged everywhere in it."""
    after = unreset_value(root)
    data = value_node_ids(net, root)
    leaves = [n for n in net.cone_nodes(after) if n.op in ("reg", "in", "param") and n.value != "rst"]
    pairs = [
        (a, b)
        for a, b in itertools.combinations(leaves, 2)
        if is_flag(a) == is_flag(b) and (a.op == "param") == (b.op == "param")
    ]
    pairs.sort(key=lambda pair: abs(net.node_width(pair[0]) - net.node_width(pair[1])))
    for a, b in pairs[:MOST_EXCHANGED]:
        cause = "operand" if {a.id, b.id} & data else "condition"
        if _is_limit_exchange(net, after, a, b):
            cause = "limit"
        by = net.substitute(after, {a.id: b, b.id: a})
        yield cause, f"{a!r} and {b!r} exchanged", by, 1


def _is_limit_exchange(net, after, a, b):
    inside = net.cone_nodes(after)
    users = [(n, n.args.index(leaf)) for n in inside for leaf in (a, b) if leaf in n.args]
    return (
        bool(users)
        and all((n.op == "clamp" and k) or n.op in COMPARED for n, k in users)
        and any(n.op == "clamp" for n, _ in users)
    )

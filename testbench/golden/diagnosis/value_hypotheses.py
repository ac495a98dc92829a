"""Hypotheses with numbers that are read off the rows, reset values, limits, words of tables; and those in no class.

    in no class: an operation without one of its operands; a shift that is left out, or binds before the sum; a product
    before it; what is loaded with the old value, by three or five quarters, as sign and magnitude, or at least 0

What nothing else explains is tried last: another word of the block as an operand, an operand of another load before, a
rounding to either side. None of this makes a name certain.

Source  docs/diagnosis.md
"""

import numpy as np

from testbench.golden.diagnosis import perturb_loads
from testbench.golden.diagnosis.net import COMPARED, ROUNDINGS
from testbench.golden.diagnosis.perturb import FAR, Hypothesis, with_argument
from testbench.golden.diagnosis.perturb_arithmetic import is_flag, number
from testbench.golden.diagnosis.perturb_control import decides, is_reset_choice

UNCLASSIFIED = ""  # class of what is in none
MOST_WORDS = 2  # of a table that may be wrong
COST = 4
FLAGS = 8  # bits up to which a word may be of flags
FEW = 40  # rows that are compared first


def hypotheses(net, rows, target, inside, wrong):
    """Hypotheses on a target from its `wrong` rows; `inside` are the nodes of its root."""
    pattern = np.unique((target.got ^ target.sound)[wrong] & ((1 << target.fmt.width) - 1))
    node_hypotheses = [h for node in inside for h in _node_hypotheses(net, rows, target, node, wrong, pattern)]
    loaded = _matching_sources(net, rows, target, wrong)
    node_hypotheses += list(_repeated_load_inversions(net, target, pattern))
    return node_hypotheses + [h for node in inside for h in _load_replacements(net, target, node, loaded)]


def _matching_sources(net, rows, target, wrong):
    """[(cause, node)] of what has the design's value in all wrong rows: a number, a register, an input, a parameter."""
    got, model_nodes = target.got[wrong], net.nodes[: net.model_size]
    matching_sources = [("constant", net.const(got[0]))] if np.all(got == got[0]) else []
    for leaf in model_nodes:
        is_operand = leaf.op == "param" or (leaf.op in ("reg", "in") and leaf.value not in (target.name, "rst"))
        if is_operand and np.array_equal(target.wrap_to_port(rows.node_values(leaf, wrong[:FEW])), got[:FEW]):
            if np.array_equal(target.wrap_to_port(rows.node_values(leaf, wrong) + np.zeros(len(wrong), np.int64)), got):
                matching_sources.append(("operand", leaf))
    return matching_sources


def _repeated_load_inversions(net, target, pattern):
    """Inverted bits of what several branches load, in all of them."""
    after = perturb_loads.unreset_value(target.root)
    for loaded, _, _ in perturb_loads.repeated_loads(net, target.root) if len(pattern) == 1 else ():
        if _is_plain(pattern[0], target.fmt.width):
            new = net.node("xor", (loaded, net.const(pattern[0])))
            by = perturb_loads.in_all_branches(net, after, loaded, new)
            yield Hypothesis("sign", f"bits {int(pattern[0]):#x} inverted in all branches", after, by, 5)


def _load_replacements(net, target, node, loaded):
    """Another number, register or input in the place of what a branch loads: rivals of what moves or keeps a value."""
    for k, child in enumerate(node.args if not is_reset_choice(node) else ()):
        if net.loads.get((node.id, k)) == target.name and child.op != "mux":
            for cause, value in loaded:
                if value is not child:
                    by = with_argument(net, node, k, value)
                    yield Hypothesis(cause, f"{value!r} instead of {child!r}", node, by, FAR)


def _replace_branch_value(net, node, old, new):
    """A choice with another number in the place of one, in all of its branches."""
    ways = [new if a is old else _replace_branch_value(net, a, old, new) if a.op == "mux" else a for a in node.args[1:]]
    return net.node("mux", (node.args[0], *ways), node.value)


def _is_plain(pattern, width):
    """Whether inverted bits are those of one mistake: one bit, all, or any in a word of flags."""
    return int(pattern).bit_count() in (1, width) or width <= FLAGS


def _node_hypotheses(net, rows, target, node, wrong, pattern):
    if is_reset_choice(node):
        design_reset_values = np.unique(target.got[wrong[rows.node_column(node.args[0])[wrong] != 0]])
        if len(design_reset_values) == 1:
            value = net.const(design_reset_values[0])
            yield Hypothesis("reset", f"{value!r} for {node.args[1]!r}", node, with_argument(net, node, 1, value), 0)
            everywhere = _replace_branch_value(net, node, node.args[1], value)
            yield Hypothesis("reset", f"{value!r} for {node.args[1]!r} wherever it is cleared", node, everywhere, 0)
    for k, child in enumerate(node.args):
        if net.loads.get((node.id, k)) == target.name and len(pattern) == 1 and _is_plain(pattern[0], target.fmt.width):
            by = with_argument(net, node, k, net.node("xor", (child, net.const(pattern[0]))))
            yield Hypothesis("sign", f"bits {int(pattern[0]):#x} inverted", node, by, 5)
    if node.op == "clamp":
        for value in {int(target.got[wrong].min()), int(target.got[wrong].max())}:
            for k, name in ((1, "lo"), (2, "hi")):
                by = with_argument(net, node, k, net.const(value))
                yield Hypothesis("limit", f"{name} is {value}", node, by, COST)
    if node.op == "table":
        used_addresses = np.unique(np.clip(rows.node_column(node.args[0])[wrong], 0, len(node.value) - 1))
        for address in used_addresses if len(used_addresses) <= MOST_WORDS else ():
            for bit in range(int(max(node.value)).bit_length()):
                for step in (1 << bit, -(1 << bit)):
                    words = list(node.value)
                    words[address] += step
                    by = net.node("table", node.args, tuple(words))
                    yield Hypothesis("constant", f"word {address} {step:+d}", node, by, COST)


def unclassified_hypotheses(net, target, inside):
    """Hypotheses of mistakes in no class at the nodes inside of a target: never named, they make a name uncertain."""
    for node in inside:
        for what, by in _unclassified_variants(net, node):
            if by is not node:
                yield Hypothesis(UNCLASSIFIED, what, node, by, FAR)
    after = perturb_loads.unreset_value(target.root)
    for loaded, _, _ in perturb_loads.repeated_loads(net, target.root):
        for what, new in _unclassified_load_variants(net, loaded, target.name):
            by = perturb_loads.in_all_branches(net, after, loaded, new)
            yield Hypothesis(UNCLASSIFIED, f"{what} in all branches", after, by, FAR)


HALVES = (8, 16, 17, 18)  # bits of the factors of partial products
LEAKS = range(1, 11)


def _unclassified_variants(net, node):
    op, a = node.op, node.args
    zero, one = net.const(0), net.const(1)
    if op in ("add", "sub", "mul"):
        yield f"without {a[1]!r}", a[0]
        yield f"without {a[0]!r}", net.node("neg", a[1:]) if op == "sub" else a[1]
        for k, x in enumerate(a):
            more = net.node("add", (x, net.node("shr", (x, one))))
            ways = [("0", zero), ("1", one), ("half more", more), ("amount", net.node("abs", (x,)))]
            for bit_count in (2, 3, 4):
                ways += [(f"{op} by {bit_count}", net.node(op, (x, net.const(bit_count)))) for op in ("shl", "shr")]
            for what, new in ways:
                yield f"{what} for {x!r}", with_argument(net, node, k, new)
    if op == "mul":
        yield "no product", zero
        for bit_count in HALVES:
            low = net.const((1 << bit_count) - 1)
            part = net.node("mul", tuple(net.node("and", (x, low)) for x in a))
            yield f"without the product of the low {bit_count} bits", net.node("sub", (node, part))
    if op in ("shl", "shr", *ROUNDINGS):
        yield "without the shift", a[0]
        for more in (2, 3, 4, -2, -3, -4):
            yield f"{more:+d} bits", net.node(op, (a[0], net.node("add", (a[1], net.const(more)))))
    if op in ("shl", "shr", "mul", *ROUNDINGS):
        for k, operand in enumerate(a[:2]):
            if operand.op in ("add", "sub"):
                for j in (0, 1):
                    part = with_argument(net, node, k, operand.args[j])
                    yield f"{op} before {operand.op}", with_argument(net, operand, j, part)
    if op in ROUNDINGS:
        half = net.node("shr", (net.node("shl", (one, a[1])), one))
        yield "the rounding constant shifted as well", net.node("add", (a[0], net.node("shr", (half, a[1]))))
        yield "the rounding constant behind the shift", net.node("add", (net.node("shr", a), half))
    if op == "clamp":
        yield "always lo", a[1]
        yield "always hi", a[2]
    if op == "mux" and not is_reset_choice(node):
        yield "sum of both branches", net.node("add", a[1:])
        yield "both branches or-ed", net.node("or", a[1:])
        yield "both branches and-ed", net.node("and", a[1:])
    for k, child in enumerate(a):
        if (node.id, k) in net.loads and child.op not in ("const", "mux"):
            for what, new in _unclassified_load_variants(net, child, net.loads[node.id, k]):
                yield what, with_argument(net, node, k, new)


def _unclassified_load_variants(net, x, name):
    one = net.const(1)
    if name in net.reset:
        old = net.node("reg", (), name)
        total = net.node("add", (x, old))
        yield f"{x!r} and the old value", total
        yield f"mean of {x!r} and the old value", net.node("shr", (total, one))
        for op in ("xor", "or", "and"):
            yield f"{x!r} {op} the old value", net.node(op, (x, old))
        yield f"{x!r} from the old value", net.node("sub", (old, x))
        yield f"the old value from {x!r}", net.node("sub", (x, old))
        greater_node = net.node("gt", (x, old))
        yield f"the larger of {x!r} and the old value", net.node("mux", (greater_node, x, old))
        yield f"the smaller of {x!r} and the old value", net.node("mux", (greater_node, old, x))
        for k in LEAKS:
            yield f"{x!r} with a leak", net.node("sub", (x, net.node("shr", (old, net.const(k)))))
    delayed_value = net.delayed_node(x)
    yield f"difference of {x!r}", net.node("sub", (x, delayed_value))
    yield f"mean of {x!r} and the value before", net.node("shr", (net.node("add", (x, delayed_value)), one))
    for k in (1, 2, 3, 4, 5, 6, 7, 8):
        part = net.node("shr", (x, net.const(k)))
        yield f"{x!r} and 1/{1 << k} of it", net.node("add", (x, part))
        yield f"{x!r} less 1/{1 << k} of it", net.node("sub", (x, part))
        yield f"{x!r} xor its bits {k} higher", net.node("xor", (x, part))
    for k in (2, 3, 4, 8):
        yield f"{x!r} without a shift by {k}", net.node("shr", (x, net.const(k)))
        yield f"{x!r} shifted by {k}", net.node("shl", (x, net.const(k)))
    width = net.fmts[name].width
    if width <= 62:
        bit_numbers = list(range(width))
        for k in range(1, width if width <= 16 else 9):
            yield f"{x!r} rotated by {k}", net.node("moved", (x,), tuple(bit_numbers[k:] + bit_numbers[:k]))
            yield f"{x!r} rotated by -{k}", net.node("moved", (x,), tuple(bit_numbers[-k:] + bit_numbers[:-k]))
    if net.fmts[name].s:
        top = net.const(1 << (width - 1))
        sign_node = net.node("lt", (x, net.const(0)))
        yield f"{x!r} as sign and magnitude", net.node("mux", (sign_node, net.node("sub", (top, x)), x))
        yield f"{x!r}, at least 0", net.node("mux", (sign_node, net.const(0), x))
        yield f"amount of {x!r}", net.node("abs", (x,))
        yield f"minus the amount of {x!r}", net.node("neg", (net.node("abs", (x,)),))


FALLBACK_COST = FAR - 1  # cost
MOST_WIDTH_DIFFERENCE = 3  # bits by which the widths of two words may differ
MOST_ENABLES = 24
MOST = 3000
READ = ("add", "sub", "mul", "neg", "abs", "shl", "shr", "clamp", "wrap", "wrapu", "mux", *ROUNDINGS, *COMPARED)


def operand_hypotheses(search, target, inside, wrong):
    """Another word, or a word of another load or of clocks before, in the place of each operand."""
    net, count = search.net, 0
    words = [n for n in net.nodes[: net.model_size] if n.op not in ("const", "param", "next", "pin") and number(n)]
    load_flag_by_id = {flag.id: flag for ways in net.load_conditions.values() for flag in ways if flag.op != "const"}
    enables = list(load_flag_by_id.values())[:MOST_ENABLES]
    for node in inside:
        for k, child in enumerate(node.args) if node.op in READ else ():
            if child.op in ("const", "param") or decides(node, k) or is_flag(child) or count > MOST:
                continue
            delayed = net.delayed_node(child)
            ways = [("late", f"{child!r} by {n} clocks", delayed := net.delayed_node(delayed)) for n in (2, 3, 4)]
            ways += [
                ("late", f"{child!r} of the last {flag!r}", net.enabled_register(flag, child, 0)) for flag in enables
            ]
            ways += [
                ("operand", f"{other!r} instead of {child!r}", other)
                for other in words
                if other is not child and abs(net.node_width(other) - net.node_width(child)) <= MOST_WIDTH_DIFFERENCE
            ]
            count += len(ways)
            for cause, what, new in ways:
                yield Hypothesis(cause, what, node, with_argument(net, node, k, new), FALLBACK_COST, True)


def free_rounding_hypotheses(search, target, inside, wrong):
    """A rounded value that is one of the two nearest, in each row that of the design."""
    net = search.net
    for node in inside:
        if node.op in ROUNDINGS:
            ways = [net.node(rule, node.args) for rule in ("floor", "ceil")]
            floor, ceil = (search.values_with_faults(target, ((node, way),), slice(None)) for way in ways)
            differ = floor != ceil
            if np.all((floor == target.got) | (ceil == target.got) | ~target.compared_mask) and differ[wrong].all():
                flag = search.free(
                    target, node, np.where(differ, ceil == target.got, search.rows.node_column(node) != floor)
                )
                by = net.node("mux", (flag, ways[1], ways[0]))
                yield Hypothesis("rounding", f"another rule for {node!r}", node, by, FALLBACK_COST, True)

"""Wrong control: conditions, priorities, comparisons, operands, and what is read a clock late or early.

Each function yields (cause, what, node, cost) as those of `perturb_arithmetic`.
Source  docs/diagnosis.md
"""

from testbench.golden.diagnosis.net import COMPARED, ROOTS, ROUNDINGS
from testbench.golden.diagnosis.perturb_arithmetic import is_flag

OPPOSITE = {"lt": "ge", "ge": "lt", "le": "gt", "gt": "le", "eq": "ne", "ne": "eq"}
NEIGHBOUR_COMPARISONS = {
    "lt": ("le", "ne"),
    "le": ("lt", "eq"),
    "gt": ("ge", "ne"),
    "ge": ("gt", "eq"),
    "eq": ("ge", "le"),
    "ne": ("lt", "gt"),
}
MOST_FLAGS = 60
MOST_DELAY_CLOCKS = 4
MOST_MODES = 3  # bits of a mode: a branch of one may be taken in another one as well


def _is_reset(node):
    return node.op == "in" and node.value == "rst"


def is_reset_choice(node):
    """Whether a node chooses between the reset value of a register and what follows."""
    return node.op == "mux" and node.value is not None


def condition_flags(net):
    """Conditions that could stand in the place of another one: flags among the leaves, and comparisons."""
    flag_nodes = [n for n in net.nodes[: net.model_size] if n.op in ("reg", "in") and is_flag(n) and not _is_reset(n)]
    flag_nodes += [n for n in net.nodes[: net.model_size] if n.op in COMPARED and len(flag_nodes) < MOST_FLAGS]
    return flag_nodes


def control_operation_variants(net, node):
    """Another condition, or another order of two."""
    op, a = node.op, node.args
    if is_reset_choice(node):
        yield from _reset_variants(net, node)
    elif op == "mux":
        yield from _choice_variants(net, node)
    users = net.users.get(node.id, ())
    if len(users) > 1 and _is_reset(node):
        for before in (1, 0):
            yield "late", "the reset by 1 clock", net.delayed_reset(node, before), 0
        for e in condition_flags(net):
            for flag_text, flag in ((f"{e!r}", e), (f"not {e!r}", net.node("not", (e,)))):
                yield "priority", f"reset only with {flag_text}", net.node("land", (node, flag)), 0
    elif len(users) > 1 and all(decides(*user) for user in users):
        yield "condition", f"always {node!r}", net.const(1), 1 if op in COMPARED else 0
        yield "condition", f"never {node!r}", net.const(0), 1 if op in COMPARED else 0
        yield "condition", f"{node!r} inverted", net.node("not", (node,)), 0
        yield from _other_conditions(net, node, 1)
    if op in COMPARED:
        for other in NEIGHBOUR_COMPARISONS[op]:
            cost = 0 if other in ("le", "lt", "ge", "gt") and op not in ("eq", "ne") else 1
            yield "comparison", f"{other} for {op}", net.node(other, a), cost
    if op == "eq" and a[1].op == "const" and a[0].op in ("reg", "in") and net.node_width(a[0]) <= MOST_MODES:
        for value in set(range(1 << net.node_width(a[0]))) - {a[1].value}:
            also = net.node("lor", (node, net.node("eq", (a[0], net.const(value)))))
            yield "condition", f"{node!r}, or {value}", also, 0
    if op in ("or", "mux") and not is_reset_choice(node):
        possible_bits = _possible_bits(node)
        if possible_bits is not None and op == "or":
            yield "condition", f"always all of {node!r}", net.const(possible_bits), 1
    if op in ("land", "lor"):
        for k in (0, 1):
            yield "condition", f"{a[k]!r} missing", a[1 - k], 1 if a[k].op in COMPARED else 0
        yield (
            "condition",
            "and for or" if op == "lor" else "or for and",
            net.node("lor" if op == "land" else "land", a),
            0,
        )
        yield from _other_conditions(net, node, 1)
    if op in ("and", "or", "xor"):
        for other in {"and", "or", "xor"} - {op}:
            yield "operator", f"{other} for {op}", net.node(other, a), 0
        for k in (0, 1):
            yield "operand", f"without {a[1 - k]!r}", a[k], 2


def _possible_bits(node):
    """All bits of a word that is an or of choices between constants, or None."""
    if node.op == "const":
        return node.value
    if node.op not in ("or", "mux"):
        return None
    argument_bits = [_possible_bits(a) for a in (node.args if node.op == "or" else node.args[1:])]
    return None if None in argument_bits else argument_bits[0] | argument_bits[1]


def decides(node, k):
    """Whether argument k of a node is a condition."""
    return node.op in ("land", "lor", "not") or (node.op == "mux" and k == 0)


def _reset_variants(net, node):
    """A register without reset or with a reset that another branch overrides."""
    rst, value, after = node.args
    register = net.node("reg", (), node.value)
    yield "no_reset", "goes on", after, 0
    yield "no_reset", "holds", net.node("mux", (rst, register, after)), 0
    for before in (1, 0):
        yield "late", "the reset by 1 clock", net.node("mux", (net.delayed_reset(rst, before), value, after)), 0
    yield "early", "1 clock", net.node("mux", (rst, value, net.node("ahead", (after,)))), 0
    yield "early", "1 clock, its reset as well", net.node("ahead", (node,)), 0
    rst_ahead = net.node("ahead", (rst,))
    yield "async_reset", "at once", net.node("mux", (rst_ahead, value, node)), 0
    if after.op == "mux" and after.args[1].op == "const" and after.args[1].value == value.value:
        # a branch that does the same as the reset
        cleared, (c, _, b) = net.node("lor", (rst, after.args[0])), after.args
        yield "no_reset", f"holds, also where {c!r}", net.node("mux", (cleared, register, b)), 1
        yield "no_reset", f"goes on, also where {c!r}", b, 1
        loading = _loads(net, b, register)
        if loading.op != "const":
            delayed_load = net.node("mux", (loading, net.enabled_register(loading, b, value.value, cleared), register))
            yield "late", "1 enable", net.node("mux", (cleared, value, delayed_load)), 0
    delayed_value, enabled = after, after
    loads = _loads(net, after, register)
    if after.op == "mux" and register in after.args[1:]:
        c, a, b = after.args
        enable, loaded = (c, a) if b is register else (net.node("not", (c,)), b)
        delayed_load = net.node("mux", (enable, net.enabled_register(enable, loaded, value.value), register))
        yield "late", f"1 enable {enable!r}", net.node("mux", (rst, value, delayed_load)), 0
    pipelined_value = after
    if loads.op != "const":
        # a register that holds, and behind it others that do not
        pipelined_value = net.enabled_register(loads, after, value.value)
        yield "late", "1 clock", net.node("mux", (rst, value, pipelined_value)), 0
    for k in range(1, MOST_DELAY_CLOCKS + 1):
        if pipelined_value is not after:
            pipelined_value = net.enabled_register(net.const(1), pipelined_value, value.value)
            yield "late", f"{k + 1} clocks", net.node("mux", (rst, value, pipelined_value)), 0
        delayed_value = net.enabled_register(net.const(1), delayed_value, value.value)
        yield "late", f"{k} clock" + "s" * (k > 1), net.node("mux", (rst, value, delayed_value)), 0
        if loads.op != "const":
            enabled = net.enabled_register(loads, enabled, value.value)
            yield (
                "late",
                f"{k} enable" + "s" * (k > 1),
                net.node("mux", (rst, value, net.node("mux", (loads, enabled, register)))),
                0,
            )
    if after.op == "mux":
        c, a, b = after.args
        yield "priority", f"{c!r} before the reset", net.node("mux", (c, a, net.node("mux", (rst, value, b)))), 0
        yield "priority", f"reset only without {c!r}", net.node("mux", (c, a, net.node("mux", (rst, value, b)))), 0
        yield "priority", f"reset only with {c!r}", net.node("mux", (net.node("land", (rst, c)), value, after)), 1
        yield from _before_the_reset(net, rst, value, after)


def _before_the_reset(net, rst, value, after):
    """The reset behind a branch that is not the first one."""
    passed, remaining_node = [after.args[:2]], after.args[2]
    while remaining_node.op == "mux":
        c, a, remaining_node = remaining_node.args
        choice_node = net.node("mux", (rst, value, remaining_node))
        for branch in reversed(passed):
            choice_node = net.node("mux", (*branch, choice_node))
        yield "priority", f"{c!r} before the reset", net.node("mux", (c, a, choice_node)), 1
        passed.append((c, a))


def _loads(net, node, register):
    """Where a register is not kept as it is."""
    if node is register:
        return net.const(0)
    if node.op != "mux":
        return net.const(1)
    ways = [_loads(net, a, register) for a in node.args[1:]]
    return ways[0] if ways[0] is ways[1] else net.node("mux", (node.args[0], *ways))


def _opposite(a, b):
    """Whether two nodes differ by a sign."""
    return (
        a.args[:1] == (b,)
        or b.args[:1] == (a,)
        or (a.op != b.op and a.args == b.args and {a.op, b.op} == {"add", "sub"})
    )


def _choice_variants(net, node):
    c, a, b = node.args
    cause = "sign" if _opposite(a, b) else "condition"
    yield cause, f"{c!r} inverted", net.node("mux", (c, b, a)), 0
    if cause == "sign":
        yield cause, f"always {a!r}", a, 0
        yield cause, f"always {b!r}", b, 0
    # a comparison that is off by one may also be a condition that never holds
    cost = 1 if c.op in COMPARED else 0
    yield "condition", f"always as where {c!r}", a, cost
    yield "condition", f"never as where {c!r}", b, cost
    if b.op == "mux" and not _is_reset(b.args[0]):
        c2, a2, b2 = b.args
        yield "priority", f"{c2!r} before {c!r}", net.node("mux", (c2, a2, net.node("mux", (c, a, b2)))), 0
    for cause, what, other, cost in _other_conditions(net, c, 1):
        yield cause, what, net.node("mux", (other, a, b)), cost


def _other_conditions(net, c, cost):
    for e in condition_flags(net):
        if e is c:
            continue
        turned = net.node("not", (e,))
        yield "condition", f"{e!r} instead of {c!r}", e, cost
        yield "condition", f"not {e!r} instead of {c!r}", turned, cost + 1
        yield "condition", f"{c!r} and {e!r}", net.node("land", (c, e)), cost + 1
        yield "condition", f"{c!r} or {e!r}", net.node("lor", (c, e)), cost + 1
        yield "condition", f"{c!r} and not {e!r}", net.node("land", (c, turned)), cost + 1


def control_operands(net, node, k, child, observed_range):
    """Operand k a clock late or early, or another one."""
    condition = decides(node, k)
    if child.op == "const" or _is_reset(child) or (is_reset_choice(node) and k == 2):
        return
    if node.op in ("shl", "shr", "wrap", "wrapu", *ROUNDINGS) and k == 1 and child.op == "param":
        return
    if condition and node.op != "mux" and child.op not in ("land", "lor"):
        yield "condition", f"{child!r} inverted", net.node("not", (child,)), 0
    if condition:
        edge = net.node("land", (child, net.node("not", (net.delayed_node(child),))))
        yield "condition", f"{child!r} only at its rising edge", edge, 1
        odd = net.odd(child)
        yield "condition", f"every second {child!r}", net.node("land", (child, odd)), 1
        yield (
            "condition",
            f"every second {child!r}, from the first on",
            net.node("land", (child, net.node("not", (odd,)))),
            1,
        )
    if child.op != "param" and node.op not in ROOTS and not (child.op in ("reg",) and _holds(net, node, child)):
        yield "late", f"{child!r} by 1 clock", net.delayed_node(child), 0 if not child.args else 1
        if not child.args:
            delayed_child = net.delayed_node(child)
            yield "late", f"{child!r} by 2 clocks", net.delayed_node(delayed_child), 1
    if child.op == "reg":
        # in a counter, or compared with a number, it is the same as another number
        doubtful = net.roots[child.value].cone >> node.id & 1 or node.op in (*COMPARED, "table")
        yield "early", f"new {child!r}", net.roots[child.value], 1 if doubtful else 0
        yield "early", f"new {child!r} except in reset", net.roots[child.value].args[0].args[2], 1 if doubtful else 0
    if child.op in ("reg", "in", "param"):
        for other in net.nodes[: net.model_size]:
            is_compatible = (other.op == "param") == (child.op == "param") and is_flag(other) == is_flag(child)
            if other.op in ("reg", "in", "param") and is_compatible and other is not child and not _is_reset(other):
                is_loaded = other.op == "reg" and other.value == net.loads.get((node.id, k))
                cause = "limit" if node.op == "clamp" and k else "condition" if condition or is_loaded else "operand"
                yield cause, f"{other!r} instead of {child!r}", other, 1


def branches(node):
    """What the branches of a choice give."""
    return [leaf for way in node.args[1:] for leaf in branches(way)] if node.op == "mux" else [node]


def load_alternatives(net, node, loaded, name):
    """What a branch loads: not loaded, what another branch loads, or loaded as well where the register is held."""
    register = net.node("reg", (), name)
    cleared = (net.const(net.reset[name]),) if name in net.reset else ()
    if not is_reset_choice(node):
        if name in net.reset and loaded is not register:
            yield "condition", f"{loaded!r} is not loaded", register, 1
        for other in (*loadable_values(net, name), *cleared) if loaded.op != "mux" else ():
            if other not in (loaded, register):
                yield "condition", f"{other!r} where {loaded!r} is loaded", other, 2
    branch_values = branches(loaded)
    for value in dict.fromkeys((*branch_values, *cleared)) if register in branch_values else ():
        if value is not register:
            yield "condition", f"{value!r} also where {name} is held", _swap_register(net, loaded, register, value), 1


def loadable_values(net, name):
    """What the branches of a register or pin load, the reset value left out."""
    root = net.roots[name].args[0]
    return tuple(dict.fromkeys(branches(root.args[2] if is_reset_choice(root) else root)))


def _swap_register(net, node, register, value):
    if node.op != "mux":
        return value if node is register else node
    return net.node(
        "mux", (node.args[0], *(_swap_register(net, way, register, value) for way in node.args[1:])), node.value
    )


def channel_variants(net, node, k, child):
    """Operand k as it is in the register of another channel."""
    if node.op in ROOTS or not child.args:
        return
    for other in net.siblings.get((node.id, k), {}).values():
        cause = "condition" if decides(node, k) else "operand"
        yield cause, f"{other!r} of another channel instead of {child!r}", other, 1


def _holds(net, node, child):
    """Whether a choice keeps a register as it is: its own value a clock late is no fault of a design."""
    return node.op == "mux" and net.roots[child.value].cone >> node.id & 1 and node.args[0] is not child

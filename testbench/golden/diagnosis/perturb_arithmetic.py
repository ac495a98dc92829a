"""Wrong arithmetic: rounding, overflow, sign, gain, constants, widths, signedness.

Each function yields (cause, what, node, cost): the node stands in the place of the operation, or of its operand.
Source  docs/diagnosis.md
"""

from fpga_model.rounding_aliases import ALIASES
from testbench.golden.diagnosis.elaborate import static
from testbench.golden.diagnosis.net import COMPARED, ROUNDINGS, least_width

NARROWED = ("add", "sub", "mul", "shl", "neg", "abs", "mux", "clamp", *ROUNDINGS)
CUT = ("add", "sub", "mul", "neg", "abs", "shl", *ROUNDINGS, *COMPARED)  # operations whose operands may be too narrow
ORDERED = ("lt", "le", "gt", "ge")


def _rule_label(rule):
    """A rounding rule with its names in other tools."""
    names = sorted(alias for alias, neutral in ALIASES.items() if neutral == rule)
    return f"{rule} ({', '.join(names)})" if names else rule


def is_flag(node):
    """Whether a node is 0 or 1."""
    return node.lo >= 0 and node.hi <= 1 and node.op not in ("const", "param")


def number(node):
    """Whether a node carries a number, not a flag, a constant or a parameter."""
    return not is_flag(node) and node.op not in ("const", "param")


def arithmetic_operation_variants(net, node, observed_range):
    """Another operation on the same operands."""
    op, a = node.op, node.args
    if op == "add":
        yield "sign", f"{a[0]!r} - {a[1]!r}", net.node("sub", a), 0
        yield "sign", f"{a[1]!r} - {a[0]!r}", net.node("sub", a[::-1]), 0
    if op == "sub":
        yield "sign", f"{a[1]!r} - {a[0]!r}", net.node("sub", a[::-1]), 0
        yield "sign", f"{a[0]!r} + {a[1]!r}", net.node("add", a), 0
        rare = 2 if a[1].op == "const" else 0
        yield "complement", f"{a[0]!r} + ~{a[1]!r}", net.node("add", (a[0], net.node("inv", a[1:]))), rare
    if op == "neg":
        yield "sign", f"{a[0]!r}", a[0], 0
        yield "complement", f"~{a[0]!r}", net.node("inv", a), 0
        if a[0].op in ROUNDINGS:
            x, n = a[0].args
            for rule in ROUNDINGS:
                yield (
                    "rounding",
                    f"{_rule_label(rule)} of the signed value",
                    net.node(rule, (net.node("neg", (x,)), n)),
                    0,
                )
    if op == "inv":
        yield "sign", f"{a[0]!r}", a[0], 1
        yield "complement", f"-{a[0]!r}", net.node("neg", a), 0
    if op == "abs":
        yield "sign", f"{a[0]!r}", a[0], 0
        yield "sign", f"-{node!r}", net.node("neg", (node,)), 0
        yield "complement", f"~{a[0]!r}", net.node("mux", (_sign_node(net, a[0]), net.node("inv", a), a[0])), 0
    if op in ROUNDINGS or op == "shr":
        yield from _rounding(net, node)
    if op in ("shl", "shr", *ROUNDINGS):
        one = net.const(1)
        yield "gain", f"one bit more than {a[1]!r}", net.node(op, (a[0], net.node("add", (a[1], one)))), 0
        yield "gain", f"one bit less than {a[1]!r}", net.node(op, (a[0], net.node("sub", (a[1], one)))), 0
    if op in ORDERED and min(a[0].lo, a[1].lo) < 0:
        yield "signedness", f"{node!r} of unsigned values", net.node(op, _unsigned(net, a)), 0
    if op == "clamp":
        yield from _limits(net, node, observed_range)
        if min(x.lo for x in a) < 0:
            x, lo, hi = _unsigned(net, a)
            unsigned_less, unsigned_greater = net.node("lt", (x, lo)), net.node("gt", (x, hi))
            inner = net.node("mux", (unsigned_greater, a[2], a[0]))
            yield "signedness", "compared as unsigned", net.node("mux", (unsigned_less, a[1], inner)), 0
            signed = net.node("mux", (net.node("gt", (a[0], a[2])), a[2], a[0]))
            yield "signedness", "lo compared as unsigned", net.node("mux", (unsigned_less, a[1], signed)), 0
            signed = net.node("lt", a[:2])
            yield "signedness", "hi compared as unsigned", net.node("mux", (signed, a[1], inner)), 0
        yield from _saturating_count(net, node)
    if op in ("wrap", "wrapu"):
        signed, width = op == "wrap", static(a[1])
        if width is not None:
            lo, hi = (-(1 << (width - 1)), (1 << (width - 1)) - 1) if signed else (0, (1 << width) - 1)
            yield "saturate", f"at {lo} and {hi}", net.node("clamp", (a[0], net.const(lo), net.const(hi))), 0
            yield "width", f"{width - 1} bits", net.node(op, (a[0], net.const(width - 1))), 1
            yield from _as_signed(net, a[0], width, signed)
            yield from _one_saturated(net, node, net.const(lo), net.const(hi))
    if op == "table":
        for step in (1, -1):
            yield (
                "constant",
                f"address {step:+d}",
                net.node(op, (net.node("add", (a[0], net.const(step))),), node.value),
                0,
            )


def _as_signed(net, sum_node, width, signed):
    """A sum modulo 2**width that saturates as one of signed values."""
    if sum_node.op in ("add", "sub") and width <= 61:
        width_node = net.const(width)
        parts = [net.node("wrap", (part, width_node)) for part in sum_node.args]
        half = 1 << (width - 1)
        limits = net.const(-half), net.const(half - 1)
        clamped_node = net.node("clamp", (net.node(sum_node.op, parts), *limits))
        by = clamped_node if signed else net.node("wrapu", (clamped_node, width_node))
        yield "saturate", f"at {-half} and {half - 1}, as signed", by, 0


def _one_saturated(net, node, lo, hi):
    """Of a choice that wraps, one value saturates."""
    chosen = node.args[0]
    for k in (1, 2) if chosen.op == "mux" else ():
        ways = list(chosen.args)
        ways[k] = net.node("clamp", (ways[k], lo, hi))
        by = net.node(node.op, (net.node("mux", ways), node.args[1]))
        yield "saturate", f"{chosen.args[k]!r} at {lo!r} and {hi!r}", by, 0


def _saturated_loads(net, sum_node, fmt):
    """A sum that is loaded: it saturates at the limits of its register."""
    if sum_node.op in ("add", "sub", "neg") and 1 < fmt.width <= 61:
        limits = net.const(fmt.lo), net.const(fmt.hi)
        yield "saturate", f"{sum_node!r} at {fmt.lo} and {fmt.hi}", net.node("clamp", (sum_node, *limits)), 0
        if not fmt.s:
            yield from _as_signed(net, sum_node, fmt.width, False)


def _saturating_count(net, node):
    """A count that stays at its end and goes the other way, or stays at the other end."""
    x, lo, hi = node.args
    if x.op in ("add", "sub") and x.args[0].op == "reg" and x.args[1].op == "const":
        other = net.node("sub" if x.op == "add" else "add", x.args)
        for limit in (hi, lo):
            at_end = net.node("eq", (x.args[0], limit))
            yield "sign", f"counts the other way, stays at {limit!r}", net.node("mux", (at_end, limit, other)), 0


def _unsigned(net, nodes):
    """Nodes as unsigned values of one width, as Verilog compares them if one of them is unsigned."""
    width = min(max(net.node_width(n) + (n.lo >= 0) for n in nodes), 62)
    return tuple(net.node("wrapu", (n, net.const(width))) for n in nodes)


def _sign_node(net, x):
    return net.node("lt", (x, net.const(0)))


def _rounding(net, node):
    x, n = node.args
    bits = static(n)
    if bits is not None and bits < 1:
        return
    if x.lo < 0:
        added = net.node("shr", (net.node("shl", (net.const(1), n)), net.const(1)))
        sum_node = net.node("add", (x, added)) if node.op == "half_up" else x
        for width in (net.node_width(x), net.node_width(x) + 1):
            if width <= 62 and node.op in ("half_up", "shr", "floor"):
                logical = net.node("shr", (net.node("wrapu", (sum_node, net.const(width))), n))
                yield "signedness", f"logical shift of {width} bits", logical, 1
    model_rule = "floor" if node.op == "shr" else node.op
    if node.op == "shr" and (is_flag(node) or x.op in ("const", "param", "table")):
        return
    for rule in ROUNDINGS:
        if rule != model_rule:
            yield "rounding", _rule_label(rule), net.node(rule, (x, n)), 2 if node.op == "shr" else 0
        elif rule != "floor":
            one = net.const(1)
            before = net.node(rule, (x, net.node("sub", (n, one))))
            yield "rounding", f"{_rule_label(rule)}, after rounding to one more bit", net.node(rule, (before, one)), 0


def _limits(net, node, observed_range):
    x, lo, hi = node.args
    one = net.const(1)
    for k, (limit, name) in enumerate(((lo, "lo"), (hi, "hi"))):
        steps = [(1, "LSB")]
        if limit.op == "shl" and static(limit.args[1]) is not None:
            steps.append((1 << static(limit.args[1]), "LSB of the result"))
        for size, unit in steps:
            for sign, op in (("+", "add"), ("-", "sub")):
                bound = net.node(op, (limit, net.const(size)))
                bounds = (bound, hi) if k == 0 else (lo, bound)
                yield "limit", f"{name} {sign}1 {unit}", net.node("clamp", (x, *bounds)), 0
                outside = net.node("gt" if k else "lt", (x, limit))
                yield "limit", f"{name} {sign}1 {unit}, only in the result", net.node("mux", (outside, bound, node)), 1
        outside = net.node("gt" if k else "lt", (x, limit))
        yield (
            "limit",
            f"beyond {name}, the other limit",
            net.node("mux", (outside, hi if k == 0 else lo, node)),
            1,
        )
        yield "limit", f"no {name}", net.node("mux", (outside, x, node)), 1
    lowest, highest = observed_range(node)
    widths = {least_width(lowest, highest), least_width(lo.lo, hi.hi), least_width(lo.lo, hi.hi) + 1}
    yield "wrap", "without a limit", x, 0
    for width in sorted(widths):
        for op in ("wrap",) if lo.lo < 0 else ("wrapu", "wrap"):
            yield "wrap", f"at {width} bits", net.node(op, (x, net.const(min(width, 62)))), 0
    yield "limit", "lo and hi exchanged", net.node("clamp", (x, hi, lo)), 1
    yield "limit", "between -hi and hi", net.node("clamp", (x, net.node("neg", (hi,)), hi)), 2
    del one


def _counter(net, node):
    """Whether a node is a register that counts, or made of one."""
    return any(n.op == "reg" and net.counts(n) for n in net.cone_nodes(node))


def _off_by_one_cause(node):
    """Cause of a constant that is off by one as an operand of a node."""
    return {"clamp": "limit"}.get(node.op, "comparison" if node.op in COMPARED else "constant")


def arithmetic_operands(net, node, k, child, observed_range):
    """Another value as operand k."""
    in_condition = node.op in ("land", "lor", "not") or (node.op == "mux" and k == 0)
    chosen_flag = node.op == "mux" and node.value is None and is_flag(node)
    if child.op in ("const", "param") and not (node.op == "mux" and k == 0) and not chosen_flag:
        cause = "reset" if node.op == "mux" and node.value is not None and k == 1 else _off_by_one_cause(node)
        if node.op not in ("shl", "shr", "wrap", "wrapu", *ROUNDINGS) and cause != "limit":
            for step in (1, -1):
                if (
                    node.op == "mul"
                    and child.op == "const"
                    and child.value + step in (child.value / 2, 2 * child.value)
                ):
                    continue
                code = cause == "comparison" and node.op in ("eq", "ne") and not _counter(net, node.args[0])
                yield cause, f"{child!r} {step:+d}", net.node("add", (child, net.const(step))), 1 if code else 0
            if child.op == "const" and 0 <= child.value < 1 << 24 and node.op != "and":
                compared = net.node_width(node.args[0]) if node.op in ("eq", "ne") else 0
                for bit in range(max(child.value.bit_length(), min(compared, 24))):
                    yield cause, f"{child!r} with bit {bit} inverted", net.const(child.value ^ 1 << bit), 2
    if node.op in COMPARED and k == 0:
        return
    if child.op == "param" and child.value[1]:
        rare = 2 if node.op == "clamp" else 0
        yield "gain", f"{child!r} x 2", net.node("shl", (child, net.const(1))), rare
        yield "gain", f"{child!r} / 2", net.node("shr", (child, net.const(1))), rare
        if net.fmts[f"parameter {child.value[0]}"].s:
            yield "sign", f"-{child!r}", net.node("neg", (child,)), 0
    yield from _sign_reinterpretation(net, child)
    if is_flag(child) and node.op in ("add", "sub"):
        yield "constant", f"{child!r} counts twice", net.node("shl", (child, net.const(1))), 0
    if is_flag(child) and not in_condition and node.op not in COMPARED:
        yield "sign", f"{child!r} inverted", net.node("not", (child,)), 0
    if not number(child) or in_condition:
        return
    amount = k == 1 and node.op in ("shl", "shr", *ROUNDINGS)
    if not amount and (node.op not in ("and", "or", "xor", "shr", "table") or child.lo < 0):
        yield "sign", f"-({child!r})", net.node("neg", (child,)), 1
    if child.op not in COMPARED:
        cost = 0 if node.op in ("add", "sub", "mul") else 1
        yield "gain", f"{child!r} x 2", net.node("shl", (child, net.const(1))), cost
        yield "gain", f"{child!r} / 2", net.node("shr", (child, net.const(1))), cost
    if (node.id, k) in net.loads:
        yield from _saturated_loads(net, child, net.fmts[net.loads[node.id, k]])
        for step in (1, -1):
            yield "constant", f"{child!r} {step:+d}", net.node("add", (child, net.const(step))), 1
        yield "complement", f"~({child!r})", net.node("inv", (child,)), 2
    if child.op in NARROWED or (child.op in ("reg", "in", "param") and node.op in CUT):
        yield from _narrower_operands(net, child, observed_range)
    elif (node.id, k) in net.loads and net.fmts[net.loads[node.id, k]].width > 2:
        yield from _narrower_loads(net, child, net.fmts[net.loads[node.id, k]])
    if any(user.op == "sub" and argument_index == 1 for user, argument_index in net.users.get(child.id, ())):
        minus = net.node("add", (child, net.const(1)))
        yield "complement", f"~{child!r} for -{child!r}, also in comparisons", minus, 1


def _sign_reinterpretation(net, child):
    """A signed value read as unsigned, or the reverse, in its own width."""
    if child.op in ("const", *COMPARED) or is_flag(child):
        return
    width = net.node_width(child)
    signed = child.lo < 0 or (child.op == "param" and net.fmts[f"parameter {child.value[0]}"].s)
    if width <= 62:
        op = "wrapu" if signed else "wrap"
        yield "signedness", f"{child!r}", net.node(op, (child, net.const(width))), 0 if not child.args else 2


def _narrower_loads(net, child, fmt):
    for lost in (1, 2, 3):
        width = fmt.width - lost
        if width > 1:
            by = net.node("wrap" if fmt.s else "wrapu", (child, net.const(width)))
            yield "width", f"{child!r} in {width} bits", by, lost - 1


def _narrowed_before(net, child, observed_range):
    """A rounded value whose sum with the rounding constant has too few bits."""
    x, n = child.args
    half = net.node("shr", (net.node("shl", (net.const(1), n)), net.const(1)))
    sum_node, need = net.node("add", (x, half)), least_width(*observed_range(x))
    for width in sorted({*range(max(need - 3, 2), need), *(w for w in WORDS if w < need)}):
        cut = net.node("wrap" if x.lo < 0 else "wrapu", (sum_node, net.const(width)))
        yield "width", f"{x!r} and its rounding constant in {width} bits", net.node("shr", (cut, n)), 1


WORDS = (8, 12, 16, 24, 32, 48)  # widths of words elsewhere
MOST_LOW = 4  # bits that an operand may lack below


def _narrower_operands(net, child, observed_range):
    """Fewer bits than the values need: some on top, those beyond a usual word, or some below."""
    lowest, highest = observed_range(child)
    need, signed = least_width(lowest, highest), lowest < 0
    if child.op == "half_up":
        yield from _narrowed_before(net, child, observed_range)
    rare = child.op == "mux"
    for width in sorted({*range(max(need - 4, 2), need), *(w for w in WORDS if w < need)}, reverse=True):
        is_likely_width = width in WORDS or need - width < 2
        for op in ("wrap", "wrapu"):
            other = (op == "wrap") != signed
            cost = (0 if is_likely_width else need - 1 - width if need - width < 4 else 3) + rare + other
            sign = f"{'un' if op == 'wrapu' else ''}signed" if other else ""
            yield "width", f"{child!r} in {width} bits {sign}".rstrip(), net.node(op, (child, net.const(width))), cost
    for low in range(1, MOST_LOW + 1):
        shift_node = net.const(low)
        cut = net.node("shl", (net.node("shr", (child, shift_node)), shift_node))
        yield "width", f"{child!r} without {low} low bits", cut, 2 if low < 3 else 3

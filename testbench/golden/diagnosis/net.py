"""The step of a block as a graph: each register's next value and each pin as operations on registers and inputs.

    node = (operation, arguments, value);   equal nodes are one node;   a root per register ("next") and per pin ("pin")
    the next value of a register is a choice of its reset value and what `step` gives; its `value` is the register

Operations have two forms, which give the same integers: on int64 columns, a row per clock, and as Python source.
Source  docs/diagnosis.md
"""

import itertools
import re

import numpy as np

MOST_SHIFT = 62
AMOUNT = f"min(max({{1}}, 0), {MOST_SHIFT})"  # of a shift, as `_amount`
CHANNEL = re.compile(r"_(\d|[xy])$")


def _int(x):
    return np.asarray(x).astype(np.int64)


def _amount(n):
    return np.clip(n, 0, MOST_SHIFT)


def _rounding_function(rule):
    def round_column(x, n):
        n = _amount(n)
        one = np.int64(1) << n
        half, low, minus = one >> 1, one - 1, x < 0
        added = {
            "floor": lambda: 0,
            "ceil": lambda: low,
            "toward_zero": lambda: np.where(minus, low, 0),
            "half_up": lambda: half,
            "half_down": lambda: low >> 1,
            "half_even": lambda: (low >> 1) + np.where(n > 0, (x >> n) & 1, 0),
            "half_away": lambda: np.where(minus, low >> 1, half),
            "half_zero": lambda: np.where(minus, half, low >> 1),
        }[rule]
        return (x + added()) >> n

    return round_column


def wrap_column(x, width, signed):
    """Column modulo 2**width, read as two's complement if `signed`."""
    width = np.clip(width, 1, MOST_SHIFT)
    mask = (np.int64(1) << width) - 1
    low = x & mask
    return np.where(low > (mask >> 1), low - mask - 1, low) if signed else low


def permute_bits(x, source_bits):
    """Bit k of the result is bit bits[k] of `x`; the result is unsigned."""
    permuted = x & ((1 << len(source_bits)) - 1)
    for k, source_bit in enumerate(source_bits):
        if source_bit != k:
            permuted = permuted ^ (((x >> source_bit ^ x >> k) & 1) << k)
    return permuted


ROUNDINGS = ("floor", "ceil", "toward_zero", "half_up", "half_down", "half_even", "half_away", "half_zero")
COMPARED = ("lt", "le", "gt", "ge", "eq", "ne")
LEAVES = ("reg", "in", "param", "const")
ROOTS = ("next", "pin")

# operation: (on columns, Python source); the source of a rounding, wrap or table is a call of a function given to it
OPERATIONS = {
    "add": (np.add, "({0} + {1})"),
    "sub": (np.subtract, "({0} - {1})"),
    "mul": (np.multiply, "({0} * {1})"),
    "neg": (np.negative, "(-{0})"),
    "inv": (np.invert, "(~{0})"),
    "abs": (np.abs, "abs({0})"),
    "shl": (lambda x, n: x << _amount(n), f"({{0}} << {AMOUNT})"),
    "shr": (lambda x, n: x >> _amount(n), f"({{0}} >> {AMOUNT})"),
    "and": (np.bitwise_and, "({0} & {1})"),
    "or": (np.bitwise_or, "({0} | {1})"),
    "xor": (np.bitwise_xor, "({0} ^ {1})"),
    "lt": (lambda a, b: _int(a < b), "({0} < {1})"),
    "le": (lambda a, b: _int(a <= b), "({0} <= {1})"),
    "gt": (lambda a, b: _int(a > b), "({0} > {1})"),
    "ge": (lambda a, b: _int(a >= b), "({0} >= {1})"),
    "eq": (lambda a, b: _int(a == b), "({0} == {1})"),
    "ne": (lambda a, b: _int(a != b), "({0} != {1})"),
    "not": (lambda a: _int(a == 0), "(not {0})"),
    "land": (lambda a, b: np.where(a != 0, b, a), "({0} and {1})"),
    "lor": (lambda a, b: np.where(a != 0, a, b), "({0} or {1})"),
    "mux": (lambda c, a, b: np.where(c != 0, a, b), "({1} if {0} else {2})"),
    "clamp": (lambda x, lo, hi: np.where(x < lo, lo, np.where(x > hi, hi, x)), "clamp({0}, {1}, {2})"),
    "wrap": (lambda x, w: wrap_column(x, w, True), "wrap({0}, {1})"),
    "wrapu": (lambda x, w: wrap_column(x, w, False), "wrapu({0}, {1})"),
    **{rule: (_rounding_function(rule), f"{rule}({{0}}, {AMOUNT})") for rule in ROUNDINGS},
    "next": (lambda x: x, "{0}"),
    "pin": (lambda x: x, "{0}"),
}


def least_width(lo, hi):
    """Least width that holds lo .. hi: signed unless lo is 0 or more."""
    if lo >= 0:
        return max(int(hi).bit_length(), 1)
    return max(int(hi).bit_length(), int(-lo - 1).bit_length()) + 1


class Node:
    """An operation on nodes. `value` is the number of a constant, (name, number) of a parameter, the name of a leaf or
    root, the words of a table, the places of moved bits, the reset value of a held node; `text` is where it stood."""

    __slots__ = ("args", "cone", "hi", "id", "lo", "op", "text", "value")

    def __repr__(self):
        return self.text or f"{self.op}{self.value if self.value is not None else ''}"


class Net:
    """Nodes of a block.

    roots            {register or pin: root node}
    fmts             {register, input or pin: Fmt}
    reset            {register: reset value}
    model_size       how many of the nodes are those of the model; hypotheses add to them
    users            {id of a node of the model: [(node that uses it, as which argument)]}
    loads            {(id of a choice, argument): register or pin} where that argument is what is loaded
    load_conditions  {(id of a choice, argument): conditions under which registers load it}
    roots_by_value   {id of what a register takes without its reset, or of what a pin is: its roots}
    siblings         {(id of a node, argument): {what stands there in registers of other channels}}, as acc_1 of acc_2
    """

    def __init__(self):
        self.nodes, self.node_index, self.roots, self.fmts, self.reset = [], {}, {}, {}, {}
        self.model_size, self.users, self.loads, self.siblings = 0, {}, {}, {}
        self.load_conditions = self.roots_by_value = None
        self.node_variants = {}

    def node(self, op, args=(), value=None, text=""):
        """The node of an operation, made if there is none yet."""
        key = (op, tuple(a.id for a in args), value)
        node = self.node_index.get(key)
        if node is None:
            node = Node()
            node.op, node.args, node.value, node.text = op, tuple(args), value, text
            node.id = len(self.nodes)
            # of the model alone: a bit for each hypothesis would cost gigabytes
            node.cone = 0 if self.model_size else 1 << node.id
            for a in args:
                node.cone |= a.cone
            node.lo, node.hi = _bounds(self, node)
            self.nodes.append(node)
            self.node_index[key] = node
        return node

    def const(self, value):
        """The node of a number."""
        return self.node("const", (), int(value), str(int(value)))

    def substitute(self, node, swaps):
        """The node of the model with other nodes in the place of some in it: {id: node}."""
        node_by_id, sites = dict(swaps), sum(1 << k for k in swaps)
        for n in self.cone_nodes(node):
            if n.id not in swaps and n.cone & sites:
                node_by_id[n.id] = self.node(n.op, [node_by_id.get(a.id, a) for a in n.args], n.value, "")
        return node_by_id.get(node.id, node)

    def enabled_register(self, load, node, reset=0, rst=None):
        """A register that takes a node where `load` is not 0, and `reset` where the block, or `rst`, resets it."""
        rst = rst or self.node("in", (), "rst")
        return self.node("held", (load, node, rst), reset, f"{node!r} late")

    def odd(self, load):
        """A flag that changes with each load, 0 behind a reset."""
        return self.node("odd", (load, self.node("in", (), "rst")), None, f"every second {load!r}")

    def delayed_reset(self, node, before):
        """The reset a clock late; what it was `before` the first row."""
        return self.enabled_register(self.const(1), node, before, self.const(0))

    def delayed_node(self, node):
        """The node a clock late, in a register that is reset."""
        return self.enabled_register(self.const(1), node, self.reset[node.value] if node.op == "reg" else 0)

    def close(self):
        """Count the nodes of the model: what comes after are those of hypotheses."""
        self.model_size = len(self.nodes)
        for node in self.nodes:
            for k, a in enumerate(node.args):
                self.users.setdefault(a.id, []).append((node, k))
        for name, root in self.roots.items():
            pending_arguments = [(root.args[0], 2) if root.op == "next" else (root, 0)]
            while pending_arguments:
                node, k = pending_arguments.pop()
                child = node.args[k]
                if child.op == "mux":
                    pending_arguments += [(child, 1), (child, 2)]
                if child.value != name or child.op != "reg":
                    self.loads.setdefault((node.id, k), name)

        self._pair_channels()

    def _pair_channels(self):
        families, visited_pairs = {}, set()
        for name in self.roots:
            if CHANNEL.search(name):
                families.setdefault(CHANNEL.sub("", name), []).append(self.roots[name])
        pending_pairs = [pair for roots in families.values() for pair in itertools.permutations(roots, 2)]
        while pending_pairs:
            a, b = pair = pending_pairs.pop()
            if a is b or pair in visited_pairs or a.op != b.op or len(a.args) != len(b.args):
                continue
            visited_pairs.add(pair)
            for k, (x, y) in enumerate(zip(a.args, b.args)):
                if x is not y:
                    self.siblings.setdefault((a.id, k), {})[y.id] = y
                    pending_pairs.append((x, y))

    def leaf(self, op, name, fmt):
        """The node of a register or an input."""
        self.fmts.setdefault(name if op == "reg" else f"in {name}", fmt)
        return self.node(op, (), name, name)

    def counts(self, register):
        """Whether the next value of a register is itself plus or minus a constant somewhere."""
        cone_nodes = self.cone_nodes(self.roots[register.value])
        return any(n.op in ("add", "sub") and n.args[0] is register and n.args[1].op == "const" for n in cone_nodes)

    def leaf_format(self, leaf):
        """Format of a register or an input."""
        return self.fmts[leaf.value if leaf.op == "reg" else f"in {leaf.value}"]

    def node_width(self, node):
        """Bits of a node: those of the format of a leaf, else what its range needs."""
        if node.op in ("reg", "in"):
            return self.leaf_format(node).width
        if node.op == "param":
            return self.fmts[f"parameter {node.value[0]}"].width
        return least_width(node.lo, node.hi)

    def cone_nodes(self, node):
        """Nodes of the model that a node is made of, itself included, arguments first."""
        nodes, cone = [], node.cone
        while cone:
            low = cone & -cone
            nodes.append(self.nodes[low.bit_length() - 1])
            cone ^= low
        return nodes


def _corners(binary_function, a, b):
    corner_values = [binary_function(x, y) for x in (a.lo, a.hi) for y in (b.lo, b.hi)]
    return min(corner_values), max(corner_values)


def _bits_range(a, b):
    """Range of and, or, xor of two nodes."""
    width = max(abs(v).bit_length() for n in (a, b) for v in (n.lo, n.hi))
    low = 0 if min(a.lo, b.lo) >= 0 else -(1 << width)
    return low, (1 << width) - 1


def _shift_range(a, n, is_shl):
    amounts = [min(max(k, 0), MOST_SHIFT) for k in (n.lo, n.hi)]
    shifted_values = [(v << k) if is_shl else (v >> k) for v in (a.lo, a.hi) for k in amounts]
    return min(shifted_values), max(shifted_values)


def _bounds(net, n):
    """Range of a node from the formats of the leaves: not tight, never too narrow."""
    op, a = n.op, n.args
    if op == "const":
        return n.value, n.value
    if op == "param":
        return n.value[1], n.value[1]
    if op in ("reg", "in"):
        fmt = net.leaf_format(n)
        return fmt.lo, fmt.hi
    if op in (*COMPARED, "not"):
        return 0, 1
    if op in ("add", "sub", "mul"):
        binary_function = {"add": lambda x, y: x + y, "sub": lambda x, y: x - y, "mul": lambda x, y: x * y}[op]
        return _corners(binary_function, *a)
    if op == "neg":
        return -a[0].hi, -a[0].lo
    if op == "inv":
        return ~a[0].hi, ~a[0].lo
    if op == "abs":
        return 0, max(abs(a[0].lo), abs(a[0].hi))
    if op == "and":
        masks = [x for x in a if x.lo >= 0]
        return (0, min(x.hi for x in masks)) if masks else _bits_range(*a)
    if op in ("or", "xor"):
        return _bits_range(*a)
    if op in ("shl", "shr"):
        return _shift_range(*a, op == "shl")
    if op in ROUNDINGS:
        low, high = _shift_range(*a, False)
        return low - 1, high + 1
    if op == "clamp":
        return min(a[1].lo, a[2].lo), max(a[1].hi, a[2].hi)
    if op in ("wrap", "wrapu"):
        width = min(max(a[1].hi, 1), MOST_SHIFT)
        return (-(1 << (width - 1)), (1 << (width - 1)) - 1) if op == "wrap" else (0, (1 << width) - 1)
    if op == "table":
        return min(n.value), max(n.value)
    if op == "moved":
        return 0, (1 << len(n.value)) - 1
    if op == "odd":
        return 0, 1
    if op == "held":
        return min(a[1].lo, n.value), max(a[1].hi, n.value)
    return min(x.lo for x in a[-2:]), max(x.hi for x in a[-2:])

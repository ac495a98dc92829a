"""Two copies of a design on one state: a miter of ANDs and inverters, each structure there once.

    Net      nodes in the making; literal 2*n is node n, 2*n + 1 its inverse, node 0 constant 0, then the leaves
    copy     a design whose inputs and flip-flops are given literals: what two copies share is the same node
    compact  a design rebuilt in this way, alone
    binary   binary AIGER of one literal, with the nodes it depends on alone, for `yosys-abc`

Source  Biere, "The AIGER And-Inverter Graph (AIG) Format", 2007; Kuehlmann, Krohm, DAC 1997 (structural hashing)
"""

import numpy as np


class Net:
    """ANDs over a number of leaves, hashed; literals are integers."""

    def __init__(self, leaves):
        self.first = 1 + leaves
        self.ands, self._known = [], {}

    def both(self, a, b):
        """Literal of a AND b."""
        if a > b:
            a, b = b, a
        if a == 0 or a ^ b == 1:
            return 0
        if a in (1, b):
            return b
        and_literal = self._known.get((a, b))
        if and_literal is None:
            and_literal = self._known[a, b] = 2 * (self.first + len(self.ands))
            self.ands.append((a, b))
        return and_literal

    def either(self, a, b):
        return self.both(a ^ 1, b ^ 1) ^ 1

    def any(self, literals):
        """OR of literals."""
        or_literal = 0
        for literal in literals:
            or_literal = self.either(or_literal, literal)
        return or_literal

    def differ(self, a, b):
        """Literal of a XOR b."""
        return self.either(self.both(a, b ^ 1), self.both(a ^ 1, b))

    def less_or_equal(self, bits, limit):
        """Literal of an unsigned number <= limit; bits least first, limit within them."""
        leq_literal = 1
        for k, bit in enumerate(bits):
            leq_literal = self.either(bit ^ 1, leq_literal) if limit >> k & 1 else self.both(bit ^ 1, leq_literal)
        return leq_literal

    def bound_literals(self, bits, signed, lo, hi):
        """Literals of `lo <= number` and `number <= hi` that are not always true."""
        lift = 1 << (len(bits) - 1) if signed else 0
        raised = [*bits[:-1], bits[-1] ^ 1] if signed else bits
        top = (1 << len(bits)) - 1
        non_trivial_bounds = [self.less_or_equal(raised, lo + lift - 1) ^ 1] if lo + lift > 0 else []
        return non_trivial_bounds + ([self.less_or_equal(raised, hi + lift)] if hi + lift < top else [])

    def copy(self, graph, leaves):
        """(literals of the outputs, next literals of the flip-flops) of a `aig.Graph` with given leaves."""
        at = [0, *leaves]
        for lhs_literal, rhs_literal in graph.ands.tolist():
            at.append(self.both(at[lhs_literal >> 1] ^ (lhs_literal & 1), at[rhs_literal >> 1] ^ (rhs_literal & 1)))
        outs, following = graph.out_literals.tolist(), graph.latches.tolist()
        return [at[x >> 1] ^ (x & 1) for x in outs], [at[x >> 1] ^ (x & 1) for x in following]

    def fanin_nodes(self, literals, following):
        """Leaves and ANDs, as nodes, that literals depend on, now or later; `following` is {leaf: next literal}."""
        visited_nodes, stack = {0}, [literal >> 1 for literal in literals]
        while stack:
            node = stack.pop()
            if node in visited_nodes:
                continue
            visited_nodes.add(node)
            if node >= self.first:
                stack += [x >> 1 for x in self.ands[node - self.first]]
            elif node in following:
                stack.append(following[node] >> 1)
        return sorted(visited_nodes - {0})


def compact(graph):
    """The same `aig.Graph` without constants, repeated structures and gates that lead nowhere."""
    leaves = graph.in_count + len(graph.latches)
    net = Net(leaves)
    outs, following = net.copy(graph, [2 * (k + 1) for k in range(leaves)])
    gate_nodes = [node for node in net.fanin_nodes([*outs, *following], {}) if node >= net.first]
    at = {k: 2 * k for k in range(net.first)} | {node: 2 * (net.first + k) for k, node in enumerate(gate_nodes)}

    def now(literals):
        return np.array([at[x >> 1] ^ (x & 1) for x in literals], np.int64)

    ands = now([x for node in gate_nodes for x in net.ands[node - net.first]]).reshape(-1, 2)
    return graph._replace(out_literals=now(outs), latches=now(following), ands=ands)


def _delta(value):
    """A difference of literals, seven bits to the byte."""
    encoded_bytes = bytearray()
    while value >> 7:
        encoded_bytes.append(0x80 | value & 0x7F)
        value >>= 7
    encoded_bytes.append(value)
    return encoded_bytes


def encode_aiger(net, literal, names, following, initial):
    """Bytes of binary AIGER whose one output is `literal`.

    names      {leaf node: name of the input}
    following  {leaf node: next literal} of the flip-flops; the other leaves are inputs
    initial    {leaf node: 0 or 1}: a flip-flop that begins with 1 is stored inverted, for the format begins with 0
    """
    nodes = net.fanin_nodes([literal], following)
    inputs = [n for n in nodes if n < net.first and n not in following]
    latches = [n for n in nodes if n < net.first and n in following]
    gates = [n for n in nodes if n >= net.first]
    at = {0: 0}
    for k, node in enumerate((*inputs, *latches, *gates)):
        at[node] = 2 * (k + 1) ^ (initial[node] if node in following else 0)

    def now(x):
        return at[x >> 1] ^ (x & 1)

    head = f"aig {len(nodes)} {len(inputs)} {len(latches)} 1 {len(gates)}\n"
    lines = [f"{now(following[n]) ^ initial[n]}\n" for n in latches] + [f"{now(literal)}\n"]
    body = bytearray()
    for node in gates:
        small, large = sorted(map(now, net.ands[node - net.first]))
        body += _delta(at[node] - large) + _delta(large - small)
    symbols = "".join(f"i{k} {names[n]}\n" for k, n in enumerate(inputs))
    return (head + "".join(lines)).encode() + bytes(body) + symbols.encode()

"""Wrong bits: reversed, exchanged, stuck.

Each function yields (cause, what, node, cost) as those of `perturb_arithmetic`.
Source  docs/diagnosis.md
"""

from testbench.golden.diagnosis.elaborate import static

MOST_PAIRS = 26  # width up to which all pairs of bits are tried


def _one(node):
    return node.op == "const" and node.value == 1


def bit_operation_variants(net, node):
    """A shift register that runs the other way."""
    op, a = node.op, node.args
    if op == "shl" and a[0].op == "reg" and _one(a[1]):
        yield "bit_order", "shifts right", net.node("shr", a), 0
    if op == "and" and a[0].op == "shl" and a[0].args[0].op == "reg" and _one(a[0].args[1]):
        yield "bit_order", "shifts right", net.node("shr", a[0].args), 0
    if op == "or" and net.node_width(node) <= 16 and any(n.op != "or" for n, _ in net.users.get(node.id, ())):
        for bit in range(net.node_width(node)):
            yield "stuck", f"bit {bit} of {node!r} at 0", net.node("and", (node, net.const(~(1 << bit)))), 0
            yield "stuck", f"bit {bit} of {node!r} at 1", net.node("or", (node, net.const(1 << bit))), 0
    if op in ("or", "add"):
        for turn, serial in (a, a[::-1]):
            shifted = turn.args[0] if turn.op == "and" else turn
            if shifted.op == "shl" and shifted.args[0].op == "reg" and _one(shifted.args[1]):
                register = shifted.args[0]
                top = net.const(1 << (net.node_width(register) - 1))
                last = net.node("mux", (serial, top, net.const(0)))
                yield (
                    "bit_order",
                    "takes the LSB first",
                    net.node("or", (net.node("shr", (register, net.const(1))), last)),
                    0,
                )
    if op == "and" and _one(a[1]) and a[0].op == "shr":
        word, position_node = a[0].args
        if word.op == "reg":
            yield "bit_order", "sends the LSB", net.node("and", (word, a[1])), 0
        yield from _other_bits(net, word, static(position_node), a[1])


def _other_bits(net, word, bit_position, one):
    """Another bit of the word of which one is read; a place whose sign is wrong ends modulo the size of an index."""
    width = net.node_width(word)
    for bit in range(min(width, 62)) if bit_position is not None else ():
        by = net.node("and", (net.node("shr", (word, net.const(bit))), one))
        if bit != bit_position:
            yield "operand", f"bit {bit} of {word!r} for bit {bit_position}", by, 2
        if bit_position and bit == -bit_position % (1 << (width - 1).bit_length()):
            yield "sign", f"bit {-bit_position} of {word!r}", by, 0


def _permute(net, child, source_bits):
    """The child with its bits moved, signed as it is."""
    permuted_node = net.node("moved", (child,), tuple(source_bits))
    return net.node("wrap", (permuted_node, net.const(len(source_bits)))) if child.lo < 0 else permuted_node


def bit_operands(net, node, k, child, observed_range):
    """Operand k with its bits in another order, or one of them stuck."""
    name = net.loads.get((node.id, k))
    leaf, root = child.op in ("reg", "in"), name is not None
    width = net.fmts[name].width if root else net.node_width(child)
    if not (leaf or root) or width < 2 or width > 62:
        return
    sizes = {width, *(n.value[1] for n in net.nodes[: net.model_size] if n.op == "param" and 2 <= n.value[1] < width)}
    for size in sorted(sizes) if leaf and not (node.op == "mux" and k == 0) else ():
        yield (
            "bit_order",
            f"{child!r} reversed",
            _permute(net, child, range(size - 1, -1, -1)),
            (size < width) + 2 * (width < 8),
        )
    if root and not leaf:
        yield "bit_order", f"{child!r} reversed", _permute(net, child, range(width - 1, -1, -1)), 2 * (width < 8)
    for source_bits, what in _exchanges(width):
        yield "bit_swap", f"{what} of {child!r}", _permute(net, child, source_bits), 1 if root or width > 4 else 3
    for bit in range(width) if root else ():
        for other in (bit - 1, bit + 1):
            if 0 <= other < width:
                source_bits = list(range(width))
                source_bits[bit] = other
                yield "operand", f"bit {other} of {child!r} for its bit {bit}", _permute(net, child, source_bits), 2
    if root:
        for bit in range(width):
            yield "stuck", f"bit {bit} at 0", net.node("and", (child, net.const(~(1 << bit)))), 1
            yield "stuck", f"bit {bit} at 1", net.node("or", (child, net.const(1 << bit))), 1


def _exchanges(width):
    """(bits, what): two bits exchanged, halves, bytes, neighbours."""
    straight = list(range(width))
    for a in straight:
        for b in range(a + 1, width) if width <= MOST_PAIRS else (a + 1,):
            if b < width:
                source_bits = straight.copy()
                source_bits[a], source_bits[b] = b, a
                yield source_bits, f"bits {a} and {b}"
    if width % 2 == 0 and width > 2:
        half = width // 2
        yield straight[half:] + straight[:half], "halves"
        yield [k ^ 1 for k in straight], "neighbours"
    if width % 8 == 0 and width > 16:
        yield [8 * (width // 8 - 1 - k // 8) + k % 8 for k in straight], "bytes"

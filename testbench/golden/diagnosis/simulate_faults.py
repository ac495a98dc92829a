"""A block with one fault as a Python function that goes on from row to row, until a visible port is not the design's.

    run(by, state, held, inputs, first, last, want) --> first row that differs, or `last`; a port of None is no matter
    by(state, inputs)                               --> what stands for the site

The hypotheses of a site share `run`; one that adds a register has a `run` of its own, which does not call `by`.
Everything but the fault is the model. A register that the fault itself replaces is seen as the fault makes it.
Source  docs/diagnosis.md
"""

from fpga_model import fixed
from fpga_model.block import python_function
from testbench.golden.diagnosis.net import MOST_SHIFT, OPERATIONS

REGISTERS = ("held", "odd")  # nodes that are registers
CALLS = {name: python_function(rule) for name, rule in fixed.ROUNDINGS.items()}
CALLS["clamp"] = python_function(fixed.clamp)
CALLS["wrap"] = lambda x, width: python_function(fixed.wrap)(x, min(max(width, 1), MOST_SHIFT))
CALLS["wrapu"] = lambda x, width: python_function(fixed.wrap_unsigned)(x, min(max(width, 1), MOST_SHIFT))


def _permute_int(x, source_bits):
    return sum((x >> source_bit & 1) << k for k, source_bit in enumerate(source_bits))


def _differs(port_values, want):
    return port_values != want and any(b is not None and a != b for a, b in zip(port_values, want))


class _Source:
    """Lines that compute nodes; a node in the cone of the fault has a name of its own for each of its two values."""

    def __init__(self, site=None, by=None, leaf_texts=None):
        self.site, self.by, self.lines, self.variables, self.added_registers = site, by, [], {}, []
        self.leaf_texts, self.tables = leaf_texts, {}

    def name(self, node, faulty):
        """The variable that holds a node; lines are added where there is none yet."""
        faulty = faulty and bool(node.cone >> self.site.id & 1)
        if faulty and node is self.site:
            return self.name(self.by, False) if self.by else "put"
        key = node.id, faulty
        if key not in self.variables:
            self.variables[key] = self._add_node_lines(node, faulty)
        return self.variables[key]

    def _add_node_lines(self, node, faulty):
        if node.op == "const":
            return f"({node.value})"
        if node.op == "param":
            return f"({node.value[1]})"
        if node.op in ("reg", "in"):
            return self.leaf_texts[node.op, node.value] if self.leaf_texts else f"{node.op}_{node.value}"
        variable_name = f"v{node.id}{'f' if faulty else ''}"
        if node.op in REGISTERS:
            args = [self.name(a, False) for a in node.args]
            if node.op == "odd":
                args[1:1] = [f"1 - held_{node.id}"]
            self.added_registers.append((node, args))
            return f"held_{node.id}"
        args = [self.name(a, faulty) for a in node.args]
        if node.op == "table":
            self.tables[f"table_{node.id}"] = node.value
            text = f"table_{node.id}[min(max({args[0]}, 0), {len(node.value) - 1})]"
        elif node.op == "moved":
            text = f"moved({args[0]}, {node.value})"
        else:
            text = OPERATIONS[node.op][1].format(*args)
        self.lines.append(f"{variable_name} = {text}")
        return variable_name


def _port(name, fmt):
    if fmt.s:
        half = 1 << (fmt.width - 1)
        return f"(int({name}) + {half} & {fmt.hi - fmt.lo}) - {half}"
    return f"int({name}) & {fmt.hi}"


def adds_a_register(net, node):
    """Whether something that stands for a site holds a value."""
    return node.id >= net.model_size and (node.op in REGISTERS or any(adds_a_register(net, a) for a in node.args))


def compile_node(net, node):
    """`by` of a node."""
    registers = [name for name, root in net.roots.items() if root.op == "next"]
    leaf_texts = {("reg", name): f"state[{k}]" for k, name in enumerate(registers)}
    input_names = sorted({n.value for n in net.nodes[: net.model_size] if n.op == "in"})
    source = _Source(leaf_texts=leaf_texts | {("in", name): f"inputs[{k}]" for k, name in enumerate(input_names)})
    result_variable = source.name(node, False)
    body = [f"    {line}" for line in source.lines]
    return _execute_lines(["def by(state, inputs):", *body, f"    return {result_variable}"], source)["by"]


def _execute_lines(lines, source):
    names = {**CALLS, "moved": _permute_int, "differs": _differs, **source.tables}
    exec(compile("\n".join(lines), "<hypothesis>", "exec"), names)
    return names


def compile_block(net, site, by, visible):
    """(run, held nodes in the order of its argument); `visible` are registers and pins, `by` None for any node."""
    source = _Source(site, by)
    registers = [name for name, root in net.roots.items() if root.op == "next"]
    port_variables = {}
    for name in visible:
        root = net.roots[name]
        node = net.node("reg", (), name) if root.op == "next" else root
        port_variables[name] = source.name(node, True)
    after = {name: source.name(net.roots[name], True) for name in registers}
    input_names = sorted({n.value for n in net.nodes[: net.model_size] if n.op == "in"})
    order = [node for node, _ in source.added_registers]
    lines = ["def run(by, state, held, inputs, first, last, want):"]
    lines += [f"    {', '.join(f'held_{n.id}' for n in order)}, = held"] if order else []
    lines += [
        "    for n in range(first, last):",
        f"        {', '.join(f'reg_{name}' for name in registers)}, = state",
        *(() if by else ("        put = by(state, inputs[n])",)),
        f"        {', '.join(f'in_{name}' for name in input_names)}, = inputs[n]",
    ]
    lines += [f"        {line}" for line in source.lines]
    port_expressions = ", ".join(_port(port_variables[name], net.fmts[name]) for name in visible)
    lines.append(f"        if differs(({port_expressions},), want[n]): return n")
    for node, (load, x, rst) in source.added_registers:
        lines.append(f"        next_{node.id} = {node.value or 0} if {rst} else {x} if {load} else held_{node.id}")
    lines.append("        state = (" + ", ".join(_port(after[name], net.fmts[name]) for name in registers) + ",)")
    lines += [f"        held_{n.id} = next_{n.id}" for n in order]
    lines.append("    return last")
    return _execute_lines(lines, source)["run"], order

"""Wires of `control` and `top`, derived from their source; two ends of a wire must have one format.

The syntax tree of `step` is run over signals instead of numbers. A signal knows every register, pin, parameter and
input that it may come from. Where it arrives at a port of a block, each of them is a wire to that port.

    check(design)    raises ValueError that names both ends of each wire whose width, sign or binary point differ
    trace(module)    the wires; an intended difference is declared by `CASTS` of the module

The declaration of a block (`fpga_model.block`) says what its `step`, outputs and functions take and give. Every other
function is run. A condition is one bit or a comparison.
Source    docs/architecture.md
"""

import ast
import functools
import inspect
import itertools
import textwrap
from dataclasses import dataclass, replace
from typing import NamedTuple

from fpga_model import block, control, top
from fpga_model.block import BIT, block_modules, fill_shape, leaves, port_name, python_function
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, bits, formats

BITWISE = {ast.BitAnd: "&", ast.BitOr: "|"}


class Leaf(NamedTuple):
    """Where a signal comes from. `kind`: register, pin, parameter, input, logic or constant; `value` of a constant."""

    name: str
    fmt: Fmt | None
    kind: str
    value: int = 0


@dataclass(frozen=True)
class Signal:
    """All leaves that it may come from; `label` is the name of the logic between them and it, or None for a leaf."""

    leaves: tuple
    label: str | None = None


class Wire(NamedTuple):
    """A signal and the port that it arrives at, as instance and port."""

    signal: Signal
    instance: str
    port: str
    fmt: Fmt

    @property
    def target(self):
        return f"{self.instance}.{self.port}"


class Unsupported(Exception):
    """Something that no wiring uses."""


def direct(name, fmt, kind):
    """The signal of one leaf."""
    return Signal((Leaf(name, fmt, kind),))


def logic(name, fmt):
    """The signal of an expression."""
    return Signal((Leaf(name, fmt, "logic"),), "")


def as_signal(value):
    """A signal of a value, which may be a constant."""
    return value if isinstance(value, Signal) else Signal((Leaf(str(value), None, "constant", value),))


def merge_signals(a, b):
    """A signal that comes from either or both."""
    if a == b:
        return a
    if isinstance(a, tuple):
        items = [merge_signals(x, y) for x, y in zip(a, b, strict=True)]
        return type(a)(*items) if hasattr(a, "_fields") else tuple(items)
    a, b = as_signal(a), as_signal(b)
    return Signal(tuple(dict.fromkeys(a.leaves + b.leaves)), "")


def nested_blocks(state, path=""):
    """(path, module) of all blocks in a state, also of those within blocks."""
    for field, module in block.state_modules(state).items():
        dotted_path = f"{path}.{field}" if path else field
        if hasattr(module, "BLOCK"):
            yield dotted_path, module
        yield from nested_blocks(module.State, dotted_path)


class Everything:
    """A record that has every optional part, for `formats`."""

    def __getattr__(self, name):
        return self


class Trace:
    """One edge of a module over signals.

    wires      all that arrive somewhere
    instances  {instance: (module, path of its parameters or None)}
    gated      instances that are stepped only where a condition holds
    parts_template  a record with the optional parts that are there; none without it
    """

    def __init__(self, module, design, parts_template=None):
        self.module, self.design = module, design
        self.wires, self.instances, self.names, self.live_records = [], {}, {}, []
        self.gated, self.depth = set(), 0
        contents = {f"{at}.{name}": fmt.for_design(design) for at, m in nested_blocks(module.State)
                    for name, fmt in m.BLOCK.holds.items()}  # fmt: skip
        self.state = self.record(formats(module.State, design, parts_template), "", "register", contents)
        self.params = self.record(formats(module.Params, design, parts_template), "", "parameter")
        inputs = {name: self.record(block.design_formats(shape, design), self.prefix(name), "input")
                  for name, shape in module.INPUTS.items()}  # fmt: skip
        structure = {name: None for name in ("d", "rom") if name in block.arguments(module)}
        self.function(python_function(module.step), {**structure, "p": self.params, "s": self.state, **inputs})
        if hasattr(module, "Pins"):
            pins = self.function(python_function(module.pins), {"p": self.params, "s": self.state})
            for (name, fmt), (_, value) in zip(leaves(formats(module.Pins, design)), leaves(pins), strict=True):
                self.arrive(value, "pins", name, fmt)
        self.wires = list(dict.fromkeys(self.wires))

    @staticmethod
    def prefix(name):
        """Inputs of a record have the names of its fields; those of the bank keep its name."""
        return "" if name == "i" else name

    def record(self, shape, path, kind, contents=block.NOTHING):
        """A record of signals, known by its path; `contents` has the formats of what some of them hold."""
        leaf_signals = iter([direct(name, contents.get(name, fmt), kind) for name, fmt in leaves(shape, path)])
        signal_record = fill_shape(shape, lambda _: next(leaf_signals))
        self.name(signal_record, path)
        return signal_record

    def name(self, signal_record, path):
        """Remember the names of a record and of the records in it."""
        if hasattr(signal_record, "_fields"):
            self.names[id(signal_record)] = path
            self.live_records.append(signal_record)
            for field, item in zip(signal_record._fields, signal_record):
                self.name(item, f"{path}.{field}" if path else field)

    # ---- ends of wires -----------------------------------------------------------------------------------------------

    def arrive(self, value, instance, port, fmt):
        """A value arrives at a port."""
        self.wires.append(Wire(as_signal(value), instance, port, fmt))

    def step(self, module, call_arguments):
        """A block's step: its inputs and parameters arrive, its registers are what they are."""
        instance = self.names[id(call_arguments["s"])]
        self.instances[instance] = module, self.names.get(id(call_arguments.get("p")))
        if self.depth:
            self.gated.add(instance)
        shapes = block.shapes(module, self.design)
        values = [value for name in shapes for _, value in leaves(call_arguments[name])]
        for (port, fmt), value in zip(block.inputs(module, self.design), values, strict=True):
            self.arrive(value, instance, port, fmt)
        if "p" not in shapes and "p" in call_arguments:
            values = [value for _, value in leaves(call_arguments["p"])]
            for (name, fmt), value in zip(block.parameters(module, self.design).items(), values, strict=True):
                self.arrive(value, instance, name, fmt)
        return call_arguments["s"]

    def output(self, module, name, shape, call_arguments):
        """A block's output: a pin, or a record of them."""
        instance = self.names[id(call_arguments["s"])]
        for port, fmt in block.inputs(module, self.design):
            if port in call_arguments:
                self.arrive(call_arguments[port], instance, port, fmt)
        if isinstance(shape, type):
            return self.record(formats(shape, self.design), instance, "pin")
        return direct(f"{instance}.{name}", shape.for_design(self.design), "pin")

    def call(self, func, call_arguments):
        """What a call returns: of a block by its declaration, of anything else by running it."""
        module = next((m for m in block_modules().values() if m.__name__ == func.__module__), None)
        name = func.__name__
        if module and name == "step":
            return self.step(module, call_arguments)
        if module and name in module.BLOCK.outputs:
            return self.output(module, name, module.BLOCK.outputs[name], call_arguments)
        if module and name in module.BLOCK.functions:
            arguments, result = module.BLOCK.functions[name]
            owner = self.names.get(id(call_arguments.get("p")), module.__name__.rpartition(".")[2])
            for argument, fmt in arguments.items():
                self.arrive(call_arguments[argument], f"{owner}.{name}", argument, fmt.for_design(self.design))
            return logic(f"{owner}.{name}", result.for_design(self.design))
        if self.module is not control and func.__module__ == control.__name__:
            if name == "step":
                return self.part(control, call_arguments)
            if shape := control.OUTPUTS.get(name):
                return direct(f"{self.names[id(call_arguments['s'])]}.{name}", shape.for_design(self.design), "pin")
        return self.function(func, call_arguments)

    def part(self, module, call_arguments):
        """A module within this one, traced by itself: its inputs arrive."""
        instance = self.names[id(call_arguments["s"])]
        self.instances[instance] = module, self.names[id(call_arguments["p"])]
        for name, shape in module.INPUTS.items():
            pairs = leaves(block.design_formats(shape, self.design), self.prefix(name))
            for (port, fmt), (_, value) in zip(pairs, leaves(call_arguments[name]), strict=True):
                self.arrive(value, instance, port_name(port), fmt)
        pairs = leaves(formats(module.Params, self.design, call_arguments["p"]))
        for (port, fmt), (_, value) in zip(pairs, leaves(call_arguments["p"]), strict=True):
            self.arrive(value, instance, port_name(port), fmt)
        return call_arguments["s"]

    # ---- running the source ------------------------------------------------------------------------------------------

    def function(self, func, call_arguments):
        """Run a function of the wiring."""
        tree = ast.parse(textwrap.dedent(inspect.getsource(func))).body[0]
        returned = self.run(
            tree.body, dict(call_arguments), (func.__globals__, f"{func.__module__.rpartition('.')[2]}.{func.__name__}")
        )
        return functools.reduce(merge_signals, returned)

    def run(self, body, env, where):
        """Run statements in `env`; returns what they return."""
        returned = []
        for node in body:
            if isinstance(node, ast.Return):
                return [*returned, self.value(node.value, env, where)]
            if isinstance(node, ast.Assign):
                (target,) = node.targets
                self.assign(target, self.value(node.value, env, where), env)
            elif isinstance(node, ast.If):
                condition_value = self.trace_condition(node.test, env, where)
                if isinstance(condition_value, bool):
                    inner = self.run(node.body if condition_value else node.orelse, env, where)
                    if inner:
                        return returned + inner
                    continue
                on, off = dict(env), dict(env)
                self.depth += 1
                returned += self.run(node.body, on, where) + self.run(node.orelse, off, where)
                self.depth -= 1
                if not isinstance(node.body[-1], ast.Return):
                    for name in on.keys() | off.keys():
                        both = merge_signals(on.get(name, off.get(name)), off.get(name, on.get(name)))
                        self.assign(ast.Name(name), both, env)
            elif not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
                raise self.unsupported_error(node, where)
        return returned

    def assign(self, target, value, env):
        if isinstance(target, ast.Tuple):
            for part, item in zip(target.elts, value, strict=True):
                self.assign(part, item, env)
        else:
            nameless = isinstance(value, Signal) and value.label == ""
            env[target.id] = replace(value, label=target.id) if nameless else value

    def trace_condition(self, node, env, where):
        """The signals of a condition arrive where it decides."""
        value = self.value(node, env, where)
        if isinstance(value, Signal):
            self.arrive(value, where[1], f"if {ast.unparse(node)}", BIT)
        return value

    def value(self, node, env, where):
        """Value of an expression."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            return env[node.id] if node.id in env else where[0][node.id]
        if isinstance(node, ast.Attribute):
            return getattr(self.value(node.value, env, where), node.attr)
        if isinstance(node, ast.Tuple):
            return tuple(self.value(item, env, where) for item in node.elts)
        if isinstance(node, ast.Subscript):
            return self.value(node.value, env, where)[self.value(node.slice, env, where)]
        if isinstance(node, ast.Compare):
            if isinstance(node.ops[0], ast.Is):  # an optional part is there, or not
                return self.value(node.left, env, where) is self.value(node.comparators[0], env, where)
            return logic(ast.unparse(node), BIT)
        if isinstance(node, ast.IfExp):
            self.trace_condition(node.test, env, where)
            a, b = self.value(node.body, env, where), self.value(node.orelse, env, where)
            if isinstance(a, int) and isinstance(b, int):
                return logic(ast.unparse(node), bits(max(a, b).bit_length()))
            return merge_signals(a, b)
        if isinstance(node, ast.BinOp) and type(node.op) in BITWISE:
            return self.bitwise(node, self.value(node.left, env, where), self.value(node.right, env, where))
        if isinstance(node, ast.Call):
            func = self.value(node.func, env, where)
            positional_values = [self.value(item, env, where) for item in node.args]
            keyword_values = {item.arg: self.value(item.value, env, where) for item in node.keywords}
            if isinstance(func, type):
                return func(*positional_values, **keyword_values)
            func = python_function(func)
            return self.call(func, inspect.signature(func).bind(*positional_values, **keyword_values).arguments)
        raise self.unsupported_error(node, where)

    def bitwise(self, node, a, b):
        """Bits of two signals, or some low bits of one."""
        if isinstance(b, int):
            return logic(ast.unparse(node), bits(b.bit_length()))
        return Signal(tuple(dict.fromkeys(a.leaves + b.leaves)), "")

    def unsupported_error(self, node, where):
        return Unsupported(f"{where[1]}: {ast.unparse(node)} is not understood as wiring")


# ---- what is found ---------------------------------------------------------------------------------------------------


@functools.cache
def trace(module, design=DEFAULT, all_parts=False):
    """`Trace` of control or top; `all_parts`: with all that are optional."""
    return Trace(module, design, Everything() if all_parts else None)


def instances():
    """{instance: (module, path of its parameters or None)} of every block in control and top."""
    block_instances = {}
    for name, (module, path) in trace(top).instances.items():
        if module is not control:
            block_instances[name] = module, path
            continue
        for inner, (part, at) in trace(control).instances.items():
            block_instances[f"{name}.{inner}"] = part, at and f"{path}.{at}"
    return {name: block_instances[name] for name, _ in nested_blocks(top.State) if name in block_instances}


def has_intended_format(wire, leaf, casts, design):
    """Whether the two formats of a wire are as they should be."""
    if leaf.kind == "constant":
        return wire.fmt.holds(leaf.value)
    return leaf.fmt == wire.fmt or any(
        (cast.source, cast.source_fmt.for_design(design), cast.target, cast.target_fmt.for_design(design))
        == (leaf.name, leaf.fmt, wire.target, wire.fmt)
        for cast in casts
    )


def mismatches(module, design=DEFAULT):
    """One line "source format -> target format" for each wire whose formats differ, with optional parts or without."""
    mismatch_lines = []
    for wire in dict.fromkeys(trace(module, design).wires + trace(module, design, True).wires):
        for leaf in wire.signal.leaves:
            if not has_intended_format(wire, leaf, module.CASTS, design):
                source = f"{leaf.name} {leaf.fmt or ''}".strip()
                mismatch_lines.append(f"{source} -> {wire.target} {wire.fmt}")
    return mismatch_lines


@functools.cache
def check(design=DEFAULT):
    """Raise ValueError if a wire of the firmware has two formats."""
    format_differences = list(itertools.chain(mismatches(control, design), mismatches(top, design)))
    if format_differences:
        raise ValueError(f"wiring: formats differ: {'; '.join(format_differences)}")

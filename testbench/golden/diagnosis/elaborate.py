"""From the source of a block's `step` and of its pins to a `Net`: the functions it calls put in place, ifs as choices.

What the firmware's kernels use is understood: records, tuples, tables, if, conditional expressions, comparisons, and,
or, not, + - * << >> & | ^ ~, abs, int, calls. Anything else raises `Unsupported`, with the function and the line.
Source  docs/diagnosis.md; fpga_model/block.py (what a block declares)
"""

import ast
import inspect
import operator
import textwrap
from functools import cache

import numpy as np

from fpga_model import block as registry
from fpga_model import fixed
from fpga_model.fixed import formats
from testbench.golden.diagnosis.net import OPERATIONS, Net, Node


class Unsupported(Exception):
    """Something that no kernel of the firmware uses."""


BINARY = {
    ast.Add: ("add", operator.add),
    ast.Sub: ("sub", operator.sub),
    ast.Mult: ("mul", operator.mul),
    ast.LShift: ("shl", operator.lshift),
    ast.RShift: ("shr", operator.rshift),
    ast.BitAnd: ("and", operator.and_),
    ast.BitOr: ("or", operator.or_),
    ast.BitXor: ("xor", operator.xor),
}
COMPARE = {
    ast.Lt: ("lt", operator.lt),
    ast.LtE: ("le", operator.le),
    ast.Gt: ("gt", operator.gt),
    ast.GtE: ("ge", operator.ge),
    ast.Eq: ("eq", operator.eq),
    ast.NotEq: ("ne", operator.ne),
}
UNARY = {
    ast.USub: ("neg", operator.neg),
    ast.Invert: ("inv", operator.invert),
    ast.Not: ("not", operator.not_),
}
BUILTINS = {"int": int, "abs": abs}
PRIMITIVES = {registry.python_function(fixed.clamp): "clamp", registry.python_function(fixed.wrap): "wrap"}
PRIMITIVES |= {registry.python_function(fixed.wrap_unsigned): "wrapu"}
PRIMITIVES |= {registry.python_function(rule): name for name, rule in fixed.ROUNDINGS.items()}


@cache
def _tree(function):
    return ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]


def _returns(statement):
    return any(isinstance(node, ast.Return) for node in ast.walk(statement))


def static(node):
    """The number of a node made of constants and parameters alone, or None."""
    if isinstance(node, (int, bool)):
        return int(node)
    if node.op == "const":
        return node.value
    if node.op == "param":
        return node.value[1]
    if node.op not in OPERATIONS:
        return None
    argument_values = []
    for a in node.args:
        value = static(a)
        if value is None:
            return None
        argument_values.append(value)
    return int(OPERATIONS[node.op][0](*[np.int64(value) for value in argument_values]))


class Elaborator:
    """Values of expressions of the model, in which a number that depends on a register or input is a node of `net`."""

    def __init__(self, net):
        self.net = net

    def as_node(self, value):
        return value if isinstance(value, Node) else self.net.const(value)

    def operation_node(self, op, args, text=""):
        return self.net.node(op, [self.as_node(a) for a in args], None, text)

    def mux_values(self, test, a, b):
        """`a` where the test holds, else `b`, leaf by leaf."""
        if a is b:
            return a
        if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
            items = [self.mux_values(test, x, y) for x, y in zip(a, b)]
            return type(a)(*items) if hasattr(a, "_fields") else tuple(items)
        if isinstance(a, (Node, int)) and isinstance(b, (Node, int)):
            a, b = self.as_node(a), self.as_node(b)
            return a if a is b else self.operation_node("mux", (test, a, b), f"{test!r} ? {a!r} : {b!r}")
        if a == b:
            return a
        raise Unsupported(f"{type(a).__name__} or {type(b).__name__}")

    def call(self, function, args, kwargs, names=None):
        """Result of a function of the model for values of its arguments."""
        function = registry.python_function(function)
        if function in PRIMITIVES:
            if any(isinstance(a, Node) for a in args):
                return self.operation_node(PRIMITIVES[function], args)
            return int(function(*args))
        if function in (int, abs):
            if not isinstance(args[0], Node):
                return function(args[0])
            return args[0] if function is int else self.operation_node("abs", args, f"abs({args[0]!r})")
        if isinstance(function, type) and hasattr(function, "_fields"):
            return function(*args, **kwargs)
        if not inspect.isfunction(function):
            raise Unsupported(f"call of {function!r}")
        bound_arguments = inspect.signature(function).bind(*args, **kwargs)
        bound_arguments.apply_defaults()
        tree = _tree(function)
        try:
            return self.evaluate(tree.body, dict(bound_arguments.arguments), function.__globals__)
        except Unsupported as error:
            raise Unsupported(f"{function.__module__}.{function.__name__}: {error}") from None

    def evaluate(self, statements, env, names):
        """Value that the statements return; `env` gets what they assign. None if they return nothing."""
        for k, statement in enumerate(statements):
            remaining = statements[k + 1 :]
            if isinstance(statement, ast.Return):
                return self.value(statement.value, env, names)
            if isinstance(statement, ast.If):
                test = self.value(statement.test, env, names)
                if not isinstance(test, Node):
                    return self.evaluate([*(statement.body if test else statement.orelse), *remaining], env, names)
                ways = (statement.body, statement.orelse)
                if _returns(statement):
                    return self.mux_values(test, *[self.evaluate([*way, *remaining], dict(env), names) for way in ways])
                yes, no = dict(env), dict(env)
                self.evaluate(ways[0], yes, names)
                self.evaluate(ways[1], no, names)
                env.update({name: self.mux_values(test, yes[name], no[name]) for name in yes.keys() & no.keys()})
            elif isinstance(statement, ast.Assign):
                assigned_value = self.value(statement.value, env, names)
                for target in statement.targets:
                    self.assign(target, assigned_value, env)
            elif isinstance(statement, ast.AugAssign):
                both = ast.BinOp(ast.Name(statement.target.id, ast.Load()), statement.op, statement.value)
                env[statement.target.id] = self.value(both, env, names)
            elif not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)):
                raise Unsupported(ast.unparse(statement))
        return None

    def assign(self, target, assigned_value, env):
        if isinstance(target, ast.Name):
            env[target.id] = assigned_value
        elif isinstance(target, ast.Tuple):
            for part, value in zip(target.elts, assigned_value, strict=True):
                self.assign(part, value, env)
        else:
            raise Unsupported(ast.unparse(target))

    def value(self, node, env, names):
        """Value of an expression: a number, a node, or a record or tuple of them."""
        take = getattr(self, f"_{type(node).__name__.lower()}", None)
        if take is None:
            raise Unsupported(ast.unparse(node))
        return take(node, env, names)

    def _constant(self, node, env, names):
        return node.value

    def _name(self, node, env, names):
        if node.id in env:
            return env[node.id]
        if node.id in names:
            return names[node.id]
        if node.id in BUILTINS:
            return BUILTINS[node.id]
        raise Unsupported(node.id)

    def _attribute(self, node, env, names):
        return getattr(self.value(node.value, env, names), node.attr)

    def _tuple(self, node, env, names):
        return tuple(self.value(item, env, names) for item in node.elts)

    def _unaryop(self, node, env, names):
        op, python_operator = UNARY[type(node.op)]
        operand_value = self.value(node.operand, env, names)
        if not isinstance(operand_value, Node):
            return int(python_operator(operand_value))
        return self.operation_node(op, (operand_value,), ast.unparse(node))

    def _binop(self, node, env, names):
        op, python_operator = BINARY[type(node.op)]
        a, b = self.value(node.left, env, names), self.value(node.right, env, names)
        if isinstance(a, Node) or isinstance(b, Node):
            return self.operation_node(op, (a, b), ast.unparse(node))
        return python_operator(a, b)

    def _compare(self, node, env, names):
        if len(node.ops) != 1:
            raise Unsupported(ast.unparse(node))
        a, b = self.value(node.left, env, names), self.value(node.comparators[0], env, names)
        if isinstance(node.ops[0], ast.Is):  # an optional part is there, or not
            return int(a is b)
        op, python_operator = COMPARE[type(node.ops[0])]
        if isinstance(a, Node) or isinstance(b, Node):
            return self._flag(op, a, b) or self.operation_node(op, (a, b), ast.unparse(node))
        return int(python_operator(a, b))

    def _flag(self, op, a, b):
        """A flag that is compared with 0 or 1 is the flag, or its opposite."""
        if op not in ("eq", "ne") or b not in (0, 1) or not isinstance(a, Node) or (a.lo, a.hi) != (0, 1):
            return None
        return a if (op == "eq") == (b == 1) else self.operation_node("not", (a,), f"not {a!r}")

    def _boolop(self, node, env, names):
        both = isinstance(node.op, ast.And)
        result = self.value(node.values[0], env, names)
        for part in node.values[1:]:
            if not isinstance(result, Node):
                if bool(result) != both:
                    return result
                result = self.value(part, env, names)
                continue
            other = self.value(part, env, names)
            result = self.operation_node("land" if both else "lor", (result, other), ast.unparse(node))
        return result

    def _ifexp(self, node, env, names):
        test = self.value(node.test, env, names)
        if not isinstance(test, Node):
            return self.value(node.body if test else node.orelse, env, names)
        return self.mux_values(test, self.value(node.body, env, names), self.value(node.orelse, env, names))

    def _subscript(self, node, env, names):
        sequence = self.value(node.value, env, names)
        if isinstance(node.slice, ast.Slice):
            ends = [part and self.value(part, env, names) for part in (node.slice.lower, node.slice.upper)]
            return sequence[slice(*ends)]
        index = self.value(node.slice, env, names)
        number = static(index)
        if number is not None:
            element = sequence[number]
            return int(element) if isinstance(element, np.integer) else element
        return self.net.node("table", (index,), tuple(int(word) for word in sequence), ast.unparse(node))

    def _call(self, node, env, names):
        args = []
        for part in node.args:
            star = isinstance(part, ast.Starred)
            argument_value = self.value(part.value if star else part, env, names)
            args += argument_value if star else [argument_value]
        kwargs = {k.arg: self.value(k.value, env, names) for k in node.keywords}
        call_result = self.call(self.value(node.func, env, names), args, kwargs)
        if isinstance(call_result, Node) and not call_result.text:
            call_result.text = ast.unparse(node)
        return call_result


def block_net(stem, params, design):
    """`Net` of a block with the parameters {flat name: raw} of a design record; raises `Unsupported`."""
    module = registry.block_modules()[stem]
    net = Net()
    runtime = module.BLOCK.runtime_params
    arguments = dict(registry.structure(module, design))
    if hasattr(module, "Params") and not runtime:
        shape = formats(module.Params, design, next(iter(registry.cases(module, design).values())))
        raws = dict(zip([registry.port_name(path) for path, _ in registry.leaves(shape)], registry.raws(shape, params)))
        paths = iter([registry.port_name(path) for path, _ in registry.leaves(shape)])
        arguments["p"] = registry.fill_shape(shape, lambda fmt: _param(net, next(paths), raws, fmt))
    reset_state = registry.power_on_registers(module, design)
    register_reset_values = [(registry.port_name(path), int(value)) for path, value in registry.leaves(reset_state)]
    shape = formats(module.State, design, reset_state)
    fmts = dict(zip([name for name, _ in register_reset_values], [fmt for _, fmt in registry.leaves(shape)]))
    names = iter(fmts)
    arguments["s"] = registry.fill_shape(shape, lambda fmt: net.leaf("reg", next(names), fmt))
    ports = iter(registry.inputs(module, design))
    for name, formed in registry.shapes(module, design).items():
        arguments[name] = registry.fill_shape(formed, lambda _: net.leaf("in", *next(ports)))
    work = Elaborator(net)
    after = work.call(module.step, [arguments[name] for name in registry.arguments(module)], {})
    reset = net.leaf("in", "rst", registry.BIT)
    for (name, value), (_, model_result) in zip(register_reset_values, registry.leaves(after), strict=True):
        net.reset[name] = value
        chosen = net.node("mux", (reset, work.as_node(value), work.as_node(model_result)), name, name)
        net.roots[name] = net.node("next", (chosen,), name, name)
    pins = iter(registry.pins(module, design))
    for name in module.BLOCK.outputs:
        pin_function = registry.python_function(getattr(module, name))
        model_result = work.call(pin_function, [arguments[k] for k in inspect.signature(pin_function).parameters], {})
        for _, leaf in registry.leaves(model_result):
            pin, fmt = next(pins)
            net.fmts[pin] = fmt
            net.roots[pin] = net.node("pin", (work.as_node(leaf),), pin, pin)
    net.close()
    return net


def _param(net, name, raws, fmt):
    net.fmts[f"parameter {name}"] = fmt
    return net.node("param", (), (name, int(raws[name])), name)

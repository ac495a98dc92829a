"""Expressions of a kernel in C: numbers as text, records and arrays as pointers, what is known as it is.

A record that an expression makes is written into a variable of its own before the statement: kernels have no effects,
so the order does not matter. Shifts go through helpers, because C leaves those of negative numbers open.
"""

import ast
import inspect
from types import ModuleType
from typing import NamedTuple

import numpy as np

from fpga_model.block import python_function
from fpga_model.design_record import Design
from testbench.golden.c_model.c_kinds import NUMBER, Array, Record, StaticValue, aggregate, c_name

BINARY = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
SHIFTS = {ast.LShift: "gyro_shl", ast.RShift: "gyro_shr"}
COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
MOST_PLAIN = 1 << 31


class Unsupported(Exception):
    """Something that no kernel of the firmware uses."""


class Value(NamedTuple):
    """A value in C: its kind, and its text; a pointer for a record or an array, a number otherwise."""

    kind: object
    text: str = ""


def literal(number):
    """Text of an integer."""
    number = int(number)
    text = str(abs(number)) if abs(number) < MOST_PLAIN else f"INT64_C({abs(number)})"
    return text if number >= 0 else f"(-{text})"


def member(pointer, name):
    """Text of a member of the record that a pointer leads to."""
    return f"{pointer[1:]}.{name}" if pointer.startswith("&") else f"{pointer}->{name}"


def address(kind, lvalue):
    """Pointer to a place of a kind; the name of an array is one."""
    return f"&{lvalue}" if isinstance(kind, Record) else lvalue


def _closes(text):
    """Whether the first parenthesis of a text is closed by the last."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return k == len(text) - 1
    return False


def bare(text):
    """Without parentheses around the whole."""
    return text[1:-1] if text.startswith("(") and _closes(text) else text


class Expressions:
    """Expressions of one function.

    program  what is common to all functions: `constant`, `table`, `record`, `function`
    env      {Python name: Value}
    globals  names of the function's module; `local` are those that the function assigns
    """

    def __init__(self, program, module, names):
        self.program, self.module, self.globals, self.local = program, module, names, set()
        self.env, self.lines, self.depth, self.scratch = {}, [], 1, []

    def line(self, text):
        self.lines.append("    " * self.depth + text)

    def temporary(self, kind):
        """A variable of the whole function; returns a pointer to it."""
        name = f"made_{len(self.scratch) + 1}"
        size = f"[{kind.count}]" if isinstance(kind, Array) else ""
        self.scratch.append(f"{kind.c_name} {name}{size};")
        return address(kind, name)

    # ---- any value ---------------------------------------------------------------------------------------------------

    def value(self, node):
        """`Value` of an expression."""
        take = getattr(self, f"_{type(node).__name__.lower()}", None)
        if take is None:
            raise Unsupported(ast.unparse(node))
        return take(node)

    def number(self, node):
        """Text of an expression that is a number."""
        value = self.value(node)
        if value.kind != NUMBER:
            raise Unsupported(f"{ast.unparse(node)} is no number")
        return value.text

    def bare_number(self, node):
        """Text of a number as an argument."""
        return bare(self.number(node))

    def module_value(self, python_value, name):
        """A value behind a name of a module: a constant, or what is known."""
        if isinstance(python_value, (bool, int, np.integer)):
            return Value(NUMBER, self.program.constant(self.module, name, int(python_value)))
        return Value(StaticValue(python_value))

    def _constant(self, node):
        return Value(StaticValue(None)) if node.value is None else Value(NUMBER, literal(node.value))

    def _name(self, node):
        if node.id in self.env:
            return self.env[node.id]
        if node.id in self.local:
            raise Unsupported(f"{node.id} is first assigned in only one branch of an if")
        if node.id in self.globals:
            return self.module_value(self.globals[node.id], node.id)
        return Value(StaticValue({"int": int, "abs": abs}[node.id]))

    def _attribute(self, node):
        base = self.value(node.value)
        if isinstance(base.kind, Record):
            kind = base.kind.field_kind(node.attr)
            if isinstance(kind, StaticValue):
                return Value(kind)
            lvalue = member(base.text, c_name(node.attr))
            return Value(kind, address(kind, lvalue))
        owner_object = base.kind.value
        attribute_value = getattr(owner_object, node.attr)
        if isinstance(owner_object, Design):
            return Value(NUMBER, self.program.key(node.attr))
        if isinstance(owner_object, ModuleType):
            if isinstance(attribute_value, (int, np.integer)):
                return Value(NUMBER, self.program.constant(owner_object.__name__, node.attr, int(attribute_value)))
            return Value(StaticValue(attribute_value))
        return self.module_value(attribute_value, ast.unparse(node))

    def _unaryop(self, node):
        if isinstance(node.op, ast.Not):
            return Value(NUMBER, f"!{self.test(node.operand)}")
        sign = "-" if isinstance(node.op, ast.USub) else "~"
        return Value(NUMBER, f"({sign}{self.number(node.operand)})")

    def _binop(self, node):
        if type(node.op) in SHIFTS:
            return Value(
                NUMBER, f"{SHIFTS[type(node.op)]}({self.bare_number(node.left)}, {self.bare_number(node.right)})"
            )
        if isinstance(node.op, ast.Add) and aggregate(self.kind(node.left)):
            return self.build_aggregate(node)
        if type(node.op) not in BINARY:
            raise Unsupported(ast.unparse(node))
        return Value(NUMBER, f"({self.number(node.left)} {BINARY[type(node.op)]} {self.number(node.right)})")

    def _compare(self, node):
        if len(node.ops) != 1 or type(node.ops[0]) not in COMPARE:
            raise Unsupported(ast.unparse(node))
        return Value(
            NUMBER, f"({self.number(node.left)} {COMPARE[type(node.ops[0])]} {self.number(node.comparators[0])})"
        )

    def _boolop(self, node):
        """The operand that decides, as in Python; a comparison is 0 or 1, so C's operators give it."""
        *first, last = node.values
        text = self.number(last)
        for part in reversed(first):
            if isinstance(node.op, ast.And):
                text = f"({self.test(part)} ? {text} : 0)"
            elif isinstance(part, ast.Compare):
                text = f"({self.test(part)} ? 1 : {text})"
            else:
                raise Unsupported(f"{ast.unparse(node)} cannot be used as a number")
        return Value(NUMBER, text)

    def _ifexp(self, node):
        test = self.test(node.test)
        if isinstance(test, bool):
            return self.value(node.body if test else node.orelse)
        if aggregate(self.kind(node.body)):
            return self.build_aggregate(node)
        return Value(NUMBER, f"({test} ? {self.number(node.body)} : {self.number(node.orelse)})")

    def _subscript(self, node):
        base = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self.build_aggregate(node)
        if isinstance(base.kind, StaticValue):
            if isinstance(node.slice, ast.Constant):
                return Value(NUMBER, literal(base.kind.value[node.slice.value]))
            table = self.program.table(base.kind.value, self.module, ast.unparse(node.value))
            return Value(NUMBER, f"{table}[{self.bare_number(node.slice)}]")
        return Value(base.kind.of, address(base.kind.of, f"{base.text}[{self.bare_number(node.slice)}]"))

    def _tuple(self, node):
        return self.build_aggregate(node)

    def _call(self, node):
        func, argument_nodes = self.resolve_call(node)
        if func is int:
            return Value(NUMBER, self.number(argument_nodes[0]))
        if func is abs:
            return Value(NUMBER, f"gyro_abs({self.bare_number(argument_nodes[0])})")
        if isinstance(func, type):
            return self.build_aggregate(node)
        signature = self.signature(func, argument_nodes)
        if isinstance(signature.result, StaticValue):
            return Value(signature.result)
        return (
            self.build_aggregate(node)
            if aggregate(signature.result)
            else Value(NUMBER, f"{signature.name}({self.arguments(signature, argument_nodes)})")
        )

    # ---- calls -------------------------------------------------------------------------------------------------------

    def resolve_call(self, node):
        """(function or record, nodes of its arguments in order, None for one that is not given)."""
        func = self.value(node.func).kind.value
        if func in (int, abs):
            return func, node.args
        func = func if isinstance(func, type) else python_function(func)
        keyword_nodes = {item.arg: item.value for item in node.keywords}
        if isinstance(func, type):
            nodes_by_name = dict(zip(func._fields, node.args)) | keyword_nodes
            return func, [nodes_by_name[name] for name in func._fields]
        return func, list(inspect.signature(func).bind(*node.args, **keyword_nodes).arguments.values())

    def signature(self, func, argument_nodes):
        return self.program.function(func, tuple(self.kind(part) for part in argument_nodes))

    def arguments(self, signature, nodes):
        """Texts of the arguments that C has."""
        return ", ".join(
            bare(self.value(part).text)
            for part, kind in zip(nodes, signature.kinds)
            if not isinstance(kind, StaticValue)
        )

    # ---- conditions --------------------------------------------------------------------------------------------------

    def test(self, node):
        """Text of a condition, or True or False where it is known."""
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Is):
            lhs_kind, rhs_kind = self.kind(node.left), self.kind(node.comparators[0])
            return isinstance(lhs_kind, StaticValue) and lhs_kind == rhs_kind
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return f"!{self.test(node.operand)}"
        if isinstance(node, ast.BoolOp):
            word = " && " if isinstance(node.op, ast.And) else " || "
            return f"({word.join(self.test(part) for part in node.values)})"
        return self.number(node)

    # ---- kinds -------------------------------------------------------------------------------------------------------

    def kind(self, node):
        """Kind of an expression; writes nothing."""
        if isinstance(node, ast.Tuple):
            return Array(self.kind(node.elts[0]), len(node.elts))
        if isinstance(node, ast.BinOp):
            lhs_kind = self.kind(node.left)
            return Array(lhs_kind.of, lhs_kind.count + self.kind(node.right).count) if aggregate(lhs_kind) else NUMBER
        if isinstance(node, (ast.UnaryOp, ast.Compare, ast.BoolOp)):
            return NUMBER
        if isinstance(node, ast.IfExp):
            test = self.test(node.test) if isinstance(node.test, ast.Compare) else None
            return self.kind(node.orelse if test is False else node.body)
        if isinstance(node, ast.Subscript):
            return self._kind_of_part(node)
        if isinstance(node, ast.Call):
            func, argument_nodes = self.resolve_call(node)
            if func in (int, abs):
                return NUMBER
            return self.program.record(func) if isinstance(func, type) else self.signature(func, argument_nodes).result
        if isinstance(node, ast.Attribute):
            base = self.kind(node.value)
            return base.field_kind(node.attr) if isinstance(base, Record) else self.value(node).kind
        return self.value(node).kind

    def _kind_of_part(self, node):
        base = self.kind(node.value)
        if isinstance(node.slice, ast.Slice):
            return Array(base.of, len(self.elements(node)))
        return NUMBER if isinstance(base, StaticValue) else base.of

    # ---- records and arrays ------------------------------------------------------------------------------------------

    def build_aggregate(self, node):
        """A record or array that an expression makes, in a variable of its own."""
        kind = self.kind(node)
        target = self.temporary(kind)
        self.fill(target, kind, node)
        return Value(kind, target)

    def fill(self, target, kind, node):
        """Write an expression into what `target` points to."""
        if isinstance(node, ast.IfExp):
            self._fill_choice(target, kind, node)
        elif isinstance(node, (ast.Tuple, ast.BinOp)) or (
            isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Slice)
        ):
            for k, part in enumerate(self.elements(node)):
                self._store(f"{target}[{k}]", kind.of, part)
        elif isinstance(node, ast.Call):
            func, argument_nodes = self.resolve_call(node)
            if not isinstance(func, type):
                signature = self.signature(func, argument_nodes)
                arguments = self.arguments(signature, argument_nodes)
                self.line(f"{signature.name}({arguments}{', ' if arguments else ''}{target});")
                return
            for (name, part_kind), part in zip(kind.fields, argument_nodes, strict=True):
                if not isinstance(part_kind, StaticValue):
                    self._store(member(target, c_name(name)), part_kind, part)
        else:
            self._copy(target, kind, self.value(node).text)

    def _fill_choice(self, target, kind, node):
        test = self.test(node.test)
        if isinstance(test, bool):
            self.fill(target, kind, node.body if test else node.orelse)
            return
        for head, part in ((f"if ({test}) {{", node.body), ("} else {", node.orelse)):
            self.line(head)
            self.depth += 1
            self.fill(target, kind, part)
            self.depth -= 1
        self.line("}")

    def _copy(self, target, kind, source):
        if isinstance(kind, Array):
            self.line(f"memcpy({target}, {source}, {kind.count} * sizeof {target}[0]);")
        else:
            self.line(f"{target[1:] if target.startswith('&') else '*' + target} = "
                      f"{source[1:] if source.startswith('&') else '*' + source};")  # fmt: skip

    def _store(self, lvalue, kind, part):
        """Write a node, or a value that is there, to a place."""
        if isinstance(part, Value):
            if aggregate(kind):
                self._copy(address(kind, lvalue), kind, part.text)
            else:
                self.line(f"{lvalue} = {part.text};")
        elif aggregate(kind):
            self.fill(address(kind, lvalue), kind, part)
        else:
            self.line(f"{lvalue} = {self.bare_number(part)};")

    def elements(self, node):
        """Elements of a tuple, of a sum of tuples or of a slice: nodes, or values."""
        if isinstance(node, ast.Tuple):
            return list(node.elts)
        if isinstance(node, ast.BinOp):
            return self.elements(node.left) + self.elements(node.right)
        sequence_node = node.value if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Slice) else node
        base = self.value(sequence_node)
        elements = [Value(base.kind.of, address(base.kind.of, f"{base.text}[{k}]")) for k in range(base.kind.count)]
        if sequence_node is node:
            return elements
        ends = [end and ast.literal_eval(end) for end in (node.slice.lower, node.slice.upper)]
        return elements[slice(*ends)]

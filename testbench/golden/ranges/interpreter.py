"""Abstract interpreter of kernels: runs their source over `intervals` instead of numbers, along every way at once.

What the firmware's kernels use is understood: records, tuples, tables, if, conditional expressions, comparisons, and,
or, not, + - * << >> & | ^ ~, abs, calls. Anything else is refused by name and line. A condition narrows both ways; ways
that agree in the names that conditions use are joined after each statement: a flag stays tied to what set it.
Source  docs/ranges.md
"""

import ast
import inspect
import textwrap
from functools import cache
from typing import NamedTuple

import numpy as np

from testbench.golden.ranges.intervals import Lin, Path, join

MOST_PATHS = 64
MOST_SHIFT = 62
COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
OPPOSITE = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}
BITWISE = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
FORKING = (ast.IfExp, ast.Call, ast.BoolOp, ast.Compare)


class Unsupported(Exception):
    """Something that no kernel of the firmware uses."""


class SourceOperation(NamedTuple):
    """An operation in the source: function, line, text."""

    function: str
    line: int
    text: str


class Source(NamedTuple):
    """A function as a tree; `tested` are the local names that its conditions use."""

    name: str
    tree: ast.FunctionDef
    names: dict
    text: str
    first: int
    tested: frozenset


@cache
def read_function_source(func):
    """Tree of a function, compiled or not."""
    plain = getattr(func, "py_func", func)
    text = textwrap.dedent(inspect.getsource(plain))
    name = f"{plain.__module__.rpartition('.')[2]}.{plain.__name__}"
    return source_of_text(text, plain.__globals__, name, plain.__code__.co_firstlineno - 1)


def source_of_text(text, names, name="run", first=0):
    """Tree of the source of a function; `names` are those of its module."""
    tree = ast.parse(text).body[0]
    tests = [part.test for part in ast.walk(tree) if isinstance(part, (ast.If, ast.IfExp))]
    tests += [part for part in ast.walk(tree) if isinstance(part, (ast.BoolOp, ast.Compare))]
    tested = frozenset(part.id for test in tests for part in ast.walk(test) if isinstance(part, ast.Name))
    return Source(name, tree, names, text, first, tested)


@cache
def _spelt_out(node):
    """`a op= b` as `a op b`."""
    load = ast.copy_location(ast.Name(node.target.id, ast.Load()), node)
    return ast.copy_location(ast.BinOp(load, node.op, node.value), node)


def is_number(x):
    return isinstance(x, (int, Lin))


class Interpreter:
    """Runs kernels.

    hooks            {function: replacement(path, arguments)}
    stored           stored(name, index, value, path) sees every store into an array
    split_functions  functions whose ways stay apart where they fill a field of a record
    tracked_names    local names whose constants keep ways apart, beside those that conditions use
    tied             local names of relations: ways that give them different forms stay apart
    notes            {SourceOperation: [lowest, highest]} of every arithmetic result
    problems         {SourceOperation: text} of what int64 or the HDL could see otherwise: shift counts, table indices
    """

    def __init__(self, hooks=None, stored=None, split_functions=(), tracked_names=frozenset(), tied=frozenset()):
        self.hooks, self.stored, self.apart = hooks or {}, stored, split_functions
        self.kept, self.tied = tracked_names, tied
        self.notes, self.problems = {}, {}
        self.where, self.seen = [], {}

    # ---- statements --------------------------------------------------------------------------------------------------

    def run(self, body, paths):
        """(paths that fall through, [(path, value)] that returned); the outermost function keeps its ways apart."""
        returned = []
        for statement in body:
            live = []
            for path in paths:
                on, back = self.statement(statement, path)
                live += on
                returned += back
            paths = live
            if len(self.where) > 1:
                paths = merge_paths(live, self.where[-1].tested | self.kept, self.tied)
            if not paths:
                break
        return paths, returned

    def statement(self, node, path):
        if isinstance(node, ast.Return):
            return [], self.fork_paths(node.value, path)
        if isinstance(node, ast.Assign):
            out = []
            for after, value in self.fork_paths(node.value, path):
                for target in node.targets:
                    self.assign(target, value, after)
                out.append(after)
            return out, []
        if isinstance(node, ast.AugAssign):
            path.env[node.target.id] = self.single(_spelt_out(node), path)
            return [path], []
        if isinstance(node, ast.If):
            true, false = self.split_paths(node.test, path)
            live, returned = self.run(node.body, true)
            other, back = self.run(node.orelse, false)
            return live + other, returned + back
        if isinstance(node, ast.Expr):
            if not isinstance(node.value, ast.Constant):
                self.single(node.value, path)
            return [path], []
        raise self.unsupported_error(node)

    def assign(self, target, value, path):
        if isinstance(target, ast.Name):
            path.env[target.id] = value
        elif isinstance(target, ast.Tuple):
            for part, item in zip(target.elts, value, strict=True):
                self.assign(part, item, path)
        elif isinstance(target, ast.Subscript) and self.stored:
            self.stored(target.value.id, self.single(target.slice, path), value, path)
        else:
            raise self.unsupported_error(target)

    # ---- conditions --------------------------------------------------------------------------------------------------

    def split_paths(self, node, path):
        """(paths where it holds, paths where it does not)."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return self.split_paths(node.operand, path)[::-1]
        if isinstance(node, ast.BoolOp):
            on, short_circuit_paths = [path], []
            for part in node.values:
                following = []
                for way in on:
                    true, false = self.split_paths(part, way)
                    following += true if isinstance(node.op, ast.And) else false
                    short_circuit_paths += false if isinstance(node.op, ast.And) else true
                on = following
            return (on, short_circuit_paths) if isinstance(node.op, ast.And) else (short_circuit_paths, on)
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Is):  # an optional part is there, or not
            is_distinct = self.single(node.left, path) is not self.single(node.comparators[0], path)
            return ([], [path]) if is_distinct else ([path], [])
        if isinstance(node, ast.Compare):
            if len(node.ops) != 1 or type(node.ops[0]) not in COMPARE:
                raise self.unsupported_error(node)
            op = COMPARE[type(node.ops[0])]
            a, b = self.single(node.left, path), self.single(node.comparators[0], path)
        else:
            op, a, b = "!=", self.single(node, path), 0
        if isinstance(a, tuple) and isinstance(b, tuple):
            return [path.copy()], [path]
        if not (is_number(a) and is_number(b)):
            raise self.unsupported_error(node)
        true = path.copy()
        return (
            [true] if true.compare(op, a, b) else [],
            [path] if path.compare(OPPOSITE[op], a, b) else [],
        )

    # ---- expressions -------------------------------------------------------------------------------------------------

    def single(self, node, path):
        """One value; `path` takes on what the ways to it have in common."""
        if not isinstance(node, FORKING):
            return self.evaluate_expression(node, path)
        if isinstance(node, ast.Call):
            func = self.single(node.func, path)
            if (hasattr(func, "py_func") or inspect.isfunction(func)) and func not in self.hooks:
                return self.evaluate_memoised_call(func, *self.arguments(node, path), path)
        env = path.env
        after, value = join(self.fork_paths(node, path.copy(env)), env)
        path.bounds, path.relations = after.bounds, after.relations
        return value

    def fork_paths(self, node, path):
        """[(path, value)], a pair for each way."""
        if isinstance(node, ast.IfExp):
            true, false = self.split_paths(node.test, path)
            return [
                pair for ways, part in ((true, node.body), (false, node.orelse)) for w in ways
                for pair in self.fork_paths(part, w)
            ]  # fmt: skip
        if isinstance(node, ast.Compare):
            true, false = self.split_paths(node, path)
            return [(way, 1) for way in true] + [(way, 0) for way in false]
        if isinstance(node, ast.BoolOp):
            return self.boolean(node, path)
        if isinstance(node, ast.Call):
            return self.call(node, path)
        value = self.evaluate_expression(node, path)
        return [(path, value)]

    def boolean(self, node, path):
        """`and`, `or` as values: the operand that decides."""
        on, path_value_pairs = [path], []
        for part in node.values[:-1]:
            following = []
            for way in on:
                true, false = self.split_paths(part, way)
                if isinstance(node.op, ast.And):
                    following += true
                    path_value_pairs += [(w, 0) for w in false]
                else:
                    following += false
                    path_value_pairs += [pair for w in true for pair in self.fork_paths(part, w)]
            on = following
        return path_value_pairs + [pair for way in on for pair in self.fork_paths(node.values[-1], way)]

    def evaluate_expression(self, node, path):
        """Value of an expression that does not fork by itself."""
        if isinstance(node, ast.Name):  # the most frequent first
            return self.name(node, path)
        if isinstance(node, ast.Attribute):
            return getattr(self.single(node.value, path), node.attr)
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Tuple):
            return tuple(self.single(item, path) for item in node.elts)
        if isinstance(node, ast.Subscript):
            return self.subscript(node, path)
        if isinstance(node, ast.BinOp):
            return self.evaluate_binary(node, path)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Invert)):
            x = self.single(node.operand, path)
            value = path.add(0 if isinstance(node.op, ast.USub) else -1, x, -1)
            return self.track_range(node, path, value)
        raise self.unsupported_error(node)

    def name(self, node, path):
        if node.id in path.env:
            return path.env[node.id]
        names = self.where[-1].names
        if node.id in names:
            return names[node.id]
        if node.id in ("int", "abs"):
            return {"int": int, "abs": abs}[node.id]
        raise self.unsupported_error(node)

    def subscript(self, node, path):
        base = self.single(node.value, path)
        if isinstance(node.slice, ast.Slice):
            ends = (node.slice.lower, node.slice.upper, node.slice.step)
            return base[slice(*(None if end is None else self.single(end, path) for end in ends))]
        index = self.single(node.slice, path)
        lo, hi = path.value_interval(index)
        if not 0 <= lo <= hi < len(base):
            self.problem(node, f"index {lo} .. {hi} of {len(base)} entries")
            lo, hi = max(lo, 0), min(hi, len(base) - 1)
        if lo == hi:
            item = base[lo]
            return int(item) if isinstance(item, np.integer) else item
        if isinstance(base, (tuple, np.ndarray)) and all(isinstance(x, (int, np.integer)) for x in base[lo : hi + 1]):
            return path.word(base, index)
        return join([(path, base[k]) for k in range(lo, hi + 1)], path.env)[1]

    def evaluate_binary(self, node, path):
        a, b = self.single(node.left, path), self.single(node.right, path)
        if isinstance(a, tuple) and isinstance(b, tuple) and isinstance(node.op, ast.Add):
            return a + b
        if not (is_number(a) and is_number(b)):
            raise self.unsupported_error(node)
        if type(node.op) in BITWISE:
            value = path.bitwise(BITWISE[type(node.op)], a, b)
        elif isinstance(node.op, (ast.Add, ast.Sub)):
            value = path.add(a, b, 1 if isinstance(node.op, ast.Add) else -1)
        elif isinstance(node.op, ast.Mult):
            value = path.mul(a, b)
        elif isinstance(node.op, (ast.LShift, ast.RShift)):
            value = self.shift(node, path, a, b)
        else:
            raise self.unsupported_error(node)
        return self.track_range(node, path, value)

    def shift(self, node, path, a, b):
        move = path.shl if isinstance(node.op, ast.LShift) else path.shr
        lo, hi = path.value_interval(b)
        if not 0 <= lo <= hi <= MOST_SHIFT:
            self.problem(node, f"shift by {lo} .. {hi}, outside 0 .. {MOST_SHIFT}")
            lo, hi = max(lo, 0), min(max(hi, 0), MOST_SHIFT)
        if lo == hi:
            return move(a, lo)
        spans = [path.value_interval(move(a, n)) for n in range(lo, hi + 1)]
        shifted_value = path.new(min(low for low, _ in spans), max(high for _, high in spans))
        if move == path.shl and isinstance(a, int) and a > 0 and isinstance(shifted_value, Lin):
            path.run.powers[shifted_value.terms[0][0]] = (a, b)
        return shifted_value

    # ---- calls -------------------------------------------------------------------------------------------------------

    def call(self, node, path):
        func = self.single(node.func, path)
        if isinstance(func, type) and hasattr(func, "_fields"):
            return self.record(func, node, path)
        positional_values, keyword_values = self.arguments(node, path)
        if func in self.hooks:
            return [(path, self.hooks[func](path, *positional_values, **keyword_values))]
        if func is int:
            return [(path, positional_values[0])]
        if func is abs:
            return [(path, self.track_range(node, path, path.magnitude(positional_values[0])))]
        return self.function(func, positional_values, keyword_values, path)

    def arguments(self, node, path):
        positional_values = [self.single(item, path) for item in node.args]
        return positional_values, {item.arg: self.single(item.value, path) for item in node.keywords}

    def evaluate_memoised_call(self, func, positional_values, keyword_values, path):
        """One value of a call, from its arguments alone: the same arguments and intervals give the same value."""
        values = (*positional_values, *keyword_values.values())
        atoms = sorted(set(iterate_atoms(values)))
        argument_atoms = set(atoms)
        relations = tuple(r for r in path.relations if all(atom in argument_atoms for atom, _ in r[0]))
        key = (func, values, tuple(keyword_values), tuple(path.bounds[atom] for atom in atoms), relations)
        if key not in self.seen:
            inside = Path(path.run, {}, {atom: path.bounds[atom] for atom in atoms}, relations)
            after, value = join(self.function(func, positional_values, keyword_values, inside), {})
            self.seen[key] = value, {atom: after.bounds[atom] for atom in set(iterate_atoms((value,)))}
        value, bounds = self.seen[key]
        for atom, (lo, hi) in bounds.items():
            least, most = path.bounds.get(atom, (lo, hi))
            path.bounds[atom] = max(lo, least), min(hi, most)
        return value

    def record(self, func, node, path):
        """A record; ways through the functions that are kept apart stay apart."""
        path_value_pairs = [(path, ())]
        names = func._fields[: len(node.args)] + tuple(item.arg for item in node.keywords)
        for part in (*node.args, *(item.value for item in node.keywords)):
            split = isinstance(part, ast.Call) and self.single(part.func, path) in self.apart
            following = []
            for way, values in path_value_pairs:
                pairs = self.fork_paths(part, way) if split else [(way, self.single(part, way))]
                following += [(after, (*values, value)) for after, value in pairs]
            path_value_pairs = following
        return [(way, func(**dict(zip(names, values)))) for way, values in path_value_pairs]

    def function(self, func, positional_values, keyword_values, path):
        """Ways through a function, joined where they return the same constant or no constant at all."""
        function_source = read_function_source(func)
        parameters = [item.arg for item in function_source.tree.args.args]
        env = {**dict(zip(parameters, positional_values)), **keyword_values}
        self.where.append(function_source)
        on, returned = self.run(function_source.tree.body, [path.copy(env)])
        self.where.pop()
        if on or not returned:
            raise Unsupported(f"{function_source.name}: a path through it returns nothing")
        return [join(group, dict(path.env)) for group in self.groups(function_source.name, returned)]

    def groups(self, name, returned):
        """Ways that are joined: those with one constant; a record keeps its ways, whatever else is one way."""
        if name.startswith("fixed."):
            return [returned]
        records = all(hasattr(value, "_fields") for _, value in returned)
        if records and len(returned) <= MOST_PATHS:
            return [[pair] for pair in returned]
        groups = {}
        for way, value in returned:
            return_constant = way.value(value) if is_number(value) else None
            if records:
                return_constant = tuple(x if isinstance(x, int) else None for x in value)
            groups.setdefault(None if isinstance(return_constant, Lin) else return_constant, []).append((way, value))
        return list(groups.values()) if len(groups) <= MOST_PATHS else [returned]

    # ---- records -----------------------------------------------------------------------------------------------------

    def source_operation(self, node):
        where = self.where[-1]
        text = ast.get_source_segment(where.text, node) if hasattr(node, "end_lineno") else None
        return SourceOperation(where.name, where.first + node.lineno, " ".join((text or ast.unparse(node)).split()))

    def track_range(self, node, path, value):
        key = (self.where[-1].name, node)
        lo, hi = path.value_interval(value)
        ends = self.notes.setdefault(key, [lo, hi])
        ends[0], ends[1] = min(ends[0], lo), max(ends[1], hi)
        if key not in OPERATIONS:
            OPERATIONS[key] = self.source_operation(node)
        return value

    def problem(self, node, text):
        self.problems[self.source_operation(node)] = text

    def unsupported_error(self, node):
        where = self.where[-1] if self.where else None
        line = where.first + node.lineno if where else 0
        return Unsupported(f"{where.name if where else '?'}, line {line}: {ast.unparse(node)} is not understood")


OPERATIONS = {}  # (function, node) -> SourceOperation, found once: the text of a node takes long to cut out


def iterate_atoms(values):
    """Atoms of values and records of values."""
    for value in values:
        if isinstance(value, Lin):
            for atom, _ in value.terms:
                yield atom
        elif isinstance(value, tuple):
            yield from iterate_atoms(value)


def merge_paths(paths, tracked_names, tied):
    """Paths with the same constants under the `tracked_names` names become one; `tied` names count with any value."""
    if len(paths) < 2:
        return paths
    groups = {}
    for path in paths:
        tracked_constants = []
        for name, value in path.env.items():
            if (name in tracked_names or name in tied) and is_number(value):
                value = path.value(value)
                if name in tied or not isinstance(value, Lin):
                    tracked_constants.append((name, value))
        groups.setdefault(tuple(tracked_constants), []).append((path, None))
    if len(groups) > MOST_PATHS:
        groups = {None: [(path, None) for path in paths]}
    return [join(group)[0] for group in groups.values()]

"""The step of a block with a probe at every decision: which outcomes, boundaries, ties and limits a stimulus has met.

    branch    test of an if, of a conditional expression, of a part of `and`, `or`, `not`      yes, no
    compare   a < b and its kin                       yes, no, and a - b = -1, 0, 1 (order only)
    round     half_up(x, n)                           dropped bits 0, 1, half - 1, half + 1, all ones;
                                                      ties by the sign of x and by the parity of what is kept
    cut       x >> n, floor(x, n)                     dropped bits 0, all ones
    clamp     clamp(x, lo, hi)                        lo - 1, lo, lo + 1, hi - 1, hi, hi + 1
    wrap      wrap, wrap_unsigned(x, width)           the two ends, and one LSB beyond each

The source of `step` is parsed, every such place is replaced by a call that notes what passes and returns what the place
would have given, and the functions it calls are copied in turn, one copy per call: each instance has probes of its own.
Source  docs/golden.md (coverage)
"""

import ast
import importlib
import inspect
import itertools
import textwrap
from typing import NamedTuple

from fpga_model import block as registry
from fpga_model import fixed
from testbench.golden.stimulus import blocks

ORDER_SYMBOLS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
EQUALITY_SYMBOLS = {ast.Eq: "==", ast.NotEq: "!="}
ROUNDED = ("zero", "one", "half-1", "half+1", "ones", "tie+even", "tie+odd", "tie-even", "tie-odd")
CLAMPED = ("lo-1", "lo", "lo+1", "hi-1", "hi", "hi+1")
WRAPPED = ("under", "lo", "hi", "over")


class Site(NamedTuple):
    """One place in the source, the outcomes it could have, and those seen.

    path   functions from `step` to the place, as texts; a further copy of one is numbered, as in "step > _pole#2"
    text   the expression
    again  its number among the same texts of the path
    """

    kind: str
    path: str
    text: str
    again: int
    possible: tuple
    reached_outcomes: set

    @property
    def name(self):
        """Where: what."""
        return f"{self.path}: {self.text}" + (f" #{self.again}" if self.again > 1 else "")

    @property
    def function(self):
        """Name of the function that it stands in."""
        return self.path.rpartition(" > ")[2].partition("#")[0]

    @property
    def copy(self):
        """Which copy of the function, from 1."""
        return int(self.path.rpartition(" > ")[2].partition("#")[2] or 1)


# Each factory returns the function that stands in the place, writing outcomes into `seen` -----------------------------


def _make_branch_probe(reached_outcomes):
    def observe_branch(value):
        reached_outcomes.add("yes" if value else "no")
        return value

    return observe_branch


def _make_comparison_probe(symbol, reached_outcomes):
    test = eval(f"lambda a, b: a {symbol} b")
    is_ordering = symbol in ORDER_SYMBOLS.values()

    def observe_comparison(a, b):
        is_true = test(a, b)
        reached_outcomes.add("yes" if is_true else "no")
        if is_ordering and -2 < a - b < 2:
            reached_outcomes.add(("-1", "0", "+1")[a - b + 1])
        return is_true

    return observe_comparison


def _make_rounding_probe(reached_outcomes):
    def observe_rounding(x, n):
        if n > 0:
            low, half = x & ((1 << n) - 1), 1 << (n - 1)
            if low == half:
                reached_outcomes.add(f"tie{'-' if x < 0 else '+'}{'odd' if (x >> n) & 1 else 'even'}")
            elif low < 2:
                reached_outcomes.add("one" if low else "zero")
            if low == half - 1:
                reached_outcomes.add("half-1")
            elif low == half + 1:
                reached_outcomes.add("half+1")
            if low == (1 << n) - 1:
                reached_outcomes.add("ones")
        return (x + ((1 << n) >> 1)) >> n

    return observe_rounding


def _make_truncation_probe(reached_outcomes):
    def observe_truncation(x, n):
        low = x & ((1 << n) - 1)
        if low == 0:
            reached_outcomes.add("zero")
        if low == (1 << n) - 1:
            reached_outcomes.add("ones")
        return x >> n

    return observe_truncation


def _make_clamp_probe(reached_outcomes):
    def observe_clamp(x, lo, hi):
        if -2 < x - lo < 2:
            reached_outcomes.add(("lo-1", "lo", "lo+1")[x - lo + 1])
        if -2 < x - hi < 2:
            reached_outcomes.add(("hi-1", "hi", "hi+1")[x - hi + 1])
        return lo if x < lo else (hi if x > hi else x)

    return observe_clamp


def _make_wrap_probe(reached_outcomes, signed):
    def lowest(width):
        return -(1 << (width - 1)) if signed else 0

    def observe_wrap(x, width):
        lo = lowest(width)
        hi = lo + (1 << width) - 1
        if x == lo or x == hi:
            reached_outcomes.add("lo" if x == lo else "hi")
        elif x == lo - 1 or x == hi + 1:
            reached_outcomes.add("under" if x < lo else "over")
        return ((x - lo) & ((1 << width) - 1)) + lo

    observe_wrap.lowest = lowest
    return observe_wrap


def _distance(kind, outcome, args):
    """How far the operands of a place are from an outcome; None where there is no measure."""
    if any(not isinstance(x, int) for x in args):
        return None
    if kind == "compare":
        a, b = args
        return abs(a - b - int(outcome)) if outcome in ("-1", "0", "+1") else abs(a - b)
    if kind == "clamp":
        x, lo, hi = args
        return abs(x - (lo if outcome[:2] == "lo" else hi) - int(outcome[2:] or 0))
    if kind == "wrap":
        x, lo, hi = args
        return abs(x - {"lo": lo, "hi": hi, "under": lo - 1, "over": hi + 1}[outcome])
    if kind in ("round", "cut"):
        x, n = args
        size, half = 1 << n, (1 << n) >> 1
        target_bits = {"zero": 0, "one": 1, "half-1": half - 1, "half+1": half + 1, "ones": size - 1}.get(outcome, half)
        away = abs((x & (size - 1)) - target_bits)
        return min(away, size - away) if n else None
    return None


PROBE_BY_FUNCTION = {
    "half_up": ("round", ROUNDED, _make_rounding_probe),
    "floor": ("cut", ("zero", "ones"), _make_truncation_probe),
    "clamp": ("clamp", CLAMPED, _make_clamp_probe),
    "wrap": ("wrap", WRAPPED, lambda seen: _make_wrap_probe(seen, True)),
    "wrap_unsigned": ("wrap", WRAPPED, lambda seen: _make_wrap_probe(seen, False)),
}


def _unwrap_kernel(function):
    return getattr(function, "py_func", function)


class _Transformer(ast.NodeTransformer):
    """Replaces the places of one function and copies the functions that it calls.

    names     what the names of the function mean that do not change while a case runs
    changing  the names that do; an expression without any has one value in a case and is no place
    """

    def __init__(self, owner, names, path, changing):
        self.owner, self.names, self.path, self.changing = owner, names, path, changing

    def is_constant(self, node):
        return not any(isinstance(n, ast.Name) and n.id in self.changing for n in ast.walk(node))

    def value(self, node):
        return eval(compile(ast.fix_missing_locations(ast.Expression(node)), "", "eval"), self.names)

    def add_probe(self, kind, node, possible, factory):
        key = self.owner.add(kind, self.path, ast.unparse(node), possible, factory)
        return ast.Name(key, ast.Load())

    def visit(self, node):
        return node if isinstance(node, ast.expr) and self.is_constant(node) else super().visit(node)

    def probe_condition(self, node):
        """The probed form of an expression whose truth is used."""
        if self.is_constant(node):
            return node
        if isinstance(node, (ast.BoolOp, ast.Compare)) or (
            isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
        ):
            return self.visit(node)
        note = self.add_probe("branch", node, ("yes", "no"), _make_branch_probe)
        return ast.Call(note, [self.visit(node)], [])

    def visit_If(self, node):
        if self.is_constant(node.test):
            return self.statements(node.body if self.value(node.test) else node.orelse) or ast.Pass()
        return ast.If(self.probe_condition(node.test), self.statements(node.body), self.statements(node.orelse))

    def statements(self, nodes):
        statements = []
        for node in nodes:
            visited = self.visit(node)
            statements += visited if isinstance(visited, list) else [visited]
        return statements

    def visit_IfExp(self, node):
        if self.is_constant(node.test):
            return self.visit(node.body if self.value(node.test) else node.orelse)
        return ast.IfExp(self.probe_condition(node.test), self.visit(node.body), self.visit(node.orelse))

    def visit_BoolOp(self, node):
        return ast.BoolOp(node.op, [self.probe_condition(value) for value in node.values])

    def visit_UnaryOp(self, node):
        operand = self.probe_condition(node.operand) if isinstance(node.op, ast.Not) else self.visit(node.operand)
        return ast.UnaryOp(node.op, operand)

    def visit_Compare(self, node):
        kind = type(node.ops[0])
        possible = ("yes", "no", "-1", "0", "+1") if kind in ORDER_SYMBOLS else ("yes", "no")
        symbol = {**ORDER_SYMBOLS, **EQUALITY_SYMBOLS}[kind]
        note = self.add_probe("compare", node, possible, lambda seen: _make_comparison_probe(symbol, seen))
        (right,) = node.comparators
        return ast.Call(note, [self.visit(node.left), self.visit(right)], [])

    def visit_BinOp(self, node):
        if not isinstance(node.op, ast.RShift):
            return self.generic_visit(node)
        note = self.add_probe("cut", node, ("zero", "ones"), _make_truncation_probe)
        return ast.Call(note, [self.visit(node.left), self.visit(node.right)], [])

    def visit_Call(self, node):
        target = self.value(node.func)
        arguments = [self.visit(x) for x in node.args]
        keywords = [ast.keyword(k.arg, self.visit(k.value)) for k in node.keywords]
        plain = _unwrap_kernel(target)
        if plain.__module__ == fixed.__name__ and plain.__name__ in PROBE_BY_FUNCTION:
            kind, possible, factory = PROBE_BY_FUNCTION[plain.__name__]
            return ast.Call(self.add_probe(kind, node, possible, factory), arguments, keywords)
        if inspect.isfunction(plain) and plain.__module__.startswith("fpga_model."):
            nodes = dict(zip(inspect.signature(plain).parameters, node.args)) | {k.arg: k.value for k in node.keywords}
            steady = {name: self.value(value) for name, value in nodes.items() if self.is_constant(value)}
            inner = self.owner.copy(plain, f"{self.path} > {ast.unparse(node.func)}", steady)
            return ast.Call(ast.Name(inner, ast.Load()), arguments, keywords)
        return ast.Call(node.func, arguments, keywords)


class Probed:
    """`step` of a module, probed; `sites` in the order of the source, a second place of the same text numbered.

    fixed  {argument of step: value} of what does not change while a case runs
    """

    def __init__(self, module, fixed, watched=None):
        self.watched, self.nearest = watched, None
        self.numbers, self.sites, self.shared, self.calls = itertools.count(), {}, {}, {}
        self.step = self.shared[self.copy(_unwrap_kernel(module.step), module.__name__.rpartition(".")[2], fixed)]

    def add(self, kind, path, text, possible, factory):
        key = f"_probe_{next(self.numbers)}"
        sites = (Site(kind, path, text, again, possible, set()) for again in itertools.count(1))
        site = next(site for site in sites if site.name not in self.sites)
        self.sites[site.name] = site
        self.shared[key] = note = factory(site.reached_outcomes)
        if self.watched and self.watched[:2] == (kind, site.name):
            self.shared[key] = self.make_distance_tracker(kind, note, self.watched[2])
        return key

    def make_distance_tracker(self, kind, note, outcome):
        """A note that keeps the least distance of its operands from the watched outcome as well."""

        def with_distance(*args):
            probe_result = note(*args)
            values = args
            if kind == "wrap":
                lo = note.lowest(args[1])
                values = (args[0], lo, lo + (1 << args[1]) - 1)
            away = _distance(kind, outcome, values)
            if away is not None and (self.nearest is None or away < self.nearest):
                self.nearest = away
            return probe_result

        return with_distance

    def copy(self, function, path, fixed):
        """Name of a probed copy of a function; `fixed` are the values of arguments that do not change in a case."""
        key = f"_copy_{next(self.numbers)}"
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        names = {**function.__globals__, **fixed}
        tree.decorator_list, tree.name = [], key
        # calls of one path are told apart by a number
        self.calls[path] = self.calls.get(path, 0) + 1
        stored = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        changing = (set(inspect.signature(function).parameters) - set(fixed)) | stored
        changed = _Transformer(self, names, path if self.calls[path] == 1 else f"{path}#{self.calls[path]}", changing)
        tree.body = changed.statements(tree.body)
        names["__builtins__"] = __builtins__
        code = compile(ast.fix_missing_locations(ast.Module([tree], [])), inspect.getfile(function), "exec")
        names.update(self.shared)
        exec(code, names)
        self.shared[key] = names[key]
        return key

    def clear(self):
        self.nearest = None
        for site in self.sites.values():
            site.reached_outcomes.clear()

    def goals(self):
        """Every (kind, name, outcome) that the sites could give."""
        return [(s.kind, s.name, outcome) for s in self.sites.values() for outcome in s.possible]

    def reached_goals(self):
        return {(s.kind, s.name, outcome) for s in self.sites.values() for outcome in s.reached_outcomes}


def build_probed_step(block, case, watched=None):
    """Probed step of a golden block for one case; `watched` is a goal whose nearest miss is kept in `nearest`."""
    module = importlib.import_module(f"fpga_model.{block.stem}")
    fixed = {} if block.runtime_params or block.cases[case] is None else {"p": block.cases[case]}
    return Probed(module, fixed | registry.structure(module), watched)


def edge(block, case, step):
    """Function (state, row of inputs without rst) -> next state, by the given step."""
    names = registry.arguments(registry.block_modules()[block.stem])
    state_index, params = names.index("s"), block.cases[case]

    def step_row(s, row):
        input_arguments = blocks.step_arguments(block, params, row)
        return step(*input_arguments[:state_index], s, *input_arguments[state_index:])

    return step_row


def follow(block, case, probed_step, rows, state=None):
    """Run rows (lists, rst first) through a probed step; returns the state after the last."""
    step_row = edge(block, case, probed_step.step)
    state = block.state if state is None else state
    for row in rows:
        state = block.state if row[0] else step_row(state, row[1:])
    return state

"""Proven range of every register of a block, by induction over its clock edges, and the widest intermediate result.

    X[0] = reset        X = what the registers may hold, a box per control state        X[n+1] = X[n] join F(X[n])

F runs one clock edge of the block's runner (`block.runner_text`, the very code that makes the vectors) over intervals,
with every input anywhere in its format and reset at any edge. Widening makes the iteration end, narrowing takes back
what it gave away, and a last pass checks the induction: reset in X, F(X) in X, X in the formats. A register whose step
leaves its format is reported as not proven, and every other result is then conditional on its width.

A block's split, relations, stops and apart are hints: they change how tight a proof is, never whether it holds.
Source  docs/ranges.md
"""

import ast
import itertools
from bisect import bisect_left, bisect_right
from functools import lru_cache
from typing import NamedTuple

from fpga_model.block import block_modules, fill_shape, leaves, port_name, structure
from fpga_model.fixed import MAX_WIDTH
from testbench.golden.ranges.interpreter import OPERATIONS, Interpreter, source_of_text
from testbench.golden.ranges.intervals import Lin, Path, Run
from testbench.golden.stimulus import blocks

# Parts of a block whose control state the block's own boxes know
SPLIT_FUNCTIONS = tuple(module.step for module in block_modules().values() if module.BLOCK.separate_paths)
PLAIN_JOINS = 3  # joins of a box before it is widened
NARROWINGS = 5
FAR = 1 << 62


class Range(NamedTuple):
    """What one register may hold: proven, or None where the proof fails; `step` is what one edge makes of X."""

    name: str
    fmt: tuple
    proven: tuple | None
    step: tuple

    @property
    def headroom(self):
        """Whole bits of the format that no value ever uses, or None."""
        return None if self.proven is None else self.fmt.width - width(*self.proven, self.fmt.s)


class Widest(NamedTuple):
    """An arithmetic result: its interval, its bits, and where it is computed."""

    lo: int
    hi: int
    bits: int
    function: str
    line: int
    text: str


class Analysis(NamedTuple):
    """Ranges of registers and pins, arithmetic results from the widest down, and what is wrong (empty: nothing)."""

    registers: tuple
    pins: tuple
    results: tuple
    problems: tuple

    @property
    def widest(self):
        """The widest result that is not a constant, or None."""
        return next((result for result in self.results if result.lo != result.hi), None)

    @property
    def sound(self):
        """True when every register is proven and no result needs more than 63 bits."""
        return not self.problems


def width(lo, hi, signed):
    """Bits that hold lo .. hi: two's complement if signed or negative, else unsigned."""
    if signed or lo < 0:
        return max(lo if lo >= 0 else -lo - 1, hi if hi >= 0 else -hi - 1).bit_length() + 1
    return hi.bit_length()


def relations_text(block):
    """The sums of registers that are proven along, as texts."""
    return [" + ".join(f"{coef}*{name}" for name, coef in sums.items()) for sums in block.relations]


# ---- one edge -----------------------------------------------------------------------------------------------------


class Edge:
    """F: one clock edge of a block with given parameters."""

    def __init__(self, block, params):
        self.block, self.params = block, params
        module = block_modules().get(block.stem)
        self.structure = structure(module, block.record) if module else {}
        self.names = [port_name(path) for path, _ in leaves(block.state)]
        self.fmts = [port.fmt for port in block.registers]
        register_index = {name: k for k, name in enumerate(self.names)}
        self.split = [(register_index[name.rstrip("?")], name.endswith("?")) for name in block.split]
        self.relations = [[(register_index[name], coef) for name, coef in sums.items()] for sums in block.relations]
        self.kept = frozenset(name.rstrip("?").rpartition("_")[2] for name in block.split)
        self.kept |= {name.rstrip("?") for name in block.split}
        self.tied = frozenset(name for sums in block.relations for name in sums)
        self.source = source_of_text(*block.source)
        (loop,) = [node for node in self.source.tree.body if isinstance(node, ast.For)]
        self.body = loop.body
        self.reset = [int(value) for _, value in leaves(block.state)]
        self.run = Run()
        self.clear_observations()

    def clear_observations(self):
        """Forget what was noted: pins, writes, arithmetic."""
        self.pins, self.interpreter = {}, Interpreter({}, self._track_pin_store, SPLIT_FUNCTIONS, self.kept, self.tied)
        self.written = [(x, x) for x in self.reset]

    def key(self, row):
        """Control state of a row of numbers."""
        return tuple(min(row[k], 1) if coarse else row[k] for k, coarse in self.split)

    def initial_boxes(self):
        """X[0]."""
        sums = [sum(coef * self.reset[k] for k, coef in sums) for sums in self.relations]
        return {self.key(self.reset): [(x, x) for x in (*self.reset, *sums)]}

    def _build_state(self, path, box):
        """The state record of a box."""
        values = [path.new(*ends, key=("register", name)) for name, ends in zip(self.names, box)]
        for sums, (lo, hi) in zip(self.relations, box[len(values) :]):
            if not path.assume(_total(path, values, sums), lo, hi):
                return None
        register_values = iter([path.value(x) for x in values])
        return fill_shape(self.block.state, lambda _: next(register_values))

    def _track_pin_store(self, name, index, value, path):
        if name == "_pins":
            self._pin(index[1], path.value_interval(value))

    def _pin(self, k, ends):
        lo, hi = self.pins.get(k, ends)
        self.pins[k] = (min(lo, ends[0]), max(hi, ends[1]))

    def __call__(self, box):
        """[(control state, box)] after one edge from a box; an edge that holds everything adds nothing."""
        path = Path(self.run)
        state = self._build_state(path, box)
        if state is None:
            return []
        inputs = tuple(path.new(p.fmt.lo, p.fmt.hi, key=("input", p.name)) for p in self.block.columns)
        path.env = {
            **{"d": 0, "rom": 0} | self.structure,
            "p": self.params,
            "s": state,
            "reset": self.block.state,
            "stim": (inputs,),
            "_regs": ("regs",),
            "_pins": ("pins",),
            "n": 0,
        }
        self.interpreter.where = [self.source]
        ends, _ = self.interpreter.run(self.body, [path])
        before = [value for _, value in leaves(state)]
        next_boxes = []
        for end in ends:
            after = [value for _, value in leaves(end.env["s"])]
            if after != before:
                for k, (old, new) in enumerate(zip(before, after)):
                    self._add_register_write(k, end, old, new)
                next_boxes += self._boxes(end, after)
        return next_boxes

    def _add_register_write(self, k, path, old, new, span=None):
        """Add what an edge writes into register k; its own old value is no write."""
        if new == old:
            return
        atom = new.terms[0][0] if isinstance(new, Lin) and new.terms[0][1] == 1 and not new.const else None
        if atom in self.run.choices:
            for value, ends in self.run.choices[atom]:
                self._add_register_write(k, path, old, value, ends)
            return
        self.written[k] = _hull(self.written[k], span or path.value_interval(new))

    def _boxes(self, path, values):
        choices = []
        for k, coarse in self.split:
            lo, hi = path.value_interval(values[k])
            choices.append([v for v in (0, 1) if lo <= v <= hi or (v and hi > 1)] if coarse else range(lo, hi + 1))
        for key in itertools.product(*choices):
            way = path.copy() if key else path
            if all(
                way.assume(values[k], 1, None) if coarse and v else way.assume(values[k], v, v)
                for (k, coarse), v in zip(self.split, key)
            ):
                sums = [way.value_interval(_total(way, values, sums)) for sums in self.relations]
                yield key, [way.value_interval(value) for value in values] + sums


def _total(path, values, sums):
    total = 0
    for k, coef in sums:
        total = path.add(total, path.remove_shift(values[k]), coef)
    return total


# ---- induction ----------------------------------------------------------------------------------------------------


def _hull(a, b):
    return (min(a[0], b[0]), max(a[1], b[1]))


def _widen_interval(old, new, stops):
    lo, hi = old
    if new[0] < lo:
        lo = stops[max(bisect_right(stops, new[0]) - 1, 0)]
    if new[1] > hi:
        hi = stops[min(bisect_left(stops, new[1]), len(stops) - 1)]
    return min(lo, new[0]), max(hi, new[1])


def _clip_box(edge, box):
    """The box, with each register inside its format; FAR is the end of a relation."""
    register_box = [(max(lo, fmt.lo), min(hi, fmt.hi)) for (lo, hi), fmt in zip(box, edge.fmts)]
    return register_box + [(max(lo, -FAR), min(hi, FAR)) for lo, hi in box[len(register_box) :]]


def _empty(box):
    return any(lo > hi for lo, hi in box)


def _boxes_after_edge(edge, boxes):
    """{control state: box} of the reset and of one edge from everything in `boxes`."""
    next_boxes = edge.initial_boxes()
    for box in boxes.values():
        for key, after in edge(box):
            next_boxes[key] = after if key not in next_boxes else [_hull(a, b) for a, b in zip(next_boxes[key], after)]
    return next_boxes


def _invariant(edge):
    """(X, F(X)): boxes that hold the reset and, inside the formats, whatever one edge makes of them.

    What `edge` has noted at the end is of one pass over X alone.
    """
    boxes, visits = edge.initial_boxes(), {}
    stops = {value + k for value in edge.block.stops for k in (-1, 0, 1)} | {0}
    sides = [sorted({*stops, fmt.lo, fmt.hi}) for fmt in edge.fmts] + [[-FAR, 0, FAR]] * len(edge.relations)
    todo = list(boxes)
    while todo:
        for key, after in edge(boxes[todo.pop(0)]):
            after = _clip_box(edge, after)
            if _empty(after):
                continue
            old = boxes.get(key)
            new = after if old is None else [_hull(a, b) for a, b in zip(old, after)]
            if new == old:
                continue
            visits[key] = visits.get(key, 0) + 1
            if old is not None and visits[key] > PLAIN_JOINS:
                new = _clip_box(edge, [_widen_interval(a, b, side) for a, b, side in zip(old, new, sides)])
            boxes[key] = new
            if key not in todo:
                todo.append(key)
    for _ in range(NARROWINGS):
        edge.clear_observations()
        image = _boxes_after_edge(edge, boxes)
        after = {key: _clip_box(edge, box) for key, box in image.items()}
        # a register holds what was last written to it, in whatever control state that was
        written = edge.written + [(-FAR, FAR)] * len(edge.relations)
        tighter = {
            key: [(max(a[0], b[0], w[0]), min(a[1], b[1], w[1])) for a, b, w in zip(boxes[key], after[key], written)]
            for key in after
            if key in boxes
        }
        if tighter == boxes:
            return boxes, image
        boxes = {key: box for key, box in tighter.items() if not _empty(box)}
    edge.clear_observations()
    return boxes, _boxes_after_edge(edge, boxes)


def analyse(block, params):
    """`Analysis` of a block with the given parameters (None where it has none)."""
    edge = Edge(block, 0 if params is None else params)
    boxes, after = _invariant(edge)  # the proof: everything below is judged on the last pass alone
    problems = [
        f"{problem_operation.function}, line {problem_operation.line}: {problem_operation.text}: {text}"
        for problem_operation, text in edge.interpreter.problems.items()
    ]
    registers = []
    for k, port in enumerate(block.registers):
        box_intervals = [box[k] for box in boxes.values()]
        step_intervals = [box[k] for box in after.values()]
        proven = (min(lo for lo, _ in box_intervals), max(hi for _, hi in box_intervals))
        step = (min(lo for lo, _ in step_intervals), max(hi for _, hi in step_intervals))
        if not (port.fmt.holds(step[0]) and port.fmt.holds(step[1])):
            problems.append(f"{port.name}: {step[0]} .. {step[1]} exceeds {port.fmt}; not proven: width only")
            proven = None
        registers.append(Range(port.name, port.fmt, proven, step))
    if not problems and not _is_closed_by_edge(after, boxes):
        problems.append("induction: the next state can leave the proven ranges")
    pins = []
    for k, port in enumerate(block.pins):
        ends = edge.pins[k]
        if not (port.fmt.holds(ends[0]) and port.fmt.holds(ends[1])):
            problems.append(f"output {port.name}: {ends[0]} .. {ends[1]} exceeds {port.fmt}")
        pins.append(Range(port.name, port.fmt, ends, ends))
    results = []
    for key, (lo, hi) in edge.interpreter.notes.items():
        results.append(Widest(lo, hi, width(lo, hi, False), *OPERATIONS[key]))
    results.sort(key=lambda found: (-found.bits, found.lo, found.function, found.line, found.text))
    problems += [
        f"{widest.function}, line {widest.line}: {widest.text}: {widest.bits} bits, above {MAX_WIDTH}"
        for widest in results
        if widest.bits > MAX_WIDTH
    ]
    return Analysis(tuple(registers), tuple(pins), tuple(results), tuple(problems))


def _is_closed_by_edge(after, boxes):
    """Whether F(X) is in X."""
    return all(
        key in boxes and all(b[0] <= a[0] and a[1] <= b[1] for a, b in zip(box, boxes[key]))
        for key, box in after.items()
    )


@lru_cache(maxsize=256)
def analyse_cached(stem, params, design=None):
    """`analyse` of a block of the registry, or of one of a design, remembered."""
    return analyse((blocks.design_blocks(design) if design else blocks.BLOCKS)[stem], params)


def analyse_case(stem, case):
    """`Analysis` of a case of the registry."""
    return analyse_cached(stem, blocks.BLOCKS[stem].cases[case])

"""Ranges of the whole design: every block of control and top with its own parameters, and what its neighbours give it.

Each block is proven for any input in its format. Here one edge of `top.step` runs over intervals, with all registers in
their proven ranges, and every block's `step` is replaced by a check of its arguments against those formats. If all fit,
the proofs hold together: at every edge each block gets what its proof assumes, so its registers stay where it says.
Source  docs/ranges.md, fpga_model/top.py
"""

from functools import cache
from operator import attrgetter
from typing import NamedTuple

from fpga_model import control, sine, top
from fpga_model import wiring as wires
from fpga_model.block import block_modules, fill_shape, leaves, port_name
from fpga_model.fixed import MAX_WIDTH
from testbench.config import Config
from testbench.golden.ranges import ranges
from testbench.golden.ranges.interpreter import Interpreter, read_function_source
from testbench.golden.ranges.intervals import Path, Run
from testbench.golden.stimulus import blocks
from testbench.run import build


class Link(NamedTuple):
    """An input of an instance: what arrives, and the format that its proof assumes."""

    port: str
    fmt: tuple
    lo: int
    hi: int

    @property
    def fits_format(self):
        return self.fmt.holds(self.lo) and self.fmt.holds(self.hi)

    @property
    def spare(self):
        """Bits of the format that never arrive; negative if too much does."""
        return self.fmt.width - ranges.width(self.lo, self.hi, self.fmt.s)


class Instance(NamedTuple):
    """A block in the design: its stem, its analysis with its own parameters, its links."""

    stem: str
    analysis: ranges.Analysis
    links: tuple


STEPS = {module.step: stem for stem, module in block_modules().items()}


def _stem(module):
    return module.__name__.rpartition(".")[2]


class _Check:
    """One edge of top over intervals."""

    def __init__(self, p):
        self.path, self.spans = Path(Run()), {}
        self.analyses, self.records, self.names = {}, {}, {}
        for name, (module, path) in wires.instances().items():
            # what is not given as parameters is an input
            params = attrgetter(path)(p) if path else None
            self.analyses[name] = ranges.analyse_cached(_stem(module), params)
            self.records[name] = record = self._build_block_state(name, attrgetter(name)(top.State()))
            self.names[id(record)] = name

    def _build_block_state(self, name, reset):
        registers = iter(self.analyses[name].registers)

        def proven_register(_):
            one = next(registers)
            return self.path.new(*(one.proven or (one.fmt.lo, one.fmt.hi)), key=("register", name, one.name))

        return fill_shape(reset, proven_register)

    def arrives(self, func, path, positional, keywords):
        """A block's step: note what it gets, return its registers as they were proven."""
        function_source = read_function_source(func)
        bound = {**dict(zip([item.arg for item in function_source.tree.args.args], positional)), **keywords}
        record = bound.pop("s")
        name = self.names[id(record)]
        if not blocks.BLOCKS[STEPS[func]].runtime_params:
            bound.pop("p", None)
        for key in ("d", "rom"):
            bound.pop(key, None)
        for key, value in bound.items():
            # a record of inputs stands for its fields: `i` with its name, runtime parameters without
            prefix = "" if key == "p" else key
            for path_name, item in leaves(value, prefix):
                self._note(name, port_name(path_name), path.value_interval(item))
        return record

    def _note(self, name, port, ends):
        old = self.spans.setdefault(name, {}).get(port, ends)
        self.spans[name][port] = (min(old[0], ends[0]), max(old[1], ends[1]))

    def run(self, p):
        hooks = {func: lambda path, *a, func=func, **k: self.arrives(func, path, a, k) for func in STEPS}
        inputs = top.Inputs(*(self.path.new(fmt.lo, fmt.hi, key=("input", at)) for at, fmt in leaves(top.INPUTS_FMT)))
        inner = control.State(*(self.records.get(f"control.{name}") for name in control.State._fields))
        state = top.State(*(inner if name == "control" else self.records[name] for name in top.State._fields))
        interpreter = Interpreter(hooks)
        interpreter.function(top.step, [p, sine.ROM, state, inputs], {}, self.path.copy())
        return interpreter


@cache
def instances():
    """{instance: Instance} of the default configuration with either demodulator.

    Raises ArithmeticError if the wiring itself computes beyond 63 bits or indexes beyond a table.
    """
    spans, check = {}, None
    firmware_params = build.firmware(Config())
    for digital in (0, 1):
        p = firmware_params._replace(digital=digital)
        check = _Check(p)
        interpreter = check.run(p)
        wide = [ends for ends in interpreter.notes.values() if ranges.width(*ends, False) > MAX_WIDTH]
        if interpreter.problems or wide:
            raise ArithmeticError(f"wiring: {[*interpreter.problems.values(), *wide]}")
        for name, ports in check.spans.items():
            for port, (lo, hi) in ports.items():
                old = spans.setdefault(name, {}).get(port, (lo, hi))
                spans[name][port] = (min(old[0], lo), max(old[1], hi))
    checked_instances = {}
    for name, (module, _) in wires.instances().items():
        stem = _stem(module)
        links = [Link(p.name, p.fmt, *spans[name][p.name]) for p in blocks.BLOCKS[stem].inputs]
        checked_instances[name] = Instance(stem, check.analyses[name], tuple(links))
    return checked_instances

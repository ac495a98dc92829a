"""Every block of the firmware as a golden reference: its declaration (`fpga_model.block`) with flat ports.

A runner takes stimulus rows (column 0 is `rst`, then the inputs of `step` in order) and writes, for each row, all
registers before that edge and the output pins that the row's inputs give. Registers and pins are flattened depth first,
dots and numbers joined by `_`: exactly the ports of the RTL after the prefixes `r_` and `o_`.
Source  docs/conventions.md, docs/firmware.md
"""

import functools
import importlib
import operator
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fpga_model import block as registry
from fpga_model import top, wiring
from fpga_model.block import BIT, block_modules, fill_shape, leaves, port_name, resolve_value
from fpga_model.design_record import DEFAULT, Design
from fpga_model.fixed import Fmt, formats

RESET_INPUT = "rst"


class Port(NamedTuple):
    """One flattened port: bare name (without `r_` and `o_`), format, reset value, and its rules where it has any."""

    name: str
    fmt: Fmt
    reset: int | None = None
    rounding: str | None = None
    overflow: str | None = None

    @property
    def width(self):
        return self.fmt.width

    @property
    def signed(self):
        return bool(self.fmt.s)


class Block(NamedTuple):
    """What the exporter has to know of a block; what is not named here is as in `fpga_model.block.Block`.

    design      record of the design that a file gives; None for the blocks that are exported without one
    inputs      ports of `step`, in order, without `rst`
    run         kernel(params, reset state, stimulus, registers, pins)
    source      (text of its source, names in it)
    """

    stem: str
    inputs: tuple
    state: tuple
    registers: tuple
    pins: tuple
    cases: dict
    run: Callable
    latency: dict
    source: tuple = ("", MappingProxyType({}))
    strobes: tuple = ()
    wait: int = 0
    dense: bool = True
    idle: Mapping = MappingProxyType({})
    roms: tuple = ()
    runtime_params: bool = False
    split: tuple = ()
    relations: tuple = ()
    stops: tuple = ()
    design: Design | None = None

    @property
    def module(self):
        return f"gyro_{self.stem}"

    @property
    def record(self):
        """The design record."""
        return self.design or DEFAULT

    @property
    def design_keys(self):
        """{NAME: value} of the keys of the design that the RTL is told: those that are not its defaults."""
        parts = [block_modules()[self.stem]] if self.stem in block_modules() else block_modules().values()
        used = {key for part in parts for key in registry.keys(part)}
        changed_keys = {key for key in used if getattr(self.record, key) != getattr(DEFAULT, key)}
        return {key.upper(): getattr(self.record, key) for key in Design._fields if key in changed_keys}

    @property
    def columns(self):
        """All columns of the stimulus, `rst` first."""
        return (Port(RESET_INPUT, BIT, 0), *self.inputs)

    @property
    def rules(self):
        """The block's own words on rounding and overflow."""
        text = importlib.import_module(f"fpga_model.{self.stem}").__doc__.splitlines()
        rule_texts = {}
        for key in ("Rounding", "Overflow"):
            rule_texts[key.lower()] = next(line[len(key) :].strip() for line in text if line.startswith(key))
        return rule_texts


def register_rule(rules, name):
    """(rounding, overflow) of a register, by its name or by that of its tuple."""
    return rules.get(name) or rules.get(name.rstrip("0123456789").rstrip("_")) or (None, None)


def _hints(module, design):
    """Hints of the range proofs, with those of the blocks within."""
    block_by_prefix = registry.values_by_prefix(module, lambda b: b)
    return {
        "split": tuple(prefix + name for prefix, b in block_by_prefix.items() for name in b.split),
        "relations": tuple(
            {prefix + name: k for name, k in sums.items()}
            for prefix, b in block_by_prefix.items()
            for sums in resolve_value(b.relations, design)
        ),
        "stops": tuple(value for b in block_by_prefix.values() for value in resolve_value(b.stops, design)),
    }


def _flatten_block(stem, module, design=None):
    """A block with flat ports."""
    record = design or DEFAULT
    declaration, rules, structure = module.BLOCK, registry.rules(module), registry.structure(module, record)
    state = registry.power_on_registers(module, record)
    register_ports = [
        Port(port_name(path), fmt, int(reset), *register_rule(rules, port_name(path)))
        for (path, reset), (_, fmt) in zip(leaves(state), leaves(formats(module.State, record)), strict=True)
    ]
    return Block(
        stem=stem,
        design=design,
        inputs=tuple(Port(*port_fields) for port_fields in registry.inputs(module, record)),
        state=state,
        registers=tuple(register_ports),
        pins=tuple(Port(*port_fields) for port_fields in registry.pins(module, record)),
        cases=registry.cases(module, record),
        roms=tuple(rom.for_design(record) for rom in declaration.roms),
        run=lambda *given: registry.runner(stem)(structure.get("d", 0), structure.get("rom", 0), *given),
        source=(registry.runner_text(module), vars(module)),
        **{
            name: resolve_value(getattr(declaration, name), record)
            for name in ("latency", "strobes", "wait", "dense", "idle")
        },
        runtime_params=declaration.runtime_params,
        **_hints(module, record),
    )


BLOCKS = {stem: _flatten_block(stem, module) for stem, module in block_modules().items()}


@functools.lru_cache(maxsize=8)
def design_blocks(design):
    """{stem: Block} of a design."""
    return {stem: _flatten_block(stem, module, design) for stem, module in block_modules().items()}


def firmware_blocks(params):
    """{stem: Block} of a firmware (`top.Params`): a case more for each instance, its name that of its role."""
    base_blocks = design_blocks(params.design)
    cases = {stem: dict(block.cases) for stem, block in base_blocks.items()}
    for role, (module, path) in wiring.instances().items():
        stem = module.__name__.rpartition(".")[2]
        if path is not None and not base_blocks[stem].runtime_params:
            cases[stem][role.rpartition(".")[2]] = operator.attrgetter(path)(params)
    return {stem: block._replace(cases=cases[stem]) for stem, block in base_blocks.items()}


@functools.cache
def _step_structure(stem, record):
    """(structure, shapes) of the arguments of `step`, found once: every row of a block asks for them."""
    module = block_modules()[stem]
    return tuple(registry.structure(module, record).values()), tuple(registry.shapes(module).values())


def step_arguments(block, params, values):
    """Arguments of `step` but for s, from the flat values of its inputs; structure and parameters first, if any."""
    structure, shapes = _step_structure(block.stem, block.record)
    value = iter(values)
    inputs = [fill_shape(shape, lambda _: next(value)) for shape in shapes]
    return [*structure, *inputs] if block.runtime_params or params is None else [*structure, params, *inputs]


def case_parameters(block, case):
    """[(name, raw, format)] of a case, as `registry.flattened_parameters`; empty where parameters are inputs."""
    params = block.cases[case]
    if params is None:
        return []
    module = top if block.stem == "top" else block_modules()[block.stem]
    parameter_entries = registry.flattened_parameters(params, formats(module.Params, block.record))
    return [(port_name(path), raw, fmt) for path, raw, fmt in parameter_entries]


def run(block, case, stimulus):
    """(registers, pins) of a case, int64 rows: registers before each edge, pins under that row's inputs.

    stimulus  int64, one row per edge, the columns of `block.columns`
    Raises ValueError if an input, a register or a pin leaves its format.
    """
    stimulus = np.ascontiguousarray(stimulus, np.int64)
    check(block.columns, stimulus, f"{block.stem}: stimulus")
    regs = np.zeros((len(stimulus), len(block.registers)), np.int64)
    pins = np.zeros((len(stimulus), len(block.pins)), np.int64)
    params = block.cases[case]
    block.run(0 if params is None else params, block.state, stimulus, regs, pins)
    check(block.registers, regs, f"{block.stem}: register")
    check(block.pins, pins, f"{block.stem}: output")
    return regs, pins


def check(ports, rows, what):
    """Raise ValueError if a column leaves the format of its port."""
    if rows.ndim != 2 or rows.shape[1] != len(ports):
        raise ValueError(f"{what}: expected {len(ports)} columns, got an array of shape {rows.shape}")
    if not len(rows):
        return
    for port, least, most in zip(ports, rows.min(axis=0).tolist(), rows.max(axis=0).tolist(), strict=True):
        if not (port.fmt.holds(least) and port.fmt.holds(most)):
            raise ValueError(f"{what} {port.name}: {least} .. {most} is outside format {port.fmt}")


def sweep_clocks(block):
    """Clocks that reset and enable sweeps have to cover: the longest whole-number latency, or the wait."""
    return max([block.wait, *(k for k in block.latency.values() if isinstance(k, int))])

"""What a block declares of itself at the end of its file: `BLOCK`. Ports, runners, proofs and wiring come from it.

    inputs    arguments of `step` after p and s: a format, [format] * n of a tuple, or a record of formats
    outputs   functions that are pins:  out(p, s, inputs by name)
    functions combinational parts that wiring calls: {name: ({argument: format}, format of the result)}

A port has a flat name: dots and numbers are joined by `_`. A field of a record of inputs begins with the name of the
argument, and an input with the name of a parameter begins with `i_`. Registers of a block within a block inherit its
rules and hints.
Source    docs/how_to/add_a_block.md
"""

import functools
import importlib
import inspect
import itertools
import pkgutil
from types import MappingProxyType, UnionType
from typing import NamedTuple, get_type_hints

import fpga_model
from fpga_model.design_record import DEFAULT, Design
from fpga_model.fixed import Fmt, bits, design_width, formats
from fpga_model.jit import kernel

BIT = bits(1)
NOTHING = MappingProxyType({})


def resolve_value(value, design):
    """A value, or what a function of the design makes of it."""
    return value(design) if callable(value) else value


class Rom(NamedTuple):
    """A table that the RTL loads: `words` of `width` bits, or a function of the design that gives them."""

    name: str
    width: int
    words: object

    def for_design(self, design):
        """The table of a design, in plain numbers."""
        return Rom(self.name, int(design_width(self.width, design)), tuple(map(int, resolve_value(self.words, design))))


class Block(NamedTuple):
    """A declaration; formats are those of the module, so that they follow the design.

    place           along the signal: the order of tables and lists
    latency         {register or pin: clocks, or a text}
    holds           {register: format} of what a register of a general block holds here, where it is narrower
    cases           {name: Params} of the golden vectors; None is `design()`
    rules           {register or its tuple: (rounding, overflow)}
    strobes         1-bit inputs that start an operation
    wait            clocks that an operation takes before the next one is usual; 0 for a pipeline
    dense           whether an operation may start before `wait` has passed
    idle            {input: value} of the quiet state, 0 if not named
    runtime_params  whether the parameters are inputs of the RTL

    Latency, wait, cases, relations and stops that follow the design are functions of its record.

    Hints of the range proofs (docs/ranges.md); they decide how tight a proof is, never whether it holds:
    split           registers whose value has a box of its own; `name?` only tells 0 from the rest
    relations       sums {register: coefficient} that are kept as tightly as the registers
    stops           values where a widened bound may stop before the end of its format
    separate_paths  whether the ways through `step` stay apart
    """

    place: int
    inputs: dict
    latency: object
    outputs: dict = NOTHING
    functions: dict = NOTHING
    holds: dict = NOTHING
    cases: object = None
    rules: dict = NOTHING
    strobes: tuple = ()
    wait: object = 0
    dense: bool = True
    idle: dict = NOTHING
    roms: tuple = ()
    runtime_params: bool = False
    split: tuple = ()
    relations: object = ()
    stops: object = ()
    separate_paths: bool = False


class Cast(NamedTuple):
    """A wire whose ends are meant to have different formats, and why."""

    source: str
    source_fmt: Fmt
    target: str
    target_fmt: Fmt
    why: str


@functools.cache
def block_modules():
    """{stem: module} of the blocks, by their place."""
    names = sorted(info.name for info in pkgutil.iter_modules(fpga_model.__path__))
    modules = [importlib.import_module(f"fpga_model.{name}") for name in names]
    blocks = sorted((m for m in modules if hasattr(m, "BLOCK")), key=lambda m: m.BLOCK.place)
    return {module.__name__.rpartition(".")[2]: module for module in blocks}


# ---- records as flat lists -------------------------------------------------------------------------------------------


def _items(node):
    """(name, item) of a record or a tuple."""
    return zip(node._fields, node) if hasattr(node, "_fields") else ((str(k), item) for k, item in enumerate(node))


def leaves(record, path=""):
    """Yield (dotted name, leaf) depth first; a plain tuple is numbered, a `Fmt` is a leaf, None has none.

    A design record is structure: it has no leaves.
    """
    if record is None or isinstance(record, Design):
        return
    if not isinstance(record, (tuple, list)) or isinstance(record, Fmt):
        yield path, record
        return
    for name, item in _items(record):
        yield from leaves(item, f"{path}.{name}" if path else name)


def parameter_defaults(shape, path=""):
    """{dotted name: default} of the parameters of a shape of formats that have a default: those that came later."""
    default_by_name = {}
    for name, item in _items(shape):
        dotted_name = f"{path}.{name}" if path else name
        if isinstance(item, Fmt):
            field_defaults = getattr(type(shape), "_field_defaults", NOTHING)
            default_by_name |= {dotted_name: field_defaults[name]} if name in field_defaults else {}
        elif item:
            default_by_name |= parameter_defaults(item, dotted_name)
    return default_by_name


def flattened_parameters(params, shape):
    """(dotted name, value, format) of parameters, without those that came later and have their default."""
    formats_of, default_by_name = dict(leaves(shape)), parameter_defaults(shape)
    return [(name, int(v), formats_of[name]) for name, v in leaves(params) if default_by_name.get(name) != v]


def required_parameters(shape, present):
    """[(flat name, format)] of what a file must name: what is `present` in it, and all but what came later."""
    added = parameter_defaults(shape)
    return [(port_name(name), fmt) for name, fmt in leaves(shape) if port_name(name) in present or name not in added]


def raws(shape, raw_by_name):
    """Raw values in the order of a shape from {flat name: raw}; what came later and is not given has its default."""
    value_by_name = {port_name(name): value for name, value in parameter_defaults(shape).items()} | raw_by_name
    return [value_by_name[port_name(name)] for name, _ in leaves(shape)]


def fill_shape(shape, take):
    """The shape with `take(leaf)` at each leaf, depth first; a list becomes a tuple, None and a design stay."""
    if shape is None or isinstance(shape, Design):
        return shape
    if isinstance(shape, (tuple, list)) and not isinstance(shape, Fmt):
        items = [fill_shape(item, take) for item in shape]
        return type(shape)(*items) if hasattr(shape, "_fields") else tuple(items)
    return take(shape)


def port_name(name):
    """Name of a port from a dotted name."""
    return name.replace(".", "_")


def design_formats(shape, design):
    """The formats of a shape at a design; a record is named by its type."""
    if isinstance(shape, type):
        return formats(shape, design)
    return fill_shape(shape, lambda fmt: fmt.for_design(design))


def reset(state, params):
    """A reset state with the optional parts `Record | None` that the parameters have."""
    part_states = {}
    for name, module in state_modules(type(state)).items():
        part_params = getattr(params, name, None)
        if part_params is not None and hasattr(part_params, "_fields"):
            part = getattr(state, name)
            part_states[name] = reset(module.State() if part is None else part, part_params)
    return state._replace(**part_states)


# ---- ports -----------------------------------------------------------------------------------------------------------


def python_function(function):
    """The Python function behind a compiled one."""
    return getattr(function, "py_func", function)


def arguments(module):
    """Names of the arguments of `step`."""
    return list(inspect.signature(python_function(module.step)).parameters)


def structure(module, design=DEFAULT):
    """{argument: value} of what `step` takes of a design: the record `d` itself, and `rom`, the module's `table`."""
    names = arguments(module)
    argument_values = {"d": design} if "d" in names else {}
    return argument_values | ({"rom": module.table(design)} if "rom" in names else {})


def shapes(module, design=DEFAULT):
    """{argument: formats} of what a row of inputs is made of, in order; `p` if the parameters are inputs."""
    argument_formats = {"p": formats(module.Params, design)} if module.BLOCK.runtime_params else {}
    return argument_formats | {name: design_formats(shape, design) for name, shape in module.BLOCK.inputs.items()}


def parameters(module, design=DEFAULT):
    """{flat name: format} of the parameters of the RTL."""
    if module.BLOCK.runtime_params or not hasattr(module, "Params"):
        return {}
    return {port_name(path): fmt for path, fmt in leaves(formats(module.Params, design))}


def inputs(module, design=DEFAULT):
    """[(flat name, format)] of the input ports."""
    parameter_names, port_formats = parameters(module, design), []
    for name, shape in shapes(module, design).items():
        prefix = "" if name == "p" else f"i_{name}" if name in parameter_names else name
        port_formats += [(port_name(path), fmt) for path, fmt in leaves(shape, prefix)]
    return port_formats


def pins(module, design=DEFAULT):
    """[(flat name, format)] of the output pins; those of a record have the names of its fields."""
    port_formats = []
    for name, shape in module.BLOCK.outputs.items():
        prefix = "" if isinstance(shape, type) else name
        port_formats += [(port_name(path), fmt) for path, fmt in leaves(design_formats(shape, design), prefix)]
    return port_formats


def state_modules(state):
    """{field: module} of the states of other modules in a state."""
    hints = get_type_hints(state) if hasattr(state, "_fields") else {}
    kinds = {name: kind for name, kind in hints.items() if isinstance(kind, type)}
    kinds |= {name: kind.__args__[0] for name, kind in hints.items() if isinstance(kind, UnionType)}
    return {name: importlib.import_module(kind.__module__) for name, kind in kinds.items()}


def values_by_prefix(module, get):
    """{prefix: value of `get`} of a block and of those within it that declare themselves."""
    value_by_prefix = {"": get(module.BLOCK)}
    for field, part in state_modules(module.State).items():
        value_by_prefix |= {f"{field}_{prefix}": value for prefix, value in values_by_prefix(part, get).items()}
    return value_by_prefix


def rules(module):
    """{register: (rounding, overflow)}, with those of the blocks within."""
    return {prefix + name: rule for prefix, block_rules in values_by_prefix(module, lambda b: b.rules).items()
            for name, rule in block_rules.items()}  # fmt: skip


def cases(module, design=DEFAULT):
    """{name: Params, or None where there are none}."""
    if module.BLOCK.cases is not None:
        return resolve_value(module.BLOCK.cases, design)
    return {"default": module.design() if parameters(module) else None}


class _KeyTracker:
    """The default design, which notes the keys that are read."""

    def __init__(self):
        self.read = set()

    def __getattr__(self, name):
        self.read.add(name)
        return getattr(DEFAULT, name)


def power_on_registers(module, design=DEFAULT):
    """The registers of a block of a design at power-on."""
    return module.reset(design) if hasattr(module, "reset") else module.State()


@functools.cache
def keys(module):
    """The keys of the design that formats, reset values, tables and latency depend on: parameters of a block's RTL."""
    key_tracker = _KeyTracker()
    for design_function in (parameters, inputs, pins, power_on_registers):
        design_function(module, key_tracker)
    formats(module.State, key_tracker)
    resolve_value(module.BLOCK.latency, key_tracker)
    for rom in module.BLOCK.roms:
        rom.for_design(key_tracker)
    return tuple(key for key in Design._fields if key in key_tracker.read)


# ---- runners ---------------------------------------------------------------------------------------------------------


def _text(shape, column):
    """Source of an argument from the columns of a row `r`."""
    if isinstance(shape, Fmt):
        return f"r[{next(column)}]"
    element_texts = ", ".join(_text(item, column) for item in shape)
    return f"{type(shape).__name__}({element_texts})" if hasattr(shape, "_fields") else f"({element_texts},)"


def _paths(record, text):
    """Sources of the leaves of a record, depth first."""
    if not isinstance(record, tuple):
        yield text
    elif hasattr(record, "_fields"):
        for name, item in zip(record._fields, record):
            yield from _paths(item, f"{text}.{name}")
    else:
        for k, item in enumerate(record):
            yield from _paths(item, f"{text}[{k}]")


def runner_text(module):
    """Source of the block's runner: stimulus rows in, all registers before each edge and the pins out.

    run(d, rom, p, s, stim, _regs, _pins)

    Row n: _regs[n], _pins[n] before edge n; then the edge, or reset if stim[n, 0] = 1.
    """
    column = itertools.count(1)
    argument_sources = {name: name for name in ("d", "rom", "p", "s")} | {
        name: _text(shape, column) for name, shape in shapes(module).items()
    }
    lines = [f"_regs[n, {k}] = {text}" for k, text in enumerate(_paths(module.State(), "s"))]
    number = itertools.count()
    for name, shape in module.BLOCK.outputs.items():
        names = inspect.signature(python_function(getattr(module, name))).parameters
        call = f"{name}({', '.join(argument_sources[k] for k in names)})"
        fields = [""] if isinstance(shape, Fmt) else [f".{field}" for field in shape._fields]
        lines += [f"_pins[n, {next(number)}] = {call}{field}" for field in fields]
    call = f"step({', '.join(argument_sources[name] for name in arguments(module))})"
    lines.append(f"s = reset if r[0] == 1 else {call}")
    head = "def run(d, rom, p, s, stim, _regs, _pins):\n    reset = s\n"
    loop = "    for n in range(stim.shape[0]):\n        r = stim[n]\n"
    return head + loop + "".join(f"        {line}\n" for line in lines)


@functools.cache
def runner(stem):
    """The compiled runner of a block.

    It counts as a function of the block's own file, so its machine code is cached with what it is made from.
    """
    module = block_modules()[stem]
    names = dict(vars(module))
    exec(compile(runner_text(module), module.__file__, "exec"), names)
    return kernel(names["run"])

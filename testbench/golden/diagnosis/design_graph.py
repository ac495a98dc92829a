"""What each block of the whole design is given, from the registers of all: the wiring as a graph.

    ports     nodes of the inputs of a block; where the model does not step it, its strobes are 0
    leaves    "in": the registers of the design and its inputs, with their names in a report

So a block of the whole design is a block by itself, with the rows that the design gave it.
Source  docs/diagnosis.md (the whole design); fpga_model/wiring.py
"""

import functools
import inspect
from typing import NamedTuple

from fpga_model import block as registry
from fpga_model import sine, top, wiring
from fpga_model.block import fill_shape, leaves, port_name
from fpga_model.fixed import formats
from testbench.golden.diagnosis.elaborate import Elaborator
from testbench.golden.diagnosis.net import Net


class Wired(NamedTuple):
    """An instance of a block.

    module  of the block;  params  {flat name: raw}
    ports   {input: node}
    names   {register or pin of the block: its name in a report}
    homes   {register or pin: (block within the block that it is of, its name there)}
    """

    module: object
    params: dict
    ports: dict
    names: dict
    homes: dict


class _Wiring(Elaborator):
    """An `Elaborator` in which the step of a block is not run: what it is given is kept, its registers go on as leaves.

    steps  {instance: (module, arguments, state behind the step)}
    """

    def __init__(self, net, state):
        super().__init__(net)
        self.steps, self._stepped = {}, {}
        self._paths_by_id = {id(functools.reduce(getattr, path.split("."), state)): path for path in wiring.instances()}
        self._modules = {registry.python_function(module.step): module for module, _ in wiring.instances().values()}

    def call(self, function, args, kwargs, names=None):
        function = registry.python_function(function)
        module = self._modules.get(function)
        step_args = inspect.signature(function).bind(*args, **kwargs).arguments if module else {}
        path = self._paths_by_id.get(id(step_args.get("s")))
        if path is None:
            return super().call(function, args, kwargs, names)
        after = fill_shape(step_args["s"], lambda node: self.net.node("in", (), f"next {node.value}"))
        self.steps[path] = module, step_args, after
        return after


def report_name(name):
    """Name of a register of top, dotted or flat, in a report: that of its RTL port if a pin has the same name."""
    return f"r_{port_name(name)}" if port_name(name) in top.Pins._fields else port_name(name)


@functools.cache
def _top_pins(kinds=("pin",)):
    """{pin of a block, dotted: pin of top}; `kinds` may name registers that are pins of top, too."""
    wires = [wire for wire in wiring.trace(top).wires if wire.instance == "pins"]
    return {leaf.name: wire.port for wire in wires for leaf in wire.signal.leaves if leaf.kind in kinds}


def instance_top_pins(path):
    """{register or pin of an instance: pin of top} of what leads to a pin of the board."""
    pin_by_leaf = _top_pins(("pin", "register"))
    return {port_name(name[len(path) + 1 :]): pin for name, pin in pin_by_leaf.items() if name.startswith(f"{path}.")}


@functools.cache
def _home(name):
    """(module of the innermost block that a register of top, dotted, is in; its name there)."""
    path, module = max(
        (p for p in wiring.nested_blocks(top.State) if name.startswith(f"{p[0]}.")), key=lambda p: len(p[0])
    )
    return module, port_name(name[len(path) + 1 :])


def _build_step_enable(net, next_value, after):
    """Node of whether a value is that behind the step, and not the one held."""
    if next_value is after:
        return net.const(1)
    if next_value.op != "mux":
        return net.const(0)
    ways = [_build_step_enable(net, way, after) for way in next_value.args[1:]]
    return ways[0] if ways[0] is ways[1] else net.node("mux", (next_value.args[0], *ways))


def wire_design(params):
    """(`Net`, {instance: `Wired`}) of a design with the `top.Params`; raises `elaborate.Unsupported`."""
    net, d = Net(), params.design
    shape = formats(top.State, d, top.reset(d))
    register_formats = iter([(report_name(name), fmt) for name, fmt in leaves(shape)])
    state = fill_shape(shape, lambda _: net.leaf("in", *next(register_formats)))
    inputs = top.Inputs(*(net.leaf("in", *port) for port in zip(top.Inputs._fields, top.INPUTS_FMT)))
    work = _Wiring(net, state)
    for name, fmt in leaves(shape):
        net.fmts[f"in next {report_name(name)}"] = fmt
    after, wired_blocks = work.call(top.step, [params, sine.table(d), state, inputs], {}), {}
    for path, (module, step_args, stepped) in work.steps.items():
        next_state = functools.reduce(getattr, path.split("."), after)
        (_, next_leaf), (_, leaf_after_step) = next(leaves(next_state)), next(leaves(stepped))
        step_enable = _build_step_enable(net, next_leaf, leaf_after_step)
        nodes = [work.as_node(leaf) for name in registry.shapes(module, d) for _, leaf in leaves(step_args[name])]
        ports = dict(zip([name for name, _ in registry.inputs(module, d)], nodes, strict=True))
        for name in module.BLOCK.strobes if step_enable.op != "const" else ():
            ports[name] = net.node("mux", (step_enable, ports[name], net.const(0)))
        inner = {port_name(name): f"{path}.{name}" for name, _ in leaves(stepped)}
        pins = {name: f"{path}.{name}" for name, _ in registry.pins(module, d)}
        pins = {name: pin for name, pin in pins.items() if pin in _top_pins()}
        values = {} if module.BLOCK.runtime_params else {port_name(k): int(v) for k, v in leaves(step_args.get("p"))}
        names = {n: report_name(leaf) for n, leaf in inner.items()} | {n: _top_pins()[leaf] for n, leaf in pins.items()}
        wired_blocks[path] = Wired(module, values, ports, names, {n: _home(leaf) for n, leaf in (inner | pins).items()})
    return net, wired_blocks

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
from fpga_model.block import filled, flat, leaves
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
        self._at = {id(functools.reduce(getattr, path.split("."), state)): path for path in wiring.instances()}
        self._modules = {registry.python_of(module.step): module for module, _ in wiring.instances().values()}

    def call(self, function, args, kwargs, names=None):
        function = registry.python_of(function)
        module = self._modules.get(function)
        given = inspect.signature(function).bind(*args, **kwargs).arguments if module else {}
        path = self._at.get(id(given.get("s")))
        if path is None:
            return super().call(function, args, kwargs, names)
        after = filled(given["s"], lambda node: self.net.node("in", (), f"next {node.value}"))
        self.steps[path] = module, given, after
        return after


def port_of(name):
    """Name of a register of top, dotted or flat, in a report: that of its RTL port if a pin has the same name."""
    return f"r_{flat(name)}" if flat(name) in top.Pins._fields else flat(name)


@functools.cache
def _pins(kinds=("pin",)):
    """{pin of a block, dotted: pin of top}; `kinds` may name registers that are pins of top, too."""
    wires = [wire for wire in wiring.trace(top).wires if wire.instance == "pins"]
    return {leaf.name: wire.port for wire in wires for leaf in wire.signal.leaves if leaf.kind in kinds}


def shown(path):
    """{register or pin of an instance: pin of top} of what leads to a pin of the board."""
    found = _pins(("pin", "register"))
    return {flat(name[len(path) + 1 :]): pin for name, pin in found.items() if name.startswith(f"{path}.")}


@functools.cache
def _home(name):
    """(module of the innermost block that a register of top, dotted, is in; its name there)."""
    path, module = max((p for p in wiring.within(top.State) if name.startswith(f"{p[0]}.")), key=lambda p: len(p[0]))
    return module, flat(name[len(path) + 1 :])


def _taken(net, found, after):
    """Node of whether a value is that behind the step, and not the one held."""
    if found is after:
        return net.const(1)
    if found.op != "mux":
        return net.const(0)
    ways = [_taken(net, way, after) for way in found.args[1:]]
    return ways[0] if ways[0] is ways[1] else net.node("mux", (found.args[0], *ways))


def wired(params):
    """(`Net`, {instance: `Wired`}) of a design with the `top.Params`; raises `elaborate.Unsupported`."""
    net, d = Net(), params.design
    shape = formats(top.State, d, top.reset(d))
    listed = iter([(port_of(name), fmt) for name, fmt in leaves(shape)])
    state = filled(shape, lambda _: net.leaf("in", *next(listed)))
    inputs = top.Inputs(*(net.leaf("in", *port) for port in zip(top.Inputs._fields, top.INPUTS_FMT)))
    work = _Wiring(net, state)
    for name, fmt in leaves(shape):
        net.fmts[f"in next {port_of(name)}"] = fmt
    after, found = work.call(top.step, [params, sine.table(d), state, inputs], {}), {}
    for path, (module, given, stepped) in work.steps.items():
        held = functools.reduce(getattr, path.split("."), after)
        (_, first), (_, own) = next(leaves(held)), next(leaves(stepped))
        taken = _taken(net, first, own)
        nodes = [work.as_node(leaf) for name in registry.shapes(module, d) for _, leaf in leaves(given[name])]
        ports = dict(zip([name for name, _ in registry.inputs(module, d)], nodes, strict=True))
        for name in module.BLOCK.strobes if taken.op != "const" else ():
            ports[name] = net.node("mux", (taken, ports[name], net.const(0)))
        inner = {flat(name): f"{path}.{name}" for name, _ in leaves(stepped)}
        shown = {name: f"{path}.{name}" for name, _ in registry.pins(module, d)}
        shown = {name: pin for name, pin in shown.items() if pin in _pins()}
        own_params = {} if module.BLOCK.runtime_params else {flat(k): int(v) for k, v in leaves(given.get("p"))}
        names = {name: port_of(at) for name, at in inner.items()} | {name: _pins()[at] for name, at in shown.items()}
        found[path] = Wired(module, own_params, ports, names, {n: _home(at) for n, at in (inner | shown).items()})
    return net, found

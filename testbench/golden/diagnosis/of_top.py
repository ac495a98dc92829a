"""Nets of the whole design, one for each block in it: its step, and the wiring and pins of its neighbours before it.

    registers of the block        "reg" and a root each; pins that show them have a root too
    registers of all the others   "in": what the design itself held there

Names are those of `fpga_model.top`: `drive_dac_left` is register `left` of instance `drive_dac`.
Source  docs/diagnosis.md (the whole design); fpga_model/wiring.py
"""

import functools

from fpga_model import block as registry
from fpga_model import sine, top, wiring
from fpga_model.block import filled, flat, leaves
from fpga_model.fixed import formats
from testbench.golden.diagnosis.elaborate import Elaborator
from testbench.golden.diagnosis.net import Net


class _OfInstance(Elaborator):
    """An `Elaborator` of `top` in which only the block at `instance` steps: the others hold."""

    def __init__(self, net, state, instance):
        super().__init__(net)
        held = [functools.reduce(getattr, path.split("."), state) for path in wiring.instances() if path != instance]
        self._held = {id(record) for record in held}
        self._steps = {registry.python_of(module.step) for module, _ in wiring.instances().values()}

    def call(self, function, args, kwargs, names=None):
        function = registry.python_of(function)
        if function in self._steps:
            held = next((a for a in args if id(a) in self._held), None)
            if held is not None:
                return held
        return super().call(function, args, kwargs, names)


def port_of(name):
    """Name of a register of top, dotted or flat, in a report: that of its RTL port if a pin has the same name."""
    return f"r_{flat(name)}" if flat(name) in top.Pins._fields else flat(name)


def instance_of(name):
    """The instance that a register of top, dotted, is in."""
    return next((path for path in wiring.instances() if name.startswith(f"{path}.")), None)


@functools.cache
def _shown():
    """{pin: instance} where a pin is what a block drives from its registers, or a register of it."""
    wires = [wire for wire in wiring.trace(top).wires if wire.instance == "pins"]
    return {wire.port: instance_of(wire.signal.leaves[0].name) for wire in wires}


def of_instance(instance, params):
    """`Net` of a block of `top`, such as "control.agc", with the `top.Params`; raises `Unsupported`."""
    net, d = Net(), params.design
    inside, path = f"{instance}.", wiring.instances()[instance][1]
    fmts = list(leaves(formats(top.State, d, top.reset(d))))
    names = iter(fmts)

    def leaf(_):
        name, fmt = next(names)
        return net.leaf("reg" if name.startswith(inside) else "in", port_of(name), fmt)

    state = filled(formats(top.State, d, top.reset(d)), leaf)
    given = iter(leaves(params))
    p = filled(formats(top.Params, d, params), lambda fmt: _parameter(net, path, *next(given), fmt))._replace(design=d)
    inputs = top.Inputs(*(net.leaf("in", *port) for port in zip(top.Inputs._fields, top.INPUTS_FMT)))
    work = _OfInstance(net, state, instance)
    after = work.call(top.step, [p, sine.table(d), state, inputs], {})
    reset, values = net.leaf("in", "rst", registry.BIT), dict(leaves(top.reset(d)))
    for name, found in leaves(after):
        if name.startswith(inside):
            port, value = port_of(name), int(values[name])
            net.reset[port] = value
            chosen = net.node("mux", (reset, work.as_node(value), work.as_node(found)), port, port)
            net.roots[port] = net.node("next", (chosen,), port, port)
    for (name, found), fmt in zip(leaves(work.call(top.pins, [p, state], {})), top.PINS_FMT, strict=True):
        if _shown()[name] == instance:
            net.fmts[name] = fmt
            net.roots[name] = net.node("pin", (work.as_node(found),), name, name)
    pruned = net.pruned()
    pruned.close()
    return pruned


def _parameter(net, path, name, raw, fmt):
    """Parameters of the block are nodes, those of the others are numbers."""
    if path is None or not name.startswith(f"{path}."):
        return int(raw)
    port = flat(name)
    net.fmts[f"parameter {port}"] = fmt
    return net.node("param", (), (port, int(raw)), port)

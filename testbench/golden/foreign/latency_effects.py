"""What a port that comes some clocks later does to the rest of the firmware, found on the wires of the model.

    carrier   from the DDS to the pins: a clock later is a clock more of lag at its node, or less for a reference
    answer    an input that something outside gives in answer to a pin: recorded rows would come too early

Words of the 8 kHz loops are no carrier: they rest between the slots, so their lateness turns no phase.
Source  docs/foreign_designs.md
"""

import functools
from typing import NamedTuple

from fpga_model import control, top, wiring
from fpga_model.block import port_name
from testbench.errors import FileError

# The pins of the board in this direction are answered by a chip (docs/architecture.md, what crosses the pins)
ANSWERS = {"adc": ("drdy_n", "dout")}
TOP_STEM = "top"
RESTS = ("control.", "sid.", "adc.")  # a carrier that gets there has become codes and words
NODES = {"drive": ("xe1",), "sense": ("ye1",), "refs": ("xe1", "ye1")}


class Lag(NamedTuple):
    """An instance of the block in the firmware, a node (xe1 or ye1), and the clocks of lag that it gets."""

    instance: str
    node: str
    clocks: int


@functools.cache
def _wires():
    """{output of an instance: ports that it goes to} of top and control."""
    targets_by_output = {}
    for module, before in ((control, "control."), (top, "")):
        for wire in wiring.trace(module, all_parts=True).wires:
            for leaf in wire.signal.leaves:
                target = wire.target if wire.instance == "pins" else before + wire.target
                targets_by_output.setdefault(before + leaf.name, set()).add(target)
    return targets_by_output


@functools.cache
def _instances():
    """{instance: stem} of top and control, the longest name first."""
    stem_by_instance = {name: module.__name__.rpartition(".")[2] for name, (module, _) in wiring.instances().items()}
    return dict(sorted(stem_by_instance.items(), key=lambda item: -len(item[0])))


def _owner(port):
    """The instance that has a port."""
    return next((name for name in _instances() if port.startswith(f"{name}.")), "")


def _carrier_pins(instance, port):
    """Pins that a register or pin of an instance reaches as a carrier."""
    reached_pins, visited_instances, todo = set(), set(), [f"{instance}.{port}"]
    while todo:
        source = todo.pop()
        for target in _wires().get(source, ()):
            if target.startswith("pins."):
                reached_pins.add(target[len("pins.") :])
            elif not target.startswith(RESTS) and _owner(target) and _owner(target) not in visited_instances:
                visited_instances.add(_owner(target))
                todo += [name for name in _wires() if _owner(name) == _owner(target)]
    return reached_pins


@functools.cache
def _carriers():
    """Instances that a phase of the DDS reaches."""
    carrier_instances, todo = {"dds"}, ["dds"]
    while todo:
        instance = todo.pop()
        for source in (name for name in _wires() if _owner(name) == instance):
            for owner in {_owner(t) for t in _wires()[source] if not t.startswith(("pins.", *RESTS))} - {""}:
                if owner not in carrier_instances:
                    carrier_instances.add(owner)
                    todo.append(owner)
    return carrier_instances


def lags(stem, case, clocks):
    """[`Lag`] of a block whose ports come later: {RTL port: clocks}. A case with the name of its role is that one.

    Of the whole design the ports are its pins.
    """
    carrier_instances = [name for name, block in _instances().items() if block == stem and name in _carriers()]
    carrier_instances = [name for name in carrier_instances if name.rpartition(".")[2] == case] or carrier_instances
    carrier_instances = [stem] if stem == TOP_STEM else carrier_instances
    clocks_by_node = {}
    for instance in sorted(carrier_instances):
        for port, delay in clocks.items():
            bare = port[2:]
            names = [n for n in _wires() if _owner(n) == instance and port_name(n[len(instance) + 1 :]) == bare]
            reached_pins = set().union(
                {bare} if stem == TOP_STEM else (), *(_carrier_pins(instance, n[len(instance) + 1 :]) for n in names)
            )
            for path, nodes in NODES.items():
                # a drive or sense port of a block with both turns its own node alone
                mine = [n for n in nodes if not bare.startswith(("drive_", "sense_")) or n[0] == "xy"[bare[0] == "s"]]
                if any(pin.startswith(path) for pin in reached_pins):
                    for node in mine:
                        # pins of one chip leave together: the latest counts; a late reference is less lag
                        sign = -1 if path == "refs" else 1
                        clocks_by_node[instance, node, sign] = max(delay, clocks_by_node.get((instance, node, sign), 0))
    pairs = dict.fromkeys((instance, node) for instance, node, _ in clocks_by_node)
    return [Lag(*pair, clocks_by_node.get((*pair, 1), 0) - clocks_by_node.get((*pair, -1), 0)) for pair in pairs]


def check(path, stem, clocks):
    """FileError for latencies that no recorded row can judge.

    An input of the block answers a late port, or a chip would read its pins at different clocks.
    """
    for name in (name for name, block_stem in _instances().items() if stem in (block_stem, TOP_STEM)):
        sources = {source: [t[len("pins.") :] for t in targets if t.startswith("pins.")]
                   for source, targets in _wires().items() if _owner(source) == name}  # fmt: skip
        pins = {pin for source, targets in sources.items()
                for pin in (targets if stem == TOP_STEM else [source[len(name) + 1 :]] * bool(targets))}  # fmt: skip
        delay_by_pin = {pin: clocks.get(f"r_{pin}", clocks.get(f"o_{pin}", 0)) for pin in sorted(pins)}
        if name in ANSWERS and any(delay_by_pin.values()):
            latest_pin = max(delay_by_pin, key=delay_by_pin.get)
            raise FileError(
                f"{path}: [ports] {latest_pin}: inputs {' and '.join(ANSWERS[name])} respond to it, so recorded rows "
                f"would come {delay_by_pin[latest_pin]} clocks too early; use gyro golden loop"
            )
        if len(set(delay_by_pin.values())) > 1:
            pin_delay_text = ", ".join(f"{pin} {delay}" for pin, delay in delay_by_pin.items())
            raise FileError(
                f"{path}: [ports]: one chip reads these pins together, so their clocks must be equal: {pin_delay_text}"
            )

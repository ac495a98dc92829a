"""What of a block is judged, at three levels: what leaves the chip, what other blocks see, everything.

    pins       what the wiring leads to a pin of the board
    outputs    besides: what the wiring leads to another block, what a block around it reads, its combinational pins,
               and what the host reads (`HOST`)
    registers  everything

The manifest lists the ports of the first two. The wiring is that of `fpga_model.wiring`.
Source  docs/foreign_designs.md
"""

import ast
import functools
import inspect
from dataclasses import dataclass

from fpga_model import control, top, wiring
from fpga_model.block import block_modules, leaves, port_name, python_function, required_parameters, state_modules
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench.errors import ConfigError
from testbench.storage.inputs import validate_data

LEVELS = ("pins", "outputs", "registers")
KINDS = {"pins": "pin", "outputs": "output", "registers": "register"}
# No wire of the firmware leads to the host, or to its bus: they read these
HOST = {
    "rate_output": ("y", "valid"),
    "axi_slave": ("awready", "wready", "wdata", "bvalid", "bresp", "arready", "rvalid", "rdata", "rresp"),
}


@functools.cache
def _wiring_levels():
    """{stem: {register or pin: level}} of what the wiring of control and top reads."""
    stems = {path: module.__name__.rpartition(".")[2] for path, module in wiring.nested_blocks(top.State)}
    lowest = {}
    for module, before in ((control, "control."), (top, "")):
        for wire in wiring.trace(module, all_parts=True).wires:
            level = "pins" if wire.instance == "pins" else "outputs"
            for name in (before + leaf.name for leaf in wire.signal.leaves if leaf.kind in ("register", "pin")):
                for path, stem in stems.items():
                    if name.startswith(f"{path}.") and not f"{before}{wire.instance}.".startswith(f"{path}."):
                        register = port_name(name[len(path) + 1 :])
                        lowest[stem, register] = level if level == "pins" else lowest.get((stem, register), level)
    return lowest


@functools.cache
def _parent_read_registers():
    """(stem, register) of what a block reads of the blocks within it, as `s.part.register`."""
    register_reads = set()
    for module in block_modules().values():
        parts = {field: part.__name__.rpartition(".")[2] for field, part in state_modules(module.State).items()}
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            inner = getattr(node, "value", None)
            if isinstance(node, ast.Attribute) and isinstance(inner, ast.Attribute) and inner.attr in parts:
                register_reads.add((parts[inner.attr], node.attr))
    return register_reads


def port_level(stem, name, is_pin):
    """First level that judges a register, or a combinational pin, of a block."""
    if stem == top.__name__.rpartition(".")[2]:
        return "pins" if is_pin else "registers"
    wiring_level = _wiring_levels().get((stem, name))
    if wiring_level is None and (is_pin or (stem, name) in _parent_read_registers() or name in HOST.get(stem, ())):
        return "outputs"
    return wiring_level or "registers"


def levels_entry(block):
    """Entry `levels` of the manifest of a `blocks.Block`: RTL ports that a level below `registers` judges."""
    ports = [(f"r_{p.name}", port_level(block.stem, p.name, False)) for p in block.registers]
    ports += [(f"o_{p.name}", port_level(block.stem, p.name, True)) for p in block.pins]
    return {"pins": [n for n, level in ports if level == "pins"],
            "outputs": [n for n, level in ports if level != "registers"]}  # fmt: skip


def compared_ports(manifest, level):
    """[(RTL port, entry of the manifest)] of what a level judges; ConfigError for another level, or an empty one."""
    ports = [(f"r_{p['name']}", p) for p in manifest["registers"]] + [
        (f"o_{p['name']}", p) for p in manifest["outputs"]
    ]
    if level not in LEVELS:
        raise ConfigError(f"level: {level!r} is not one of {', '.join(LEVELS)}")
    if level == "registers":
        return ports
    stated = validate_data(manifest.get("levels"), dict[str, list[str]], "manifest: levels")
    level_port_pairs = [(name, p) for name, p in ports if name in stated.get(level, ())]
    if not level_port_pairs:
        raise ConfigError(f"level: {manifest['block']} has no port at level {level}")
    return level_port_pairs


def port_kind(manifest, name):
    """pin, output or register: the first level that judges an RTL port."""
    stated = manifest.get("levels", {})
    return next((KINDS[level] for level in LEVELS[:2] if name in stated.get(level, ())), "register")


def unused_params(block):
    """Parameters of a block that neither its edge nor its pins read: a design need not have them."""
    module = block_modules().get(block.stem)
    if module is None or not hasattr(module, "Params"):
        return []
    read = set()
    for name in ("step", *module.BLOCK.outputs):
        for node in ast.walk(ast.parse(inspect.getsource(python_function(getattr(module, name))))):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "p":
                read.add(node.attr)
            if isinstance(node, ast.Call) and any(isinstance(a, ast.Name) and a.id == "p" for a in node.args):
                return []  # p goes on as a whole
    return [port_name(field) for field in module.Params._fields if field not in read]


def roms(manifest):
    """Parameters of a design that name a table."""
    if not any(name.startswith("rom/") for name in manifest["sha256"]):
        return []
    return ["SINE_ROM_FILE", "CORDIC_ROM_FILE"] if manifest["block"] == "top" else ["ROM_FILE"]


def used_params(manifest):
    """Entries of the parameters that a bench sets."""
    unused = manifest.get("unused_params", ())
    return [p for p in manifest.get("params", []) if p["name"] not in unused]


def omitted_params(manifest):
    """Entries of the parameters that a block has and this bundle does not list, as each is 0 in it."""
    module = block_modules().get(manifest["block"])
    if not hasattr(module, "Params"):
        return []
    shape, present_params = formats(module.Params, DEFAULT), {p["name"] for p in manifest.get("params", [])}
    names = {name for name, _ in required_parameters(shape, present_params)}
    return [{"name": port_name(name), "fmt": list(fmt)} for name, fmt in leaves(shape) if port_name(name) not in names]


@dataclass
class Key:
    """Entry of `design_params`."""

    name: str
    value: int


def rtl_parameters(manifest):
    """[(NAME, value)] of the keys that the RTL of a bundle takes; FileError where the entry is none."""
    key_entries = validate_data(manifest.get("design_params", []), list[Key], "manifest: design_params")
    return [(key.name, key.value) for key in key_entries]

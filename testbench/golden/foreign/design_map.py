"""Map of a design that was not written for a bundle: its names, widths, reset and clock for those of the bundle.

    schema = "gyro-design-map/1.0"
    top = "pi_core"               module or entity; gyro_BLOCK if not given
    library = "work_of_top"       VHDL library of the entity; `design`, where files without a library go, if not given
    [clock]                       port = "clk"
    [reset]                       port = "rst", active = 1 or 0, style = "sync", "async" or "none"
    [inputs], [outputs]           port of the bundle = port of the design; same name if it is not listed
    [parameters]                  parameter of the bundle = that of the design, or a table of its name and VHDL type,
                                  integer included; without [parameters] all, by their names
    [constants], [ties]           parameters, and inputs, of the design that the bundle does not know = a whole number

A port of the design is a name, a slice `name[7:0]` or bit `name[3]` of it, "" for none, or a table: port, width (bits
of it), invert, type (VHDL: std_logic, std_logic_vector, signed or unsigned). A wider input gets copies of the sign, or
zeros; a wider output must have them.
Source  docs/foreign_designs.md
"""

import difflib
import re
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError
from testbench.golden.stimulus import levels
from testbench.golden.stimulus.levels import rtl_parameters
from testbench.storage.inputs import read_toml

SCHEMA = "gyro-design-map/1.0"
NAME = re.compile(r"[A-Za-z]\w*")
PORT = re.compile(r"([A-Za-z]\w*)(?:\[(\d{1,4})(?::(\d{1,4}))?\])?")
STYLES = ("sync", "async", "none")
TYPES = ("std_logic", "std_logic_vector", "signed", "unsigned")
MOST_WIDTH = 1024
MOST_NAMES = 12  # in one line
LIBRARY = "design"
TABLES = {"clock": ("port",), "reset": ("port", "active", "style"), "inputs": None, "outputs": None,
          "parameters": None, "constants": None, "ties": None}  # fmt: skip


class Port(NamedTuple):
    """A port of the design: its name ('' for none), the bits of it, how many they are, and what is done to them.

    hi, lo  bits of a slice; None for the whole port
    """

    name: str
    width: int
    hi: int | None = None
    lo: int | None = None
    invert: bool = False
    type: str = ""


class DesignMap(NamedTuple):
    """What a design calls the ports of a bundle; `inputs`, `outputs` and `parameters` are in the bundle's order.

    reset       (port, active level); port '' where the design has none
    style       sync, async or none
    inputs      ((entry of the manifest, Port), ...) without the reset
    outputs     ((RTL port of the bundle, entry of the manifest, Port), ...) of the level
    parameters  ((name in the bundle, name in the design, type), ...)
    constants, ties  ((name in the design, value), ...)
    """

    top: str
    library: str
    clock: str
    reset: tuple
    style: str
    inputs: tuple
    outputs: tuple
    parameters: tuple
    constants: tuple
    ties: tuple


class _Reader:
    """A map's tables against a manifest; every refusal is one line that names map and key."""

    def __init__(self, path, manifest):
        self.path, self.manifest = path or "map", manifest
        self.tree = {"schema": SCHEMA} if path is None else read_toml(Path(path), error=FileError)

    def refuse(self, text):
        raise FileError(f"{self.path}: {text}")

    def require(self, ok, key, value, limit):
        if not ok:
            self.refuse(f"{key}: {value!r} is not {limit}")

    def table(self, name):
        table = self.tree.get(name, {})
        self.require(isinstance(table, dict), name, table, "a table")
        return table

    def require_name(self, where, name, names):
        if name not in names:
            similar = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
            hint = f"did you mean {similar[0]}?" if similar else f"names: {', '.join(list(names)[:12]) or 'none'}"
            self.refuse(f"[{where}]: {self.manifest['block']} has no {name}; {hint}")

    def head(self):
        """Schema, names of tables and of their keys; (top, library, clock, reset, style)."""
        tree = self.tree
        self.require(tree.get("schema") == SCHEMA, "schema", tree.get("schema"), SCHEMA)
        allowed = ("schema", "top", "library", *TABLES)
        for key in tree:
            self.require(key in allowed, "key", key, f"one of {', '.join(allowed)}")
            for name in self.table(key) if TABLES.get(key) else ():
                self.require(name in TABLES[key], f"{key} key", name, f"one of {', '.join(TABLES[key])}")
        top, clock, reset = tree.get("top", f"gyro_{self.manifest['block']}"), self.table("clock"), self.table("reset")
        style = reset.get("style", "sync")
        self.require(style in STYLES, "reset.style", style, f"one of {', '.join(STYLES)}")
        library = tree.get("library", LIBRARY)
        identifier_by_key = {"top": top, "library": library, "clock.port": clock.get("port", "clk")}
        if style != "none":
            identifier_by_key["reset.port"] = reset.get("port", "rst")
        for key, name in identifier_by_key.items():
            self.require(isinstance(name, str) and NAME.fullmatch(name), key, name, "a name")
        active = reset.get("active", 1)
        self.require(type(active) is int and active in (0, 1), "reset.active", active, "0 or 1")
        return top, library, identifier_by_key["clock.port"], (identifier_by_key.get("reset.port", ""), active), style

    def port(self, key, raw_entry, width):
        """`Port` of an entry of [inputs] or [outputs], of a bundle's port of `width` bits."""
        entry = {"port": raw_entry} if isinstance(raw_entry, str) else raw_entry
        self.require(isinstance(entry, dict) and "port" in entry, key, raw_entry, "a port, or a table with port")
        for name in entry:
            self.require(
                name in ("port", "width", "invert", "type"), f"{key}: key", name, "one of port, width, invert, type"
            )
        if entry["port"] == "":
            return Port("", width)
        port_match = PORT.fullmatch(entry["port"]) if isinstance(entry["port"], str) else None
        self.require(port_match, key, entry["port"], "a name, name[bit] or name[high:low]")
        hi, lo = (None if k is None else int(k) for k in port_match.groups()[1:])
        lo = hi if lo is None else lo
        if hi is not None and hi < lo:
            self.refuse(f"{key}: slice {entry['port']}: high bit {hi} is below low bit {lo}")
        bits = entry.get("width", width if hi is None else hi - lo + 1)
        self.require(type(bits) is int and 0 < bits <= MOST_WIDTH, f"{key}: width", bits, f"1 .. {MOST_WIDTH} bits")
        if hi is not None and hi - lo + 1 != bits:
            self.refuse(f"{key}: {entry['port']} has {hi - lo + 1} bits, its width is {bits}")
        invert, kind = entry.get("invert", False), entry.get("type", "")
        self.require(type(invert) is bool, f"{key}: invert", invert, "true or false")
        self.require(kind in ("", *TYPES), f"{key}: type", kind, f"one of {', '.join(TYPES)}")
        return Port(port_match[1], bits, hi, lo, invert, kind)

    def inputs(self):
        ports = self.manifest["inputs"][1:]
        input_entries = self.table("inputs")
        for name in input_entries:
            self.require_name("inputs", name, [p["name"] for p in ports])
        return tuple(
            (p, self.port(f"[inputs] {p['name']}", input_entries.get(p["name"], p["name"]), p["width"])) for p in ports
        )

    def outputs(self, level):
        every = levels.compared_ports(self.manifest, "registers")
        rtl_port_by_name = {name: name for name, _ in every}
        for ports in (every, levels.compared_ports(self.manifest, level)):
            bare = [p["name"] for _, p in ports]
            rtl_port_by_name |= {p["name"]: name for name, p in ports if bare.count(p["name"]) == 1}
        entry_by_port = {}
        for name, raw_entry in self.table("outputs").items():
            self.require_name("outputs", name, rtl_port_by_name)
            if rtl_port_by_name[name] in entry_by_port:
                self.refuse(f"[outputs]: {name} and {rtl_port_by_name[name]} are the same port")
            entry_by_port[rtl_port_by_name[name]] = raw_entry
        output_ports = []
        for name, p in levels.compared_ports(self.manifest, level):
            port = self.port(f"[outputs] {name}", entry_by_port.get(name, name), p["width"])
            if not port.name:
                self.refuse(f'[outputs] {name}: "" leaves this port out, but level {level} compares it')
            output_ports.append((name, p, port))
        return tuple(output_ports)

    def parameters(self):
        names = [name for name, _ in rtl_parameters(self.manifest)] + [
            p["name"] for p in self.manifest.get("params", [])
        ]
        names += levels.roms(self.manifest)
        used = [name for name in names if name not in self.manifest.get("unused_params", ())]
        names += [p["name"] for p in levels.omitted_params(self.manifest)]
        parameter_entries = self.table("parameters") if "parameters" in self.tree else dict(zip(used, used))
        parameter_triples = []
        for name, raw_entry in parameter_entries.items():
            self.require_name("parameters", name, names)
            entry = {"name": raw_entry} if isinstance(raw_entry, str) else raw_entry
            ok = isinstance(entry, dict) and set(entry) <= {"name", "type"} and isinstance(entry.get("name"), str)
            self.require(ok, f"[parameters] {name}", raw_entry, "a name, or a table of name and type")
            self.require(NAME.fullmatch(entry["name"]), f"[parameters] {name}", entry["name"], "a name")
            kinds = ("", *TYPES, "integer")
            kind = entry.get("type", "")
            self.require(kind in kinds, f"[parameters] {name}: type", kind, f"one of {', '.join(kinds[1:])}")
            parameter_triples.append((name, entry["name"], kind))
        return tuple(parameter_triples)

    def numbers(self, key):
        for name, value in self.table(key).items():
            self.require(NAME.fullmatch(name), f"[{key}]", name, "a name")
            self.require(
                type(value) is int and abs(value) < 1 << 31, f"[{key}] {name}", value, "a whole number of 32 bits"
            )
        return tuple(self.table(key).items())


def parameter_notes(manifest, port_map):
    """Lines on parameters of a block to which a map gives no value; none of those that no register depends on."""
    mapped_names = {name for name, *_ in port_map.parameters}
    constants = {name.lower() for name, _ in port_map.constants}
    names = [name for name, _ in rtl_parameters(manifest)] + [p["name"] for p in levels.used_params(manifest)]
    unset = [name for name in names if name not in mapped_names and name.lower() not in constants]
    if not unset:
        return ()
    names_text = ", ".join(unset[:MOST_NAMES]) + (f" and {len(unset) - MOST_NAMES} more" if unset[MOST_NAMES:] else "")
    words = ("parameters", "are", "values") if unset[1:] else ("parameter", "is", "value")
    return (f"{words[0]} {names_text} {words[1]} not in [parameters] of the map; the design uses its own {words[2]}",)


def _check_single_drivers(read, port_map):
    """Refuse an input of the design, or a bit of it, that is driven twice."""
    driven = {port_map.clock: {None: "[clock]"}}

    def drive(name, bits, who):
        driver_by_bit = driven.setdefault(name, {})
        clash = next((k for k in driver_by_bit if k is None or bits is None or k in bits), "free")
        if clash != "free":
            read.refuse(f"port {name} of the design has two drivers: {driver_by_bit[clash]} and {who}")
        driver_by_bit.update(dict.fromkeys([None] if bits is None else bits, who))

    if port_map.reset[0]:
        drive(port_map.reset[0], None, "[reset]")
    for p, port in port_map.inputs:
        if port.name:
            drive(port.name, None if port.hi is None else range(port.lo, port.hi + 1), f"[inputs] {p['name']}")
    for name, _ in port_map.ties:
        drive(name, None, "[ties]")
    bundle_params = {}
    for name, design_param, _ in (*port_map.parameters, *((n, n, "") for n, _ in port_map.constants)):
        if design_param in bundle_params:
            read.refuse(
                f"parameter {design_param} of the design has two values: of {bundle_params[design_param]} and of {name}"
            )
        bundle_params[design_param] = name
    for name, _, port in port_map.outputs:
        if port.name in driven:
            who = next(iter(driven[port.name].values()))
            read.refuse(f"port {port.name} of the design is an input (of {who}) and an output ({name})")


def read(path, manifest, level, top=None):
    """`DesignMap` of a file for a bundle's manifest at a level; FileError with one line for each thing that is wrong.

    path  None: every port has the bundle's name
    top   name of the design's module or entity, before that of the map
    """
    reader = _Reader(path, manifest)
    map_top, library, clock, reset, style = reader.head()
    port_map = DesignMap(
        top=top or map_top,
        library=library,
        clock=clock,
        reset=reset,
        style=style,
        inputs=reader.inputs(),
        outputs=reader.outputs(level),
        parameters=reader.parameters(),
        constants=reader.numbers("constants"),
        ties=reader.numbers("ties"),
    )
    _check_single_drivers(reader, port_map)
    return port_map

"""Heads and instances of `testbench/rtl/top.v` and `control.v`, written from declarations and wires.

    python -m testbench.golden.rtl_wiring            write what is stale
    python -m testbench.golden.rtl_wiring --check    name what is stale, exit code 1

Written: parameters and ports of the module with widths and the formats of the default design; parameters and ports of
every instance, and what they connect to. Keys of the design are parameters in capitals; widths are expressions in them.
By hand stay the logic between instances, notes beside ports, defaults of parameters, the names of the nets that pins
drive, and the connection of a port that logic drives. A new instance begins as `gyro_NAME ROLE ();`.
Source  docs/how_to/add_a_block.md
"""

import re
import sys
from pathlib import Path

from fpga_model import block, control, top, wiring
from fpga_model.block import leaves, port_name
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import RULES, Width, bits, formats
from testbench.errors import FileError
from testbench.storage.files import write_text

RTL = Path(__file__).resolve().parents[1] / "rtl"
FILES = {"control.v": control, "top.v": top}
BIT = bits(1)
FORMAT = r"\[-?\d+,-?\d+,-?\d+\]"
INSTANCE = r"^    gyro_{stem}(?: #\((?:.(?!\n    \);))*?\n    \))? {role} \(.*?\);\n"
ROMS = {"sine": "SINE_ROM_FILE", "cordic": "CORDIC_ROM_FILE"}


def _stem(module):
    return module.__name__.rpartition(".")[2]


def _instance_ports(module):
    """[(port, format)] of an instance: inputs, registers and pins, without clock and reset."""
    if module in FILES.values():
        return _module_ports(module)
    registers = [(f"r_{port_name(path)}", fmt) for path, fmt in leaves(formats(module.State, RULES))]
    return [*block.inputs(module, RULES), *registers, *((f"o_{name}", fmt) for name, fmt in block.pins(module, RULES))]


def _module_ports(module):
    """The same of control or top; of the bank only what is read."""
    read = {leaf.name for wire in wiring.trace(module).wires for leaf in wire.signal.leaves}
    port_formats = []
    for name, shape in module.INPUTS.items():
        for path, fmt in leaves(block.design_formats(shape, RULES), "" if name == "i" else name):
            if name != "bank" or path in read:
                port_formats.append((port_name(path), fmt))
    port_formats += [(f"r_{port_name(path)}", fmt) for path, fmt in leaves(formats(module.State, RULES))]
    pins = formats(module.Pins)._asdict() if hasattr(module, "Pins") else module.OUTPUTS
    return [*port_formats, *((f"o_{name}", fmt) for name, fmt in pins.items())]


def _contained_blocks(module):
    """The blocks in control or top; a block itself."""
    if module not in FILES.values():
        return {module}
    return {block for part, _ in wiring.trace(module).instances.values() for block in _contained_blocks(part)}


def _parameters(module):
    """[(name, format)] of the parameters: keys of the design first and tables last, both with no format."""
    parts = _contained_blocks(module)
    used = {key for part in parts for key in block.keys(part)}
    pairs = [(key.upper(), None) for key in DEFAULT._fields if key in used]
    if module not in FILES.values():
        return [*pairs, *block.parameters(module, RULES).items(), *(("ROM_FILE", None) for _ in module.BLOCK.roms)]
    pairs += [(port_name(path), fmt) for path, fmt in leaves(formats(module.Params, RULES))]
    return [*pairs, *((name, None) for stem, name in ROMS.items() if stem in map(_stem, parts))]


# ---- head ------------------------------------------------------------------------------------------------------------


def _vector_range(width):
    """Range of a declaration."""
    high = width - 1
    return f"[{high.text if isinstance(high, Width) else high}:0]"


def _kind(fmt):
    """Sign and range of a declaration, in columns."""
    span = _vector_range(fmt.width) if fmt and fmt.width > 1 else ""
    return f"{'signed' if fmt and fmt.s else '':<6} {span:>6}"


def _append_note(line, fmt, note):
    """A line with its note by hand, or its format; a note may begin with it."""
    format_text = str(fmt) if fmt.width > 1 else ""
    text = re.sub(f"^{FORMAT}", format_text, note or format_text)
    return f"{line} // {text}" if text else line.rstrip()


def _notes(head):
    """{name: note by hand} and {parameter: default} of a head."""
    notes, defaults = {}, {}
    for line in head.splitlines():
        code, _, comment = line.partition("//")
        name = re.search(r"(\w+)\s*(?:=\s*([^,\s]+)\s*)?,?\s*$", code)
        if name:
            notes[name[1]] = comment.strip()
            defaults[name[1]] = name[2]
    return notes, defaults


def format_module_head(module, text):
    """Parameters and ports of the module; notes and defaults are those of `text`, its head so far."""
    notes, defaults = _notes(text)
    parameters, lines = _parameters(module), []
    pad = max(len(name) for name, _ in parameters)
    for name, fmt in parameters:
        value = defaults.get(name)
        if fmt is None:
            value = getattr(DEFAULT, name.lower(), value or '""')
            span = ""
            if name == "MASTER_HZ":  # Verilator takes no parameter without a width into the division that it is for
                span, value = "[31:0]", f"32'd{value}"
            lines.append(f"    parameter {'':<6} {span:>6} {name:<{pad}} = {value},")
            continue
        if isinstance(fmt.width, Width):
            value = "0"
        elif not value or not value.startswith(f"{fmt.width}'"):
            value = f"{fmt.width}'{'s' if fmt.s else ''}d0"
        span = f"{'signed' if fmt.s else '':<6} {_vector_range(fmt.width):>6}"
        declaration = f"    parameter {span} {name}"
        lines.append(_append_note(f"{declaration:<{pad + 28}} = {value + ',':<8}", fmt, notes.get(name)))
    lines[-1] = lines[-1].rstrip(",")
    lines.append(") (")
    ports = [("clk", BIT), ("rst", BIT), *_instance_ports(module)]
    pad = max(len(name) for name, _ in ports) + 2
    for k, (name, fmt) in enumerate(ports):
        way = "output" if name.startswith(("r_", "o_")) else "input"
        end = "," if k < len(ports) - 1 else ""
        declaration = f"    {way:<6} wire {_kind(fmt)} {name + end}"
        lines.append(_append_note(f"{declaration:<{pad + 30}}", fmt, notes.get(name)))
    return "\n".join(lines)


# ---- instances -------------------------------------------------------------------------------------------------------


def _connections(text):
    """{port: what it is connected to} of an instance as it stands."""
    return {port: " ".join(to.split()) for port, to in re.findall(r"\.(\w+)\s*\(((?:[^()]|\([^()]*\))*)\)", text)}


class Design:
    """A module with the text of its file."""

    def __init__(self, module, path):
        self.module, self.path, self.text = module, path, path.read_text()
        self.trace = wiring.trace(module)
        self.widths = {path: fmt.width for path, fmt in leaves(formats(module.State))}
        self.old = {role: _connections(self.region(role)) for role in self.trace.instances}

    def pattern(self, role):
        return re.compile(INSTANCE.format(stem=_stem(self.trace.instances[role][0]), role=role), re.M | re.S)

    def region(self, role):
        """Text of an instance; FileError if there is none."""
        instance_match = self.pattern(role).search(self.text)
        if not instance_match:
            stem = _stem(self.trace.instances[role][0])
            raise FileError(f"{self.path}: no instance {role}; write `gyro_{stem} {role} ();` where it belongs")
        return instance_match[0]

    def net(self, leaf, fmt):
        """What a leaf is called in Verilog: a part of a register where the port has fewer bits."""
        if leaf.kind == "register":
            cut = f"[{fmt.width - 1}:0]" if fmt.width < self.widths[leaf.name] else ""
            return f"r_{port_name(leaf.name)}{cut}"
        if leaf.kind == "pin":
            role, _, pin = leaf.name.rpartition(".")
            return self.old[role].get(f"o_{pin}", f"{role}_{pin}")
        return port_name(leaf.name)

    def connection(self, role, port, fmt, wires):
        """What a port is connected to: a net where nothing but a wire is between, else what is written by hand."""
        module = self.trace.instances[role][0]
        if port in ("clk", "rst"):
            return port
        if port == "ROM_FILE":
            return ROMS[_stem(module)]
        if port.startswith("r_"):
            return f"r_{port_name(role)}_{port[2:]}"
        if port.startswith("o_"):
            return self.old[role].get(port, f"{role}_{port[2:]}")
        wire = wires.get((role, port))
        if wire is None:  # a table of control
            return port
        (leaf, *more_leaves), strobes = wire.signal.leaves, getattr(module, "BLOCK", None) and module.BLOCK.strobes
        by_hand = more_leaves or wire.signal.label is not None or leaf.kind == "constant"
        if by_hand or (role in self.trace.gated and port in strobes):
            return self.old[role].get(port, wire.signal.label or f"{role}_{port}")
        return self.net(leaf, fmt)

    def connection_lines(self, role, ports, wires):
        """Lines of connections, in columns."""
        pad = max(len(name) for name, _ in ports)
        lines = [f"        .{name:<{pad}}({self.connection(role, name, fmt, wires)})" for name, fmt in ports]
        return ",\n".join(lines)

    def instance_text(self, role):
        """Text of an instance."""
        module = self.trace.instances[role][0]
        wires = {(wire.instance, wire.port): wire for wire in self.trace.wires}
        parameters = _parameters(module)
        values = f" #(\n{self.connection_lines(role, parameters, wires)}\n    )" if parameters else ""
        ports = self.connection_lines(role, [("clk", BIT), ("rst", BIT), *_instance_ports(module)], wires)
        return f"    gyro_{_stem(module)}{values} {role} (\n{ports}\n    );\n"

    def regenerate_text(self):
        """The file with head and instances as they should be."""
        text = self.text
        begin = text.index(f"module gyro_{_stem(self.module)} #(\n")
        begin = text.index("\n", begin) + 1
        end = text.index("\n);\n", begin)
        text = text[:begin] + format_module_head(self.module, text[begin:end]) + text[end:]
        for role in self.trace.instances:
            text = self.pattern(role).sub(lambda _, role=role: self.instance_text(role), text, count=1)
        return text


def stale(rtl=RTL):
    """{path: renewed text} of the files that are not what declarations and wires say."""
    designs = [Design(module, Path(rtl) / name) for name, module in FILES.items()]
    return {one.path: text for one in designs if (text := one.regenerate_text()) != one.text}


def main(arguments=None):
    """Write stale files, or with --check only name them; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments not in ([], ["--check"]):
        print("usage: python -m testbench.golden.rtl_wiring [--check]", file=sys.stderr)
        return 2
    stale_files = stale()
    for path, text in stale_files.items():
        if arguments:
            print(f"{path.name} is stale; run: python -m testbench.golden.rtl_wiring", file=sys.stderr)
        else:
            write_text(path, text)
            print(f"written: {path.name}")
    return 1 if stale_files and arguments else 0


if __name__ == "__main__":
    sys.exit(main())

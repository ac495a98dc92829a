"""A board's top level with the port of the host: `gyro_top`, and `gyro_host` as the master of its register bank.

    write(folder, params)   gyro_board.v and the tables, as `board.write`, with pins of the SPI port in place of the bus

Source  docs/blocks/host.md
"""

from pathlib import Path

from fpga_model import host, registers, top
from fpga_model.fixed import formats
from testbench.flatten import format_leaves
from testbench.golden.recording import board
from testbench.golden.stimulus.blocks import RESET_INPUT, flat
from testbench.storage.files import write_text

BUS = {"write": "r_bus_bank_write", "address": "r_bus_bank_address", "data": "r_bus_bank_data"}  # of top, of the port
# what the port reads besides the registers of the map
READ = ("rates.slot", "control.rate_output.valid", "control.rate_output.k")
HEAD, TAIL = "\n);\n", "\n    );\n\nendmodule\n"


def read_paths(design):
    """{dotted path: format} of the firmware's registers that the port reads."""
    known = dict(format_leaves(formats(top.State, design)))
    return {path: known[path] for path in (*(r.path for r in registers.MAP if r.path), *READ)}


def _span(width):
    return f"[{width - 1}:0] " if width > 1 else ""


def text(params):
    """Verilog of the board; tables are looked for in the folder where the tool runs."""
    widths = {flat(path): fmt.width for path, fmt in read_paths(params.design).items()}
    bus = {name: fmt.width for name, fmt in zip(top.Inputs._fields, top.INPUTS_FMT, strict=True) if name in BUS}
    lines = [line for line in board.text(params).split("\n") if line.split()[-1:] not in ([f"{n},"] for n in bus)]
    found = "\n".join(lines)
    pins = [f"    input wire {name}" for name in host.Inputs._fields]
    pins += [f"    output wire o_{name}" for name in host.Pins._fields]
    wires = [f"    wire {_span(width)}{name};" for name, width in {**widths, **bus}.items()]
    joined = [f"        .r_{name}({name})" for name in widths]
    own = [f".{name}({name})" for name in ("clk", RESET_INPUT, *host.Inputs._fields, *widths)]
    own += [f".{port}({name})" for name, port in BUS.items()] + [f".o_{name}(o_{name})" for name in host.Pins._fields]
    listed = ",\n        ".join(own)
    port = f"    gyro_host #(.DDS_BITS({params.design.dds_bits})) host (\n        {listed}\n    );\n"
    assert found.count(HEAD) == found.count(TAIL) == 1
    found = found.replace(HEAD, ",\n" + ",\n".join(pins) + HEAD + "\n" + "\n".join(wires) + "\n")
    return found.replace(TAIL, ",\n" + ",\n".join(joined) + "\n    );\n\n" + port + "\nendmodule\n")


def write(folder, params):
    """Write the board's files; returns the path of gyro_board.v."""
    path = board.write(folder, params)
    write_text(Path(path), text(params))
    return path

"""A board's top level with a port of the host: `gyro_top`, and `gyro_host` as the master of its register bank.

    write(folder, params)   gyro_board.v and the tables, as `board_recording.write`; SPI pins in place of the bus
    port                    `fpga_model.host_axi` for the AXI4-Lite port, `gyro_host_axi`

Source  docs/host_port.md
"""

from pathlib import Path

from fpga_model import host, registers, top
from fpga_model.fixed import formats
from testbench.flatten import format_leaves
from testbench.golden.recording import board_recording
from testbench.golden.stimulus.blocks import RESET_INPUT, port_name
from testbench.storage.files import write_text

BUS = {"write": "r_bus_bank_write", "address": "r_bus_bank_address", "data": "r_bus_bank_data"}  # of top, of the port
# what the port reads besides the registers of the map
READ = ("rates.slot", "control.rate_output.valid", "control.rate_output.k")
HEAD, TAIL = "\n);\n", "\n    );\n\nendmodule\n"


def read_paths(design):
    """{dotted path: format} of the firmware's registers that the port reads."""
    format_by_path = dict(format_leaves(formats(top.State, design)))
    return {path: format_by_path[path] for path in (*(r.path for r in registers.MAP if r.path), *READ)}


def _vector_prefix(width):
    return f"[{width - 1}:0] " if width > 1 else ""


def text(params, port=host):
    """Verilog of the board; tables are looked for in the folder where the tool runs."""
    name = port.__name__.rpartition(".")[2]
    widths = {port_name(path): fmt.width for path, fmt in read_paths(params.design).items()}
    bus = {name: fmt.width for name, fmt in zip(top.Inputs._fields, top.INPUTS_FMT, strict=True) if name in BUS}
    lines = [
        line for line in board_recording.text(params).split("\n") if line.split()[-1:] not in ([f"{n},"] for n in bus)
    ]
    board_verilog = "\n".join(lines)
    pins = [f"    input wire {_vector_prefix(fmt.width)}{pin}" for pin, fmt in port.INPUTS_FMT._asdict().items()]
    pins += [f"    output wire {_vector_prefix(fmt.width)}o_{pin}" for pin, fmt in port.PINS_FMT._asdict().items()]
    wires = [f"    wire {_vector_prefix(width)}{name};" for name, width in {**widths, **bus}.items()]
    joined = [f"        .r_{name}({name})" for name in widths]
    links = [f".{pin}({pin})" for pin in ("clk", RESET_INPUT, *port.Inputs._fields, *widths)]
    links += [f".{pin}({wire})" for wire, pin in BUS.items()] + [f".o_{pin}(o_{pin})" for pin in port.Pins._fields]
    link_text = ",\n        ".join(links)
    instance = f"    gyro_{name} #(.DDS_BITS({params.design.dds_bits})) host (\n        {link_text}\n    );\n"
    assert board_verilog.count(HEAD) == board_verilog.count(TAIL) == 1
    board_verilog = board_verilog.replace(HEAD, ",\n" + ",\n".join(pins) + HEAD + "\n" + "\n".join(wires) + "\n")
    return board_verilog.replace(TAIL, ",\n" + ",\n".join(joined) + "\n    );\n\n" + instance + "\nendmodule\n")


def write(folder, params, port=host):
    """Write the board's files; returns the path of gyro_board.v."""
    path = board_recording.write(folder, params)
    write_text(Path(path), text(params, port))
    return path

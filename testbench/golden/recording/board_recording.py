"""A board's top level around `gyro_top`: pins only, parameters of a configuration set, registers left inside.

    write(folder, params)   gyro_board.v, sine.hex, cordic_atan.hex: what a synthesis reads beside testbench/rtl

Parameters cannot be given to yosys or Quartus as texts on a command line, so they stand in a file.
Source  docs/rtl.md
"""

from pathlib import Path

from fpga_model import top
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench.errors import ConfigError
from testbench.flatten import format_leaves, leaves
from testbench.golden.bundles.benches import rom_files
from testbench.golden.stimulus.blocks import BLOCKS, RESET_INPUT, design_blocks, port_name
from testbench.storage.files import write_text

MODULE = "gyro_board"
ROMS = (("sine", "SINE_ROM_FILE"), ("cordic", "CORDIC_ROM_FILE"))


def check(params):
    """Raise ConfigError for a firmware that the Verilog of the whole design has not."""
    if params.control.notch is not None:
        raise ConfigError("firmware.notch_hz: the Verilog of the whole design has no notch; set it to 0")
    if params.paths is not None:
        raise ConfigError(
            "firmware.*_sine_registers, *_code_registers: the Verilog of the whole design has none; set them to 0"
        )


def top_parameters(params):
    """[(name, width, raw bits)] of the parameters of gyro_top, from `fpga_model.top.Params`; its design first."""
    d = params.design
    design_keys = {name: value for block in design_blocks(d).values() for name, value in block.design_keys.items()}
    pairs = zip(leaves(params), format_leaves(formats(top.Params, d)), strict=True)
    values = [(port_name(name), fmt.width, int(raw) & ((1 << fmt.width) - 1)) for (name, raw), (_, fmt) in pairs]
    return [*((name, 32, value) for name, value in design_keys.items()), *values]


def write_roms(folder, design=DEFAULT):
    """{parameter of gyro_top: path} of the tables of a design, written into a folder."""
    paths = {}
    for stem, parameter in ROMS:
        for name, text in rom_files(design_blocks(design)[stem]).items():
            if name.endswith(".hex"):
                paths[parameter] = Path(folder) / Path(name).name
                write_text(paths[parameter], text)
    return paths


def ports():
    """[(direction, name, width)] of the board, clock first."""
    port_list = [("input", "clk", 1), ("input", RESET_INPUT, 1)]
    port_list += [("input", name, fmt.width) for name, fmt in zip(top.Inputs._fields, top.INPUTS_FMT)]
    return port_list + [("output", f"o_{name}", fmt.width) for name, fmt in zip(top.Pins._fields, top.PINS_FMT)]


def text(params):
    """Verilog of the board; tables are looked for in the folder where the tool runs."""
    values = [f".{name}({width}'h{raw:x})" for name, width, raw in top_parameters(params)]
    values += [f'.{parameter}("{Path(name).name}")' for stem, parameter in ROMS for name in rom_files(BLOCKS[stem])
               if name.endswith(".hex")]  # fmt: skip
    comma = ",\n"
    declared = comma.join(
        f"    {way} wire {f'[{width - 1}:0] ' if width > 1 else ''}{name}" for way, name, width in ports()
    )
    joined = comma.join(f"        .{name}({name})" for _, name, _ in ports())
    return f"""// Generated: the pins of the firmware, its parameters set; registers stay inside
`timescale 1ps/1ps
module {MODULE} (
{declared}
);

    gyro_top #(
        {(comma + "        ").join(values)}
    ) firmware (
{joined}
    );

endmodule
"""


def write(folder, params):
    """Write the board's files; returns the path of gyro_board.v."""
    path = Path(folder) / f"{MODULE}.v"
    write_text(path, text(params))
    write_roms(folder, params.design)
    return path

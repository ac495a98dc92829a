"""Parameters, widths and latencies for Verilog, SystemVerilog and VHDL, and tables as .hex and .mif.

Source  docs/golden.md (files of a bundle)
"""

from testbench.golden.bundles.benches.layout import constants
from testbench.golden.stimulus.blocks import case_parameters


def _verilog_params(block, case, count):
    lines = [f"localparam {name} = {value};" for name, value in constants(block, count)]
    lines += [f"localparam P_{key} = {value};  // of the design" for key, value in block.design_keys.items()]
    for name, raw, fmt in case_parameters(block, case):
        sign, letter = (" signed", "sh") if fmt.s else ("", "h")
        word = raw & ((1 << fmt.width) - 1)
        lines.append(
            f"localparam{sign} [{fmt.width - 1}:0] P_{name} = {fmt.width}'{letter}{word:x};  // {fmt}, raw {raw}"
        )
    return lines


def params_vh(block, case, count):
    """Parameters to be included inside a Verilog module."""
    return "\n".join([f"// Widths and parameters of {block.stem}/{case}", *_verilog_params(block, case, count)]) + "\n"


def params_svh(block, case, count):
    """The same as a SystemVerilog package."""
    body = [f"    {line}" for line in _verilog_params(block, case, count)]
    name = f"{block.module}_params"
    head = [f"// Widths and parameters of {block.stem}/{case}", f"package {name};"]
    return "\n".join([*head, *body, "endpackage"]) + "\n"


def vhdl_type(width):
    return "std_logic" if width == 1 else f"std_logic_vector({width - 1} downto 0)"


def _vhdl_literal(raw, width):
    if width == 1:
        return f"'{raw & 1}'"
    return f'"{raw & ((1 << width) - 1):0{width}b}"'


def params_pkg(block, case, count):
    """The same as a VHDL package."""
    name = f"{block.module}_params"
    lines = [f"-- Widths and parameters of {block.stem}/{case}", "library ieee;", "use ieee.std_logic_1164.all;", ""]
    lines.append(f"package {name} is")
    lines += [f"    constant {key} : natural := {value};" for key, value in constants(block, count)]
    lines += [
        f"    constant P_{key} : natural := {value};  -- of the design" for key, value in block.design_keys.items()
    ]
    for key, raw, fmt in case_parameters(block, case):
        lines.append(
            f"    constant P_{key} : {vhdl_type(fmt.width)} := {_vhdl_literal(raw, fmt.width)};  -- {fmt}, raw {raw}"
        )
    return "\n".join([*lines, "end package;"]) + "\n"


def rom_files(block):
    """{path: text} of the tables as .hex and as .mif."""
    files = {}
    for rom in block.roms:
        count = -(-rom.width // 4)
        files[f"rom/{rom.name}.hex"] = "".join(f"{word:0{count}x}\n" for word in rom.words)
        head = [f"WIDTH = {rom.width};", f"DEPTH = {len(rom.words)};", "ADDRESS_RADIX = UNS;", "DATA_RADIX = HEX;"]
        rows = [f"    {k} : {word:0{count}X};" for k, word in enumerate(rom.words)]
        files[f"rom/{rom.name}.mif"] = "\n".join([*head, "CONTENT BEGIN", *rows, "END;"]) + "\n"
    return files

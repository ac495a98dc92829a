"""A scoreboard in SystemVerilog for each block: the model in C beside a design, clock by clock, through DPI-C.

    dpi/BLOCK_scoreboard.sv   module gyro_BLOCK_scoreboard, with the ports and parameters of the design
    dpi/BLOCK_bind.sv         puts one into every instance of gyro_BLOCK
    dpi/gyro_dpi_blocks.c     the function of one clock under the name of each block: their vectors differ in width

Source  docs/c_model.md
"""


def _total_port_width(ports):
    return sum(port.width for port in ports)


def _join_name_lines(names, indent):
    """Names side by side, some to a line."""
    lines = [", ".join(names[k : k + 6]) for k in range(0, len(names), 6)]
    return (",\n" + " " * indent).join(lines)


def _literal(value):
    """A number of more than 32 bits needs its width."""
    return f"64'sd{value}" if value >= 0 else f"-64'sd{-value}"


def scoreboard(c_block):
    """Text of BLOCK_scoreboard.sv."""
    b = c_block.block
    input_width, result_width = _total_port_width(b.inputs), _total_port_width((*b.registers, *b.pins))
    inputs = [p.name for p in b.inputs]
    results = [f"r_{p.name}" for p in b.registers] + [f"o_{p.name}" for p in b.pins]
    ports = ["    input wire clk", "    input wire rst"]
    ports += [f"    input wire [{p.width - 1}:0] {name}" for name, p in zip(inputs, b.inputs)]
    ports += [f"    input wire [{p.width - 1}:0] {name}" for name, p in zip(results, (*b.registers, *b.pins))]
    params = [f"    parameter longint {name} = {_literal(value)}" for name, _, value, _ in c_block.params]
    head = " #(\n" + ",\n".join(params) + "\n)" if params else ""
    sets = [f'        void\'(gyro_dpi_set(model, "{name}", {name}));' for name, _, _, _ in c_block.params]
    return "\n".join(
        [
            f"// The model of {b.stem} beside a design: the first clock in which a port differs ends the simulation.",
            f"module gyro_{b.stem}_scoreboard{head} (",
            ",\n".join(ports),
            ");",
            "    import gyro_dpi::*;",
            f'    import "DPI-C" function int gyro_{b.stem}_dpi_clock(',
            f"        input chandle model, input bit rst, input bit [{input_width - 1}:0] given,",
            f"        input bit [{result_width - 1}:0] shown, input bit [{result_width - 1}:0] known);",
            "",
            "    chandle model;",
            "    int found;",
            f"    wire [{input_width - 1}:0] given = {{{_join_name_lines(inputs, 8)}}};",
            f"    wire [{result_width - 1}:0] shown = {{{_join_name_lines(results, 8)}}};",
            "",
            "    initial begin",
            f'        model = gyro_dpi_open("{b.stem}");',
            *sets,
            "    end",
            "",
            "    // a bit that is x or z is so in shown ^ shown too, and 0 in a vector of two states",
            "    always @(posedge clk) begin",
            f"        found = gyro_{b.stem}_dpi_clock(model, rst, given, shown, ~(shown ^ shown));",
            "        if (found != 0) begin",
            f'            report(model, "{b.stem}", found);',
            "            $fatal(1);",
            "        end",
            "    end",
            "",
            "    final if (found == 0)",
            f'        $display("{b.stem}: %0d clocks equal to the model [dpi]", gyro_dpi_number(model) + 1);',
            "endmodule",
            "",
        ]
    )


def bind(c_block):
    """Text of BLOCK_bind.sv."""
    b = c_block.block
    names = ["clk", "rst", *(p.name for p in b.inputs)]
    names += [f"r_{p.name}" for p in b.registers] + [f"o_{p.name}" for p in b.pins]
    params = ", ".join(f".{name}({name})" for name, _, _, _ in c_block.params)
    ports = _join_name_lines([f".{name}({name})" for name in names], 4)
    head = f" #({params})" if params else ""
    return f"bind gyro_{b.stem} gyro_{b.stem}_scoreboard{head} scoreboard (\n    {ports});\n"


def functions(c_blocks):
    """Text of gyro_dpi_blocks.c."""
    lines = ['#include "gyro_dpi.h"', ""]
    for c_block in c_blocks:
        name = f"gyro_{c_block.block.stem}_dpi_clock"
        parameter_text = (
            "void *model, svBit rst, const svBitVecVal *given, const svBitVecVal *shown, const svBitVecVal *known"
        )
        lines += [f"int {name}({parameter_text});", f"int {name}({parameter_text}) {{"]
        lines += ["    return gyro_dpi_clock(model, rst, given, shown, known);", "}", ""]
    return "\n".join(lines)


def dpi_texts(c_blocks):
    """{path: text} of all of them."""
    files = {f"dpi/{c_block.block.stem}_scoreboard.sv": scoreboard(c_block) for c_block in c_blocks}
    files |= {f"dpi/{c_block.block.stem}_bind.sv": bind(c_block) for c_block in c_blocks}
    return files | {"dpi/gyro_dpi_blocks.c": functions(c_blocks)}

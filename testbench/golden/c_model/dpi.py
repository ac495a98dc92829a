"""A scoreboard in SystemVerilog for each block: the model in C beside a design, clock by clock, through DPI-C.

    dpi/BLOCK_scoreboard.sv   module gyro_BLOCK_scoreboard, with the ports and parameters of the design
    dpi/BLOCK_bind.sv         puts one into every instance of gyro_BLOCK
    dpi/gyro_dpi_blocks.c     the function of one clock under the name of each block: their vectors differ in width

Source  docs/c_model.md
"""


def _width(ports):
    return sum(port.width for port in ports)


def _joined(names, indent):
    """Names side by side, some to a line."""
    lines = [", ".join(names[k : k + 6]) for k in range(0, len(names), 6)]
    return (",\n" + " " * indent).join(lines)


def _literal(value):
    """A number of more than 32 bits needs its width."""
    return f"64'sd{value}" if value >= 0 else f"-64'sd{-value}"


def scoreboard(made):
    """Text of BLOCK_scoreboard.sv."""
    b = made.ports
    given, shown = _width(b.inputs), _width((*b.registers, *b.pins))
    inputs = [p.name for p in b.inputs]
    results = [f"r_{p.name}" for p in b.registers] + [f"o_{p.name}" for p in b.pins]
    ports = ["    input wire clk", "    input wire rst"]
    ports += [f"    input wire [{p.width - 1}:0] {name}" for name, p in zip(inputs, b.inputs)]
    ports += [f"    input wire [{p.width - 1}:0] {name}" for name, p in zip(results, (*b.registers, *b.pins))]
    params = [f"    parameter longint {name} = {_literal(value)}" for name, _, value, _ in made.params]
    head = " #(\n" + ",\n".join(params) + "\n)" if params else ""
    sets = [f'        void\'(gyro_dpi_set(model, "{name}", {name}));' for name, _, _, _ in made.params]
    return "\n".join(
        [
            f"// The model of {b.stem} beside a design: the first clock in which a port differs ends the simulation.",
            f"module gyro_{b.stem}_scoreboard{head} (",
            ",\n".join(ports),
            ");",
            "    import gyro_dpi::*;",
            f'    import "DPI-C" function int gyro_{b.stem}_dpi_clock(',
            f"        input chandle model, input bit rst, input bit [{given - 1}:0] given,",
            f"        input bit [{shown - 1}:0] shown, input bit [{shown - 1}:0] known);",
            "",
            "    chandle model;",
            "    int found;",
            f"    wire [{given - 1}:0] given = {{{_joined(inputs, 8)}}};",
            f"    wire [{shown - 1}:0] shown = {{{_joined(results, 8)}}};",
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


def bind(made):
    """Text of BLOCK_bind.sv."""
    b = made.ports
    names = ["clk", "rst", *(p.name for p in b.inputs)]
    names += [f"r_{p.name}" for p in b.registers] + [f"o_{p.name}" for p in b.pins]
    params = ", ".join(f".{name}({name})" for name, _, _, _ in made.params)
    ports = _joined([f".{name}({name})" for name in names], 4)
    head = f" #({params})" if params else ""
    return f"bind gyro_{b.stem} gyro_{b.stem}_scoreboard{head} scoreboard (\n    {ports});\n"


def functions(made):
    """Text of gyro_dpi_blocks.c."""
    lines = ['#include "gyro_dpi.h"', ""]
    for found in made:
        name = f"gyro_{found.ports.stem}_dpi_clock"
        given = "void *model, svBit rst, const svBitVecVal *given, const svBitVecVal *shown, const svBitVecVal *known"
        lines += [f"int {name}({given});", f"int {name}({given}) {{"]
        lines += ["    return gyro_dpi_clock(model, rst, given, shown, known);", "}", ""]
    return "\n".join(lines)


def texts(made):
    """{path: text} of all of them."""
    files = {f"dpi/{m.ports.stem}_scoreboard.sv": scoreboard(m) for m in made}
    files |= {f"dpi/{m.ports.stem}_bind.sv": bind(m) for m in made}
    return files | {"dpi/gyro_dpi_blocks.c": functions(made)}

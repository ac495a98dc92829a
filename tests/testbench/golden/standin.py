"""A design that plays back rows: it has the ports and parameters of `gyro_top`, and nothing behind them.

Row n is on its outputs before edge n after the first reset; behind the last row it stays there. What it plays can be
changed in one place, which is a design with one fault.
"""

from testbench.golden.bundles import benches, bundle
from testbench.golden.bundles.benches.layout import TOP_ROMS
from testbench.golden.stimulus import blocks

VERILOG = """`timescale 1ps/1ps
module gyro_top #(
{params}
) (
{ports}
);
    reg [{top}:0] rows [0:{last}];
    reg [31:0] n;
    reg free;
    wire [{top}:0] now = rows[n];
    assign {{{names}}} = now;
    initial begin
        $readmemh("{path}", rows);
        n = 0;
        free = 0;
    end
    always @(posedge clk) begin
        if (!rst) free <= 1'b1;
        if ((!rst || free) && n != {last}) n <= n + 1;
    end
endmodule
"""
VHDL = """library ieee;
use ieee.std_logic_1164.all;
use std.textio.all;
entity gyro_top is
    generic (
{params}
    );
    port (
{ports}
    );
end entity;
architecture playback of gyro_top is
    signal now : std_logic_vector({padded} downto 0);
begin
{assigns}
    main: process
        file rows : text;
        variable text_line : line;
        variable word : std_logic_vector({padded} downto 0);
        variable free : boolean := false;
    begin
        file_open(rows, "{path}", read_mode);
        readline(rows, text_line);
        hread(text_line, word);
        now <= word;
        loop
            wait until rising_edge(clk);
            if rst = '0' then
                free := true;
            end if;
            if free and not endfile(rows) then
                readline(rows, text_line);
                hread(text_line, word);
                now <= word;
            end if;
        end loop;
    end process;
end architecture;
"""


def write(folder, design, case, rows, change=None):
    """Files of a design for Verilog and VHDL that plays packed `rows`; `change` is (row, port, xor) or None."""
    folder.mkdir(parents=True, exist_ok=True)
    found, given = benches.result_port_pairs(design), blocks.case_parameters(design, case)
    width = sum(p.width for _, p in found)
    rows = list(rows)
    if change is not None:
        row, port, flip = change
        low = {name: lo for name, _, _, lo in benches.slices(found)}[port]
        rows[row] ^= flip << low
    path = folder / "play.hex"
    path.write_text(bundle.hex_text(rows, width))
    padded = 4 * bundle.digits(width) - 1
    inputs = [("clk", 1), *((p.name, p.width) for p in design.columns)]
    (folder / "top.v").write_text(
        VERILOG.format(
            params=",\n".join(
                [f"    parameter [{fmt.width - 1}:0] {name} = 0" for name, _, fmt in given]
                + [f'    parameter {name} = ""' for name in TOP_ROMS]
            ),
            ports=",\n".join(
                [f"    input wire [{w - 1}:0] {name}" if w > 1 else f"    input wire {name}" for name, w in inputs]
                + [f"    output wire [{p.width - 1}:0] {name}" for name, p in found]
            ),
            top=width - 1,
            last=len(rows) - 1,
            names=", ".join(name for name, _ in found),
            path=path,
        )
    )
    (folder / "top.vhd").write_text(
        VHDL.format(
            params=";\n".join(
                [f"        {name} : {benches.vhdl_type(fmt.width)}" for name, _, fmt in given]
                + [f"        {name} : string" for name in TOP_ROMS]
            ),
            ports=";\n".join(
                [f"        {name} : in {benches.vhdl_type(w)}" for name, w in inputs]
                + [f"        {name} : out {benches.vhdl_type(p.width)}" for name, p in found]
            ),
            padded=padded,
            assigns="\n".join(
                f"    {name} <= now{benches.vhdl_slice(p.width, hi, lo)};" for name, p, hi, lo in benches.slices(found)
            ),
            path=path,
        )
    )
    return folder

"""Benches that write down what a design does: no comparison, one line of hexadecimal words per clock.

    reset for `reset.cycles` edges; row n of stim.hex is driven while the clock is low; just before edge n all registers
    and pins go to rows.txt, one word each, in the order of the manifest

Everything comes from the manifest, so that any bundle will do. Each association of the design's ports and parameters
has a line of its own: tools name lines, and `port_of_line` turns those into ports. An input gets an expression where
the tool then refuses an output in its place, and a port that nothing drives is z.
Source  docs/golden.md (what a design must look like)
"""

import re

from testbench.errors import FileError
from testbench.golden.bundles.design_entry import rtl_parameters
from testbench.golden.stimulus import levels

TOP = "gyro_log"
ROWS = "rows.txt"
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def logged_ports(manifest, level="registers"):
    """(RTL port, entry of the manifest) of everything that is logged at a level."""
    return levels.compared_ports(manifest, level)


def _check_manifest_names(manifest):
    names = [manifest["block"]] + [p["name"] for kind in ("inputs", "registers", "outputs") for p in manifest[kind]]
    names += [p["name"] for p in manifest.get("params", [])] + [name for name, _ in rtl_parameters(manifest)]
    for name in names:
        if not NAME.fullmatch(str(name)):
            raise FileError(f"manifest: {name!r} is not a valid name of a port, a parameter or a block")
    if [p["name"] for p in manifest["inputs"]][:1] != ["rst"]:
        raise FileError("manifest: the first input is not rst")


def _slices(ports):
    """(port, msb, lsb) of ports packed side by side, the first in the most significant bits."""
    remaining_bits = sum(p["width"] for p in ports)
    for port in ports:
        yield port, remaining_bits - 1, remaining_bits - port["width"]
        remaining_bits -= port["width"]


def _half_ps(manifest):
    return round(1e12 / manifest["clock"]["hz"]) // 2


def parameters(manifest, every=True):
    """(name, width, signed, raw bits) of the parameters; `every`: also those that a Verilog design need not have."""
    for p in manifest.get("params", []) if every else levels.used_params(manifest):
        width = sum(p["fmt"])
        yield p["name"], width, bool(p["fmt"][0]), int(p["raw"]) & ((1 << width) - 1)


def verilog(manifest, rom=None, level="registers", module=None):
    """The bench in Verilog-2005, of what a level judges.

    rom     path of the block's table, if it has one
    module  what is instantiated; gyro_BLOCK if not given
    """
    _check_manifest_names(manifest)
    inputs, result_ports = manifest["inputs"], logged_ports(manifest, level)
    width, half = sum(p["width"] for p in inputs), _half_ps(manifest)
    values = [f".{name}({value})" for name, value in rtl_parameters(manifest)]
    values += [f".{name}({bits}'{'s' * signed}h{raw:x})" for name, bits, signed, raw in parameters(manifest, False)]
    values += [f'.ROM_FILE("{rom}")'] if rom else []
    ports = [".clk(clk)", *(f".{p['name']}(`IN(now[{hi}:{lo}]))" for p, hi, lo in _slices(inputs))]
    ports += [f".{name}({name})" for name, _ in result_ports]
    generics = " #(\n" + ",\n".join(values) + "\n)" if values else ""
    wires = "\n".join(f"    wire [{p['width'] - 1}:0] {name};" for name, p in result_ports)
    words = ", ".join(name for name, _ in result_ports)
    return f"""`timescale 1ps/1ps
`ifdef __ICARUS__
`define IN(net) ((net) | 1'b0)
`else
`define IN(net) net
`endif
module {TOP};
    reg [{width - 1}:0] stim [0:{manifest["n"] - 1}];
    reg [{width - 1}:0] now;
    reg clk;
    integer n, file;
{wires}
    {module or "gyro_" + manifest["block"]}{generics} dut (
{("," + chr(10)).join(ports)}
    );
    initial begin
        $readmemh("stim.hex", stim);
        file = $fopen("{ROWS}", "w");
        clk = 1'b0;
        now = stim[0];
        now[{width - 1}] = 1'b1;
        for (n = 0; n < {int(manifest["reset"]["cycles"])}; n = n + 1) begin
            #{half} clk = 1'b1;
            #{half} clk = 1'b0;
        end
        for (n = 0; n < {manifest["n"]}; n = n + 1) begin
            now = stim[n];
            #{half - 1} $fwrite(file, "{" ".join(["%h"] * len(result_ports))}\\n", {words});
            #1 clk = 1'b1;
            #{half} clk = 1'b0;
        end
        $fclose(file);
        $finish;
    end
endmodule
"""


def vhdl(manifest, rom=None, level="registers", module=None):
    """The bench in VHDL-2008."""
    _check_manifest_names(manifest)
    inputs, result_ports = manifest["inputs"], logged_ports(manifest, level)
    wide, half = sum(p["width"] for p in inputs), _half_ps(manifest)
    outs = list(_slices([p | {"name": name} for name, p in result_ports]))

    def literal(raw, bits):
        return f"'{raw}'" if bits == 1 else f'"{raw:0{bits}b}"'

    def part(hi, lo):
        return f"({hi})" if hi == lo else f"({hi} downto {lo})"

    values = [f"{name} => {value}" for name, value in rtl_parameters(manifest)]
    values += [f"{name} => {literal(raw, bits)}" for name, bits, _, raw in parameters(manifest)]
    values += [f'ROM_FILE => "{rom}"'] if rom else []
    nets = [(p["name"], f"now{part(hi, lo)}") for p, hi, lo in _slices(inputs)]
    ports = ["clk => clk", *(f"{name} => {net} and {net}" for name, net in nets)]
    ports += [f"{p['name']} => got{part(hi, lo)}" for p, hi, lo in outs]
    generics = "generic map (\n" + ",\n".join(values) + "\n)\n" if values else ""
    writes = "\n".join(f"            write(row, to_hstring(got({hi} downto {lo})) & ' ');" for _, hi, lo in outs)
    return f"""library ieee;
use ieee.std_logic_1164.all;
use std.textio.all;
entity {TOP} is end entity;
architecture bench of {TOP} is
    signal clk : std_logic := '0';
    signal now : std_logic_vector({wide - 1} downto 0) := (others => '0');
    signal got : std_logic_vector({outs[0][1]} downto 0) := (others => 'Z');
begin
    dut : entity work.{module or "gyro_" + manifest["block"]}
{generics}port map (
{("," + chr(10)).join(ports)}
);
    process
        file stim : text open read_mode is "stim.hex";
        file rows : text open write_mode is "{ROWS}";
        variable given, row : line;
        variable word : std_logic_vector({-(-wide // 4) * 4 - 1} downto 0);
    begin
        now <= ({wide - 1} => '1', others => '0');
        for n in 1 to {int(manifest["reset"]["cycles"])} loop
            wait for {half} ps;
            clk <= '1';
            wait for {half} ps;
            clk <= '0';
        end loop;
        for n in 1 to {manifest["n"]} loop
            readline(stim, given);
            hread(given, word);
            now <= word({wide - 1} downto 0);
            wait for {half - 1} ps;
{writes}
            writeline(rows, row);
            wait for 1 ps;
            clk <= '1';
            wait for {half} ps;
            clk <= '0';
        end loop;
        wait;
    end process;
end architecture;
"""


def port_of_line(text, number):
    """Port or parameter of the design that a line of a bench connects, or None."""
    lines = text.splitlines()
    line = lines[number - 1] if 0 < number <= len(lines) else ""
    connection_match = re.fullmatch(r"\.(\w+)\(.*\),?|(?:std_logic_vector\()?(\w+)\)? => .*", line.strip())
    return (connection_match[1] or connection_match[2]) if connection_match else None

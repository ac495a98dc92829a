"""Self-checking VHDL-2008 bench: GHDL, or any other simulator of VHDL-2008.

Source  docs/golden.md (rows)
"""

from testbench.golden.bundles.benches.layout import SHOWN, inputs_of, results, rom_name, slices
from testbench.golden.bundles.benches.params import vhdl_type
from testbench.golden.stimulus.blocks import params_of


def vhdl_slice(width, hi, lo):
    return f"({hi})" if width == 1 else f"({hi} downto {lo})"


def vhdl_bench(block, case):
    """Self-checking VHDL-2008 bench; `finished` and `errors` are for a surrounding bench."""
    inputs, found, given = inputs_of(block), results(block), params_of(block, case)
    title, name = f"{block.stem}/{case}", f"tb_{block.stem}"
    generics = [f"            {key} : {vhdl_type(fmt.width)}" for key, _, fmt in given]
    maps = [f"            {key} => P_{key}" for key, _, _ in given]
    if block.roms:
        generics.append("            ROM_FILE : string")
        maps.append(f'            ROM_FILE => DIR & "{rom_name(block)}"')
    joined = ";\n".join(generics)
    declared = f"        generic (\n{joined}\n        );\n" if generics else ""
    ports = ["            clk : in std_logic", *(f"            {n} : in {vhdl_type(p.width)}" for n, p in inputs)]
    ports += [f"            {n} : out {vhdl_type(p.width)}" for n, p in found]
    port_maps = ["                clk => clk"]
    port_maps += [f"                {n} => now{vhdl_slice(p.width, hi, lo)}" for n, p, hi, lo in slices(inputs)]
    port_maps += [f"                {n} => got{vhdl_slice(p.width, hi, lo)}" for n, p, hi, lo in slices(found)]
    joined_maps = ",\n    ".join(maps)
    mapped = f"            generic map (\n    {joined_maps}\n            )\n" if maps else ""
    shows = [
        f'                    tell("{n}", n, got({hi} downto {lo}), want({hi} downto {lo}), care({hi} downto {lo}));'
        for n, p, hi, lo in slices(found)
    ]
    return f"""-- Self-checking bench of {title}: drives while clk is low, compares just before the rising edge.
library ieee;
use ieee.std_logic_1164.all;
use std.textio.all;
use work.{block.module}_params.all;

entity {name} is
    generic (
        NO_DESIGN : boolean := false;
        DIR : string := ""  -- folder of the bundle, with a slash at its end
    );
    port (
        finished : out boolean := false;
        errors : out natural := 0
    );
end entity;

architecture bench of {name} is
    component {block.module} is
{declared}        port (
{(";" + chr(10)).join(ports)}
        );
    end component;

    signal clk : std_logic := '0';
    signal now : std_logic_vector(IN_WIDTH - 1 downto 0) := (others => '0');
    signal got : std_logic_vector(OUT_WIDTH - 1 downto 0);

    procedure tell(port_name : string; n : natural; found, expected, care : std_logic_vector) is
        variable text_line : line;
        constant zero : std_logic_vector(care'length - 1 downto 0) := (others => '0');
    begin
        if ((found xor expected) and care) /= zero then
            write(text_line, string'("row ") & integer'image(n) & ": " & port_name & ": expected "
                & to_hstring(expected) & ", got " & to_hstring(found) & " (hex)");
            writeline(output, text_line);
        end if;
    end procedure;
begin
    given: if not NO_DESIGN generate
        dut: {block.module}
{mapped}            port map (
{("," + chr(10)).join(port_maps)}
            );
    end generate;

    main: process
        file stim_file : text;
        file exp_file : text;
        file mask_file : text;
        variable text_line : line;
        variable stim_word : std_logic_vector((IN_WIDTH + 3) / 4 * 4 - 1 downto 0);
        variable exp_word, mask_word : std_logic_vector((OUT_WIDTH + 3) / 4 * 4 - 1 downto 0);
        variable want, care : std_logic_vector(OUT_WIDTH - 1 downto 0);
        constant ZERO : std_logic_vector(OUT_WIDTH - 1 downto 0) := (others => '0');
        variable bad, first : natural := 0;
    begin
        if NO_DESIGN then
            write(text_line, string'("NO DESIGN {title}: the bench elaborates, no design was given"));
            writeline(output, text_line);
            finished <= true;
            wait;
        end if;
        file_open(stim_file, DIR & "stim.hex", read_mode);
        file_open(exp_file, DIR & "exp.hex", read_mode);
        file_open(mask_file, DIR & "mask.hex", read_mode);
        now <= (IN_WIDTH - 1 => '1', others => '0');
        for n in 1 to RESET_CYCLES loop
            wait for HALF_PS * 1 ps;
            clk <= '1';
            wait for HALF_PS * 1 ps;
            clk <= '0';
        end loop;
        for n in 0 to N_ROWS - 1 loop
            readline(stim_file, text_line);
            hread(text_line, stim_word);
            readline(exp_file, text_line);
            hread(text_line, exp_word);
            readline(mask_file, text_line);
            hread(text_line, mask_word);
            now <= stim_word(IN_WIDTH - 1 downto 0);
            want := exp_word(OUT_WIDTH - 1 downto 0);
            care := mask_word(OUT_WIDTH - 1 downto 0);
            wait for (HALF_PS - 1) * 1 ps;
            if ((got xor want) and care) /= ZERO then
                if bad = 0 then
                    first := n;
                end if;
                if bad < {SHOWN} then
{chr(10).join(shows)}
                end if;
                bad := bad + 1;
            end if;
            wait for 1 ps;
            clk <= '1';
            wait for HALF_PS * 1 ps;
            clk <= '0';
        end loop;
        if bad = 0 then
            write(text_line, string'("PASS {title}: ") & integer'image(N_ROWS) & " rows, {len(found)} ports");
        else
            write(text_line, string'("FAIL {title}: ") & integer'image(bad) & " of " & integer'image(N_ROWS)
                & " rows differ, the first is row " & integer'image(first));
        end if;
        writeline(output, text_line);
        errors <= bad;
        finished <= true;
        wait;
    end process;
end architecture;
"""

"""Texts of a bundle that run in other people's tools: parameters, ROM files, benches, Makefile, viewer set-up.

Every bench does the same: reset with quiet inputs for `reset.cycles` edges, then drive row n while the clock is low,
compare just before the rising edge, report per port, and print one line that begins with PASS or FAIL. Module and
entity are `gyro_<block>`, registers ports `r_<name>`, output pins `o_<name>`; parameters are named as in `Params`.
Source  docs/conventions.md
"""

from fpga_model.rates import MASTER_HZ
from testbench.golden.blocks import RESET_INPUT, params_of

PERIOD_PS = (1_000_000_000_000 + MASTER_HZ // 2) // MASTER_HZ
HALF_PS = PERIOD_PS // 2
RESET_CYCLES = 2
SHOWN = 10  # rows that a bench reports in full
# Blocks that a design may build from others of the same folder
PARTS = {
    "agc": ("pi",),
    "frequency_tracker": ("pi",),
    "rate_loop": ("pi",),
    "quadrature_loop": ("pi", "isqrt"),
    "sequencer": ("lock_monitor", "fault_monitor"),
}


def rom_name(block):
    """Path of the block's table inside the bundle, or None."""
    return f"rom/{block.roms[0].name}.hex" if block.roms else None


def results(block):
    """(RTL port, Port) of everything compared: registers, then outputs."""
    return [(f"r_{p.name}", p) for p in block.registers] + [(f"o_{p.name}", p) for p in block.pins]


def slices(named):
    """(name, port, msb, lsb) of ports packed side by side, the first in the most significant bits."""
    left = sum(port.width for _, port in named)
    for name, port in named:
        yield name, port, left - 1, left - port.width
        left -= port.width


def _width_of(named):
    return sum(port.width for _, port in named)


def _inputs(block):
    return [(port.name, port) for port in block.columns]


def _constants(block, count):
    """(name, integer) that every language gets."""
    listed = [
        ("N_ROWS", count),
        ("RESET_CYCLES", RESET_CYCLES),
        ("HALF_PS", HALF_PS),
        ("IN_WIDTH", _width_of(_inputs(block))),
        ("OUT_WIDTH", _width_of(results(block))),
    ]
    listed += [(f"W_{name}", port.width) for name, port in _inputs(block)]
    listed += [(f"W_{name}", port.width) for name, port in results(block)]
    listed += [(f"LATENCY_{name}", clocks) for name, clocks in block.latency.items() if isinstance(clocks, int)]
    return listed


# ---- parameters and tables -----------------------------------------------------------------------------------------


def _verilog_params(block, case, count):
    lines = [f"localparam {name} = {value};" for name, value in _constants(block, count)]
    for name, raw, fmt in params_of(block, case):
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
    lines += [f"    constant {key} : natural := {value};" for key, value in _constants(block, count)]
    for key, raw, fmt in params_of(block, case):
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


# ---- Verilog -------------------------------------------------------------------------------------------------------


def span(width):
    return f"[{width - 1}:0] " if width > 1 else ""


def _verilog_instance(block, case, inputs):
    """Instance `dut`; `inputs` gives the net of an input port."""
    generics = [f".{name}(P_{name})" for name, _, _ in params_of(block, case)]
    if block.roms:
        generics.append(f'.ROM_FILE("{rom_name(block)}")')
    ports = [".clk(clk)", *(f".{name}({inputs(name)})" for name, _ in _inputs(block))]
    ports += [f".{name}({name})" for name, _ in results(block)]
    head = f"{block.module} #(\n        {(',' + chr(10) + '        ').join(generics)}\n    ) dut" if generics else ""
    joined = ",\n        ".join(ports)
    return f"    {head or block.module + ' dut'} (\n        {joined}\n    );"


def verilog_bench(block, case):
    """Self-checking Verilog bench; needs a simulator with delays, nothing else."""
    inputs, found = _inputs(block), results(block)
    title = f"{block.stem}/{case}"
    nets = [f"    wire {span(p.width)}s_{n} = now[{hi}:{lo}];" for n, p, hi, lo in slices(inputs)]
    nets += [f"    wire {span(p.width)}{n};" for n, p in found]
    packed = ", ".join(n for n, _ in found)
    shows = [
        f"            if ((({n} ^ want[{hi}:{lo}]) & care[{hi}:{lo}]) !== {p.width}'d0)\n"
        f'                $display("row %0d: {n}: expected %0h, got %0h (hex)", n, want[{hi}:{lo}], {n});'
        for n, p, hi, lo in slices(found)
    ]
    return f"""// Self-checking bench of {title}: drives while clk is low, compares just before the rising edge.
`timescale 1ps/1ps
module tb_{block.stem};
    `include "params.vh"

    reg [IN_WIDTH-1:0] stim [0:N_ROWS-1];
    reg [OUT_WIDTH-1:0] exp [0:N_ROWS-1];
    reg [OUT_WIDTH-1:0] mask [0:N_ROWS-1];
    reg clk;
    reg [IN_WIDTH-1:0] now;
    reg [OUT_WIDTH-1:0] want, care;
    integer n, errors, first;

{chr(10).join(nets)}
    wire [OUT_WIDTH-1:0] got = {{{packed}}};

`ifndef NO_DESIGN
{_verilog_instance(block, case, lambda name: f"s_{name}")}
`endif

    task show;
        begin
{chr(10).join(shows)}
        end
    endtask

    initial begin
        $readmemh("stim.hex", stim);
        $readmemh("exp.hex", exp);
        $readmemh("mask.hex", mask);
`ifdef VCD_FILE
        $dumpfile(`VCD_FILE);
        $dumpvars(0, tb_{block.stem});
`endif
        clk = 1'b0;
        errors = 0;
        first = 0;
`ifdef NO_DESIGN
        $display("NO DESIGN {title}: the bench elaborates, no design was given");
`else
        now = stim[0];
        now[IN_WIDTH-1] = 1'b1;
        for (n = 0; n < RESET_CYCLES; n = n + 1) begin
            #(HALF_PS) clk = 1'b1;
            #(HALF_PS) clk = 1'b0;
        end
        for (n = 0; n < N_ROWS; n = n + 1) begin
            now = stim[n];
            want = exp[n];
            care = mask[n];
            #(HALF_PS - 1);
            if (((got ^ want) & care) !== {{OUT_WIDTH{{1'b0}}}}) begin
                if (errors == 0) first = n;
                if (errors < {SHOWN}) show;
                errors = errors + 1;
            end
            #1 clk = 1'b1;
            #(HALF_PS) clk = 1'b0;
        end
        if (errors == 0) $display("PASS {title}: %0d rows, {len(found)} ports", N_ROWS);
        else $display("FAIL {title}: %0d of %0d rows differ, the first is row %0d", errors, N_ROWS, first);
`endif
        $finish;
    end
endmodule
"""


def cocotb_top(block, case):
    """The design with the case's parameters, as the top level of cocotb."""
    ports = ["    input wire clk", *(f"    input wire {span(p.width)}{n}" for n, p in _inputs(block))]
    ports += [f"    output wire {span(p.width)}{n}" for n, p in results(block)]
    return f"""// {block.stem}/{case} with its parameters set
`timescale 1ps/1ps
module cocotb_{block.stem} (
{("," + chr(10)).join(ports)}
);
    `include "params.vh"

{_verilog_instance(block, case, lambda name: name)}
endmodule
"""


# ---- VHDL ----------------------------------------------------------------------------------------------------------


def vhdl_slice(width, hi, lo):
    return f"({hi})" if width == 1 else f"({hi} downto {lo})"


def vhdl_bench(block, case):
    """Self-checking VHDL-2008 bench; `finished` and `errors` are for a surrounding bench."""
    inputs, found, given = _inputs(block), results(block), params_of(block, case)
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


def vunit_bench(block, case):
    """The VHDL bench as a test of VUnit."""
    name = f"tb_{block.stem}"
    return f"""-- {block.stem}/{case} as a test of VUnit
library vunit_lib;
context vunit_lib.vunit_context;

entity {name}_vunit is
    generic (
        runner_cfg : string;
        tb_path : string;
        no_design : boolean := false
    );
end entity;

architecture bench of {name}_vunit is
    signal finished : boolean;
    signal errors : natural;
begin
    inner: entity work.{name}
        generic map (NO_DESIGN => no_design, DIR => tb_path)
        port map (finished => finished, errors => errors);

    main: process
    begin
        test_runner_setup(runner, runner_cfg);
        if not finished then
            wait until finished;
        end if;
        check_equal(errors, 0, "rows that differ");
        test_runner_cleanup(runner);
    end process;
end architecture;
"""


# ---- Python tools and make -----------------------------------------------------------------------------------------


def cocotb_test(block, case):
    """cocotb test (1.9 and 2) that is its own runner: RTL=folder python3 test_<block>.py."""
    parts = " " + " ".join(f'"{part}",' for part in PARTS.get(block.stem, ())) if block.stem in PARTS else ""
    return f'''"""cocotb test of {block.stem}/{case}; RTL=folder python3 test_{block.stem}.py (SIM is icarus)."""

import json
import os
import sys
from pathlib import Path

BLOCK = "{block.stem}"
HERE = Path(__file__).resolve().parent
SOURCES = (BLOCK,{parts})
HALF_PS = {HALF_PS}

try:
    import cocotb
    from cocotb.triggers import Timer
except ImportError:
    sys.exit("cocotb is not installed: pip install cocotb")


def rows(name, ports):
    """Packed words of a hex file as one list of unsigned values per row."""
    for line in (HERE / name).read_text().split():
        word, values = int(line, 16), []
        for port in reversed(ports):
            values.append(word & ((1 << port["width"]) - 1))
            word >>= port["width"]
        yield values[::-1]


@cocotb.test()
async def golden(dut):
    manifest = json.loads((HERE / "manifest.json").read_text())
    inputs = manifest["inputs"]
    results = manifest["registers"] + manifest["outputs"]
    names = ["r_" + port["name"] for port in manifest["registers"]] + ["o_" + p["name"] for p in manifest["outputs"]]
    drive = [getattr(dut, port["name"]) for port in inputs]
    sense = [getattr(dut, name) for name in names]
    dut.clk.value = 0
    for pin in drive:
        pin.value = 0
    dut.rst.value = 1
    for _ in range(manifest["reset"]["cycles"]):
        await Timer(HALF_PS, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    wrong = 0
    vectors = zip(rows("stim.hex", inputs), rows("exp.hex", results), rows("mask.hex", results))
    for n, (stim, expected, mask) in enumerate(vectors):
        for pin, value in zip(drive, stim):
            pin.value = value
        await Timer(HALF_PS - 1, "ps")
        before = wrong
        for name, pin, want, care in zip(names, sense, expected, mask):
            text = str(pin.value)
            got = int(text, 2) if set(text) <= set("01") else None
            if got is None or (got ^ want) & care:
                wrong += wrong == before
                if wrong <= {SHOWN}:
                    shown = text if got is None else f"{{got:x}}"
                    dut._log.error("row %d: %s: expected %x, got %s (hex)", n, name, want, shown)
        await Timer(1, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    assert wrong == 0, f"FAIL {block.stem}/{case}: {{wrong}} rows differ"


def main():
    try:
        from cocotb_tools.runner import get_runner
    except ImportError:
        from cocotb.runner import get_runner
    rtl = os.environ.get("RTL", "")
    sources = [Path(rtl).resolve() / f"{{stem}}.v" for stem in SOURCES] if rtl else []
    if not sources or not sources[0].is_file():
        if rtl:
            sys.exit(f"FAIL {block.stem}/{case}: no design {{sources[0]}}")
        print("NO DESIGN {block.stem}/{case}: no design was given")
        return
    build = HERE / "build" / "cocotb"
    runner = get_runner(os.environ.get("SIM", "icarus"))
    top = f"cocotb_{{BLOCK}}"
    files = [HERE / f"{{top}}.v", *(path for path in sources if path.is_file())]
    runner.build(sources=files, includes=[HERE], hdl_toplevel=top, build_dir=build, always=True)
    (build / "results.xml").unlink(missing_ok=True)
    done = runner.test(hdl_toplevel=top, test_module=Path(__file__).stem, build_dir=build, test_dir=HERE,
                       results_xml=str(build / "results.xml"))
    text = Path(done).read_text()
    if "<failure" in text or "<error" in text or "<testcase" not in text:
        sys.exit("FAIL {block.stem}/{case}")
    print("PASS {block.stem}/{case}")


if __name__ == "__main__":
    main()
'''


def vunit_run(block, case):
    """Run script of VUnit: RTL=folder python3 run_vunit.py."""
    return f'''"""{block.stem}/{case} under VUnit: RTL=folder python3 run_vunit.py; without RTL it only elaborates."""

import os
from pathlib import Path

from vunit import VUnit

HERE = Path(__file__).resolve().parent
SOURCES = {("vhd", block.stem, *PARTS.get(block.stem, ()))[1:]!r}

vu = VUnit.from_argv()
vu.add_vhdl_builtins()
lib = vu.add_library("golden")
for name in ("params_pkg.vhd", "tb_{block.stem}.vhd", "tb_{block.stem}_vunit.vhd"):
    lib.add_source_files(HERE / name)
rtl = os.environ.get("RTL", "")
if rtl:
    for stem in SOURCES:
        path = Path(rtl).resolve() / f"{{stem}}.vhd"
        if path.is_file() or stem == SOURCES[0]:
            lib.add_source_files(path)
lib.test_bench("tb_{block.stem}_vunit").set_generic("no_design", not rtl)
vu.main()
'''


def makefile(block, case):
    """`make check SIM=icarus|verilator|ghdl|cocotb|vunit RTL=folder`; without RTL the bench is elaborated alone."""
    stem, parts = block.stem, " ".join(PARTS.get(block.stem, ()))
    return f"""# {stem}/{case}: make check SIM=icarus|verilator|ghdl|cocotb|vunit RTL=folder (absolute, or from here)
# The folder holds {stem}.v or {stem}.vhd with {block.module}; without RTL the bench is only elaborated.
SIM ?= icarus
RTL ?=
PYTHON ?= python3
PARTS = {parts}
SUFFIX = $(if $(filter ghdl vunit,$(SIM)),vhd,v)
WANTED = $(RTL)/{stem}.$(SUFFIX)
DESIGN = $(if $(RTL),$(foreach part,$(PARTS),$(wildcard $(RTL)/$(part).$(SUFFIX))) $(WANTED))
NONE = $(if $(RTL),,-DNO_DESIGN)
RESULT = build/$(SIM).txt
JUDGE = cat $(RESULT); grep -q $(if $(RTL),'^PASS ','^NO DESIGN ') $(RESULT)

check: given
	@$(MAKE) --no-print-directory run-$(SIM) RTL='$(RTL)' SIM=$(SIM)

given:
	@mkdir -p build
	@if [ -n '$(RTL)' ] && [ ! -f '$(WANTED)' ]; then echo 'FAIL {stem}/{case}: no design $(WANTED)'; exit 2; fi

run-icarus:
	@iverilog -g2005 -I. -s tb_{stem} $(NONE) -o build/tb.vvp tb_{stem}.v $(DESIGN)
	@vvp -n build/tb.vvp > $(RESULT); $(JUDGE)

run-verilator:
	@verilator --binary --timing -Wno-fatal -Wno-lint -Wno-style -I. --top-module tb_{stem} $(NONE) \\
	--Mdir build/verilator -o sim tb_{stem}.v $(DESIGN) > build/verilator.log 2>&1 \\
	|| (cat build/verilator.log; exit 2)
	@build/verilator/sim > $(RESULT); $(JUDGE)

run-ghdl:
	@mkdir -p build/ghdl
	@ghdl -a --std=08 --workdir=build/ghdl params_pkg.vhd $(DESIGN) tb_{stem}.vhd
	@ghdl -e --std=08 --workdir=build/ghdl -o build/ghdl/tb tb_{stem} $(if $(RTL),,2> build/ghdl/unbound.log)
	@ghdl -r --std=08 --workdir=build/ghdl tb_{stem} $(if $(RTL),,-gNO_DESIGN=true) > $(RESULT) 2>&1; $(JUDGE)

run-cocotb:
	@env -u MAKEFLAGS -u MAKELEVEL SIM=icarus RTL='$(RTL)' $(PYTHON) test_{stem}.py > $(RESULT) 2>&1; $(JUDGE)

run-vunit:
	@RTL='$(RTL)' $(PYTHON) run_vunit.py -o build/vunit > $(RESULT) 2>&1; status=$$?; tail -8 $(RESULT); exit $$status

clean:
	rm -rf build

.PHONY: check given clean run-icarus run-verilator run-ghdl run-cocotb run-vunit
"""


def texts(block, case, count):
    """{path: text} of everything above for a case of `count` rows."""
    stem = block.stem
    return {
        "params.vh": params_vh(block, case, count),
        "params.svh": params_svh(block, case, count),
        "params_pkg.vhd": params_pkg(block, case, count),
        **rom_files(block),
        f"tb_{stem}.v": verilog_bench(block, case),
        f"cocotb_{stem}.v": cocotb_top(block, case),
        f"tb_{stem}.vhd": vhdl_bench(block, case),
        f"tb_{stem}_vunit.vhd": vunit_bench(block, case),
        f"test_{stem}.py": cocotb_test(block, case),
        "run_vunit.py": vunit_run(block, case),
        "Makefile": makefile(block, case),
    }


assert RESET_INPUT == "rst", "the benches name the reset"

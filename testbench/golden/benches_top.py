"""Benches of the whole firmware: they replay recorded inputs, and check listed rows and a signature of every frame.

    before edge n   clk is low: host events and samples of n; what the ADS1298 did after edge n - 1
    half a clock    registers and pins enter the signature; if n is listed in at.hex, inputs, registers, pins are compared
    edge n          clk rises

After 3250 clocks the signature is compared with its line of sig.hex. Everything is read from the files of the bundle.
The converter is modelled in the bench because it answers the design: it shifts when SCLK rises and DRDY_N follows CS_N.
Verilator gets the signature by chunks of 60 bits, which it turns into words of the machine; the others by whole rows,
XOR written with AND and OR where Icarus is 14 times faster so.
Source  docs/golden.md (the whole design), docs/parts/adc_serial.md, testbench/golden/signature.py
"""

from analog_frontend import adc_serial
from fpga_model.rates import FRAME_CYCLES, TICK_CYCLES
from testbench.golden import benches, signature
from testbench.golden.benches import HALF_PS, RESET_CYCLES, SHOWN
from testbench.golden.blocks import BLOCKS, params_of

ROM_PARAMETERS = {"SINE_ROM_FILE": "rom/sine.hex", "CORDIC_ROM_FILE": "rom/cordic_atan.hex"}
PARTS = ("control", *BLOCKS)
CLOCK_BITS = 32
ADC_BITS = CLOCK_BITS + adc_serial.WORDS * adc_serial.WORD_BITS
HOST_BITS = CLOCK_BITS + 4 + 8 + 48
SAR_BITS = 36
# Frames that a simulator runs unless FRAMES is given: half a minute or so of each
DEFAULT_FRAMES = {"icarus": 300, "verilator": 0, "ghdl": 2, "cocotb": 3, "vunit": 2}


def constants(counts):
    """(name, integer) of a replay, beside those of every bench.

    counts  {frames, conversions, host_events, samples}
    """
    out_width = counts["out_width"]
    return [
        ("N_FRAMES", counts["frames"]),
        ("N_ADC", counts["conversions"]),
        ("N_HOST", counts["host_events"]),
        ("N_SAR", counts["samples"]),
        ("FRAME_CYCLES", FRAME_CYCLES),
        ("TICK_CYCLES", TICK_CYCLES),
        ("ADC_BITS", ADC_BITS),
        ("HOST_BITS", HOST_BITS),
        ("SAR_BITS", SAR_BITS),
        ("ADC_PULSE", adc_serial.PULSE),
        ("ROW_BITS", signature.padded(out_width)),
    ]


def _with(text, before, lines):
    """Text with lines inserted before the last line that begins with `before`."""
    head, mark, tail = text.rpartition(before)
    return head + "".join(f"{line}\n" for line in lines) + mark + tail


def parameters(block, case, rows, counts):
    """{path: text} of params.vh, params.svh and params_pkg.vhd."""
    extra = constants(counts)
    return {
        "params.vh": benches.params_vh(block, case, rows) + "".join(f"localparam {k} = {v};\n" for k, v in extra),
        "params.svh": _with(
            benches.params_svh(block, case, rows), "endpackage", [f"    localparam {k} = {v};" for k, v in extra]
        ),
        "params_pkg.vhd": _with(
            benches.params_pkg(block, case, rows),
            "end package;",
            [f"    constant {k} : natural := {v};" for k, v in extra],
        ),
    }


# ---- Verilog ---------------------------------------------------------------------------------------------------------


def _verilog_instance(block, case):
    generics = [f".{name}(P_{name})" for name, _, _ in params_of(block, case)]
    generics += [f'.{name}("{path}")' for name, path in ROM_PARAMETERS.items()]
    ports = [".clk(clk)", *(f".{p.name}({p.name})" for p in block.columns)]
    ports += [f".{name}({name})" for name, _ in benches.results(block)]
    comma = ",\n        "
    return f"    {block.module} #(\n        {comma.join(generics)}\n    ) dut (\n        {comma.join(ports)}\n    );"


def _chunks(total):
    """(bits of the first chunk, number of further chunks) of a word of `total` bits."""
    first = (total - 1) % signature.CHUNK + 1
    return first, (total - first) // signature.CHUNK


def _verilog_append(row_bits):
    """Statements that append `row` to the signature: for Verilator, and for the others."""
    first, more = _chunks(row_bits)
    keep = 64 - first
    size = 64 * signature.WORDS
    two, eight = (64 * (signature.BACK[2] - signature.BACK[3]), 64 * (signature.BACK[1] - signature.BACK[3]))
    low = row_bits + two + eight
    return f"""`ifdef VERILATOR
            high = {{{64 - first}'d0, sig[63:{keep}]}};
            high = high ^ (high << 1);
            sig = {{sig[{keep - 1}:0], row[{row_bits - 1}:{row_bits - first}]}} ^ high ^ (high << 3);
            for (j = {more - 1}; j >= 0; j = j - 1) sig = folded(sig, row[{signature.CHUNK}*j +: {signature.CHUNK}]);
`else
            // one row up: what leaves comes back at 0, {two}, {eight} and {two + eight} bits
            leaves = {{{two}'d0, rest[{size - 1}:{size - row_bits}]}};
            once = {{rest[{size - 1}:{size - row_bits}], {two}'d0}};
            once = (once | leaves) & ~(once & leaves);
            comes = {{{eight}'d0, once}};
            twice = {{once, {eight}'d0}};
            twice = (twice | comes) & ~(twice & comes);
            comes = {{rest[{low - row_bits - 1}:0], row}};
            twice = (twice | comes) & ~(twice & comes);
            rest = {{rest[{size - 1 - row_bits}:{low - row_bits}], twice}};
`endif"""


def _verilog_reduce():
    """Statements that bring the remainder of a frame to 64 bits."""
    size = 64 * signature.WORDS
    first, more = _chunks(size)
    return f"""`ifndef VERILATOR
            sig = {{{64 - first}'d0, rest[{size - 1}:{size - first}]}};
            for (j = {more - 1}; j >= 0; j = j - 1) sig = folded(sig, rest[{signature.CHUNK}*j +: {signature.CHUNK}]);
            rest = {size}'d0;
`endif"""


def verilog_bench(block, case, counts):
    """Self-checking Verilog bench; needs a simulator with delays, nothing else."""
    found, title = benches.results(block), f"{block.stem}/{case}"
    inputs = [(p.name, p) for p in block.columns]
    row_bits, size = signature.padded(counts["out_width"]), 64 * signature.WORDS
    two, eight = (64 * (signature.BACK[2] - signature.BACK[3]), 64 * (signature.BACK[1] - signature.BACK[3]))
    nets = [f"    reg {benches._span(p.width)}{n};" for n, p in inputs]
    nets += [f"    wire {benches._span(p.width)}{n};" for n, p in found]
    shows = [
        f"            if ({n} !== {want}[{hi}:{lo}])\n"
        f'                $display("clock %0d: {n}: expected %0h, got %0h (hex)", n, {want}[{hi}:{lo}], {n});'
        for want, named in (("fed", inputs), ("want", found))
        for n, p, hi, lo in benches._slices(named)
    ]
    return f"""// Self-checking bench of {title}: replays recorded inputs, compares listed rows and a signature of every frame.
// +FRAMES=n stops after n frames. A model of the ADS1298 feeds the ADC master.
`timescale 1ps/1ps
module tb_{block.stem};
    `include "params.vh"

    reg [{CLOCK_BITS - 1}:0] at [0:N_ROWS-1];
    reg [IN_WIDTH-1:0] stim [0:N_ROWS-1];
    reg [OUT_WIDTH-1:0] exp [0:N_ROWS-1];
    reg [63:0] sigs [0:N_FRAMES-1];
    reg [ADC_BITS-1:0] adc [0:N_ADC];
    reg [HOST_BITS-1:0] host [0:N_HOST];
    reg [SAR_BITS-1:0] sar [0:N_SAR];

    reg clk;
{chr(10).join(nets)}
    wire [IN_WIDTH-1:0] given = {{{", ".join(n for n, _ in inputs)}}};
    wire [OUT_WIDTH-1:0] got = {{{", ".join(n for n, _ in found)}}};

`ifndef NO_DESIGN
{_verilog_instance(block, case)}
`endif

    // ---- the converter, after each edge, with the pins as they are then
    reg [215:0] result, shift;
    reg [2:0] pulse, pulse_was;
    reg cs_n_was, sclk_was, drdy_n_was, loaded;
    reg [31:0] conversion, conversion_at;

    task convert(input [31:0] edge_number);
        begin
            loaded = conversion_at == edge_number;
            drdy_n_was = drdy_n;
            pulse_was = pulse;
            if (pulse_was != 0) begin
                pulse = pulse_was - 3'd1;
                if (pulse_was == 1) drdy_n = 1'b0;
            end
            if (loaded) begin
                result = adc[conversion][215:0];
                conversion = conversion + 1;
                conversion_at = conversion < N_ADC ? adc[conversion][ADC_BITS-1 -: 32] : 32'hffffffff;
                if (!drdy_n_was) begin
                    drdy_n = 1'b1;
                    pulse = ADC_PULSE;
                end else if (pulse_was == 0) drdy_n = 1'b0;
            end
            if (o_adc_cs_n !== cs_n_was) begin
                dout = 1'b0;
                shift = o_adc_cs_n ? 216'd0 : result;
            end else if (!o_adc_cs_n && o_adc_sclk !== sclk_was) begin
                if (o_adc_sclk) begin
                    dout = shift[215];
                    shift = shift << 1;
                end else if (!loaded && pulse_was == 0) drdy_n = 1'b1;
            end
            cs_n_was = o_adc_cs_n;
            sclk_was = o_adc_sclk;
        end
    endtask

    // ---- host and samples
    reg [31:0] event_number, event_at, sample, tick_left;

    task drive(input [31:0] edge_number);
        begin
            rst = 1'b0;
            write = 1'b0;
            if (event_at == edge_number) begin
                if (host[event_number][56]) rst = 1'b1;
                else begin
                    write = 1'b1;
                    {{address, data}} = host[event_number][55:0];
                end
                event_number = event_number + 1;
                event_at = event_number < N_HOST ? host[event_number][HOST_BITS-1 -: 32] : 32'hffffffff;
            end
            if (tick_left == 0) begin
                if (sample < N_SAR) {{sample_x, sample_y}} = sar[sample];
                sample = sample + 1;
                tick_left = TICK_CYCLES;
            end
            tick_left = tick_left - 1;
        end
    endtask

    // ---- signature: remainder modulo x^64 + x^4 + x^3 + x + 1 of all rows of a frame, each with zeros in front
    function [63:0] folded(input [63:0] old, input [{signature.CHUNK - 1}:0] chunk);
        reg [63:0] high_bits;
        begin
            high_bits = {{{64 - signature.CHUNK}'d0, old[63:{64 - signature.CHUNK}]}};
            high_bits = high_bits ^ (high_bits << 1);
            folded = {{old[{63 - signature.CHUNK}:0], chunk}} ^ high_bits ^ (high_bits << 3);
        end
    endfunction

    reg [63:0] sig, high;
    reg [ROW_BITS-1:0] row;
    reg [{row_bits + two - 1}:0] leaves, once;
    reg [{row_bits + two + eight - 1}:0] comes, twice;
    reg [{size - 1}:0] rest;
    integer j;

    task append;
        begin
            row = {{{row_bits - counts["out_width"]}'d0, got}};
{_verilog_append(row_bits)}
        end
    endtask

    task finish_frame;
        begin
{_verilog_reduce()}
            if (sig !== sigs[frame]) begin
                if (bad_frames == 0) bad_frame = frame;
                if (bad_frames < {SHOWN})
                    $display("frame %0d, clocks %0d .. %0d: signature: expected %h, got %h; rows of it: gyro golden window FOLDER --frame %0d",
                        frame, frame * FRAME_CYCLES, frame * FRAME_CYCLES + FRAME_CYCLES - 1, sigs[frame], sig, frame);
                bad_frames = bad_frames + 1;
            end
            sig = 64'd0;
            frame = frame + 1;
            left = FRAME_CYCLES;
        end
    endtask

    // ---- rows
    reg [IN_WIDTH-1:0] fed;
    reg [OUT_WIDTH-1:0] want;
    integer n, k, last, frames, frame, left, bad_rows, bad_clock, bad_frames, bad_frame;
    reg [31:0] row_at;

    task show;
        begin
{chr(10).join(shows)}
        end
    endtask

    task compare;
        begin
            fed = stim[k];
            want = exp[k];
            if (got !== want || given !== fed) begin
                if (bad_rows == 0) bad_clock = n;
                if (bad_rows < {SHOWN}) show;
                bad_rows = bad_rows + 1;
            end
            k = k + 1;
            row_at = k < N_ROWS ? at[k] : 32'hffffffff;
        end
    endtask

    initial begin
        $readmemh("at.hex", at);
        $readmemh("stim.hex", stim);
        $readmemh("exp.hex", exp);
        $readmemh("sig.hex", sigs);
        if (N_ADC != 0) $readmemh("adc.hex", adc, 0, N_ADC - 1);
        if (N_HOST != 0) $readmemh("host.hex", host, 0, N_HOST - 1);
        if (N_SAR != 0) $readmemh("sar.hex", sar, 0, N_SAR - 1);
`ifdef VCD_FILE
        $dumpfile(`VCD_FILE);
        $dumpvars(0, tb_{block.stem});
`endif
        if (!$value$plusargs("FRAMES=%d", frames)) frames = N_FRAMES;
        if (frames <= 0 || frames > N_FRAMES) frames = N_FRAMES;
        last = frames * FRAME_CYCLES;
        clk = 1'b0;
        {{drdy_n, dout, sample_x, sample_y, write, address, data}} = {{1'b1, {{(IN_WIDTH - 2){{1'b0}}}}}};
        {{cs_n_was, sclk_was, pulse, result, shift}} = {{1'b1, 436'd0}};
        {{conversion, event_number, sample, tick_left}} = 128'd0;
        conversion_at = N_ADC != 0 ? adc[0][ADC_BITS-1 -: 32] : 32'hffffffff;
        event_at = N_HOST != 0 ? host[0][HOST_BITS-1 -: 32] : 32'hffffffff;
        sig = 64'd0;
        rest = {size}'d0;
        {{k, frame, bad_rows, bad_clock, bad_frames, bad_frame}} = 192'd0;
        left = FRAME_CYCLES;
        row_at = at[0];
`ifdef NO_DESIGN
        $display("NO DESIGN {title}: the bench elaborates, no design was given");
`else
        rst = 1'b1;
        for (n = 0; n < RESET_CYCLES; n = n + 1) begin
            #(HALF_PS) clk = 1'b1;
            #(HALF_PS) clk = 1'b0;
        end
        for (n = 0; n < last; n = n + 1) begin
            if (n != 0) convert(n - 1);
            drive(n);
            #(HALF_PS - 1);
            append;
            if (row_at == n) compare;
            left = left - 1;
            if (left == 0) finish_frame;
            #1 clk = 1'b1;
            #(HALF_PS) clk = 1'b0;
        end
        if (bad_rows == 0 && bad_frames == 0)
            $display("PASS {title}: %0d clocks, %0d rows of {len(found)} ports, %0d of %0d frame signatures", last, k, frames, N_FRAMES);
        else if (bad_rows == 0)
            $display("FAIL {title}: %0d of %0d signatures differ, the first is of frame %0d; all %0d rows agree", bad_frames, frames, bad_frame, k);
        else
            $display("FAIL {title}: %0d of %0d rows differ, the first is at clock %0d; %0d of %0d signatures differ", bad_rows, k, bad_clock, bad_frames, frames);
`endif
        $finish;
    end
endmodule
"""


# ---- VHDL ------------------------------------------------------------------------------------------------------------


def vhdl_bench(block, case, counts):
    """The same in VHDL-2008; `finished` and `errors` are for a surrounding bench."""
    inputs, found = [(p.name, p) for p in block.columns], benches.results(block)
    given, title, name = params_of(block, case), f"{block.stem}/{case}", f"tb_{block.stem}"
    generics = [f"            {key} : {benches._vhdl_type(fmt.width)}" for key, _, fmt in given]
    generics += [f"            {key} : string" for key in ROM_PARAMETERS]
    maps = [f"            {key} => P_{key}" for key, _, _ in given]
    maps += [f'            {key} => DIR & "{path}"' for key, path in ROM_PARAMETERS.items()]
    ports = ["            clk : in std_logic"]
    ports += [f"            {n} : in {benches._vhdl_type(p.width)}" for n, p in inputs]
    ports += [f"            {n} : out {benches._vhdl_type(p.width)}" for n, p in found]
    port_maps = ["                clk => clk"]
    for signal_name, named in (("feed", inputs), ("got", found)):
        port_maps += [
            f"                {n} => {signal_name}{benches._vhdl_slice(p.width, hi, lo)}"
            for n, p, hi, lo in benches._slices(named)
        ]
    place = {n: (hi, lo) for n, _, hi, lo in benches._slices(inputs)}
    pins = {n: hi for n, _, hi, _ in benches._slices(found)}
    shows = [
        f'                    tell("{n}", n, {got}({hi} downto {lo}), {want}({hi} downto {lo}));'
        for got, want, named in (("feed", "fed", inputs), ("got", "want", found))
        for n, p, hi, lo in benches._slices(named)
    ]
    size, row_bits = 64 * signature.WORDS, signature.padded(counts["out_width"])
    first, more = _chunks(size)

    def span(key):
        return f"({place[key][0]} downto {place[key][1]})"

    backs = " xor\n            ".join(
        f"shift_left(resize(leaving, {size}), {64 * back})" if back else f"resize(leaving, {size})"
        for back in signature.BACK
    )
    return f"""-- Self-checking bench of {title}: replays recorded inputs, compares listed rows and a signature of every frame.
-- Generic FRAMES stops after so many frames; 0 runs them all. A model of the ADS1298 feeds the ADC master.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.textio.all;
use work.{block.module}_params.all;

entity {name} is
    generic (
        NO_DESIGN : boolean := false;
        FRAMES : natural := 0;
        DIR : string := ""  -- folder of the bundle, with a slash at its end
    );
    port (
        finished : out boolean := false;
        errors : out natural := 0
    );
end entity;

architecture bench of {name} is
    component {block.module} is
        generic (
{(";" + chr(10)).join(generics)}
        );
        port (
{(";" + chr(10)).join(ports)}
        );
    end component;

    signal clk : std_logic := '0';
    signal feed : std_logic_vector(IN_WIDTH - 1 downto 0) := (others => '0');
    signal got : std_logic_vector(OUT_WIDTH - 1 downto 0);

    procedure tell(port_name : string; n : natural; found, expected : std_logic_vector) is
        variable text_line : line;
    begin
        if found /= expected then
            write(text_line, string'("clock ") & integer'image(n) & ": " & port_name & ": expected "
                & to_hstring(expected) & ", got " & to_hstring(found) & " (hex)");
            writeline(output, text_line);
        end if;
    end procedure;

    -- one chunk of {signature.CHUNK} bits; the remainder is modulo x^64 + x^4 + x^3 + x + 1
    function folded(old, chunk : unsigned) return unsigned is
        variable high : unsigned(63 downto 0) := resize(old(63 downto {64 - signature.CHUNK}), 64);
    begin
        high := high xor shift_left(high, 1);
        return shift_left(old, {signature.CHUNK}) xor resize(chunk, 64) xor high xor shift_left(high, 3);
    end function;

    function reduced(rest : unsigned) return unsigned is
        variable sig : unsigned(63 downto 0) := resize(rest({size - 1} downto {size - first}), 64);
    begin
        for j in {more - 1} downto 0 loop
            sig := folded(sig, rest({signature.CHUNK} * j + {signature.CHUNK - 1} downto {signature.CHUNK} * j));
        end loop;
        return sig;
    end function;

    -- a row is appended modulo x^{size} + ...; what leaves on the left comes back on the right
    function appended(rest : unsigned; row : std_logic_vector) return unsigned is
        variable leaving : unsigned({row_bits - 1} downto 0) := rest({size - 1} downto {size - row_bits});
    begin
        return (shift_left(rest, {row_bits}) or resize(unsigned(row), {size})) xor
            {backs};
    end function;
begin
    given: if not NO_DESIGN generate
        dut: {block.module}
            generic map (
    {("," + chr(10) + "    ").join(maps)}
            )
            port map (
{("," + chr(10)).join(port_maps)}
            );
    end generate;

    main: process
        file at_file, stim_file, exp_file, sig_file, adc_file, host_file, sar_file : text;
        variable text_line : line;
        variable at_word : std_logic_vector({CLOCK_BITS - 1} downto 0);
        variable stim_word : std_logic_vector((IN_WIDTH + 3) / 4 * 4 - 1 downto 0);
        variable exp_word : std_logic_vector((OUT_WIDTH + 3) / 4 * 4 - 1 downto 0);
        variable sig_word : std_logic_vector(63 downto 0);
        variable adc_word : std_logic_vector(ADC_BITS - 1 downto 0);
        variable host_word : std_logic_vector(HOST_BITS - 1 downto 0);
        variable sar_word : std_logic_vector(SAR_BITS - 1 downto 0);
        variable fed : std_logic_vector(IN_WIDTH - 1 downto 0);
        variable want : std_logic_vector(OUT_WIDTH - 1 downto 0);
        variable rest : unsigned({size - 1} downto 0) := (others => '0');
        variable sig : unsigned(63 downto 0);
        variable result, shift : std_logic_vector(215 downto 0) := (others => '0');
        variable cs_n, cs_n_was, drdy_n, drdy_n_was : std_logic := '1';
        variable sclk, sclk_was, dout : std_logic := '0';
        variable pulse, pulse_was : natural := 0;
        variable loaded : boolean;
        variable row_at, conversion_at, event_at : integer := -1;
        variable rows, conversions, events, samples : natural := 0;
        variable frame, bad_rows, bad_clock, bad_frames, bad_frame, last_frame : natural := 0;

        procedure next_row is
        begin
            row_at := -1;
            if rows < N_ROWS then
                readline(at_file, text_line);
                hread(text_line, at_word);
                row_at := to_integer(unsigned(at_word));
                rows := rows + 1;
            end if;
        end procedure;

        procedure next_conversion is
        begin
            conversion_at := -1;
            if conversions < N_ADC then
                readline(adc_file, text_line);
                hread(text_line, adc_word);
                conversion_at := to_integer(unsigned(adc_word(ADC_BITS - 1 downto ADC_BITS - 32)));
                conversions := conversions + 1;
            end if;
        end procedure;

        procedure next_event is
        begin
            event_at := -1;
            if events < N_HOST then
                readline(host_file, text_line);
                hread(text_line, host_word);
                event_at := to_integer(unsigned(host_word(HOST_BITS - 1 downto HOST_BITS - 32)));
                events := events + 1;
            end if;
        end procedure;
    begin
        if NO_DESIGN then
            write(text_line, string'("NO DESIGN {title}: the bench elaborates, no design was given"));
            writeline(output, text_line);
            finished <= true;
            wait;
        end if;
        file_open(at_file, DIR & "at.hex", read_mode);
        file_open(stim_file, DIR & "stim.hex", read_mode);
        file_open(exp_file, DIR & "exp.hex", read_mode);
        file_open(sig_file, DIR & "sig.hex", read_mode);
        file_open(adc_file, DIR & "adc.hex", read_mode);
        file_open(host_file, DIR & "host.hex", read_mode);
        file_open(sar_file, DIR & "sar.hex", read_mode);
        next_row;
        next_conversion;
        next_event;
        last_frame := N_FRAMES;
        if FRAMES > 0 and FRAMES < N_FRAMES then
            last_frame := FRAMES;
        end if;
        feed{span("rst")[:-1].split(" downto")[0] + ")"} <= '1';
        for n in 1 to RESET_CYCLES loop
            wait for HALF_PS * 1 ps;
            clk <= '1';
            wait for HALF_PS * 1 ps;
            clk <= '0';
        end loop;
        for n in 0 to last_frame * FRAME_CYCLES - 1 loop
            -- the converter, after edge n - 1, with the pins as they are then
            if n /= 0 then
                cs_n := got({pins["o_adc_cs_n"]});
                sclk := got({pins["o_adc_sclk"]});
                loaded := conversion_at = n - 1;
                drdy_n_was := drdy_n;
                pulse_was := pulse;
                if pulse_was /= 0 then
                    pulse := pulse_was - 1;
                    if pulse_was = 1 then
                        drdy_n := '0';
                    end if;
                end if;
                if loaded then
                    result := adc_word(215 downto 0);
                    next_conversion;
                    if drdy_n_was = '0' then
                        drdy_n := '1';
                        pulse := ADC_PULSE;
                    elsif pulse_was = 0 then
                        drdy_n := '0';
                    end if;
                end if;
                if cs_n /= cs_n_was then
                    dout := '0';
                    shift := (others => '0');
                    if cs_n = '0' then
                        shift := result;
                    end if;
                elsif cs_n = '0' and sclk /= sclk_was then
                    if sclk = '1' then
                        dout := shift(215);
                        shift := shift(214 downto 0) & '0';
                    elsif not loaded and pulse_was = 0 then
                        drdy_n := '1';
                    end if;
                end if;
                cs_n_was := cs_n;
                sclk_was := sclk;
            end if;
            -- host and samples
            feed({place["rst"][0]}) <= '0';
            feed({place["write"][0]}) <= '0';
            if event_at = n then
                if host_word(56) = '1' then
                    feed({place["rst"][0]}) <= '1';
                else
                    feed({place["write"][0]}) <= '1';
                    feed{span("address")} <= host_word(55 downto 48);
                    feed{span("data")} <= host_word(47 downto 0);
                end if;
                next_event;
            end if;
            if n mod TICK_CYCLES = 0 and samples < N_SAR then
                readline(sar_file, text_line);
                hread(text_line, sar_word);
                feed{span("sample_x")} <= sar_word(35 downto 18);
                feed{span("sample_y")} <= sar_word(17 downto 0);
                samples := samples + 1;
            end if;
            feed({place["drdy_n"][0]}) <= drdy_n;
            feed({place["dout"][0]}) <= dout;
            wait for (HALF_PS - 1) * 1 ps;
            rest := appended(rest, got);
            if row_at = n then
                readline(stim_file, text_line);
                hread(text_line, stim_word);
                readline(exp_file, text_line);
                hread(text_line, exp_word);
                fed := stim_word(IN_WIDTH - 1 downto 0);
                want := exp_word(OUT_WIDTH - 1 downto 0);
                if got /= want or feed /= fed then
                    if bad_rows = 0 then
                        bad_clock := n;
                    end if;
                    if bad_rows < {SHOWN} then
{chr(10).join(shows)}
                    end if;
                    bad_rows := bad_rows + 1;
                end if;
                next_row;
            end if;
            if n mod FRAME_CYCLES = FRAME_CYCLES - 1 then
                sig := reduced(rest);
                rest := (others => '0');
                readline(sig_file, text_line);
                hread(text_line, sig_word);
                if std_logic_vector(sig) /= sig_word then
                    if bad_frames = 0 then
                        bad_frame := frame;
                    end if;
                    if bad_frames < {SHOWN} then
                        write(text_line, string'("frame ") & integer'image(frame) & ", clocks "
                            & integer'image(n + 1 - FRAME_CYCLES) & " .. " & integer'image(n)
                            & ": signature: expected " & to_hstring(sig_word) & ", got " & to_hstring(sig)
                            & "; rows of it: gyro golden window FOLDER --frame " & integer'image(frame));
                        writeline(output, text_line);
                    end if;
                    bad_frames := bad_frames + 1;
                end if;
                frame := frame + 1;
            end if;
            wait for 1 ps;
            clk <= '1';
            wait for HALF_PS * 1 ps;
            clk <= '0';
        end loop;
        if row_at >= 0 then
            rows := rows - 1;  -- one was read ahead
        end if;
        if bad_rows = 0 and bad_frames = 0 then
            write(text_line, string'("PASS {title}: ") & integer'image(last_frame * FRAME_CYCLES) & " clocks, "
                & integer'image(rows) & " rows of {len(found)} ports, " & integer'image(last_frame) & " of "
                & integer'image(N_FRAMES) & " frame signatures");
        elsif bad_rows = 0 then
            write(text_line, string'("FAIL {title}: ") & integer'image(bad_frames) & " of " & integer'image(last_frame)
                & " signatures differ, the first is of frame " & integer'image(bad_frame) & "; all "
                & integer'image(rows) & " rows agree");
        else
            write(text_line, string'("FAIL {title}: ") & integer'image(bad_rows) & " of " & integer'image(rows)
                & " rows differ, the first is at clock " & integer'image(bad_clock) & "; "
                & integer'image(bad_frames) & " of " & integer'image(last_frame) & " signatures differ");
        end if;
        writeline(output, text_line);
        errors <= bad_rows + bad_frames;
        finished <= true;
        wait;
    end process;
end architecture;
"""


# ---- Python tools and make -------------------------------------------------------------------------------------------


def cocotb_top(block, case):
    """The design with the case's parameters as the top level of cocotb; all results in one wide port."""
    found = benches.results(block)
    ports = ["    input wire clk", *(f"    input wire {benches._span(p.width)}{p.name}" for p in block.columns)]
    ports += ["    output wire adc_cs_n", "    output wire adc_sclk", "    output wire [OUT_BITS-1:0] got"]
    nets = [f"    wire {benches._span(p.width)}{n};" for n, p in found]
    return f"""// {block.stem}/{case} with its parameters set
`timescale 1ps/1ps
module cocotb_{block.stem} #(
    parameter OUT_BITS = {sum(p.width for _, p in found)}
) (
{("," + chr(10)).join(ports)}
);
    `include "params.vh"

{chr(10).join(nets)}
    assign got = {{{", ".join(n for n, _ in found)}}};
    assign adc_cs_n = o_adc_cs_n;
    assign adc_sclk = o_adc_sclk;

{_verilog_instance(block, case)}
endmodule
"""


def cocotb_test(block, case):
    """cocotb test (1.9 and 2) that is its own runner: RTL=folder python3 test_top.py."""
    stem = block.stem
    return f'''"""cocotb test of {stem}/{case}; RTL=folder FRAMES=n python3 test_{stem}.py (SIM is icarus, FRAMES 0 runs all)."""

import json
import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = {("top", *(part for part in PARTS))!r}
FRAMES = int(os.environ.get("FRAMES") or {DEFAULT_FRAMES["cocotb"]})
HALF_PS = {HALF_PS}
WORD_BITS, PULSE = {adc_serial.WORD_BITS * adc_serial.WORDS}, {adc_serial.PULSE}
ROW_BITS = {signature.padded(sum(p.width for _, p in benches.results(block)))}
POLYNOMIAL = {signature.POLYNOMIAL:#x}
POWER = {signature.POWER}

try:
    import cocotb
    from cocotb.triggers import Timer
except ImportError:
    sys.exit("cocotb is not installed: pip install cocotb")


def words(name):
    return [int(line, 16) for line in (HERE / name).read_text().split()]


def remainder(value):
    """Of a polynomial over GF(2) modulo the signature's, folded at powers of it first."""
    power = POWER
    while power:
        low = 64 * power
        while value >> low:
            high, value = value >> low, value & ((1 << low) - 1)
            for tap in {signature.TAPS!r}:
                value ^= high << tap * power
        power //= 2
    return value


class Converter:
    """The ADS1298 after each edge, with the pins as they are then."""

    def __init__(self):
        self.conversions = [(word >> WORD_BITS, word & ((1 << WORD_BITS) - 1)) for word in words("adc.hex")][::-1]
        self.cs_n, self.sclk, self.drdy_n, self.dout = 1, 0, 1, 0
        self.pulse = self.result = self.shift = 0

    def step(self, edge, cs_n, sclk):
        loaded = bool(self.conversions) and self.conversions[-1][0] == edge
        drdy_n, pulse = self.drdy_n, self.pulse
        if pulse:
            self.pulse -= 1
            if pulse == 1:
                self.drdy_n = 0
        if loaded:
            self.result = self.conversions.pop()[1]
            if drdy_n == 0:
                self.drdy_n, self.pulse = 1, PULSE
            elif pulse == 0:
                self.drdy_n = 0
        if cs_n != self.cs_n:
            self.dout, self.shift = 0, 0 if cs_n else self.result
        elif not cs_n and sclk != self.sclk:
            if sclk:
                self.dout = self.shift >> (WORD_BITS - 1)
                self.shift = self.shift << 1 & ((1 << WORD_BITS) - 1)
            elif not loaded and pulse == 0:
                self.drdy_n = 1
        self.cs_n, self.sclk = cs_n, sclk


def fields(word, ports):
    """Unsigned values of ports packed side by side."""
    values = []
    for port in reversed(ports):
        values.append(word & ((1 << port["width"]) - 1))
        word >>= port["width"]
    return values[::-1]


@cocotb.test()
async def golden(dut):
    manifest = json.loads((HERE / "manifest.json").read_text())
    ports = manifest["registers"] + manifest["outputs"]
    frame_cycles, tick = manifest["frame_cycles"], manifest["tick_cycles"]
    frames = min(FRAMES or manifest["frames"], manifest["frames"])
    at, stim, exp, sig = words("at.hex"), words("stim.hex"), words("exp.hex"), words("sig.hex")
    host, sar, adc = words("host.hex")[::-1], words("sar.hex"), Converter()
    dut.clk.value = 0
    for port in manifest["inputs"]:
        getattr(dut, port["name"]).value = 1 if port["name"] in ("rst", "drdy_n") else 0
    for _ in range(manifest["reset"]["cycles"]):
        await Timer(HALF_PS, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    wrong, row, stream, busy = 0, 0, 0, True
    fed = dict.fromkeys([port["name"] for port in manifest["inputs"]], 0)
    for n in range(frames * frame_cycles):
        if n:
            adc.step(n - 1, int(dut.adc_cs_n.value), int(dut.adc_sclk.value))
        now = {{**fed, "rst": 0, "write": 0, "drdy_n": adc.drdy_n, "dout": adc.dout}}
        if host and host[-1] >> 60 == n:
            event = host.pop()
            if event >> 56 & 1:
                now["rst"] = 1
            else:
                now.update(write=1, address=event >> 48 & 0xFF, data=event & ((1 << 48) - 1))
        if n % tick == 0 and n // tick < len(sar):
            now.update(sample_x=sar[n // tick] >> 18, sample_y=sar[n // tick] & ((1 << 18) - 1))
        for name, value in now.items():
            if busy or value != fed[name]:
                getattr(dut, name).value = value
        fed, busy = now, False
        await Timer(HALF_PS - 1, "ps")
        text = str(dut.got.value)
        got = int(text, 2) if set(text) <= set("01") else None
        stream = stream << ROW_BITS | (got or 0)
        if stream.bit_length() > 64 * POWER:
            stream = remainder_of_rows(stream)
        if row < len(at) and at[row] == n:
            given = 0
            for port in manifest["inputs"]:
                given = given << port["width"] | fed[port["name"]]
            if got != exp[row] or given != stim[row]:
                wrong += 1
                if wrong <= {SHOWN}:
                    report(dut, n, ports, exp[row], got, text)
                    report(dut, n, manifest["inputs"], stim[row], given, "")
            row += 1
        if n % frame_cycles == frame_cycles - 1:
            frame = n // frame_cycles
            if remainder(stream) != sig[frame]:
                wrong += 1
                dut._log.error("frame %d: signature: expected %016x, got %016x", frame, sig[frame], remainder(stream))
            stream = 0
        await Timer(1, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    assert wrong == 0, f"FAIL {stem}/{case}: {{wrong}} rows or signatures differ"


def remainder_of_rows(value):
    """One fold at the largest power: the stream stays short."""
    low = 64 * POWER
    high, value = value >> low, value & ((1 << low) - 1)
    for tap in {signature.TAPS!r}:
        value ^= high << tap * POWER
    return value


def report(dut, n, ports, expected, got, text):
    """One line for each port that differs."""
    if got is None:
        dut._log.error("clock %d: unknown bits among the results: %s ...", n, text[:40])
        return
    for port, want, have in zip(ports, fields(expected, ports), fields(got, ports)):
        if want != have:
            dut._log.error("clock %d: %s: expected %x, got %x (hex)", n, port["name"], want, have)


def main():
    try:
        from cocotb_tools.runner import get_runner
    except ImportError:
        from cocotb.runner import get_runner
    rtl = os.environ.get("RTL", "")
    sources = [Path(rtl).resolve() / f"{{stem}}.v" for stem in SOURCES] if rtl else []
    if not sources or not sources[0].is_file():
        if rtl:
            sys.exit(f"FAIL {stem}/{case}: no design {{sources[0]}}")
        print("NO DESIGN {stem}/{case}: no design was given")
        return
    build = HERE / "build" / "cocotb"
    runner = get_runner(os.environ.get("SIM", "icarus"))
    files = [HERE / "cocotb_{stem}.v", *(path for path in sources if path.is_file())]
    runner.build(sources=files, includes=[HERE], hdl_toplevel="cocotb_{stem}", build_dir=build, always=True)
    (build / "results.xml").unlink(missing_ok=True)
    done = runner.test(hdl_toplevel="cocotb_{stem}", test_module=Path(__file__).stem, build_dir=build, test_dir=HERE,
                       results_xml=str(build / "results.xml"))
    text = Path(done).read_text()
    if "<failure" in text or "<error" in text or "<testcase" not in text:
        sys.exit("FAIL {stem}/{case}")
    print(f"PASS {stem}/{case}: {{FRAMES or 'all'}} frames")


if __name__ == "__main__":
    main()
'''


def vunit_run(block, case):
    """Run script of VUnit: RTL=folder FRAMES=n python3 run_vunit.py."""
    return f'''"""{block.stem}/{case} under VUnit: RTL=folder python3 run_vunit.py; without RTL it only elaborates."""

import os
from pathlib import Path

from vunit import VUnit

HERE = Path(__file__).resolve().parent
SOURCES = {("top", *PARTS)!r}

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
bench = lib.test_bench("tb_{block.stem}_vunit")
bench.set_generic("no_design", not rtl)
bench.set_generic("frames", int(os.environ.get("FRAMES") or {DEFAULT_FRAMES["vunit"]}))
vu.main()
'''


def vunit_bench(block, case):
    """The VHDL bench as a test of VUnit."""
    text = benches.vunit_bench(block, case)
    text = text.replace("no_design : boolean := false\n", "no_design : boolean := false;\n        frames : natural := 0\n")
    return text.replace("NO_DESIGN => no_design, ", "NO_DESIGN => no_design, FRAMES => frames, ")


def makefile(block, case):
    """`make check SIM=icarus|verilator|ghdl|cocotb|vunit RTL=folder [FRAMES=n]`; without RTL the bench elaborates."""
    stem = block.stem
    defaults = "\n".join(f"FRAMES_{sim} = {frames}" for sim, frames in DEFAULT_FRAMES.items())
    return f"""# {stem}/{case}: make check SIM=icarus|verilator|ghdl|cocotb|vunit RTL=folder (absolute, or from here) [FRAMES=n]
# The folder holds {stem}.v or {stem}.vhd with {block.module}, and its parts; without RTL the bench is only elaborated.
# FRAMES: stop after so many, 0 runs all. Unless given, slow simulators stop early:
{defaults}
SIM ?= icarus
RTL ?=
PYTHON ?= python3
FRAMES ?= $(FRAMES_$(SIM))
PARTS = {" ".join(PARTS)}
SUFFIX = $(if $(filter ghdl vunit,$(SIM)),vhd,v)
WANTED = $(RTL)/{stem}.$(SUFFIX)
DESIGN = $(if $(RTL),$(foreach part,$(PARTS),$(wildcard $(RTL)/$(part).$(SUFFIX))) $(WANTED))
NONE = $(if $(RTL),,-DNO_DESIGN)
RESULT = build/$(SIM).txt
JUDGE = cat $(RESULT); grep -q $(if $(RTL),'^PASS ','^NO DESIGN ') $(RESULT)

check: given
	@$(MAKE) --no-print-directory run-$(SIM) RTL='$(RTL)' SIM=$(SIM) FRAMES=$(FRAMES)

given:
	@mkdir -p build
	@if [ -n '$(RTL)' ] && [ ! -f '$(WANTED)' ]; then echo 'FAIL {stem}/{case}: no design $(WANTED)'; exit 2; fi

run-icarus:
	@iverilog -g2005 -I. -s tb_{stem} $(NONE) -o build/tb.vvp tb_{stem}.v $(DESIGN)
	@vvp -n build/tb.vvp +FRAMES=$(FRAMES) > $(RESULT); $(JUDGE)

run-verilator:
	@verilator --binary --timing -O3 --x-assign fast --x-initial fast -Wno-fatal -Wno-lint -Wno-style -I. \\
	--top-module tb_{stem} $(NONE) --Mdir build/verilator -o sim tb_{stem}.v $(DESIGN) \\
	-CFLAGS -O2 > build/verilator.log 2>&1 || (cat build/verilator.log; exit 2)
	@build/verilator/sim +FRAMES=$(FRAMES) > $(RESULT); $(JUDGE)

run-ghdl:
	@mkdir -p build/ghdl
	@ghdl -a --std=08 --workdir=build/ghdl params_pkg.vhd $(DESIGN) tb_{stem}.vhd
	@ghdl -e --std=08 --workdir=build/ghdl -o build/ghdl/tb tb_{stem} $(if $(RTL),,2> build/ghdl/unbound.log)
	@ghdl -r --std=08 --workdir=build/ghdl tb_{stem} -gFRAMES=$(FRAMES) $(if $(RTL),,-gNO_DESIGN=true) \\
	--max-stack-alloc=0 > $(RESULT) 2>&1; $(JUDGE)

run-cocotb:
	@env -u MAKEFLAGS -u MAKELEVEL SIM=icarus RTL='$(RTL)' FRAMES=$(FRAMES) $(PYTHON) test_{stem}.py > $(RESULT) 2>&1; $(JUDGE)

run-vunit:
	@RTL='$(RTL)' FRAMES=$(FRAMES) $(PYTHON) run_vunit.py -o build/vunit > $(RESULT) 2>&1; status=$$?; tail -8 $(RESULT); exit $$status

clean:
	rm -rf build

.PHONY: check given clean run-icarus run-verilator run-ghdl run-cocotb run-vunit
"""


def texts(block, case, rows, counts):
    """{path: text} of everything above."""
    stem = block.stem
    return {
        **parameters(block, case, rows, counts),
        **benches.rom_files(block),
        f"tb_{stem}.v": verilog_bench(block, case, counts),
        f"cocotb_{stem}.v": cocotb_top(block, case),
        f"tb_{stem}.vhd": vhdl_bench(block, case, counts),
        f"tb_{stem}_vunit.vhd": vunit_bench(block, case),
        f"test_{stem}.py": cocotb_test(block, case),
        "run_vunit.py": vunit_run(block, case),
        "Makefile": makefile(block, case),
    }

"""The Verilog bench, and the top level that cocotb gets.

Verilator gets the signature by chunks of 60 bits, which it turns into words of the machine; Icarus by whole rows, XOR
written with AND and OR, where it is 14 times faster so.
Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import SHOWN
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, GROUP, PART_BITS, ROM_PARAMETERS, SHOWN_ROWS
from testbench.golden.bundles.top_benches.layout import chunks as chunks_of
from testbench.golden.recording import signature
from testbench.golden.stimulus.blocks import params_of


def _verilog_instance(block, case):
    generics = [f".{name}(P_{name})" for name, _, _ in params_of(block, case)]
    generics += [f'.{name}("{path}")' for name, path in ROM_PARAMETERS.items()]
    ports = [".clk(clk)", *(f".{p.name}({p.name})" for p in block.columns)]
    ports += [f".{name}({name})" for name, _ in benches.results(block)]
    comma = ",\n        "
    return f"    {block.module} #(\n        {comma.join(generics)}\n    ) dut (\n        {comma.join(ports)}\n    );"


def _pieces(found, row_bits):
    """Chunks of a row as concatenations of slices of ports, from the left; zeros in front of the first port."""
    first, more = chunks_of(row_bits)
    parts = [("{width}'d0", row_bits - sum(p.width for _, p in found), 0)] + [(n, p.width, 1) for n, p in found]
    chunks, room = [[]], first
    for name, width, is_port in parts:
        left = width
        while left:
            taken = min(left, room)
            if not is_port:
                chunks[-1].append(name.format(width=taken))
            elif taken == width:
                chunks[-1].append(name)
            else:
                chunks[-1].append(f"{name}[{left - 1}:{left - taken}]")
            left, room = left - taken, room - taken
            if not room:
                chunks.append([])
                room = signature.CHUNK
    return ["{" + ", ".join(chunk) + "}" for chunk in chunks[: 1 + more]]


def _nested(names):
    """Concatenation of many ports in two levels: simulators copy what is there for each part that they add."""
    groups = [names[k : k + GROUP] for k in range(0, len(names), GROUP)]
    return "{" + ",\n            ".join("{" + ", ".join(group) + "}" for group in groups) + "}"


def _verilog_append(found, row_bits):
    """Statements that append the ports to the signature: for Verilator, and for the others."""
    first, _ = chunks_of(row_bits)
    head, *others = _pieces(found, row_bits)
    keep, size = 64 - first, 64 * signature.WORDS
    two, eight = _backs()
    low = row_bits + two + eight
    folds = "\n".join(f"            sig = folded(sig, {chunk});" for chunk in others)
    return f"""`ifdef VERILATOR
            high = {{{keep}'d0, sig[63:{keep}]}};
            high = high ^ (high << 1);
            sig = {{sig[{keep - 1}:0], {head}}} ^ high ^ (high << 3);
{folds}
`else
            gather;
            // one row up: what leaves comes back at 0, {two}, {eight} and {two + eight} bits
            leaves = {{{two}'d0, rest[{size - 1}:{size - row_bits}]}};
            once = {{rest[{size - 1}:{size - row_bits}], {two}'d0}};
            once = (once | leaves) & ~(once & leaves);
            comes = {{{eight}'d0, once}};
            twice = {{once, {eight}'d0}};
            twice = (twice | comes) & ~(twice & comes);
            comes = {{rest[{low - row_bits - 1}:0], {row_bits - sum(p.width for _, p in found)}'d0, got}};
            twice = (twice | comes) & ~(twice & comes);
            rest = {{rest[{size - 1 - row_bits}:{low - row_bits}], twice}};
`endif"""


def _backs():
    """Shifts of the two factors of the polynomial of the long remainder: (1 + x^a) (1 + x^b)."""
    return 64 * (signature.BACK[2] - signature.BACK[3]), 64 * (signature.BACK[1] - signature.BACK[3])


def _verilog_reduce():
    """Statements that bring the remainder of a frame to 64 bits."""
    size = 64 * signature.WORDS
    first, more = chunks_of(size)
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
    two, eight = _backs()
    nets = [f"    reg {benches.span(p.width)}{n};" for n, p in inputs]
    nets += [f"    wire {benches.span(p.width)}{n};" for n, p in found]
    shows = [
        f"            if ({n} !== {want}[{hi}:{lo}])\n"
        f'                $display("clock %0d: {n}: expected %0h, got %0h (hex)", n, {want}[{hi}:{lo}], {n});'
        for want, named in (("fed", inputs), ("want", found))
        for n, p, hi, lo in benches.slices(named)
    ]
    return f"""// Self-checking bench of {title}: replays recorded inputs, compares rows and signatures.
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
    reg [OUT_WIDTH-1:0] got;

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
    reg [{row_bits + two - 1}:0] leaves, once;
    reg [{row_bits + two + eight - 1}:0] comes, twice;
    reg [{size - 1}:0] rest;
    integer j;

    task append;
        begin
{_verilog_append(found, row_bits)}
        end
    endtask

    task finish_frame;
        begin
{_verilog_reduce()}
            if (sig !== sigs[frame]) begin
                if (bad_frames == 0) bad_frame = frame;
                if (bad_frames < {SHOWN})
                    $display("frame %0d (clocks %0d .. %0d): signature: expected %h, got %h", frame,
                        frame * FRAME_CYCLES, frame * FRAME_CYCLES + FRAME_CYCLES - 1, sigs[frame], sig);
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

    task gather;
        got = {_nested([n for n, _ in found])};
    endtask

    task compare;
        begin
            gather;
            fed = stim[k];
            want = exp[k];
            if (got !== want || given !== fed) begin
                if (bad_rows == 0) bad_clock = n;
                if (bad_rows < {SHOWN_ROWS}) show;
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
            $display("PASS {title}: %0d clocks, %0d rows of {len(found)} ports, %0d of %0d frames",
                last, k, frames, N_FRAMES);
        else if (bad_rows == 0)
            $display("FAIL {title}: %0d of %0d frames differ, all %0d rows agree; gyro golden window --frame %0d",
                bad_frames, frames, k, bad_frame);
        else
            $display("FAIL {title}: %0d of %0d rows differ, the first is at clock %0d; %0d of %0d frames differ",
                bad_rows, k, bad_clock, bad_frames, frames);
`endif
        $finish;
    end
endmodule
"""


def cocotb_top(block, case):
    """The design with the case's parameters as the top level of cocotb; all results side by side, in parts."""
    found = benches.results(block)
    width = sum(p.width for _, p in found)
    parts = range(-(-width // PART_BITS))
    assigns = [f"    assign got_{k} = got[{PART_BITS * (k + 1) - 1}:{PART_BITS * k}];" for k in parts]
    ports = ["    input wire clk", *(f"    input wire {benches.span(p.width)}{p.name}" for p in block.columns)]
    ports += [
        "    output wire adc_cs_n",
        "    output wire adc_sclk",
        *(f"    output wire [{PART_BITS - 1}:0] got_{k}" for k in parts),
    ]
    nets = [f"    wire {benches.span(p.width)}{n};" for n, p in found]
    return f"""// {block.stem}/{case} with its parameters set
`timescale 1ps/1ps
module cocotb_{block.stem} (
{("," + chr(10)).join(ports)}
);
    `include "params.vh"

{chr(10).join(nets)}
    wire [{PART_BITS * len(parts) - 1}:0] got = {_nested([n for n, _ in found])};
{chr(10).join(assigns)}
    assign adc_cs_n = o_adc_cs_n;
    assign adc_sclk = o_adc_sclk;

{_verilog_instance(block, case)}
endmodule
"""

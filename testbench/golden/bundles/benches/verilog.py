"""Self-checking Verilog bench: Icarus, Verilator, or any other simulator with delays.

Source  docs/golden.md (rows)
"""

from testbench.golden.bundles.benches.layout import SHOWN, inputs_of, results, rom_name, slices
from testbench.golden.stimulus.blocks import params_of


def span(width):
    return f"[{width - 1}:0] " if width > 1 else ""


def instance(block, case, inputs):
    """Instance `dut`; `inputs` gives the net of an input port."""
    generics = [f".{name}(P_{name})" for name, _, _ in params_of(block, case)]
    if block.roms:
        generics.append(f'.ROM_FILE("{rom_name(block)}")')
    ports = [".clk(clk)", *(f".{name}({inputs(name)})" for name, _ in inputs_of(block))]
    ports += [f".{name}({name})" for name, _ in results(block)]
    head = f"{block.module} #(\n        {(',' + chr(10) + '        ').join(generics)}\n    ) dut" if generics else ""
    joined = ",\n        ".join(ports)
    return f"    {head or block.module + ' dut'} (\n        {joined}\n    );"


def verilog_bench(block, case):
    """Self-checking Verilog bench; needs a simulator with delays, nothing else."""
    inputs, found = inputs_of(block), results(block)
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
{instance(block, case, lambda name: f"s_{name}")}
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

"""The Verilog bench, and the top level that cocotb gets.

Verilator gets the signature by chunks of 60 bits, which it turns into words of the machine; Icarus by whole rows, XOR
written with AND and OR, where it is 14 times faster so.
Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import REPORTED_ROWS
from testbench.golden.bundles.benches.template import fill_template
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, GROUP, PART_BITS, pin_validities, sent_slices
from testbench.golden.bundles.top_benches.layout import chunks as chunks_of
from testbench.golden.recording import signature


def _row_chunk_expressions(ports, row_bits):
    """Chunks of a row as concatenations of slices of ports, from the left; zeros in front of the first port."""
    first, more = chunks_of(row_bits)
    parts = [("{width}'d0", row_bits - sum(p.width for _, p in ports), 0)] + [(n, p.width, 1) for n, p in ports]
    chunks, room = [[]], first
    for name, width, is_port in parts:
        remaining_bits = width
        while remaining_bits:
            chunk_bits = min(remaining_bits, room)
            if not is_port:
                chunks[-1].append(name.format(width=chunk_bits))
            elif chunk_bits == width:
                chunks[-1].append(name)
            else:
                chunks[-1].append(f"{name}[{remaining_bits - 1}:{remaining_bits - chunk_bits}]")
            remaining_bits, room = remaining_bits - chunk_bits, room - chunk_bits
            if not room:
                chunks.append([])
                room = signature.CHUNK
    return ["{" + ", ".join(chunk) + "}" for chunk in chunks[: 1 + more]]


def _concatenate_ports(names):
    """Concatenation of many ports in two levels: simulators copy what is there for each part that they add."""
    groups = [names[k : k + GROUP] for k in range(0, len(names), GROUP)]
    return "{" + ",\n            ".join("{" + ", ".join(group) + "}" for group in groups) + "}"


def _verilog_append(result_ports, row_bits):
    """Statements that append the ports to the signature: for Verilator, and for the others."""
    first, _ = chunks_of(row_bits)
    head, *further_chunks = _row_chunk_expressions(result_ports, row_bits)
    keep, size = 64 - first, 64 * signature.WORDS
    two, eight = _backs()
    low = row_bits + two + eight
    folds = "\n".join(f"            sig = folded(sig, {chunk});" for chunk in further_chunks)
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
            comes = {{rest[{low - row_bits - 1}:0], {row_bits - sum(p.width for _, p in result_ports)}'d0, got}};
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


def _sent(design):
    """What the converter sends of the present conversion."""
    slices, zeros = sent_slices(design)
    parts = [f"adc[conversion][{high}:{low}]" for high, low in slices]
    return "{" + ", ".join([*parts, f"{zeros}'d0"]) + "}" if zeros else parts[0]


def _nets(block, clocks):
    """Declarations of what the design shows; a pin that is not judged in every clock has a second net."""
    masked, lines = pin_validities(block, clocks), []
    most = max((validity.clocks for validity in masked.values()), default=0)
    if most:
        lines += [
            f"    reg [{most.bit_length() - 1}:0] age = 0;  // clocks since a reset",
            f"    always @(posedge clk) age <= rst ? 0 : age == {most} ? age : age + 1;",
        ]
    for n, p in benches.result_port_pairs(block):
        if n not in masked:
            lines.append(f"    wire {benches.span(p.width)}{n};")
            continue
        select_n, running = (f"{name}_pin" if name in masked else name for name in masked[n].chip or ("", ""))
        counts = [f"~{select_n} & {running}"] if masked[n].chip else []
        counts += [f"(age >= {masked[n].clocks})"] if masked[n].clocks else []
        lines += [
            f"    wire {benches.span(p.width)}{n}_pin;",
            f"    wire {benches.span(p.width)}{n} = {n}_pin & {{{p.width}{{{' & '.join(counts)}}}}};",
        ]
    return lines


def _instance(block, case, clocks):
    """Instance `dut` with these nets."""
    text = benches.dut_instance(block, case, lambda name: name)
    for n in pin_validities(block, clocks):
        text = text.replace(f".{n}({n})", f".{n}({n}_pin)")
    return text


def verilog_bench(block, case, counts, clocks=None):
    """Self-checking Verilog bench; needs a simulator with delays, nothing else."""
    result_ports = benches.result_port_pairs(block)
    inputs = [(p.name, p) for p in block.columns]
    row_bits, size = signature.padded_width(counts["out_width"]), 64 * signature.WORDS
    two, eight = _backs()
    nets = [f"    reg {benches.span(p.width)}{n};" for n, p in inputs]
    nets += _nets(block, clocks)
    shows = [
        f"            if ({n} !== {want}[{hi}:{lo}])\n"
        f'                $display("clock %0d: {n}: expected %0h, got %0h (hex)", n, {want}[{hi}:{lo}], {n});'
        for want, port_pairs in (("fed", inputs), ("want", result_ports))
        for n, p, hi, lo in benches.slices(port_pairs)
    ]
    return fill_template(
        "top.v.in",
        title=f"{block.stem}/{case}",
        stem=block.stem,
        nets="\n".join(nets),
        inputs=", ".join(n for n, _ in inputs),
        instance=_instance(block, case, clocks),
        sent=_sent(block.record),
        gathered=_concatenate_ports([n for n, _ in result_ports]),
        append=_verilog_append(result_ports, row_bits),
        reduce=_verilog_reduce(),
        shows="\n".join(shows),
        clock_top=CLOCK_BITS - 1,
        chunk_top=signature.CHUNK - 1,
        kept=64 - signature.CHUNK,
        kept_top=63 - signature.CHUNK,
        once_top=row_bits + two - 1,
        twice_top=row_bits + two + eight - 1,
        size=size,
        rest_top=size - 1,
        shown=REPORTED_ROWS,
        shown_rows=counts["shown_rows"],
        count=len(result_ports),
    )


def cocotb_top(block, case, clocks=None):
    """The design with the case's parameters as the top level of cocotb; all results side by side, in parts."""
    result_ports = benches.result_port_pairs(block)
    width = sum(p.width for _, p in result_ports)
    parts = range(-(-width // PART_BITS))
    assigns = [f"    assign got_{k} = got[{PART_BITS * (k + 1) - 1}:{PART_BITS * k}];" for k in parts]
    port_lines = ["    input wire clk", *(f"    input wire {benches.span(p.width)}{p.name}" for p in block.columns)]
    port_lines += [
        "    output wire adc_cs_n",
        "    output wire adc_sclk",
        *(f"    output wire [{PART_BITS - 1}:0] got_{k}" for k in parts),
    ]
    nets = _nets(block, clocks)
    return f"""// {block.stem}/{case} with its parameters set
`timescale 1ps/1ps
module cocotb_{block.stem} (
{("," + chr(10)).join(port_lines)}
);
    `include "params.vh"

{chr(10).join(nets)}
    wire [{PART_BITS * len(parts) - 1}:0] got = {_concatenate_ports([n for n, _ in result_ports])};
{chr(10).join(assigns)}
    assign adc_cs_n = o_adc_cs_n;
    assign adc_sclk = o_adc_sclk;

{_instance(block, case, clocks)}
endmodule
"""

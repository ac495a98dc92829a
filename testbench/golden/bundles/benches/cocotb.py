"""cocotb test, its own runner, and the Verilog top that sets the parameters of the case.

Source  docs/golden.md (using a bench in your own flow)
"""

from testbench.golden.bundles.benches.layout import (
    PARTS,
    REPORTED_ROWS,
    block_levels,
    half_ps,
    input_ports,
    port_count_text,
    result_port_pairs,
)
from testbench.golden.bundles.benches.template import fill_template
from testbench.golden.bundles.benches.verilog import dut_instance, span


def cocotb_top(block, case):
    """The design with the case's parameters, as the top level of cocotb."""
    ports = ["    input wire clk", *(f"    input wire {span(p.width)}{n}" for n, p in input_ports(block))]
    ports += [f"    output wire {span(p.width)}{n}" for n, p in result_port_pairs(block)]
    return f"""// {block.stem}/{case} with its parameters set
`timescale 1ps/1ps
module cocotb_{block.stem} (
{("," + chr(10)).join(ports)}
);
    `include "params.vh"

{dut_instance(block, case, lambda name: name)}
endmodule
"""


def cocotb_test(block, case):
    """cocotb test (1.9 and 2) that is its own runner: RTL=folder SIM=icarus|verilator python3 test_<block>.py."""
    return fill_template(
        "block_test.py.in",
        title=f"{block.stem}/{case}",
        stem=block.stem,
        sources=repr((*PARTS.get(block.stem, ()), block.stem)),
        half_ps=half_ps(block),
        shown=REPORTED_ROWS,
        ports=repr({level: port_count_text(block, level) for level in block_levels(block)}),
        default="registers",
    )

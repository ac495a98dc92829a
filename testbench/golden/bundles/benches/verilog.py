"""Self-checking Verilog bench: Icarus, Verilator, or any other simulator with delays.

Source  docs/golden.md (rows)
"""

from testbench.golden.bundles.benches.layout import (
    REPORTED_ROWS,
    compared_port_names,
    input_ports,
    level_mask,
    port_count_text,
    result_port_pairs,
    rom_parameters,
    set_params,
    slices,
    total_width,
)
from testbench.golden.bundles.benches.template import fill_template


def span(width):
    return f"[{width - 1}:0] " if width > 1 else ""


def dut_instance(block, case, inputs):
    """Instance `dut`; `inputs` gives the net of an input port."""
    generics = [f".{name}(P_{name})" for name in (*block.design_keys, *(n for n, _, _ in set_params(block, case)))]
    generics += [f'.{name}("{path}")' for name, path in rom_parameters(block).items()]
    ports = [".clk(clk)", *(f".{name}({inputs(name)})" for name, _ in input_ports(block))]
    pins, outputs = (compared_port_names(block, level) for level in ("pins", "outputs"))
    ports += [f".{name}({name})" for name in pins]
    output_connections = [f"        , .{name}({name})" for name in outputs if name not in pins]
    register_connections = [f"        , .{name}({name})" for name, _ in result_port_pairs(block) if name not in outputs]
    joined = "\n".join([",\n        ".join(ports), "`ifndef LEVEL_PINS", *output_connections, "`ifndef LEVEL_OUTPUTS",
                        *register_connections, "`endif", "`endif"])  # fmt: skip
    head = f"{block.module} #(\n        {(',' + chr(10) + '        ').join(generics)}\n    ) dut" if generics else ""
    return f"    {head or block.module + ' dut'} (\n        {joined}\n    );"


def verilog_bench(block, case):
    """Self-checking Verilog bench; needs a simulator with delays, nothing else."""
    inputs, result_ports = input_ports(block), result_port_pairs(block)
    nets = [f"    wire {span(p.width)}s_{n} = now[{hi}:{lo}];" for n, p, hi, lo in slices(inputs)]
    nets += [f"    wire {span(p.width)}{n};" for n, p in result_ports]
    shows = [
        f"            if ((({n} ^ want[{hi}:{lo}]) & care[{hi}:{lo}]) !== {p.width}'d0)\n"
        f'                $display("row %0d: {n}: expected %0h, got %0h (hex)", n, want[{hi}:{lo}], {n});'
        for n, p, hi, lo in slices(result_ports)
    ]
    return fill_template(
        "block.v.in",
        title=f"{block.stem}/{case}",
        stem=block.stem,
        nets="\n".join(nets),
        packed=", ".join(n for n, _ in result_ports),
        instance=dut_instance(block, case, lambda name: f"s_{name}"),
        shows="\n".join(shows),
        shown=REPORTED_ROWS,
        **{
            f"mask_{level}": f"{total_width(result_ports)}'h{level_mask(block, level):x}"
            for level in ("pins", "outputs")
        },
        **{f"counted_{level}": port_count_text(block, level) for level in ("pins", "outputs", "registers")},
    )

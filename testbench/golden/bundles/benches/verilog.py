"""Self-checking Verilog bench: Icarus, Verilator, or any other simulator with delays.

Source  docs/golden.md (rows)
"""

from testbench.golden.bundles.benches.layout import SHOWN, inputs_of, results, rom_parameters, slices
from testbench.golden.bundles.benches.template import filled
from testbench.golden.stimulus.blocks import params_of


def span(width):
    return f"[{width - 1}:0] " if width > 1 else ""


def instance(block, case, inputs):
    """Instance `dut`; `inputs` gives the net of an input port."""
    generics = [f".{name}(P_{name})" for name in (*block.keys, *(name for name, _, _ in params_of(block, case)))]
    generics += [f'.{name}("{path}")' for name, path in rom_parameters(block).items()]
    ports = [".clk(clk)", *(f".{name}({inputs(name)})" for name, _ in inputs_of(block))]
    ports += [f".{name}({name})" for name, _ in results(block)]
    head = f"{block.module} #(\n        {(',' + chr(10) + '        ').join(generics)}\n    ) dut" if generics else ""
    joined = ",\n        ".join(ports)
    return f"    {head or block.module + ' dut'} (\n        {joined}\n    );"


def verilog_bench(block, case):
    """Self-checking Verilog bench; needs a simulator with delays, nothing else."""
    inputs, found = inputs_of(block), results(block)
    nets = [f"    wire {span(p.width)}s_{n} = now[{hi}:{lo}];" for n, p, hi, lo in slices(inputs)]
    nets += [f"    wire {span(p.width)}{n};" for n, p in found]
    shows = [
        f"            if ((({n} ^ want[{hi}:{lo}]) & care[{hi}:{lo}]) !== {p.width}'d0)\n"
        f'                $display("row %0d: {n}: expected %0h, got %0h (hex)", n, want[{hi}:{lo}], {n});'
        for n, p, hi, lo in slices(found)
    ]
    return filled(
        "block.v.in",
        title=f"{block.stem}/{case}",
        stem=block.stem,
        nets="\n".join(nets),
        packed=", ".join(n for n, _ in found),
        instance=instance(block, case, lambda name: f"s_{name}"),
        shows="\n".join(shows),
        shown=SHOWN,
        count=len(found),
    )

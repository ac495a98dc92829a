"""Self-checking VHDL-2008 bench: GHDL, or any other simulator of VHDL-2008.

Source  docs/golden.md (rows)
"""

from testbench.golden.bundles.benches.layout import SHOWN, inputs_of, results, rom_parameters, slices
from testbench.golden.bundles.benches.params import vhdl_type
from testbench.golden.bundles.benches.template import filled
from testbench.golden.stimulus.blocks import params_of


def vhdl_slice(width, hi, lo):
    return f"({hi})" if width == 1 else f"({hi} downto {lo})"


def component(block, case, fed):
    """Declaration and instance of the design for a template: inputs come from signal `fed`, results go to `got`."""
    inputs, found, given = inputs_of(block), results(block), params_of(block, case)
    generics = [f"            {key} : natural" for key in block.keys]
    generics += [f"            {key} : {vhdl_type(fmt.width)}" for key, _, fmt in given]
    maps = [f"            {key} => P_{key}" for key in (*block.keys, *(key for key, _, _ in given))]
    for key, path in rom_parameters(block).items():
        generics.append(f"            {key} : string")
        maps.append(f'            {key} => DIR & "{path}"')
    declared, mapped = ";\n".join(generics), ",\n    ".join(maps)
    ports = ["            clk : in std_logic", *(f"            {n} : in {vhdl_type(p.width)}" for n, p in inputs)]
    ports += [f"            {n} : out {vhdl_type(p.width)}" for n, p in found]
    port_maps = ["                clk => clk"]
    for signal, named in ((fed, inputs), ("got", found)):
        port_maps += [f"                {n} => {signal}{vhdl_slice(p.width, hi, lo)}" for n, p, hi, lo in slices(named)]
    return {
        "title": f"{block.stem}/{case}",
        "name": f"tb_{block.stem}",
        "module": block.module,
        "declared": f"        generic (\n{declared}\n        );\n" if generics else "",
        "mapped": f"            generic map (\n    {mapped}\n            )\n" if maps else "",
        "ports": ";\n".join(ports),
        "port_maps": ",\n".join(port_maps),
        "count": len(found),
    }


def vhdl_bench(block, case):
    """Self-checking VHDL-2008 bench; `finished` and `errors` are for a surrounding bench."""
    shows = [
        f'                    tell("{n}", n, got({hi} downto {lo}), want({hi} downto {lo}), care({hi} downto {lo}));'
        for n, p, hi, lo in slices(results(block))
    ]
    return filled("block.vhd.in", **component(block, case, "now"), shows="\n".join(shows), shown=SHOWN)

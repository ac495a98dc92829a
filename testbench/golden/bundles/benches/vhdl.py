"""Self-checking VHDL-2008 bench: GHDL, or any other simulator of VHDL-2008.

Source  docs/golden.md (rows)
"""

from testbench.golden.bundles.benches.layout import SHOWN, inputs_of, results, rom_name, slices
from testbench.golden.bundles.benches.params import vhdl_type
from testbench.golden.bundles.template import filled
from testbench.golden.stimulus.blocks import params_of


def vhdl_slice(width, hi, lo):
    return f"({hi})" if width == 1 else f"({hi} downto {lo})"


def vhdl_bench(block, case):
    """Self-checking VHDL-2008 bench; `finished` and `errors` are for a surrounding bench."""
    inputs, found, given = inputs_of(block), results(block), params_of(block, case)
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
    return filled(
        "block.vhd.in",
        title=f"{block.stem}/{case}",
        name=f"tb_{block.stem}",
        module=block.module,
        declared=declared,
        mapped=mapped,
        ports=";\n".join(ports),
        port_maps=",\n".join(port_maps),
        shows="\n".join(shows),
        shown=SHOWN,
        count=len(found),
    )

"""Self-checking VHDL-2008 bench: GHDL, or any other simulator of VHDL-2008.

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
    slices,
    total_width,
)
from testbench.golden.bundles.benches.params import vhdl_type
from testbench.golden.bundles.benches.template import fill_template
from testbench.golden.stimulus.blocks import case_parameters


def vhdl_slice(width, hi, lo):
    return f"({hi})" if width == 1 else f"({hi} downto {lo})"


def _level_constant_lines(block):
    """Constants of a level: those of the others are comments, or go."""
    word = "constant JUDGED : std_logic_vector(OUT_WIDTH - 1 downto 0) := {};"
    text = 'constant COUNTED : string := "{}";'
    width = total_width(result_port_pairs(block))
    for level in ("registers", "outputs", "pins"):
        bits = "(others => '1')" if level == "registers" else f'"{level_mask(block, level):0{width}b}"'
        for line in (word.format(bits), text.format(port_count_text(block, level))):
            yield f"    {line}  -- level registers" if level == "registers" else f"    --{level}-- {line}"


def component(block, case, fed):
    """Declaration and instance of the design for a template: inputs come from signal `fed`, results go to `got`."""
    inputs, result_ports, case_params = input_ports(block), result_port_pairs(block), case_parameters(block, case)
    generics = [f"            {key} : natural" for key in block.design_keys]
    generics += [f"            {key} : {vhdl_type(fmt.width)}" for key, _, fmt in case_params]
    maps = [f"            {key} => P_{key}" for key in (*block.design_keys, *(key for key, _, _ in case_params))]
    for key, path in rom_parameters(block).items():
        generics.append(f"            {key} : string")
        maps.append(f'            {key} => DIR & "{path}"')
    declared, mapped = ";\n".join(generics), ",\n    ".join(maps)
    # a line of a level goes, with its separator, where check.sh leaves that level out; so the inputs come last
    mark = dict.fromkeys(compared_port_names(block, "pins"), "")
    mark = dict.fromkeys(compared_port_names(block, "outputs"), "  -- level outputs") | mark
    marks = {n: mark.get(n, "  -- level registers") for n, _ in result_ports}
    ports = [f"            {n} : out {vhdl_type(p.width)};{marks[n]}" for n, p in result_ports]
    ports += [f"            {n} : in {vhdl_type(p.width)};" for n, p in inputs] + ["            clk : in std_logic"]
    port_maps = [
        f"                {n} => got{vhdl_slice(p.width, hi, lo)},{marks[n]}" for n, p, hi, lo in slices(result_ports)
    ]
    port_maps += [f"                {n} => {fed}{vhdl_slice(p.width, hi, lo)}," for n, p, hi, lo in slices(inputs)]
    port_maps += ["                clk => clk"]
    return {
        "title": f"{block.stem}/{case}",
        "name": f"tb_{block.stem}",
        "module": block.module,
        "declared": f"        generic (\n{declared}\n        );\n" if generics else "",
        "mapped": f"            generic map (\n    {mapped}\n            )\n" if maps else "",
        "ports": "\n".join(ports),
        "port_maps": "\n".join(port_maps),
        "judged": "\n".join(_level_constant_lines(block)),
        "count": len(result_ports),
    }


def vhdl_bench(block, case):
    """Self-checking VHDL-2008 bench; `finished` and `errors` are for a surrounding bench."""
    shows = [
        f'                    tell("{n}", n, got({hi} downto {lo}), want({hi} downto {lo}), care({hi} downto {lo}));'
        for n, p, hi, lo in slices(result_port_pairs(block))
    ]
    return fill_template("block.vhd.in", **component(block, case, "now"), shows="\n".join(shows), shown=REPORTED_ROWS)

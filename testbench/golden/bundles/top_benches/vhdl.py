"""The VHDL-2008 bench.

Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import SHOWN
from testbench.golden.bundles.template import filled
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, ROM_PARAMETERS, SHOWN_ROWS, chunks
from testbench.golden.recording import signature
from testbench.golden.stimulus.blocks import params_of


def vhdl_bench(block, case, counts):
    """The same in VHDL-2008; `finished` and `errors` are for a surrounding bench."""
    inputs, found = [(p.name, p) for p in block.columns], benches.results(block)
    given = params_of(block, case)
    generics = [f"            {key} : {benches.vhdl_type(fmt.width)}" for key, _, fmt in given]
    generics += [f"            {key} : string" for key in ROM_PARAMETERS]
    maps = [f"            {key} => P_{key}" for key, _, _ in given]
    maps += [f'            {key} => DIR & "{path}"' for key, path in ROM_PARAMETERS.items()]
    ports = ["            clk : in std_logic"]
    ports += [f"            {n} : in {benches.vhdl_type(p.width)}" for n, p in inputs]
    ports += [f"            {n} : out {benches.vhdl_type(p.width)}" for n, p in found]
    port_maps = ["                clk => clk"]
    for signal_name, named in (("feed", inputs), ("got", found)):
        port_maps += [
            f"                {n} => {signal_name}{benches.vhdl_slice(p.width, hi, lo)}"
            for n, p, hi, lo in benches.slices(named)
        ]
    place = {n: (hi, lo) for n, _, hi, lo in benches.slices(inputs)}
    pins = {n: hi for n, _, hi, _ in benches.slices(found)}
    shows = [
        f'                    tell("{n}", n, {got}({hi} downto {lo}), {want}({hi} downto {lo}));'
        for got, want, named in (("feed", "fed", inputs), ("got", "want", found))
        for n, p, hi, lo in benches.slices(named)
    ]
    size, row_bits = 64 * signature.WORDS, signature.padded(counts["out_width"])
    first, more = chunks(size)

    backs = " xor\n            ".join(
        f"shift_left(resize(leaving, {size}), {64 * back})" if back else f"resize(leaving, {size})"
        for back in signature.BACK
    )
    return filled(
        "top.vhd.in",
        title=f"{block.stem}/{case}",
        name=f"tb_{block.stem}",
        module=block.module,
        generics=";\n".join(generics),
        maps=",\n    ".join(maps),
        ports=";\n".join(ports),
        port_maps=",\n".join(port_maps),
        shows="\n".join(shows),
        backs=backs,
        size=size,
        rest_top=size - 1,
        row_bits=row_bits,
        row_top=row_bits - 1,
        row_low=size - row_bits,
        first_low=size - first,
        last_chunk=more - 1,
        chunk=signature.CHUNK,
        chunk_top=signature.CHUNK - 1,
        kept=64 - signature.CHUNK,
        clock_top=CLOCK_BITS - 1,
        cs_n=pins["o_adc_cs_n"],
        sclk=pins["o_adc_sclk"],
        **{key: place[key][0] for key in ("rst", "write", "drdy_n", "dout")},
        **{key: "({} downto {})".format(*place[key]) for key in ("address", "data", "sample_x", "sample_y")},
        shown=SHOWN,
        shown_rows=SHOWN_ROWS,
        count=len(found),
    )

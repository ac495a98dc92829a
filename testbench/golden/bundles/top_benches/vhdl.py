"""The VHDL-2008 bench.

Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import SHOWN
from testbench.golden.bundles.benches.template import filled
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, chunks, sent_slices, unread
from testbench.golden.recording import signature


def vhdl_bench(block, case, counts):
    """The same in VHDL-2008; `finished` and `errors` are for a surrounding bench."""
    inputs, found = [(p.name, p) for p in block.columns], benches.results(block)
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
    slices, zeros = sent_slices(block.record)
    design, masked = benches.component(block, case, "feed"), unread(block)
    for n in masked:
        design["port_maps"] = design["port_maps"].replace(f"{n} => got({pins[n]}),", f"{n} => {n},")
    sent = [f"adc_word({high} downto {low})" for high, low in slices]
    return filled(
        "top.vhd.in",
        sent=" & ".join([*sent, *([f'"{0:0{zeros}}"'] if zeros else [])]),
        **design,
        data_pins="".join(f"    signal {n} : std_logic;\n" for n in masked),
        read_pins="".join(f"    got({pins[n]}) <= {n} and not got({pins[select]});\n" for n, select in masked.items()),
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
        shown_rows=counts["shown_rows"],
    )

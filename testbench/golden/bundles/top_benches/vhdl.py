"""The VHDL-2008 bench.

Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import REPORTED_ROWS
from testbench.golden.bundles.benches.template import fill_template
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, chunks, pin_validities, sent_slices
from testbench.golden.recording import signature


def _port_high_bit(block, name):
    return next(hi for n, _, hi, _ in benches.slices(benches.result_port_pairs(block)) if n == name)


def _read(block, clocks):
    """(masked pins, declarations, statements) of the pins that are not judged in every clock."""
    masked = pin_validities(block, clocks)
    most, declared, lines = max((validity.clocks for validity in masked.values()), default=0), [], []
    if most:
        declared.append(f"    signal age : natural range 0 to {most} := 0;  -- clocks since a reset")
        reset = next(hi for n, _, hi, _ in benches.slices([(p.name, p) for p in block.columns]) if n == "rst")
        lines += [
            "    aged: process(clk)", "    begin", "        if rising_edge(clk) then",
            f"            if feed({reset}) = '1' then", "                age <= 0;",
            f"            elsif age < {most} then", "                age <= age + 1;",
            "            end if;", "        end if;", "    end process;",
        ]  # fmt: skip
    for n, p, hi, lo in benches.slices(benches.result_port_pairs(block)):
        if n not in masked:
            continue
        slice_text = benches.vhdl_slice(p.width, hi, lo)
        zero = "'0'" if p.width == 1 else "(others => '0')"
        counts = [f"age >= {masked[n].clocks}"] if masked[n].clocks else []
        if masked[n].chip:
            select_n, running = (
                name if name in masked else f"got({_port_high_bit(block, name)})" for name in masked[n].chip
            )
            counts.append(f"{select_n} = '0' and {running} = '1'")
        declared.append(f"    signal {n} : {benches.vhdl_type(p.width)};")
        lines.append(f"    got{slice_text} <= {n} when {' and '.join(counts)} else {zero};")
    return masked, "".join(f"{line}\n" for line in declared), "".join(f"{line}\n" for line in lines)


def vhdl_bench(block, case, counts, clocks=None):
    """The same in VHDL-2008; `finished` and `errors` are for a surrounding bench."""
    inputs, result_ports = [(p.name, p) for p in block.columns], benches.result_port_pairs(block)
    input_slices = {n: (hi, lo) for n, _, hi, lo in benches.slices(inputs)}
    pins = {n: hi for n, _, hi, _ in benches.slices(result_ports)}
    shows = [
        f'                    tell("{n}", n, {got}({hi} downto {lo}), {want}({hi} downto {lo}));'
        for got, want, port_pairs in (("feed", "fed", inputs), ("got", "want", result_ports))
        for n, p, hi, lo in benches.slices(port_pairs)
    ]
    size, row_bits = 64 * signature.WORDS, signature.padded_width(counts["out_width"])
    first, more = chunks(size)
    backs = " xor\n            ".join(
        f"shift_left(resize(leaving, {size}), {64 * back})" if back else f"resize(leaving, {size})"
        for back in signature.BACK
    )
    slices, zeros = sent_slices(block.record)
    design, (masked, declared, statements) = benches.component(block, case, "feed"), _read(block, clocks)
    for n, p, hi, lo in benches.slices(result_ports):
        if n in masked:
            port_map_line = f"{n} => got{benches.vhdl_slice(p.width, hi, lo)},"
            design["port_maps"] = design["port_maps"].replace(port_map_line, f"{n} => {n},")
    sent = [f"adc_word({high} downto {low})" for high, low in slices]
    return fill_template(
        "top.vhd.in",
        sent=" & ".join([*sent, *([f'"{0:0{zeros}}"'] if zeros else [])]),
        **design,
        data_pins=declared,
        read_pins=statements,
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
        **{key: input_slices[key][0] for key in ("rst", "write", "drdy_n", "dout")},
        **{key: "({} downto {})".format(*input_slices[key]) for key in ("address", "data", "sample_x", "sample_y")},
        shown=REPORTED_ROWS,
        shown_rows=counts["shown_rows"],
    )

"""The cocotb test: replay, rows and signature in Python, clock by clock.

Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from analog_frontend.parts import adc_serial
from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import PARTS
from testbench.golden.bundles.benches.template import fill_template
from testbench.golden.bundles.top_benches.layout import DEFAULT_FRAMES, PART_BITS, REPORTED_ROWS, sent_slices
from testbench.golden.recording import signature


def cocotb_test(block, case):
    """cocotb test (1.9 and 2) that is its own runner: RTL=folder python3 test_top.py."""
    stem = block.stem
    slices, _ = sent_slices(block.record)
    size, field_expressions = adc_serial.WORD_BITS * adc_serial.WORDS, []
    for high, low in slices:
        size -= high - low + 1
        field_expressions.append(f"(word >> {low} & {2 ** (high - low + 1) - 1:#x}) << {size}")
    width = sum(p.width for _, p in benches.result_port_pairs(block))
    return fill_template(
        "top_test.py.in",
        stem=stem,
        case=case,
        sources=repr((*PARTS[stem], stem)),
        default_frames=DEFAULT_FRAMES["cocotb"],
        half_ps=benches.half_ps(block),
        sent=" | ".join(field_expressions) if field_expressions[1:] else "word & ((1 << WORD_BITS) - 1)",
        word_bits=adc_serial.WORD_BITS * adc_serial.WORDS,
        pulse=adc_serial.PULSE,
        row_bits=signature.padded_width(width),
        polynomial=f"{signature.POLYNOMIAL:#x}",
        power=signature.POWER,
        taps=signature.TAPS,
        parts=-(-width // PART_BITS),
        shown=REPORTED_ROWS,
    )

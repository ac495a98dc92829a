"""What the benches of the whole design agree on: constants, parts, widths of what they replay.

Source  docs/golden.md (the whole design)
"""

from typing import NamedTuple

from analog_frontend.parts import adc_serial
from testbench.golden.bundles import benches
from testbench.golden.recording import signature
from testbench.golden.recording.board_pins import READ

CLOCK_BITS = 32
ADC_BITS = CLOCK_BITS + adc_serial.WORDS * adc_serial.WORD_BITS
HOST_BITS = CLOCK_BITS + 4 + 8 + 48
SAR_BITS = 36
GROUP = 15  # ports, about the root of their number
REPORTED_ROWS = 2  # reported in full: each may have two hundred ports
PART_BITS = 1024  # of a word that cocotb reads; Verilator's VPI gives 2048 at most
# Frames that a simulator runs unless FRAMES is given: half a minute or so of each
DEFAULT_FRAMES = {"icarus": 300, "verilator": 0, "ghdl": 20, "cocotb": 20, "cocotb-verilator": 60, "vunit": 20}


def constants(design, counts):
    """(name, integer) of a replay of a design, beside those of every bench.

    counts  {frames, conversions, host_events, samples}
    """
    out_width = counts["out_width"]
    return [
        ("N_FRAMES", counts["frames"]),
        ("N_ADC", counts["conversions"]),
        ("N_HOST", counts["host_events"]),
        ("N_SAR", counts["samples"]),
        ("FRAME_CYCLES", design.frame_clocks),
        ("TICK_CYCLES", design.tick_clocks),
        ("ADC_BITS", ADC_BITS),
        ("HOST_BITS", HOST_BITS),
        ("SAR_BITS", SAR_BITS),
        ("ADC_PULSE", adc_serial.PULSE),
        ("ROW_BITS", signature.padded_width(out_width)),
    ]


class PinValidity(NamedTuple):
    """When a bench judges a pin; elsewhere it takes 0 for it, as rows and signatures do.

    chip    (RTL port that selects the chip, low; RTL port that says that SCLK runs) of a data pin, or None
    clocks  that the pin comes later: so many clocks behind a reset it is not judged
    """

    chip: tuple | None
    clocks: int


def pin_validities(block, clocks=None):
    """{RTL port: PinValidity} of the pins that are not judged in every clock: of a bundle of the pins alone.

    clocks  {pin: clocks that it comes later}
    """
    validity_by_port = {}
    for pin in () if block.registers else block.pins:
        chip, delay_clocks = READ.get(pin.name), (clocks or {}).get(pin.name, 0)
        if chip or delay_clocks:
            validity_by_port[f"o_{pin.name}"] = PinValidity(chip and tuple(f"o_{name}" for name in chip), delay_clocks)
    return validity_by_port


def sent_slices(design):
    """(high, low) bits of a word of adc.hex that the converter sends, in order, and how many zeros follow them."""
    bits, size = design.adc_word_bits, adc_serial.WORDS * adc_serial.WORD_BITS
    if bits == adc_serial.WORD_BITS:
        return [(size - 1, 0)], 0
    tops = range(size - 1, 0, -adc_serial.WORD_BITS)
    return [(top, top - bits + 1) for top in tops], size - bits * adc_serial.WORDS


def _insert_lines(text, before, lines):
    """Text with lines inserted before the last line that begins with `before`."""
    head, mark, tail = text.rpartition(before)
    return head + "".join(f"{line}\n" for line in lines) + mark + tail


def parameters(block, case, rows, counts):
    """{path: text} of params.vh, params.svh and params_pkg.vhd."""
    extra = constants(block.record, counts)
    return {
        "params.vh": benches.params_vh(block, case, rows) + "".join(f"localparam {k} = {v};\n" for k, v in extra),
        "params.svh": _insert_lines(
            benches.params_svh(block, case, rows), "endpackage", [f"    localparam {k} = {v};" for k, v in extra]
        ),
        "params_pkg.vhd": _insert_lines(
            benches.params_pkg(block, case, rows),
            "end package;",
            [f"    constant {k} : natural := {v};" for k, v in extra],
        ),
    }


def chunks(total):
    """(bits of the first chunk, number of further chunks) of a word of `total` bits."""
    first = (total - 1) % signature.CHUNK + 1
    return first, (total - first) // signature.CHUNK

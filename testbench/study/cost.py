"""What the firmware of a design costs: bits of registers, of multipliers and of tables, from the declared formats.

    registers    widths of all registers at the design, less the bits that the design keeps at zero:
                 what prop and acc have beyond the fraction bits of the coefficients, of codes and shift registers of a
                 DAC of n bits what is above n, 24 - n of the codes of an ADC of n bits, wherever they are kept
    multipliers  product of the two widths of each: two sines, two modulators, eight gains of the loops
    tables       rows by width of the sine's table, which both sines share

Source    docs/word_lengths.md
"""

from typing import NamedTuple

from fpga_model import modulator, pi, sine
from fpga_model import top as fpga
from fpga_model.fixed import formats
from testbench.engines import chips
from testbench.flatten import format_leaves

LOOPS = 4
SENSE_LOOPS = 2  # whose error is a code of the ADC; the others' is a result of the CORDIC
CODE_BITS = modulator.CODE.width
WORD_BITS = 24  # of the ADC's codes and of a DAC's shift register


class Cost(NamedTuple):
    """Bits of a design."""

    registers: int
    multipliers: int
    tables: int


def _unused_bits(name, config):
    """Bits of a register that a design keeps at zero."""
    d, board = config.design, chips.dac_chips(config.design)
    role, _, part = name.partition(".")
    for side, chip in (("drive", board.drive), ("sense", board.sense)):
        if role == f"{side}_modulator" and part != "product":
            return CODE_BITS - chip.bits
        if role == f"{side}_dac" and part == "shift":
            return WORD_BITS - chip.master.bits
    if part.endswith(("loop.prop", "loop.acc")):
        return max(d.accumulator_fraction_bits - d.coefficient_fraction_bits, 0)
    if role == "adc" and part in ("shift", "status"):
        return WORD_BITS - d.adc_word_bits
    if role == "adc" and part.startswith("channels") and int(part.rpartition(".")[2]) >= d.adc_channels:
        return WORD_BITS
    if (role == "adc" and part.startswith("channels")) or part in ("rate_loop.error", "quadrature_loop.error"):
        return WORD_BITS - d.adc_bits
    return 0


def design_cost(config):
    """`Cost` of a configuration's firmware."""
    design = config.design_record()
    leaves = format_leaves(formats(fpga.State, design))
    registers = sum(fmt.width - _unused_bits(name, config) for name, fmt in leaves)
    slope, middle, out = (fmt.for_design(design) for fmt in (sine.SLOPE, sine.MIDDLE, sine.OUT))
    coefficient = pi.COEF.width - pi.COEF.f + config.design.coefficient_fraction_bits
    errors = LOOPS * pi.ERR.width - SENSE_LOOPS * (WORD_BITS - config.design.adc_bits)
    multipliers = 2 * slope.width * middle.width + 2 * modulator.AMPLITUDE.width * out.width + 2 * coefficient * errors
    tables = (sine.BASE.for_design(design).width + slope.width) << design.sine_address_bits
    return Cost(registers, multipliers, tables)

"""Rates and word lengths of the firmware in one record: every block, engine, record and report takes them from here.

    tick = tick_clocks clocks, one update of the DACs        frame = frame_ticks ticks, one conversion of the ADC

Formats   each field unsigned, of the bits in its annotation
Source    docs/firmware.md (another design, and what is refused)

The fields are keys of `[design]`: `gyro config --keys`. `Fmt(0, 0, width("dds_bits"))` is [0,0,48] by default, and
`fmt.for_design(design)` the format of another design. Kernels take the record at run time: nothing is compiled again.
"""

from functools import cache
from typing import NamedTuple

from fpga_model.fixed import Term, Width, bits


class Design(NamedTuple):
    """Rates and word lengths; the defaults are those of the paper's board."""

    master_hz: bits(28) = 26_000_000
    tick_clocks: bits(5) = 26
    frame_ticks: bits(9) = 125
    dds_bits: bits(6) = 48
    sine_address_bits: bits(4) = 10
    sine_fraction_bits: bits(4) = 10
    sine_bits: bits(5) = 18
    cordic_iterations: bits(5) = 24
    cordic_guard_bits: bits(4) = 8
    accumulator_fraction_bits: bits(5) = 24
    adc_divider: bits(4) = 2
    adc_word_bits: bits(5) = 24
    adc_channels: bits(4) = 8
    adc_tail_clocks: bits(9) = 54

    @property
    def tick_hz(self):
        """Update rate of the DACs (Hz)."""
        return self.master_hz / self.tick_clocks

    @property
    def frame_clocks(self):
        """Master clocks to a frame."""
        return self.tick_clocks * self.frame_ticks

    @property
    def frame_hz(self):
        """Frame rate of the ADC (Hz)."""
        return self.master_hz / self.frame_clocks


DEFAULT = Design()


@cache
def width(key):
    """The width that a key of the design holds."""
    return Width(0, {Term(key.upper(), getattr(DEFAULT, key), lambda design: getattr(design, key)): 1})


@cache
def count_width(key):
    """The width of a counter that runs from 0 to below what a key of the design holds."""

    def rule(design):
        return (getattr(design, key) - 1).bit_length()

    return Width(0, {Term(f"$clog2({key.upper()})", rule(DEFAULT), rule): 1})

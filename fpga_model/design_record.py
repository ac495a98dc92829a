"""What the firmware is built with: rates and word lengths in one record, `Design`; and widths that follow from it.

A `Width` is the int of the default design that remembers how it comes from the record: formats are written once, with
widths in them, and `fixed.formats(record, design)` gives those of another design.

    ACC = Fmt(1, 0, width("dds_bits") + 2)        ACC.f == 50, and ACC.at(DEFAULT._replace(dds_bits=32)).f == 34

Source    docs/design.md
"""

from typing import NamedTuple


class Design(NamedTuple):
    """Rates and word lengths of a firmware; the defaults are those of the paper's board."""

    master_hz: int = 26_000_000
    tick_clocks: int = 26  # master clocks to an update of the DACs
    frame_ticks: int = 125  # updates to a frame of the ADC
    dds_bits: int = 48  # of the phase, and of frequency and phase words
    sine_address_bits: int = 10  # of the quarter-wave table
    sine_fraction_bits: int = 10  # of the interpolation
    sine_bits: int = 18  # of the sine, sign included

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


class Width(int):
    """A number of bits that the design decides: an int at the default design, `at(design)` at another."""

    def __new__(cls, rule):
        self = super().__new__(cls, rule(DEFAULT))
        self.rule = rule
        return self

    def at(self, design):
        """The number at another design."""
        return int(self.rule(design))

    def __add__(self, other):
        return Width(lambda d: at(self, d) + at(other, d))

    __radd__ = __add__

    def __sub__(self, other):
        return Width(lambda d: at(self, d) - at(other, d))

    def __rsub__(self, other):
        return Width(lambda d: at(other, d) - at(self, d))

    def __neg__(self):
        return Width(lambda d: -at(self, d))


def width(key):
    """The width that a key of `Design` holds."""
    return Width(lambda design: getattr(design, key))


def at(number, design):
    """A width, or a plain number, at a design."""
    return number.at(design) if isinstance(number, Width) else number


def most(*numbers):
    """The largest of some widths."""
    if any(isinstance(n, Width) for n in numbers):
        return Width(lambda d: max(at(n, d) for n in numbers))
    return max(numbers)

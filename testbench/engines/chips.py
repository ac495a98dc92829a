"""The DACs of a board: each a serial master in the firmware and the digital side of a part, for the same frame.

    DAC8811   16 bits, latched by CS        AD5791  20 bits in a frame of 24, latched by LDAC, opened by a control word
    DAC82002  16 bits in a frame of 24      generic any number of bits, nothing else in its frame, latched by SYNC

Source    docs/blocks/spi_dac.md, docs/parts/dac_serial.md
"""

from typing import NamedTuple

from analog_frontend.parts import dac_serial
from fpga_model import spi_dac


class Chip(NamedTuple):
    """A DAC: bits of its code, both sides of its frame, and the fastest SCLK of its data sheet (Hz)."""

    name: str
    bits: int
    master: spi_dac.Params
    part: dac_serial.Params
    most_hz: int


class Chips(NamedTuple):
    """The DACs of drive, sense and V_q, or one thing of each."""

    drive: object
    sense: object
    quadrature: object


DAC8811 = Chip("DAC8811", 16, spi_dac.DAC8811, dac_serial.DAC8811, 50_000_000)
AD5791 = Chip("AD5791", 20, spi_dac.AD5791, dac_serial.AD5791, 35_000_000)
DAC82002 = Chip("DAC82002", 16, spi_dac.DAC82002, dac_serial.DAC82002, 50_000_000)
NAMED = {chip.name: chip for chip in (DAC8811, AD5791, DAC82002)}
DEFAULT = Chips(DAC8811, AD5791, DAC82002)
GENERIC = "generic"
GENERIC_HZ = 200_000_000


def generic(bits, signed=True):
    """A DAC whose frame is its code, most significant bit first, two's complement or straight binary."""
    mask = (1 << bits) - 1
    master = spi_dac.Params(bits=bits, lead=0, ldac=0, flip=0, header=0, control=0, data_mask=mask)
    part = dac_serial.Params(0, 0, mask, bits=bits, sign_bit=1 << (bits - 1) if signed else 0)
    return Chip(GENERIC, bits, master, part, GENERIC_HZ)


def of(design):
    """`Chips` of a [design] section."""
    drive = generic(design.drive_dac_bits) if design.drive_dac == GENERIC else NAMED[design.drive_dac]
    sense = generic(design.sense_dac_bits) if design.sense_dac == GENERIC else NAMED[design.sense_dac]
    quadrature = generic(16, signed=False) if design.quadrature_dac == GENERIC else NAMED[design.quadrature_dac]
    return Chips(drive, sense, quadrature)


def parts(chips):
    """The digital sides, as the engines step them."""
    return Chips(*(chip.part for chip in chips))

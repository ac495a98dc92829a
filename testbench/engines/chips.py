"""The DACs of a board: each a serial master in the firmware and the digital side of a part, for the same frame.

    DAC8811   16 bits, latched by CS        AD5791  20 bits in a frame of 24, latched by LDAC, opened by a control word
    DAC82002  16 bits in a frame of 24      generic a frame, a latch and a code as the keys of its role say

Source    fpga_model/spi_dac.py, analog_frontend/parts/dac_serial.py
"""

from typing import NamedTuple

from analog_frontend.parts import dac_serial
from fpga_model import spi_dac


class Chip(NamedTuple):
    """A DAC: bits of its code, both sides of its frame, and the fastest SCLK (Hz) and its least pulse (s)."""

    name: str
    bits: int
    master: spi_dac.Params
    part: dac_serial.Params
    most_hz: int
    high_s: float


class Chips(NamedTuple):
    """The DACs of drive, sense and V_q, or one thing of each."""

    drive: object
    sense: object
    quadrature: object


DAC8811 = Chip("DAC8811", 16, spi_dac.DAC8811, dac_serial.DAC8811, 50_000_000, 10e-9)
AD5791 = Chip("AD5791", 20, spi_dac.AD5791, dac_serial.AD5791, 35_000_000, 10e-9)
DAC82002 = Chip("DAC82002", 16, spi_dac.DAC82002, dac_serial.DAC82002, 50_000_000, 9e-9)
DAC_CHIPS = {chip.name: chip for chip in (DAC8811, AD5791, DAC82002)}
DEFAULT = Chips(DAC8811, AD5791, DAC82002)
GENERIC = "generic"
GENERIC_HZ, GENERIC_HIGH_S = 200_000_000, 2.5e-9
QUADRATURE_BITS = 16
# Keys of [design] that only a generic DAC has, behind the name of its role
GENERIC_KEYS = ("frame_bits", "command", "tail_bits", "lead_clocks", "latch")


def generic_dac(bits, signed=True, frame_bits=0, command=0, tail_bits=0, lead_clocks=0, latch="SYNC"):
    """A DAC of any frame: command, code and `tail_bits` that it ignores, most significant bit first.

    frame_bits  0 for that of the code and the tail alone
    signed      two's complement, else straight binary
    latch       SYNC: its rise at the frame's end; LDAC: its fall one clock later; load: LDAC falls with the next load
    """
    mask, head = (1 << bits) - 1, bits + tail_bits
    frame_bits = frame_bits or head
    has_ldac = int(latch != "SYNC")
    master = spi_dac.Params(
        bits=frame_bits,
        lead=lead_clocks,
        ldac=int(latch == "LDAC"),
        flip=0,
        header=command << head,
        control=0,
        data_mask=mask,
        tail=tail_bits,
        strobe=int(latch == "load"),
    )
    part = dac_serial.Params(
        (1 << frame_bits) - (1 << head),
        command << head,
        mask,
        bits=frame_bits,
        has_ldac=has_ldac,
        sign_bit=1 << (bits - 1) if signed else 0,
        tail=tail_bits,
    )
    return Chip(GENERIC, bits, master, part, GENERIC_HZ, GENERIC_HIGH_S)


def _role_chip(design, role, bits):
    """The DAC of a role, its SCLK divided."""
    name = getattr(design, f"{role}_dac")
    chip = DAC_CHIPS.get(name)
    if name == GENERIC:
        keys = {key: getattr(design, f"{role}_dac_{key}") for key in GENERIC_KEYS}
        chip = generic_dac(bits, role != "quadrature", **keys)
    return chip._replace(master=chip.master._replace(gap=getattr(design, f"{role}_dac_divider") - 1))


def dac_chips(design):
    """`Chips` of a [design] section."""
    bits = Chips(design.drive_dac_bits, design.sense_dac_bits, QUADRATURE_BITS)
    return Chips(*(_role_chip(design, role, n) for role, n in bits._asdict().items()))


def parts(chips):
    """The digital sides, as the engines step them."""
    return Chips(*(chip.part for chip in chips))

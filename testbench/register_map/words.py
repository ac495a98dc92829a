"""The register map as a bus of 32-bit words sees it.

    byte address = 8 x address in the map        bits 31 .. 0
                   8 x address in the map + 4    bits 47 .. 32, of a register of more than 32 bits: NAME_HI
    low word     = bits of the register in its format, two's complement without sign extension; bits above read 0

A read of NAME_LO latches NAME_HI. A write of NAME_LO is held until NAME_HI is written: both take effect in that clock.
Source  docs/register_map.md
"""

from typing import NamedTuple

from fpga_model import dds, fault_monitor, host_bus, registers, sequencer, spi_slave
from fpga_model.fixed import Fmt

WORD_BITS, WORD_BYTES = 32, 4
BYTES_PER_ADDRESS = 8
LOOPS = ("AGC", "PLL", "FTR", "QSC")
MAP = (*registers.MAP, *host_bus.MAP)  # all that a host sees


def _single(names):
    """{field: (lowest bit, bits)} of fields of one bit, lowest bit first."""
    return {name: (k, 1) for k, name in enumerate(names)}


# Fields of registers, and names of the values 0, 1, .. of others
FIELDS = {
    "control": _single(sequencer.CONTROL_BITS),
    "fault_clear": _single(fault_monitor.NAMES),
    "lock": _single(LOOPS),
    "flags": _single(fault_monitor.NAMES),
    "sample_status": host_bus.sample_status_fields(),
    "spi_errors": _single(spi_slave.ERROR_BITS),
}
VALUES = {"state": sequencer.STATES}


class Field(NamedTuple):
    """Bits low .. low + width - 1 of a word; `reset` None: it is the state of another block. `values`: their names."""

    name: str
    low: int
    width: int
    reset: int | None
    values: tuple = ()


class Word(NamedTuple):
    """A word of the bus: bits `low_bit` .. of the register; `half` is "", "LO" or "HI"."""

    name: str
    address: int
    register: registers.Register
    low_bit: int
    half: str
    fields: tuple


def design_register_map(design):
    """`MAP` of a design: phases have its `dds_bits`, and reset values are its own."""
    reset = registers.reset(design)
    for r in MAP:
        fmt = Fmt(0, 0, design.dds_bits) if r.fmt == dds.PHASE else r.fmt
        yield r._replace(fmt=fmt, reset=getattr(reset, r.name) if r.access == "rw" else r.reset)


def unit(register):
    """Unit of a register's value, "1" if it has none."""
    return register.unit or "1"


def lsb(register):
    """One LSB as text, such as 2^-20 deg/s."""
    of, size = unit(register), f"2^-{register.fmt.f}" if register.fmt.f else "1"
    if of in ("1", "bits"):
        return size
    return f"{size} x {of}" if of[0] in "(0123456789" else f"{size} {of}"


def _fields(register, low_bit, width):
    """Fields of a word that holds `width` bits of a register."""
    has_reset = register.access != "ro" or not register.path
    raw = registers.to_bus(register.reset, register.fmt) >> low_bit if has_reset else None
    bits_by_field = FIELDS.get(register.name, {"VALUE": (0, width)})

    def reset(low, size):
        return None if raw is None else raw >> low & ((1 << size) - 1)

    values = VALUES.get(register.name, ())
    return tuple(Field(name, low, size, reset(low, size), values) for name, (low, size) in bits_by_field.items())


def words(register_map=MAP):
    """Every `Word` of registers, by address."""
    out = []
    for r in register_map:
        name, address = r.name.upper(), r.address * BYTES_PER_ADDRESS
        high = r.fmt.width - WORD_BITS
        if high <= 0:
            out.append(Word(name, address, r, 0, "", _fields(r, 0, r.fmt.width)))
            continue
        out.append(Word(f"{name}_LO", address, r, 0, "LO", _fields(r, 0, WORD_BITS)))
        out.append(Word(f"{name}_HI", address + WORD_BYTES, r, WORD_BITS, "HI", _fields(r, WORD_BITS, high)))
    return tuple(sorted(out, key=lambda word: word.address))

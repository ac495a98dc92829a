"""The register map as text: what every format is compared with. Fields and words are read from the text alone."""

import re
from typing import NamedTuple

from testbench.commands.reference_tables import register_table
from testbench.console.markdown import markdown

# Registers of the port of a host, written by hand; a test compares them with host_bus.MAP
PORT = """
| 0x50 | SAMPLE_RATE | [1,11,20] | - | ro | deg/s | RATE of the newest sample; reading it takes the sample |
| 0x51 | SAMPLE_TEMPERATURE | [1,15,0] | - | ro | 256 code LSB | TEMPERATURE of the sample |
| 0x52 | SAMPLE_STATUS | [0,21,0] | - | ro | bits | of the sample: 0 .. 7 FLAGS, 8 .. 11 STATE, 12 .. 15 LOCK, \
16 .. 18 K, 19 NEW, 20 OVERRUN |
| 0x53 | SAMPLE_NUMBER | [0,12,0] | - | ro | - | number of the sample's 8 kHz frame since reset, modulo 4096 |
| 0x54 | SPI_ERRORS | [0,3,0] | 0x0 | w1c | bits | wrong frames of the SPI port: 0 CRC, 1 LENGTH, 2 COMMAND |
"""
ROW = re.compile(
    r"^\| 0x(\w\w) \| (\w+) \| \[(\d),(-?\d+),(\d+)\] \| (-|0x\w+) \| (\w+) \| ([^|]+) \| ([^|]+) \|$", re.M
)
HW = {"rw": "r", "ro": "w", "w1c": "rw"}


class Row(NamedTuple):
    """A register: index, name, signed, bits, fraction bits, reset as bits (None: not known), access, unit, text."""

    index: int
    name: str
    signed: int
    width: int
    fraction_bits: int
    reset: int | None
    access: str
    unit: str
    text: str

    def bit_names(self):
        """Names of numbered bits, such as `0 RUN, 1 HOLD_AGC`; of a number none."""
        return re.findall(r"\b\d+ ([A-Z_]+)", self.text) if self.unit == "bits" else []

    def ranges(self):
        """[(name, low, width)] of numbered bits, and of ranges such as `0 .. 7 FLAGS`."""
        found = re.findall(r"\b(\d+)(?: \.\. (\d+))? ([A-Z_]+)\b", self.text) if self.unit == "bits" else []
        return [(name, int(low), int(high or low) - int(low) + 1) for low, high, name in found]

    def value_names(self):
        return re.findall(r"\b\d+ ([A-Z_]+)", self.text) if self.name == "STATE" else []


class Part(NamedTuple):
    """A word of the bus, with its fields as (name, low, width, reset)."""

    name: str
    address: int
    row: Row
    fields: list


def rows():
    """Every `Row` of the text."""
    found = []
    for index, name, s, i, f, reset, access, unit, text in ROW.findall(markdown(register_table()) + PORT):
        known = None if reset == "-" else int(reset, 16)
        found.append(Row(int(index, 16), name, int(s), int(s) + int(i) + int(f), int(f), known, access, unit, text))
    assert len(found) == 36
    faults = next(row for row in found if row.name == "FLAGS").bit_names()
    assert len(faults) == 8
    return found


def parts():
    """Every `Part`, by the rules of the bus: eight bytes a register, 32 bits a word."""
    table = rows()
    faults = next(row for row in table if row.name == "FLAGS").bit_names()
    for row in table:
        named = [(name, n, 1) for n, name in enumerate(faults)] if row.name == "FAULT_CLEAR" else row.ranges()
        sizes = [row.width] if row.width <= 32 else [32, row.width - 32]
        for k, size in enumerate(sizes):
            reset = None if row.reset is None else (row.reset // 2 ** (32 * k)) % 2**size
            fields = [
                (name, low, width, None if reset is None else reset // 2**low % 2**width)
                for name, low, width in named or [("VALUE", 0, size)]
            ]
            assert sum(width for _, _, width, _ in fields) == size
            name = row.name + ("", "_LO", "_HI")[0 if len(sizes) == 1 else k + 1]
            yield Part(name, row.index * 8 + k * 4, row, fields)

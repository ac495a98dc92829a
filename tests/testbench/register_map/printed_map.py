"""The register map as the page of the block prints it: what every format is compared with."""

import re
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).parents[3] / "docs" / "blocks" / "registers.md"
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

    def value_names(self):
        return re.findall(r"\b\d+ ([A-Z_]+)", self.text) if self.name == "STATE" else []


class Part(NamedTuple):
    """A word of the bus, with its fields as (name, low, width, reset)."""

    name: str
    address: int
    row: Row
    fields: list


def rows():
    """Every `Row` of the page."""
    found = []
    for index, name, s, i, f, reset, access, unit, text in ROW.findall(PAGE.read_text()):
        known = None if reset == "-" else int(reset, 16)
        found.append(Row(int(index, 16), name, int(s), int(s) + int(i) + int(f), int(f), known, access, unit, text))
    assert len(found) > 30
    faults = next(row for row in found if row.name == "FLAGS").bit_names()
    assert len(faults) == 8
    return found


def parts():
    """Every `Part`, by the rules of the bus: eight bytes a register, 32 bits a word."""
    table = rows()
    faults = next(row for row in table if row.name == "FLAGS").bit_names()
    for row in table:
        names = faults if row.name == "FAULT_CLEAR" else row.bit_names()
        sizes = [row.width] if row.width <= 32 else [32, row.width - 32]
        for k, size in enumerate(sizes):
            reset = None if row.reset is None else (row.reset // 2 ** (32 * k)) % 2**size
            bits = None if reset is None else [reset // 2**n % 2 for n in range(size)]
            fields = [(name, n, 1, bits and bits[n]) for n, name in enumerate(names)] or [("VALUE", 0, size, reset)]
            assert len(fields) in (1, size)
            name = row.name + ("", "_LO", "_HI")[0 if len(sizes) == 1 else k + 1]
            yield Part(name, row.index * 8 + k * 4, row, fields)

"""The paper's printed numbers by symbol, case and temperature; rows and rivals of what is asked about them.

Source    docs/measured_parts.md, docs/references.md
"""

import csv
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError

HEAD = "quantity,symbol,case,temperature_C,value"
ROOM = "room temperature (value not stated)"
TEMPERATURES = ("-20", ROOM, "50")
AGREE = 3.0  # of the paper's own spread


class Rival(NamedTuple):
    """One explanation: what it predicts, and the experiment that would tell."""

    name: str
    predicts: str
    experiment: str


class Row(NamedTuple):
    """One question. `spread` is the paper's own, None if it prints none."""

    name: str
    unit: str
    paper: float
    spread: float | None
    model: float | None
    where: str
    rivals: tuple

    @property
    def explained(self):
        if self.model is None:
            return False
        return self.spread is not None and abs(self.paper - self.model) <= AGREE * self.spread


class Numbers:
    """Values of the paper's list by symbol, case and temperature."""

    def __init__(self, path):
        try:
            text = Path(path).read_text()
        except (OSError, UnicodeDecodeError) as problem:
            raise FileError(f"{path}: cannot be read: {problem}") from None
        if not text.startswith(HEAD):
            raise FileError(f"{path}: line 1: expected a line that begins with {HEAD}")
        self.rows = list(csv.DictReader(text.splitlines()))

    def get(self, symbol, case, temperature=ROOM):
        """The only value of a symbol whose case begins so; FileError if there is none or more."""
        found = [
            r
            for r in self.rows
            if r["symbol"] == symbol and r["case"].startswith(case) and r["temperature_C"] in (temperature, "")
        ]
        if len(found) != 1:
            raise FileError(f"numbers of the paper: {len(found)} values of {symbol}, {case}, {temperature}; one wanted")
        return float(found[0]["value"])

    def spread(self, symbol, case, temperature=ROOM):
        """The number that the paper prints as its spread, `std 20.84`."""
        found = [r for r in self.rows if r["symbol"] == symbol and r["case"].startswith(case)]
        text = next(r["std_or_max_fluctuation"] for r in found if r["temperature_C"] == temperature)
        return float(text.split()[-1])

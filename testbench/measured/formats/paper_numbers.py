"""The paper's printed numbers by symbol, case and temperature; rows and rivals of what is asked about them.

Source    docs/measured_parts.md, docs/references.md
"""

import csv
import math
from typing import NamedTuple

from testbench.errors import FileError
from testbench.storage.inputs import read_lines

HEAD = "quantity,symbol,case,temperature_C,value"
ROOM = "room temperature (value not stated)"
TEMPERATURES = ("-20", ROOM, "50")
MOST = 1e9  # of any number
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
        self.path, lines = path, [line for _, line in read_lines(path)]
        if not lines or not lines[0].startswith(HEAD):
            raise FileError(f"{path}: line 1: expected a line that begins with {HEAD}")
        table = csv.DictReader(lines)
        try:
            # a row that ends early has empty cells
            self.rows = [{key: value or "" for key, value in row.items()} for row in table]
        except csv.Error as problem:
            raise FileError(f"{path}: line {table.line_num}: {problem}") from None

    def get(self, symbol, case, temperature=ROOM):
        """The only value of a symbol whose case begins so; FileError if there is none or more."""
        found = [
            r
            for r in self.rows
            if r["symbol"] == symbol and r["case"].startswith(case) and r["temperature_C"] in (temperature, "")
        ]
        if len(found) != 1:
            raise FileError(f"{self.path}: {len(found)} values of {symbol}, {case}, {temperature}; one wanted")
        return self._number(found[0]["value"], symbol)

    def spread(self, symbol, case, temperature=ROOM):
        """The number that the paper prints as its spread, `std 20.84`."""
        found = [r for r in self.rows if r["symbol"] == symbol and r["case"].startswith(case)]
        texts = [r.get("std_or_max_fluctuation", "") for r in found if r["temperature_C"] == temperature]
        return self._number(texts[0].split()[-1] if texts and texts[0].split() else "", symbol)

    def _number(self, text, symbol):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (0 < abs(value) < MOST):
            raise FileError(f"{self.path}: {symbol}: {text[:40]!r} is not a number other than 0, below {MOST:g}")
        return value

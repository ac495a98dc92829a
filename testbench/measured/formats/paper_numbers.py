"""The paper's printed numbers by symbol, case and temperature, for the rivals of what is not met.

Source    docs/measured_results.md, docs/references.md
"""

import math
from typing import NamedTuple

from testbench.errors import FileError
from testbench.judge.numbers import MOST, table

ROOM = "room temperature (value not stated)"
TEMPERATURES = ("-20", ROOM, "50")


class Rival(NamedTuple):
    """One explanation: what it predicts, and the experiment that would tell."""

    name: str
    predicts: str
    experiment: str


class Numbers:
    """Values of the paper's list by symbol, case and temperature."""

    def __init__(self, path):
        self.path, self.rows = path, table(path)

    def get(self, symbol, case, temperature=ROOM):
        """The only value of a symbol whose case begins so; FileError if there is none or more."""
        matching_rows = [
            r
            for r in self.rows
            if r["symbol"] == symbol and r["case"].startswith(case) and r["temperature_C"] in (temperature, "")
        ]
        if len(matching_rows) != 1:
            raise FileError(
                f"{self.path}: {len(matching_rows)} values of {symbol}, {case}, {temperature}; expected one"
            )
        return self._parse_value(matching_rows[0]["value"], symbol)

    def _parse_value(self, text, symbol):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (0 < abs(value) < MOST):
            raise FileError(f"{self.path}: {symbol}: {text[:40]!r} is not a number other than 0, below {MOST:g}")
        return value

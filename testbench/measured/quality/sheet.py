"""A recording as its columns, whatever file it came from: what the checks look at.

axis      what the rows are ordered by: time, frequency, code        signal    what was measured
setting   what was programmed, such as the volts of a source         slow      room, temperature of a case
other     what only some rules look at
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

AXIS, SIGNAL, SETTING, SLOW, OTHER = "axis", "signal", "setting", "slow", "other"
DB_PER_NEPER = 20 / np.log(10)


class Column(NamedTuple):
    """`values` as the file has them; `error`: what is left of them when their known course is taken off, or None.

    limits     (lowest, highest) that can be, by physics or as the file states
    fast       True: the signal changes from row to row by more than its noise
    resolution what print or unpacking takes away beside the column's own grid
    """

    name: str
    unit: str
    values: np.ndarray
    role: str = SIGNAL
    error: np.ndarray | None = None
    limits: tuple = (-np.inf, np.inf)
    fast: bool = False
    resolution: float = 0.0

    @property
    def unwrapped_values(self):
        """The values; angles without their jumps of a turn."""
        return np.unwrap(self.values, period=360.0) if self.unit == "deg" else self.values

    @property
    def course(self):
        """What the checks of noise look at."""
        return self.unwrapped_values if self.error is None else self.error


class Sheet(NamedTuple):
    """`order`: rows in the order in which neighbours belong together; `stated`: numbers of the file's head by name."""

    place: str
    kind: str
    columns: tuple
    order: np.ndarray | None = None
    stated: Mapping = MappingProxyType({})

    @property
    def rows(self):
        return len(self.columns[0].values)

    def columns_by_role(self, *roles):
        """Columns of these roles."""
        return [c for c in self.columns if c.role in roles]

    def column(self, name):
        """The column of a name, or None."""
        return next((c for c in self.columns if c.name == name), None)

    def reorder_values(self, v):
        """Values in the order in which neighbours belong together."""
        return v if self.order is None else v[self.order]

    def file_rows(self, rows):
        """Rows of the file behind rows of `reorder_values`."""
        return np.asarray(rows) if self.order is None else self.order[rows]

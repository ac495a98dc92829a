"""What a check finds, and what becomes of it by its kind.

    report    the trace goes on; the finding stands beside its result
    correct   the recording is put right as the finding says, and the trace goes on
    refuse    no law is fitted; --option quality=report goes on all the same
Source  docs/quality.md
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.errors import FileError

REPORT, CORRECT, REFUSE = "report", "correct", "refuse"
ACTIONS = {
    "interpolated": REFUSE,
    "duplicated": REFUSE,
    "quantised": REPORT,
    "stuck": REFUSE,
    "spikes": REFUSE,
    "clipped": REFUSE,
    "swapped": REFUSE,
    "unit": REFUSE,
    "gap": REPORT,
    "reversed": REFUSE,
    "drift": REPORT,
}


class Finding(NamedTuple):
    """kind: a key of ACTIONS; column; rows: first and last row, from 1; share of the rows; action; words."""

    place: str
    kind: str
    column: str
    rows: tuple
    share: float
    action: str
    words: str

    def __str__(self):
        where = f", rows {self.rows[0]} .. {self.rows[1]}" if self.rows else ""
        share = f", {100 * self.share:.3g} % of the rows" if self.rows else ""
        return f"{self.place}: {self.kind}: {self.column}{where}{share}: {self.words} ({self.action})"

    def as_json(self):
        """Plain data; the place without its folder, as a report does not depend on where a file lies."""
        return self._asdict() | {"place": Path(self.place).name, "rows": list(self.rows)}


class QualityError(FileError):
    """A recording that is refused by its quality; `findings` are those behind it."""

    def __init__(self, findings):
        self.findings = tuple(findings)
        super().__init__("; ".join(str(f) for f in self.findings))


def from_json(data):
    """`Finding` of `as_json`."""
    return Finding(**data | {"rows": tuple(data["rows"])})


def finding(sheet, kind, column, rows, words, action=None):
    """`Finding` about rows (indices or a mask over all rows; None: the whole column)."""
    if rows is None:
        return Finding(str(sheet.place), kind, column, (), 1.0, action or ACTIONS[kind], words)
    rows = np.flatnonzero(rows) if np.asarray(rows).dtype == bool else np.asarray(rows)
    span = (int(rows.min()) + 1, int(rows.max()) + 1)
    return Finding(str(sheet.place), kind, column, span, len(rows) / sheet.rows, action or ACTIONS[kind], words)

"""What a user says of a design that was not written from ours.

Source  docs/foreign_designs.md
"""

from pathlib import Path
from typing import NamedTuple


class Choice(NamedTuple):
    """What a user says of a design: simulator, level, list of files, top, map and latency file; None if nothing."""

    sim: str | None = None
    level: str | None = None
    files: Path | None = None
    top: str | None = None
    map: Path | None = None
    latency: Path | None = None


AS_OURS = Choice()

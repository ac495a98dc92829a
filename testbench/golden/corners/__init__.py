"""Corners that a search has found: short rows from reset that reach what no directed family of a block reaches.

    BLOCK.json    {"schema", "found": {case: [{"goal": ..., "rows": [[times, {input: value}], ...]}]}, "missing": ...}

An export only replays them, so it needs no search and is the same everywhere. `python -m testbench.golden.corners`
searches again.
Source  docs/golden.md
"""

import functools
import json
from pathlib import Path

FOLDER = Path(__file__).parent
SCHEMA = "gyro-corners/1.0"
FAMILY = "corners_found"


@functools.cache
def stored(stem):
    """What is stored of a block: {"found": {case: [...]}, "missing": {case: {goal: reason}}}; empty if nothing is."""
    path = FOLDER / f"{stem}.json"
    if not path.is_file():
        return {"found": {}, "missing": {}}
    data = json.loads(path.read_text("ascii"))
    if data.get("schema") != SCHEMA or data.get("block") != stem:
        raise ValueError(f"{path}: schema {data.get('schema')!r} of {data.get('block')!r}, not {SCHEMA!r} of {stem!r}")
    return data


def replay(w):
    """Append the found rows to a stimulus, each after a reset of its own; an input that is not named is idle."""
    entries = stored(w.block.stem)["found"].get(w.case, ())
    if not entries:
        return
    w.family(FAMILY)
    for entry in entries:
        w.row(rst=1)
        for times, values in entry["rows"]:
            w.row(values, times=times)

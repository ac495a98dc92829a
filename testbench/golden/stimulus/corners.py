"""Corners that a search has found: short rows from reset that reach what no directed family of a block reaches.

    BLOCK.json    {"schema", "block", "found": {case: [{"goal", "rows"}]}, "missing": {goal: reason}}
    rows          [times, {input: value}, [inputs that count up by 1 from row to row]]; others are idle

An export only replays them, so it needs no search and is the same everywhere. To search again:
`python -m tests.testbench.golden.corners_search`.
Source  docs/golden.md
"""

import functools
from pathlib import Path

from testbench.storage.inputs import read_json

FOLDER = Path(__file__).with_name("corners_found")
SCHEMA = "gyro-corners/1.0"
FAMILY = "corners_found"


def corner_path(stem):
    return FOLDER / f"{stem}.json"


@functools.cache
def load_corners(stem):
    """What is stored of a block; empty if nothing is. Raises ValueError if the file is another's."""
    path = corner_path(stem)
    if not path.is_file():
        return {"found": {}, "missing": {}}
    data = read_json(path)
    if data.get("schema") != SCHEMA or data.get("block") != stem:
        raise ValueError(f"{path}: schema {data.get('schema')!r} of {data.get('block')!r}, not {SCHEMA!r} of {stem!r}")
    return data


def goal_text(goal):
    """A goal as it is stored: kind, place and outcome."""
    return " | ".join(goal)


def append_corner(w, rows):
    """A reset and the rows of one entry."""
    w.append_row(rst=1)
    for times, values, counting in rows:
        for n in range(times if counting else 1):
            w.append_row(
                {**values, **{name: values.get(name, 0) + n for name in counting}}, times=1 if counting else times
            )


def replay(w):
    """Append the family of found corners to a stimulus."""
    entries = load_corners(w.block.stem)["found"].get(w.case, ())
    if entries:
        w.family(FAMILY)
    for entry in entries:
        append_corner(w, entry["rows"])

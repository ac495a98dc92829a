"""All readers of recordings of parts: what a file is by its content, and what the nearest reader lacks in another.

content(path)             what the first reader that knows the file gives; None: none does
describe_unreadable_file(path)   one line: the nearest reader, what it wants and what it found
"""

from collections.abc import Callable
from typing import NamedTuple

from testbench.errors import FileError
from testbench.measured.formats import (
    column_map,
    gyro_npz,
    input_output,
    levels_mat,
    mat_file,
    meters_csv,
    ringdown_text,
    touchstone,
)
from testbench.measured.formats.table import read_table
from testbench.storage import inputs

HEAD_BYTES = 4096


class Reader(NamedTuple):
    """knows(path, head): first look; read(path): content, None if it is of something else."""

    knows: Callable
    read: Callable


READERS = (
    Reader(lambda path, head: ringdown_text.is_one(head), ringdown_text.load),
    Reader(lambda path, head: touchstone.is_one(head), touchstone.load),
    Reader(lambda path, head: meters_csv.is_meters_file(path), meters_csv.read),
    Reader(lambda path, head: gyro_npz.is_zero_rate_file(path), gyro_npz.read),
    Reader(lambda path, head: input_output.is_one(head), input_output.load),
    Reader(lambda path, head: levels_mat.is_levels_file(path), levels_mat.read),
)


def content(path):
    """Content of a recording; None if no reader knows it. FileError: a reader knows it, and it is damaged."""
    head = inputs.head(path, HEAD_BYTES)
    column_map.refuse_other_toml(path)
    for reader in READERS:
        recording = reader.read(path) if reader.knows(path, head) else None
        if recording is not None:
            return recording
    return None


def describe_unreadable_file(path):
    """What the nearest reader lacks in a file that none reads."""
    head = inputs.head(path, HEAD_BYTES)
    text = head.decode("utf-8", "replace")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    first = lines[0][:80] if lines else "nothing"
    if mat_file.is_mat(head):
        mat_arrays = mat_file.read_mat(path)[0]
        sizes = ", ".join(f"{name} {v.shape}" for name, v in list(mat_arrays.items())[:8]) or "no arrays of numbers"
        return f"MATLAB file with {sizes}; expected V1 and V2 (V), or vectors of 2^9 .. 2^18 rising levels (V)"
    comment = next((line for line in lines if line.startswith("%")), None)
    if comment:
        title = next((line for line in lines if line.startswith("%") and "," in line), comment)
        titles = "'% time [s], power [dBm]' or '% frequency [Hz], ...'"
        return f"ring-down or spectrum: found {title[:80]!r}, expected {titles}"
    option = next((line for line in lines if line.startswith("#")), None)
    if option:
        return f"Touchstone: found {option[:80]!r}, expected an option line such as '# Hz S dB R 50'"
    if first.lower().startswith("date") or ";source" in first.lower():
        return f"readings of voltmeters: found {first!r}, expected '{meters_csv.HEAD}...' in line 1"
    try:
        columns = list(read_table(path))
    except FileError as problem:
        return str(problem).partition(": ")[2]
    return f"a table of columns {', '.join(columns[:12])[:200]}"

"""Signals of a dump by their paths, as maps write them: what only some tools put before, into or behind a path.

Source    docs/golden.md
"""

import difflib
import re

from testbench.errors import FileError

SLICE = re.compile(r"^(.*?)\s*\[(\d{1,6})(?::(\d{1,6}))?\]$")


def _normalised_path(name):
    """A path without what only some tools write: the backslash of an escaped name, a dot before an index."""
    return re.sub(r"(^|\.)\\", r"\1", name).replace(".[", "[")


def index_signals(pairs):
    """{path: signal} of (path, signal); None where two signals have one path."""
    signal_index = {}
    for name, signal in pairs:
        name = _normalised_path(name)
        signal_index[name] = signal if signal_index.get(name, signal) == signal else None
    return signal_index


def find_signal(path, signal_index, where):
    """(signal, hi, lo) of a path of the map: the whole signal, or a slice of it.

    Verilator puts everything below TOP, and GHDL leaves the top out of an FST: both may be missing in the map.
    """
    spelled = _normalised_path(path)
    head, _, stripped_path = spelled.partition(".")
    ways = [spelled, f"TOP.{spelled}"]
    if stripped_path and not any(name.startswith(f"{head}.") for name in signal_index):
        ways.append(stripped_path)
    for way in ways:
        slice_match = SLICE.match(way)
        if way in signal_index:
            name, hi, lo = way, None, None
        elif slice_match and slice_match[1] in signal_index:
            name, hi = slice_match[1], int(slice_match[2])
            lo = hi if slice_match[3] is None else int(slice_match[3])
            if hi < lo:
                raise FileError(f"{where}: slice {path}: high bit {hi} is below low bit {lo}")
        else:
            continue
        if signal_index[name] is None:
            raise FileError(f"{where}: duplicate signal {path} in the dump")
        return name, hi, lo
    tail = spelled.rsplit(".", 1)[-1].split("[")[0]
    similar_paths = sorted(name for name in signal_index if name.rsplit(".", 1)[-1] == tail)[:4]
    similar_paths = similar_paths or difflib.get_close_matches(spelled, signal_index, n=2)
    hint = f"; similar: {', '.join(similar_paths)}" if similar_paths else ""
    raise FileError(f"{where}: no signal {path}{hint}")

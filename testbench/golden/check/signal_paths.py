"""Signals of a dump by their paths, as maps write them: what only some tools put before, into or behind a path.

Source    docs/golden.md
"""

import difflib
import re

from testbench.errors import FileError

SLICE = re.compile(r"^(.*?)\s*\[(\d{1,6})(?::(\d{1,6}))?\]$")


def _spelled(name):
    """A path without what only some tools write: the backslash of an escaped name, a dot before an index."""
    return re.sub(r"(^|\.)\\", r"\1", name).replace(".[", "[")


def listed_signals(pairs):
    """{path: signal} of (path, signal); None where two signals have one path."""
    known = {}
    for name, signal in pairs:
        name = _spelled(name)
        known[name] = signal if known.get(name, signal) == signal else None
    return known


def wanted_signal(path, known, where):
    """(signal, hi, lo) of a path of the map: the whole signal, or a slice of it.

    Verilator puts everything below TOP, and GHDL leaves the top out of an FST: both may be missing in the map.
    """
    spelled = _spelled(path)
    head, _, rest = spelled.partition(".")
    ways = [spelled, f"TOP.{spelled}"]
    if rest and not any(name.startswith(f"{head}.") for name in known):
        ways.append(rest)
    for way in ways:
        found = SLICE.match(way)
        if way in known:
            name, hi, lo = way, None, None
        elif found and found[1] in known:
            name, hi = found[1], int(found[2])
            lo = hi if found[3] is None else int(found[3])
            if hi < lo:
                raise FileError(f"{where}: slice {path}: {hi} is below {lo}")
        else:
            continue
        if known[name] is None:
            raise FileError(f"{where}: signal {path} is there more than once")
        return name, hi, lo
    tail = spelled.rsplit(".", 1)[-1].split("[")[0]
    near = sorted(name for name in known if name.rsplit(".", 1)[-1] == tail)[:4]
    near = near or difflib.get_close_matches(spelled, known, n=2)
    hint = f"; there is {', '.join(near)}" if near else ""
    raise FileError(f"{where}: no signal {path}{hint}")

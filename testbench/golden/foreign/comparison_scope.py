"""What of a bundle is judged of a design: its reset, and the clocks that its ports come later.

    reset sync   every row
          async  not the first row of a reset: the design has already left its state
          none   the longest part of the stimulus without a reset, from the state of reset on: power-up is the reset
    latency k    row n of a port is expected at row n + k; rows n with a reset in n .. n + k - 1 are not judged

`ComparisonScope.care` is aligned with the golden rows: row n of a port is what the design shows at row n + k.
Source  docs/foreign_designs.md
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.errors import FileError
from testbench.golden.foreign import latency_effects
from testbench.golden.stimulus import levels
from testbench.storage.inputs import read_toml

SCHEMA = "gyro-latency/1.0"
MOST_CLOCKS = 1 << 12


class ComparisonScope(NamedTuple):
    """A bundle, or the part of it that a design without a reset can follow.

    golden   `bundles.bundle.Bundle`
    first    row of the whole bundle that row 0 is
    clocks   {RTL port: extra clocks}
    care     bool, a row for each golden row and a column for each register and output of the manifest
    """

    golden: tuple
    level: str
    first: int
    clocks: dict
    care: np.ndarray


def read_latency(path, manifest, level):
    """{RTL port: clocks} of a latency file; FileError for a port that the level does not judge."""
    path = Path(path)
    tree = read_toml(path, error=FileError)
    if tree.get("schema") != SCHEMA:
        raise FileError(f"{path}: schema: {tree.get('schema')!r} is not {SCHEMA}")
    for key in tree:
        if key not in ("schema", "ports"):
            raise FileError(f"{path}: key: {key!r} is not one of schema, ports")
    if not isinstance(tree.get("ports", {}), dict):
        raise FileError(f"{path}: ports: {tree['ports']!r} is not a table of port = clocks")
    latency_by_port, ports = {}, levels.compared_ports(manifest, level)
    if level == "registers" and tree.get("ports"):
        raise FileError(f"{path}: [ports]: latencies are for level pins or outputs; level registers allows none")
    for name, clocks in tree.get("ports", {}).items():
        fits = [port for port, p in ports if name in (port, p["name"])]
        if len(fits) != 1:
            raise FileError(
                f"{path}: [ports]: level {level} compares no port {name}; it compares {', '.join(n for n, _ in ports)}"
            )
        if type(clocks) is not int or not 0 <= clocks <= MOST_CLOCKS:
            raise FileError(f"{path}: [ports] {name}: {clocks!r} is not 0 .. {MOST_CLOCKS} clocks")
        latency_by_port[fits[0]] = clocks
    latency_effects.check(path, manifest["block"], latency_by_port)
    return latency_by_port


def _free(reset):
    """First row and end of the longest part without a reset; its first row is the state of reset."""
    edges = np.flatnonzero(np.diff(np.r_[1, reset, 1]))
    begins, ends = edges[::2], edges[1::2]
    if not len(begins):
        raise FileError("stimulus: every row has a reset, so a design without a reset cannot be compared")
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])


def build_scope(golden, level, style="sync", clocks=None):
    """`ComparisonScope` of a bundle that was read, at a level, for a design of this reset style and latency."""
    manifest, clocks = golden.manifest, clocks or {}
    names = [name for name, _ in levels.compared_ports(manifest, "registers")]
    first, reset = 0, golden.stim[:, 0] != 0
    care = golden.mask != 0
    if style == "none":
        first, end = _free(reset)
        # the edge of a reset leaves the row before it as it was
        end = min(end + 1, len(reset))
        part = {name: getattr(golden, name)[first:end].copy() for name in ("stim", "exp", "mask", "at")}
        golden = golden._replace(**part)
        manifest = {**manifest, "n": end - first, "reset": {**manifest["reset"], "cycles": 0}}
        care, reset = care[first:end], reset[first:end].copy()
        golden.stim[:, 0], reset[:] = 0, False
    else:
        care = care.copy()
    level_port_names = {name for name, _ in levels.compared_ports(manifest, level)}
    for column, name in enumerate(names):
        care[:, column] &= name in level_port_names
        _mask_reset_rows(care[:, column], reset, style, clocks.get(name, 0))
    clocks = {name: k for name, k in clocks.items() if k}
    return ComparisonScope(golden._replace(manifest=manifest), level, first, clocks, care)


def _mask_reset_rows(care, reset, style, clocks):
    """Leave out the rows of a port, `clocks` late, that a reset makes those of no particular design."""
    reset_starts = reset & ~np.r_[True, reset[:-1]] if style == "async" else np.zeros(len(reset), bool)
    rows = len(reset)
    for k in range(clocks):
        # row n of the model is row n + clocks of the design, which a reset at n + k has cleared or not
        care[: rows - k] &= ~reset[k:]
        care[rows - k :] = False
    care[: rows - clocks] &= ~reset_starts[clocks:]
    care[rows - clocks :] = False


def remove_latency(scope, columns, port):
    """Column of a port with its extra clocks taken out; rows beyond the end repeat the last."""
    column = columns
    k = min(scope.clocks.get(port, 0), len(column.values))
    if not k:
        return column
    order = np.minimum(np.arange(len(column.values)) + k, len(column.values) - 1)
    return type(column)(column.values[order], column.valid[order])


def delayed_rows(scope):
    """(exp, mask) as the design shows them: each port `clocks` later, and no bit judged that `care` leaves out."""
    golden, names = scope.golden, [name for name, _ in levels.compared_ports(scope.golden.manifest, "registers")]
    exp, mask = golden.exp.copy(), np.where(scope.care, golden.mask, 0)
    for column, name in enumerate(names):
        k = scope.clocks.get(name, 0)
        if k:
            exp[k:, column], exp[:k, column] = golden.exp[:-k, column], 0
            mask[k:, column], mask[:k, column] = mask[:-k, column].copy(), 0
    return exp, mask

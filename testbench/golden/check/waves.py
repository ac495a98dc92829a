"""Logs of other people's simulations as columns: VCD, FST and GHW dumps and CSV, through a map from port to signal.

    schema = "gyro-map/1.0"                 row 0 is the first active edge that sees reset released;
    [clock]                                 without [reset] it is active edge `first_edge` (default 0)
    signal = "tb.clk"
    edge = "rising"                         or "falling"
    [reset]                                 optional
    signal = "tb.rst"
    active = 1
    [ports]                                 port of the manifest = path in the dump, or a slice of it
    phase = "tb.dut.phase"
    taps_0 = "tb.dut.taps[17:0]"

A row is what the dump shows just before the active edge: a change at the instant of the edge comes after it.
A bit that is not 0 or 1 makes the value of that row unknown. Values are two's complement of the port's own width.
FST is read with pywellen, which is optional; the others need nothing (decision 0009). A CSV has a header of names and
one row per clock, decimal or 0x hex; it needs neither [clock] nor [reset], and `first_edge` is the line of row 0.
Source    docs/golden.md
"""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model.fixed import bits
from testbench.errors import FileError
from testbench.golden.bundles import bundle
from testbench.golden.check import ghw, vcd_log
from testbench.golden.check.compare import BEFORE, Column, compare_bundle, formats
from testbench.golden.check.signal_paths import find_signal, index_signals
from testbench.storage import inputs, sandboxed_read
from testbench.storage.inputs import parse_json

SCHEMA = "gyro-map/1.0"
MOST_WIDTH = 1 << 12  # bits of a signal
FST = (bytes([0]) + (329).to_bytes(8, "big"), bytes([254]))  # first bytes: header block, or all of it in one gzip block
# VHDL's weak levels are levels; everything else is unknown
LEVELS = str.maketrans("LlHh", "0011")


class Map(NamedTuple):
    """A signal map; `reset` is None or (path, active level)."""

    ports: dict
    clock: str
    rising: bool
    reset: tuple | None
    first_edge: int


def read_map(path):
    """Read and check a map; raises FileError naming the key."""
    path = Path(path)
    tree = inputs.read_toml(path, error=FileError)

    def expect(ok, key, value, limit):
        if not ok:
            raise FileError(f"{path}: {key}: {value!r} is not {limit}")

    expect(tree.get("schema") == SCHEMA, "schema", tree.get("schema"), SCHEMA)
    allowed = {
        "schema": (),
        "first_edge": (),
        "ports": None,
        "clock": ("signal", "edge"),
        "reset": ("signal", "active"),
    }
    for key, value in tree.items():
        expect(key in allowed, "key", key, f"one of {', '.join(allowed)}")
        if key in ("ports", "clock", "reset"):
            expect(isinstance(value, dict), key, value, "a table")
        for name in value if allowed[key] else ():
            expect(name in allowed[key], f"{key} key", name, f"one of {', '.join(allowed[key])}")
    ports, clock, reset = tree.get("ports", {}), tree.get("clock", {}), tree.get("reset")
    expect(ports and all(isinstance(v, str) for v in ports.values()), "ports", ports, "a table of port = signal path")
    expect(isinstance(clock.get("signal", ""), str), "clock.signal", clock.get("signal"), "a signal path")
    expect(clock.get("edge", "rising") in ("rising", "falling"), "clock.edge", clock.get("edge"), "rising or falling")
    if reset is not None:
        expect(isinstance(reset.get("signal"), str), "reset.signal", reset.get("signal"), "a signal path")
        expect(reset.get("active", 1) in (0, 1), "reset.active", reset.get("active"), "0 or 1")
    first = tree.get("first_edge", 0)
    expect(type(first) is int and first >= 0, "first_edge", first, "a whole number from 0")
    return Map(
        ports=ports,
        clock=clock.get("signal", ""),
        rising=clock.get("edge", "rising") == "rising",
        reset=None if reset is None else (reset["signal"], reset.get("active", 1)),
        first_edge=first,
    )


# Dumps: a reader gives {path: (times, texts, width, hi, lo)} of the wanted signals ------------------------------------


def _vcd(path, paths):
    """Changes of the wanted signals of a VCD file, and the slices."""
    identifier_by_path, slice_by_path = {}, {}

    def choose(header_signals):
        header_signals = index_signals(header_signals)
        for signal_path in paths:
            signal, hi, lo = find_signal(signal_path, header_signals, path)
            identifier, width, kind = header_signals[signal]
            if kind in ("real", "realtime", "string", "event"):
                raise FileError(f"{path}: signal {signal} is a {kind}, not bits")
            identifier_by_path[signal_path] = identifier
            slice_by_path[signal_path] = (width, hi, lo)
        return identifier_by_path.values()

    changes = vcd_log.read(path, choose)
    return {name: (*changes[identifier], *slice_by_path[name]) for name, identifier in identifier_by_path.items()}


def _fst(path, paths):
    """As `_vcd`, for FST: read in a process of its own, because damage can end the library's process."""
    try:
        import pywellen  # noqa: F401
    except ImportError:
        raise FileError(f"{path}: FST needs pywellen: pip install pywellen, or dump VCD") from None
    with inputs.open_input(path):
        reader_output = sandboxed_read.read_in_subprocess("testbench.golden.check.fst_log", path, "FST file", *paths)
    return parse_json(reader_output, path, dict[str, tuple[list[int], list[str], int, int | None, int | None]])


def _ghw(path, paths):
    """As `_vcd`, for GHW."""
    slice_by_path = {}

    def choose(width_by_signal):
        signal_index = index_signals((name, name) for name in width_by_signal)
        for signal_path in paths:
            signal, hi, lo = find_signal(signal_path, signal_index, path)
            slice_by_path[signal_path] = signal_index[signal], hi, lo
            if not width_by_signal[signal_index[signal]] or width_by_signal[signal_index[signal]] > MOST_WIDTH:
                raise FileError(f"{path}: signal {signal} is not bits, or has more than {MOST_WIDTH}")
        return list(dict.fromkeys(signal for signal, _, _ in slice_by_path.values()))

    columns = ghw.read(path, choose)
    return {signal_path: (*columns[signal], hi, lo) for signal_path, (signal, hi, lo) in slice_by_path.items()}


READERS = {".vcd": _vcd, ".fst": _fst, ".ghw": _ghw, ".csv": None}


def _extend_bits(text, width):
    """All bits of a VCD vector: the left is filled with 0, or with the unknown that leads."""
    text = text.translate(LEVELS).lower()
    return text.rjust(width, text[0] if text[0] not in "01" else "0")


def _parse_bits(text, signed):
    """Value of bits, or None."""
    if set(text) - {"0", "1"}:
        return None
    value = int(text, 2)
    return value - (1 << len(text)) if signed and text[0] == "1" else value


def _sample_column(change, at, port, fmt, where):
    """Column of a signal just before the times `at`."""
    times, texts, width, hi, lo = change
    if width > MOST_WIDTH:
        raise FileError(f"{where}: port {port}: its signal has {width} bits, above the limit {MOST_WIDTH} bits")
    if hi is not None and hi >= width:
        raise FileError(f"{where}: port {port}: bit {hi} of a signal of {width} bits is outside 0 .. {width - 1}")
    selected_bit_count = width if hi is None else hi - lo + 1
    if selected_bit_count != fmt.width:
        raise FileError(f"{where}: port {port}: {selected_bit_count} bits in the dump, {fmt.width} in the manifest")
    decoded = np.zeros(len(texts) + 1, np.int64)
    valid_texts = np.zeros(len(texts) + 1, bool)
    for k, text in enumerate(texts):
        text = _extend_bits(text, width)
        if hi is not None:
            text = text[width - 1 - hi : width - lo]
        value = _parse_bits(text, fmt.s)
        if value is not None:
            decoded[k + 1], valid_texts[k + 1] = value, True
    change_indices = np.searchsorted(np.asarray(times, np.int64), at, "left")
    return Column(decoded[change_indices], valid_texts[change_indices])


def _active_edge_times(change, rising, where):
    """Times of the active edges: from a known level to the other."""
    times, texts, width, _, _ = change
    if width != 1:
        raise FileError(f"{where}: the clock has {width} bits, expected 1")
    levels = [text.translate(LEVELS) for text in texts]
    old, new = ("0", "1") if rising else ("1", "0")
    # several changes at one time are delta cycles: only the last one counts
    last = {}
    for time, level in zip(times, levels):
        last[time] = level
    edge_times, before = [], None
    for time, level in last.items():
        if before == old and level == new:
            edge_times.append(time)
        before = level
    if not edge_times:
        raise FileError(f"{where}: the clock has no {'rising' if rising else 'falling'} edge")
    return np.array(edge_times, np.int64)


def _from_dump(path, reader, signal_map, fmts):
    if not signal_map.clock:
        raise FileError(f"{path}: the map has no clock.signal, which a dump needs")
    signal_paths = [signal_map.clock, *signal_map.ports.values()] + ([signal_map.reset[0]] if signal_map.reset else [])
    changes = reader(path, list(dict.fromkeys(signal_paths)))
    at = _active_edge_times(changes[signal_map.clock], signal_map.rising, path)
    if signal_map.reset:
        name, active = signal_map.reset
        levels = _sample_column(changes[name], at, "reset", bits(1), path)
        asserted = np.flatnonzero(levels.valid & (levels.values == active))
        free = np.flatnonzero(levels.valid & (levels.values != active))
        free = free[free > asserted[0]] if len(asserted) else free[:0]
        if not len(free):
            raise FileError(
                f"{path}: reset {name}: never {active} and later {1 - active} at a clock edge; check reset.active"
            )
        at = at[free[0] :]
    at = at[signal_map.first_edge :]
    if not len(at):
        raise FileError(f"{path}: first_edge {signal_map.first_edge} is after the last clock edge")
    return {port: _sample_column(changes[name], at, port, fmts[port], path) for port, name in signal_map.ports.items()}


# CSV ------------------------------------------------------------------------------------------------------------------


def _from_csv(path, signal_map, fmts):
    with inputs.explain_damage(path, "CSV file"):
        rows = list(csv.reader(line for _, line in inputs.read_lines(path)))
    if len(rows) < 2:
        raise FileError(f"{path}: a header and at least one row are needed")
    header = [name.strip() for name in rows[0]]
    rows = rows[1 + signal_map.first_edge :]
    if len(set(header)) != len(header):
        raise FileError(f"{path}: duplicate column {max(header, key=header.count)}")
    for n, row in enumerate(rows):
        if len(row) != len(header):
            raise FileError(f"{path}: row {n}: {len(row)} cells, the header has {len(header)}")
    out = {}
    for port, name in signal_map.ports.items():
        if name not in header:
            raise FileError(f"{path}: no column {name}; columns: {', '.join(header[:8])}")
        k, fmt = header.index(name), fmts[port]
        values, valid_cells = np.zeros(len(rows), np.int64), np.zeros(len(rows), bool)
        for n, row in enumerate(rows):
            cell = row[k].strip()
            if not cell or set(cell.lower()) <= set("xzuw"):
                continue
            try:
                value = int(cell, 16) if cell.lower().startswith("0x") else int(cell)
            except ValueError:
                raise FileError(f"{path}: row {n}, {name}: {cell[:40]!r} is not an integer") from None
            # hex, and decimal of a tool that prints bits, may be unsigned
            if fmt.s and fmt.hi < value < 1 << fmt.width:
                value -= 1 << fmt.width
            if not fmt.holds(value):
                raise FileError(f"{path}: row {n}, {name}: {cell} does not fit {fmt.width} bits {fmt}")
            values[n], valid_cells[n] = value, True
        out[port] = Column(values, valid_cells)
    return out


def dump_type(path):
    """Ending of a dump, .vcd, .fst, .ghw or .csv; FileError for another, or for the content of another."""
    kind, first = Path(path).suffix.lower(), inputs.head(path, len(ghw.MAGIC))
    content = ".fst" if first.startswith(FST) else ".ghw" if first == ghw.MAGIC else kind
    if kind not in READERS:
        raise FileError(f"{path}: the file type {kind or '(none)'} is not .vcd, .fst, .ghw or .csv")
    if content != kind:
        raise FileError(f"{path}: the content is that of a {content} file; rename it to end in {content}")
    return kind


def read_log(path, signal_map, fmts):
    """Columns of the mapped ports of a .vcd, .fst, .ghw or .csv file.

    signal_map  a `Map`
    fmts     {port: Fmt} of the manifest (`compare.formats`)
    """
    strange = sorted(set(signal_map.ports) - set(fmts))
    if strange:
        raise FileError(f"map: port {strange[0]} is not in the manifest; ports: {', '.join(list(fmts)[:12])}")
    kind = dump_type(path)
    if kind == ".csv":
        return _from_csv(path, signal_map, fmts)
    return _from_dump(path, READERS[kind], signal_map, fmts)


def check(folder, log, map_path, before=BEFORE):
    """Compare a log with the bundle in `folder`, which is verified first; returns a `compare.Report`."""
    golden = bundle.read(folder)
    return compare_bundle(golden, read_log(log, read_map(map_path), formats(golden.manifest)), before)

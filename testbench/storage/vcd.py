"""Waveforms of a window of clock edges: a VCD file, and set-ups of GTKWave (.gtkw) and Surfer (.sucl) for it.

Row n of the window holds what the registers hold before edge n. In the file edge n is at (n + 1 - first) clocks: row 0
is seen in the clock before the window's first edge, and the clock rises where a simulator would sample the row.
Every line of one signal has the same length, so whole blocks of changes are laid out by array operations.
Source  docs/record.md
"""

import math
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.storage.files import replace_file, write_text
from testbench.version import VERSION

BLOCK_ROWS = 4096
CLOCK_NAME = "clk_26m"


class Signal(NamedTuple):
    """A column of the window: dotted name, width in bits, and whether viewers should show it signed."""

    name: str
    width: int
    signed: bool = False


def signals(names, formats):
    """Signals from register names and their formats [s, i, f]."""
    return [Signal(name, fmt.width, bool(fmt.s)) for name, fmt in zip(names, formats)]


def _identifier(index):
    """VCD identifier of a signal: printable characters, shortest first."""
    text = ""
    index += 1
    while index:
        index, digit = divmod(index - 1, 94)
        text += chr(33 + digit)
    return text


def picoseconds(edges, clock_hz=DEFAULT.master_hz):
    """Time of clock edges, rounded to the nearest picosecond."""
    num, den = Fraction(10**12, clock_hz).as_integer_ratio()
    return (2 * num * np.asarray(edges, np.int64) + den) // (2 * den)


def _half_after(edges, clock_hz):
    """Time half a clock after each edge."""
    num, den = Fraction(10**12, clock_hz).as_integer_ratio()
    return (num * (2 * np.asarray(edges, np.int64) + 1) + den) // (2 * den)


def _header(tree, ids, comment):
    lines = [
        "$version ftr-gyro " + VERSION + " $end",
        "$comment " + " ".join(comment.split()).replace("$end", "") + " $end",
        "$timescale 1 ps $end",
    ]

    def declare(node):
        for name, item in node.items():
            if isinstance(item, dict):
                lines.append(f"$scope module {name} $end")
                declare(item)
                lines.append("$upscope $end")
            else:
                span = f" [{item.width - 1}:0]" if item.width > 1 else ""
                lines.append(
                    f"$var {'wire' if item.width == 1 else 'reg'} {item.width} {ids[item.name]} {name}{span} $end"
                )

    declare(tree)
    lines.append("$enddefinitions $end")
    return "\n".join(lines) + "\n"


def _tree(signal_list, top):
    """Nested dict of scopes; a name that is also a scope raises."""
    tree = {}
    for signal in signal_list:
        *scopes, leaf = [top, *signal.name.split(".")]
        node = tree
        for scope in scopes:
            node = node.setdefault(scope, {})
            if not isinstance(node, dict):
                raise ValueError(f"signal {signal.name}: {scope} is the name of both a signal and a scope")
        if leaf in node:
            raise ValueError(f"signal {signal.name}: is a duplicate, or has the name of a scope")
        node[leaf] = signal
    return tree


def _vcd_lines(values, width, identifier, is_valid=None):
    """Byte matrix, one line of equal length per value: `0!` for one bit, `b0101 !` for more; x where not known."""
    tail = np.frombuffer((identifier if width == 1 else " " + identifier).encode() + b"\n", np.uint8)
    head = 0 if width == 1 else 1
    lines = np.empty((len(values), head + width + len(tail)), np.uint8)
    if head:
        lines[:, 0] = ord("b")
    shifts = np.arange(width - 1, -1, -1, dtype=np.int64)
    lines[:, head : head + width] = ((values[:, None] >> shifts) & 1) + ord("0")
    if is_valid is not None:
        lines[~is_valid, head : head + width] = ord("x")
    lines[:, head + width :] = tail
    return lines


def _stamps(times):
    """List of (row indices, byte matrix) of the lines `#time`, grouped by their number of digits."""
    digits = np.char.str_len(times.astype("U20"))
    groups = []
    for count in np.unique(digits):
        rows = np.flatnonzero(digits == count)
        powers = 10 ** np.arange(count - 1, -1, -1, dtype=np.int64)
        lines = np.empty((len(rows), count + 2), np.uint8)
        lines[:, 0], lines[:, -1] = ord("#"), ord("\n")
        lines[:, 1:-1] = times[rows, None] // powers % 10 + ord("0")
        groups.append((rows, lines))
    return groups


def _layout(groups, row_count):
    """Bytes of groups of lines, each (rows, line matrix), in the order of rows, then of groups."""
    sizes = np.zeros((len(groups), row_count), np.int64)
    for k, (rows, lines) in enumerate(groups):
        sizes[k, rows] = lines.shape[1]
    ends = np.cumsum(sizes.T.ravel()).reshape(row_count, len(groups)).T
    out = np.empty(int(sizes.sum()), np.uint8)
    for k, (rows, lines) in enumerate(groups):
        if len(rows):
            out[(ends[k, rows] - lines.shape[1])[:, None] + np.arange(lines.shape[1])] = lines
    return out.tobytes()


def _check(rows, signal_list):
    if rows.ndim != 2 or rows.dtype != np.int64 or rows.shape[1] != len(signal_list) or not len(rows):
        raise ValueError(f"window: expected int64 rows of {len(signal_list)} columns, got {rows.dtype} {rows.shape}")
    for k, signal in enumerate(signal_list):
        if not 1 <= signal.width <= 64:
            raise ValueError(f"signal {signal.name}: width {signal.width} is outside 1..64 bits")
        if signal.width < 64:
            lo = -(1 << (signal.width - 1)) if signal.signed else 0
            hi = (1 << (signal.width - signal.signed)) - 1
            least, most = rows[:, k].min(), rows[:, k].max()
            if least < lo or most > hi:
                raise ValueError(
                    f"signal {signal.name}: {least}..{most} is outside {lo}..{hi}, its {signal.width} bits"
                )


def write_vcd(path, rows, signal_list, first_edge=0, top="gyro", edges=None, clock_hz=DEFAULT.master_hz, is_valid=None):
    """Write a window as VCD.

    rows         int64, one row per clock edge, one column per signal
    signal_list  `Signal`s
    first_edge   number of the edge that samples the first row, counted from power-on
    top          outermost scope
    edges        edges that sample the rows, counted from `first_edge` and rising; None: one row after the other.
                 Between them nothing is known: the clock rests, and values stay as they were
    clock_hz     nominal frequency of the master clock
    is_valid     bool, of the shape of `rows`: where a value is none, its bits are x; None: all are known
    """
    rows = np.asarray(rows)
    is_valid = np.ones(rows.shape, bool) if is_valid is None else is_valid
    edges = np.arange(len(rows)) if edges is None else np.asarray(edges, np.int64)
    signal_list = list(signal_list)
    _check(rows, signal_list)
    clock = Signal(CLOCK_NAME, 1)
    tree = _tree([clock, *signal_list], top)
    ids = {signal.name: _identifier(k) for k, signal in enumerate([clock, *signal_list])}
    comment = (
        f"Time 0 is one clock before edge {first_edge}; edge n is at (n + 1 - {first_edge}) / {clock_hz / 1e6:.9g} MHz."
    )
    with replace_file(path) as part, open(part, "wb") as file:
        file.write(_header(tree, ids, comment).encode())
        before = None, None
        for begin in range(0, len(rows), BLOCK_ROWS):
            block, sure = rows[begin : begin + BLOCK_ROWS], is_valid[begin : begin + BLOCK_ROWS]
            count = len(block)
            index = edges[begin : begin + count]
            every = np.arange(count)
            changed = np.ones(block.shape, bool)
            changed[1:] = (block[1:] != block[:-1]) | (sure[1:] != sure[:-1])
            if begin:
                changed[0] = (block[0] != before[0]) | (sure[0] != before[1])
            before = block[-1].copy(), sure[-1].copy()
            rise, fall = (_vcd_lines(np.full(count, level), 1, ids[CLOCK_NAME]) for level in (1, 0))
            groups = [*_stamps(picoseconds(index, clock_hz)), (every, rise)]
            for k, signal in enumerate(signal_list):
                at = np.flatnonzero(changed[:, k])
                groups.append((at, _vcd_lines(block[at, k], signal.width, ids[signal.name], sure[at, k])))
            groups += [*_stamps(_half_after(index, clock_hz)), (every, fall)]
            file.write(_layout(groups, count))
        file.write(f"#{int(picoseconds(edges[-1] + 1, clock_hz))}\n1{ids[CLOCK_NAME]}\n".encode())


# ---- set-ups of viewers ----------------------------------------------------------------------------------------------

GTKW_BINARY, GTKW_HEX, GTKW_UNSIGNED, GTKW_SIGNED = 0x28, 0x22, 0x24, 0x420
GTKW_ANALOG = 0x8000
GTKW_WINDOW_PS = 4_000_000  # in 1000 pixels at first sight: four DAC frames
WIDE_BITS = 33  # words wider than this are read in hexadecimal


def _signal_group(name):
    """Group of a signal: everything before its last dot."""
    return name.rpartition(".")[0] or "top"


def _signals_by_group(signal_list):
    groups = {}
    for signal in signal_list:
        groups.setdefault(_signal_group(signal.name), []).append(signal)
    return groups


def _gtkw_flags(signal, analog):
    if signal.width == 1:
        return GTKW_BINARY
    if signal.width >= WIDE_BITS and not signal.signed:
        return GTKW_HEX
    return (GTKW_SIGNED if signal.signed else GTKW_UNSIGNED) | (GTKW_ANALOG if analog else 0)


def write_gtkw(path, vcd_path, signal_list, top="gyro", analog=(), expanded=("pins",), marker_ps=None):
    """Write the save file of GTKWave: one group per block, the groups named in `expanded` open.

    analog     names of signals drawn as curves
    marker_ps  time of the marker, which is in the middle of what is shown first; None: from the beginning, no marker
    """
    signal_list = list(signal_list)
    begin, marker = (0, -1) if marker_ps is None else (max(0, marker_ps - GTKW_WINDOW_PS // 2), marker_ps)
    lines = [f"[*] ftr-gyro {VERSION}", f'[dumpfile] "{Path(vcd_path).name}"', f"[timestart] {begin}"]
    # zoom: minus log2 of picoseconds per 200 pixels, then the marker, and the named markers, all unset
    lines += [
        "[size] 1600 1000",
        f"*{-math.log2(GTKW_WINDOW_PS / 5):.3f} {marker}" + " -1" * 26,
        "[signals_width] 280",
        "[sst_width] 220",
    ]
    lines += ["@28", f"{top}.{CLOCK_NAME}"]
    for group, members in _signals_by_group(signal_list).items():
        is_open = group in expanded or group.rpartition(".")[2] in expanded
        lines += ["@800200" if is_open else "@c00200", f"-{group}"]
        for signal in members:
            span = f"[{signal.width - 1}:0]" if signal.width > 1 else ""
            curve = signal.name in analog and signal.width > 1
            lines += [f"@{_gtkw_flags(signal, curve):x}", f"{top}.{signal.name}{span}"]
            lines += ["@20000", "-", "-"] if curve else []
        lines += ["@1000200" if is_open else "@1401200", f"-{group}"]
    write_text(path, "\n".join(lines) + "\n")


def _letters(index):
    """Surfer's name of a displayed item: its number in hexadecimal, digits a to p."""
    return "".join(chr(ord("a") + int(digit, 16)) for digit in f"{index:x}")


def write_sucl(path, vcd_path, signal_list, top="gyro"):
    """Write the command file of Surfer: the clock, then a divider and the signals of each block."""
    name = Path(vcd_path).name
    lines = [f"# surfer {name} --command-file {Path(path).name}", f"variable_add {top}.{CLOCK_NAME}"]
    item = 1
    for group, members in _signals_by_group(list(signal_list)).items():
        lines.append(f"divider_add {group}")
        item += 1
        for signal in members:
            lines.append(f"variable_add {top}.{signal.name}")
            if signal.width > 1:
                wide = signal.width >= WIDE_BITS and not signal.signed
                format_name = "Hexadecimal" if wide else "Signed" if signal.signed else "Unsigned"
                lines += [f"item_focus {_letters(item)}_{signal.name}", f"item_set_format {format_name}"]
            item += 1
    lines += ["item_unfocus", "zoom_fit"]
    write_text(path, "\n".join(lines) + "\n")


def write_window(path, rows, signal_list, first_edge=0, clock_hz=DEFAULT.master_hz, top="gyro", analog=()):
    """VCD, GTKWave and Surfer files side by side; returns their paths."""
    path = Path(path)
    write_vcd(path, rows, signal_list, first_edge, top, clock_hz=clock_hz)
    write_gtkw(path.with_suffix(".gtkw"), path, signal_list, top, analog)
    write_sucl(path.with_suffix(".sucl"), path, signal_list, top)
    return [path, path.with_suffix(".gtkw"), path.with_suffix(".sucl")]

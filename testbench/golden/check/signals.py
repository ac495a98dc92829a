"""Signals of a dump, and a map of them to a bundle's ports: suggestions for somebody to correct.

A port gets the signal of its width whose last name is most like its own; clock and reset are found by their names.
Source  docs/golden.md (comparing a log)
"""

import difflib
import re
from typing import NamedTuple

from testbench.errors import FileError
from testbench.golden.check import ghw, vcd_log
from testbench.golden.check.waves import SCHEMA, dump_type
from testbench.golden.stimulus import levels
from testbench.storage import inputs, sandboxed_read
from testbench.storage.inputs import parse_json

ALIKE = 0.5  # of difflib's ratio, below which a name suggests nothing
OURS = b"$version ftr-gyro"  # begins a waveform that this project has written: row 0 is at its first edge
CLOCK, RESET = re.compile(r"^(clk|clock|ck|sys_?clk)\w*$", re.I), re.compile(r"(rst|reset)", re.I)


class _HeaderRead(Exception):
    """Ends a reader when the header is known."""


class Signal(NamedTuple):
    """Path of a signal in a dump, and its bits; None if it has none."""

    path: str
    width: int | None


def signals(path):
    """[`Signal`] of a VCD, FST or GHW dump, or the columns of a CSV; FileError as the readers."""
    kind, dump_signals = dump_type(path), []

    def choose(header_signals):
        pairs = header_signals.items() if isinstance(header_signals, dict) else header_signals
        dump_signals.extend(Signal(name, one[1] if isinstance(one, tuple) else one) for name, one in pairs)
        raise _HeaderRead

    if kind == ".fst":
        reader_output = sandboxed_read.read_in_subprocess("testbench.golden.check.fst_log", path, "FST file")
        return [Signal(*one) for one in parse_json(reader_output, path, list[tuple[str, int | None]])]
    if kind == ".csv":
        first = next(inputs.read_lines(path), (1, ""))[1]
        return [Signal(name.strip(), None) for name in first.split(",") if name.strip()]
    try:
        (vcd_log if kind == ".vcd" else ghw).read(path, choose)
    except _HeaderRead:
        pass
    return dump_signals


def _bare_name(path):
    """Last name of a path, without what marks a register or a port."""
    return re.sub(r"^[ro]_|_(reg|q|o|i|out|in)$", "", path.rpartition(".")[2].partition("[")[0].lower())


def suggest_signals(ports, dump_signals):
    """{port: path} of [(name, width)] and [`Signal`]: each signal once, the most alike first."""
    pairs = []
    for name, width in ports:
        for signal in dump_signals:
            if signal.width in (width, None):
                ratio = difflib.SequenceMatcher(None, name.lower(), _bare_name(signal.path)).ratio()
                pairs.append((-ratio, len(signal.path), name, signal.path))
    path_by_port = {}
    for ratio, _, name, path in sorted(pairs):
        if -ratio >= ALIKE and name not in path_by_port and path not in path_by_port.values():
            path_by_port[name] = path
    return path_by_port


def is_ours(path):
    """Whether a dump is a waveform that this project has written, such as the `golden.vcd` of a bundle."""
    return inputs.head(path, len(OURS)) == OURS


def skeleton(dump_signals, manifest=None, ours=False):
    """Text of a map: what is suggested, and a comment for each port without a suggestion.

    ours  row 0 is at the first edge, whatever a reset does behind it (`is_ours`)
    """
    bits = [s.path for s in dump_signals if s.width in (1, None)]
    clock = next((p for p in bits if CLOCK.match(_bare_name(p))), None)
    reset = next((p for p in bits if RESET.search(_bare_name(p))), None)
    lines = [f'schema = "{SCHEMA}"', *["first_edge = 0"] * ours, "[clock]"]
    lines.append(f'signal = "{clock}"' if clock else '# signal = "top.clk"')
    if reset and not ours:
        active = 0 if _bare_name(reset).endswith("n") else 1
        lines += ["[reset]", f'signal = "{reset}"', f"active = {active}"]
    lines.append("[ports]")
    if manifest is None:
        lines += [f'# port = "{s.path}"' for s in dump_signals if s.path not in (clock, reset)]
        return "\n".join(lines) + "\n"
    ports = [(p["name"], p["width"]) for _, p in levels.compared_ports(manifest, "registers")]
    candidate_signals = [s for s in dump_signals if s.path not in (clock, reset)]
    path_by_port = suggest_signals(ports, candidate_signals)
    for name, width in ports:
        lines.append(f'{name} = "{path_by_port[name]}"' if name in path_by_port else f'# {name} = ""  # {width} bits')
    return "\n".join(lines) + "\n"


def text(path, dump_signals):
    """Lines for a terminal."""
    if not dump_signals:
        raise FileError(f"{path}: has no signal")
    wide = max(len(s.path) for s in dump_signals)
    return "\n".join(
        f"{s.path.ljust(wide)}  {'' if s.width is None else f'{s.width} bits'}".rstrip() for s in dump_signals
    )

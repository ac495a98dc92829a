"""Does the design synthesise, and to what size: yosys, for ECP5 and iCE40, with what must not be there refused.

    front end    no latch, no asynchronous reset, no net that is read and not driven, no loop, no second driver
    mapping      synth_ecp5, synth_ice40 -dsp
    afterwards   the same checks of the mapped netlist

The counts are a proxy for the Cyclone IV E of the board: yosys cannot size that part (docs/rtl.md). Memories, carry
chains and multipliers are of other shapes there.
Source  docs/rtl.md
"""

import json
import re
import shutil
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from testbench.config import Config, changed
from testbench.errors import ConfigError
from testbench.golden.loop.library import sources
from testbench.golden.recording import board_recording
from testbench.run import build
from testbench.storage.files import write_text
from testbench.tool import run_tool

RTL = Path(__file__).resolve().parents[2] / "rtl"
MAPPERS = {"ecp5": "synth_ecp5", "ice40": "synth_ice40 -dsp"}
BOARDS = {"analog": "analog_sid", "digital": "digital_sid"}
FORBIDDEN = "t:$dlatch t:$adff t:$adffe t:$dffsr t:$dffsre t:$aldff t:$aldffe t:$dlatchsr t:$adlatch t:$sr"
MAPPED_LATCHES = "t:$_DLATCH* t:$_SR_*"


class Netlist(NamedTuple):
    """What a synthesis came to: cells by type, empty after the front end alone."""

    family: str
    board: str
    cells: dict
    yosys: str
    seconds: float

    def text(self):
        checked = f"{self.family or 'front end'}, board {self.board}: no latch, no undriven net"
        return f"{checked}, {sum(self.cells.values())} cells, {self.seconds:.1f} s" if self.cells else checked

    def count(self, pattern):
        """Cells whose type matches."""
        return sum(count for name, count in self.cells.items() if re.fullmatch(pattern, name))


def script(files, family):
    """Commands for yosys; `family` None stops after the checks of the front end."""
    lines = [f"read_verilog -defer {path}" for path in files]
    lines += [
        f"read_verilog {board_recording.MODULE}.v",
        f"hierarchy -check -top {board_recording.MODULE}",
        "proc; flatten; opt; check -assert",
        f"select -assert-none {FORBIDDEN}",
    ]
    if family:
        lines += [
            f"{MAPPERS[family]} -top {board_recording.MODULE}",
            f"check -assert; select -assert-none {MAPPED_LATCHES}",
            "tee -q -o cells.json stat -json",
        ]
    return "\n".join(lines) + "\n"


def synthesise(rtl, family=None, name="analog", folder=None):
    """`Netlist` of the design in folder `rtl` on a board.

    family  ecp5, ice40, or None: the checks of the front end alone
    name    analog or digital: which demodulator
    folder  where the board's files and the netlist's counts are left; a temporary one if None
    Raises ConfigError for a wrong name or a missing tool, FileError for what yosys refuses.
    """
    if family is not None and family not in MAPPERS:
        raise ConfigError(f"family: {family!r} is not one of {', '.join(MAPPERS)}")
    if name not in BOARDS:
        raise ConfigError(f"board: {name!r} is not one of {', '.join(BOARDS)}")
    if shutil.which("yosys") is None:
        raise ConfigError("yosys: not installed; the synthesis needs it")
    config = changed(Config(), {"firmware.board": BOARDS[name]})
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="gyro-synth-") as temporary:
        work = Path(folder or temporary).resolve()
        work.mkdir(parents=True, exist_ok=True)
        board_recording.write(work, build.firmware(config))
        write_text(work / "synth.ys", script(sources(rtl), family))
        run_tool(["yosys", "-q", "synth.ys"], work, f"{rtl}: synthesis for {family or 'no family'}, board {name}")
        cells = json.loads((work / "cells.json").read_text()) if family else None
    cell_counts = cells["modules"][f"\\{board_recording.MODULE}"]["num_cells_by_type"] if cells else {}
    return Netlist(family, name, cell_counts, cells["creator"] if cells else "", time.perf_counter() - began)

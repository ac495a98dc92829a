"""What a loop leaves of a difference: a waveform of the last two frames, and a bundle to replay.

    window.vcd, window.gtkw   inputs, registers and pins of the model, pins of the design, up to the row that differs
    bundle/top/loop           vectors of the whole design: inputs from power-on, every clock of these frames as a row

The model is replayed on the inputs that the design was given; until the difference both are one.
Source  docs/rtl.md (a design with the pins alone)
"""

from pathlib import Path

import numpy as np

from fpga_model import top
from fpga_model.fixed import formats
from testbench.flatten import format_leaves
from testbench.golden.bundles import top as bundles
from testbench.golden.recording import recording, replay
from testbench.golden.stimulus.blocks import RESET_INPUT
from testbench.storage import vcd

CASE = "loop"


def _listed(design):
    """Signals of the waveform: inputs, the model's registers and pins, the design's pins."""
    inputs = [vcd.Signal(f"in.{RESET_INPUT}", 1)]
    inputs += [vcd.Signal(f"in.{n}", f.width, bool(f.s)) for n, f in zip(top.Inputs._fields, top.INPUTS_FMT)]
    registers = format_leaves(formats(top.State, design))
    listed = inputs + [vcd.Signal(f"model.reg.{name}", f.width, bool(f.s)) for name, f in registers]
    for whose in ("model.pin", "yours.pin"):
        listed += [vcd.Signal(f"{whose}.{n}", f.width) for n, f in zip(top.Pins._fields, top.PINS_FMT)]
    return listed


def write(folder, difference):
    """Write the package of a `run.Difference` into a folder; returns it."""
    folder, found, design = Path(folder), difference.recorded, difference.design
    folder.mkdir(parents=True, exist_ok=True)
    count = max(len(found.pins), 1)
    first, frames = difference.row + 1 - count, difference.row // design.frame_clocks + 1
    at = np.arange(first, difference.row + 1)
    rows = replay.run(found.params, found.stimulus, frames, at)
    yours = found.pins if len(found.pins) else rows.pins  # the first row of all is that of the reset
    listed = _listed(design)
    path = folder / "window.vcd"
    every = np.column_stack([rows.inputs, rows.registers, rows.pins, yours])
    vcd.write_vcd(path, every, listed, first_edge=first, top="gyro_top", clock_hz=design.master_hz)
    vcd.write_gtkw(folder / "window.gtkw", path, listed, top="gyro_top", expanded=("model.pin", "yours.pin"))
    shown = recording.Window(first, count, "up to the row that differs")
    made = recording.Recording(CASE, found.params, frames, frames, found.stimulus, (shown,), "")
    bundles.write(made, folder / "bundle" / bundles.STEM / CASE, of_board=True)
    return folder

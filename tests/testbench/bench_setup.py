"""Short cuts that tests of the closed loop share: an open-loop bench without start-up, quiet configurations."""

from pathlib import Path

import numpy as np

from fpga_model import dds, frequency_tracker, rate_loop, sequencer
from testbench import config
from testbench.run import nodes, simulate

BOARDS = Path(__file__).resolve().parents[2] / "docs" / "boards"
QUIET = {f"noise.{name}": False for name in ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")}


def configured(**values):
    """A checked configuration; dots in the names are written as two underscores."""
    values = {key.replace("__", "."): value for key, value in values.items()}
    return config.changed(config.Config(), values, library=True)


def board(name):
    """Configuration of a file of docs/boards."""
    return config.load(BOARDS / f"{name}.toml")


def quiet(**values):
    """As `configured`, every noise source off."""
    return config.changed(configured(**values), QUIET)


def open_loop(checked, frequency_hz, drive=0.7, sense=0.6):
    """A bench in state OPEN with fixed words: no start-up, no loop; both modes driven at `frequency_hz`."""
    sim = simulate.Simulation(checked, 25.0, 25.0)
    s = sim.state
    word = dds.word_of_hz(frequency_hz, sim.design)
    control = s.fpga.control
    amplitude, rate = round(drive * 2**23), round(sense * 2**23)
    bank = s.fpga.registers._replace(
        control=sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR,
        frequency_fixed=word,
        amplitude_fixed=amplitude,
        rate_fixed=rate,
        **dict(
            zip(
                ("phase_drive_sine", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref"),
                checked.firmware.phase_words(sim.design.dds_bits),
            )
        ),
    )
    control = control._replace(
        sequencer=control.sequencer._replace(state=sequencer.OPEN, control=bank.control),
        frequency_tracker=frequency_tracker.State(centre=word, word=word),
        rate_loop=rate_loop.State(),
    )
    chips = s.chips._replace(sense=s.chips.sense._replace(enabled=1, staged=0, latch=0, code=0))
    sim.state = s._replace(fpga=s.fpga._replace(registers=bank, control=control), chips=chips)
    sim.now = (np.zeros(1), np.full(1, 25.0))
    return sim


def read_open_loop(checked, frequency_hz, settle_s=0.02, seconds=0.12):
    """Node phases of an open-loop bench."""
    sim = open_loop(checked, frequency_hz)
    sim.advance(round(settle_s * sim.design.tick_hz), 0.0, 25.0)
    ticks = round(seconds * sim.design.tick_hz)
    streams = sim.advance(ticks, 0.0, 25.0, probe_ticks=ticks)
    probe = sim.read_out(streams, 25.0)
    return nodes.read(probe._replace(fx_hz=checked.plant.fx_hz))

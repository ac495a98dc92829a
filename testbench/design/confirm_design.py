"""A design's predictions beside the engine: time of lock, bandwidth, peak and scale of the simulated gyroscope.

    lines      a multisine of rate at SHARES of the predicted bandwidth, all multiples of 1/window
    level      |word per rate| of a line over that of the lowest, which stands for rest
    bandwidth  where the level crosses -3.01 dB, linear between lines in logarithmic frequency
Source  docs/design_of_loops.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.config import changed
from testbench.errors import ConfigError
from testbench.paper.loop import confirm
from testbench.run import simulate
from testbench.run.simulation import DEG, Simulation

SHARES = (0.02, 0.12, 0.25, 0.4, 0.55, 0.7, 0.8, 0.88, 0.94, 1.0, 1.06, 1.14, 1.25)
LEAST_WINDOW_S, PERIODS, SETTLE_S, LINE_DPS = 2.0, 50, 2.5, 4.0
LOCK_LIMIT_S = 30.0


class Measured(NamedTuple):
    """What the engine shows; `bandwidth_hz` is None if no line is below -3 dB."""

    lock_s: float
    bandwidth_hz: float | None
    peak_db: float
    lsb_per_dps: float  # of the lowest line, `lowest_hz`


def _lines(bandwidth_hz):
    """(lines Hz, window s)."""
    window = max(LEAST_WINDOW_S, math.ceil(PERIODS / bandwidth_hz * 8) / 8)
    return np.unique(np.round(np.array(SHARES) * bandwidth_hz * window)) / window, window


def lowest_hz(bandwidth_hz):
    """The line (Hz) that stands for rest."""
    return float(_lines(bandwidth_hz)[0][0])


def measure(config, bandwidth_hz, settle_s=SETTLE_S):
    """`Measured` of a configuration from power-on; lines around a predicted bandwidth (Hz).

    settle_s  time that the lines have to settle (s)
    Raises ConfigError if the gyroscope does not lock, or loses lock under the lines.
    """
    sim = Simulation(config, 25.0, 25.0)
    sim.keep_codes = sim.keep_rows = False
    lock_s = simulate.start(config, sim, 0.0, 25.0, limit_s=LOCK_LIMIT_S)
    if lock_s is None:
        raise ConfigError(f"simulation: the gyroscope does not lock within {LOCK_LIMIT_S:g} s")
    frame_ticks, frame_hz = sim.design.frame_ticks, sim.design.frame_hz
    sim.advance(-sim.tick % frame_ticks, 0.0, 25.0)
    lines, window = _lines(bandwidth_hz)
    rate = confirm.multisine(lines, LINE_DPS, settle_s, window, frame_hz)
    sim.keep_rows = True
    sim.advance(len(rate) * frame_ticks, rate * DEG, 25.0)
    run = confirm.ProfileRun(1 / frame_hz, sim.columns(), bool(sim.locked))
    if not run.locked:
        raise ConfigError("simulation: the gyroscope loses lock during the multisine of rate")
    size = np.abs(confirm.measured_response(run, rate, lines, window))
    level = 20 * np.log10(size / size[0])
    stopband_lines = np.flatnonzero(level < -3.0103)
    inside = level[: stopband_lines[0]] if len(stopband_lines) else level
    edge = None
    if len(stopband_lines):
        k = stopband_lines[0]
        part = (level[k - 1] + 3.0103) / (level[k - 1] - level[k])
        edge = float(lines[k - 1] * (lines[k] / lines[k - 1]) ** part)
    return Measured(float(lock_s), edge, max(float(inside.max()), 0.0), float(size[0]))


def simulate_design(result):
    """`Measured` of a design's own board, noise off."""
    settle_s = max(SETTLE_S, 5 * (result.advice.ring_tau_s or 0.0))
    return measure(changed(result.config, confirm.QUIET), result.advice.bandwidth_hz, settle_s)

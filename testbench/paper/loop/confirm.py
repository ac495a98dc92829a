"""The simulated loop beside the linear one: rate profiles for gyroscopes, words of 8 kHz back.

    multisine     sum of A_i sin(2 pi f_i t + phi_i), all f_i multiples of 1/window, read by least squares over it
    run_profiles  each gyroscope from power-on to lock, then its profile
Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.errors import ConfigError
from testbench.run import simulate
from testbench.run.simulation import Simulation

DEG = math.pi / 180
LINES_HZ = (1, 2, 4, 7, 11, 15, 18, 21, 24, 26, 28, 30, 35, 42, 50, 60)
SETTLE_S, WINDOW_S, LINE_DPS = 2.5, 2.0, 4.0


class ProfileRun(NamedTuple):
    """Rows of a profile from its first frame on, and whether the gyroscope was in lock all the time."""

    frame_s: float
    columns: dict
    locked: bool

    @property
    def time_s(self):
        """Instants of the rows, 0 the profile's first."""
        return np.arange(len(self.columns["lock"])) * self.frame_s


def _run_profile(config, rate_dps):
    temp = config.scenario.temperature_degc
    temp_degc = temp if isinstance(temp, (int, float)) else temp[0][1]
    sim = Simulation(config, temp_degc, temp_degc)
    sim.keep_codes = sim.keep_rows = False
    if simulate.start(config, sim, float(rate_dps[0]) * DEG, temp_degc) is None:
        raise ConfigError("loop simulation: the gyroscope did not lock")
    frame_ticks = sim.design.frame_ticks
    sim.advance(-sim.tick % frame_ticks, float(rate_dps[0]) * DEG, temp_degc)
    sim.keep_rows = True
    sim.advance(len(rate_dps) * frame_ticks, rate_dps * DEG, temp_degc)
    columns = sim.columns()
    lock = columns["lock"]
    return ProfileRun(1 / sim.design.frame_hz, columns, bool(np.all(lock == lock[0])) and sim.locked)


def run_profiles(configs, profiles_dps):
    """[`ProfileRun`, ...]; profiles are deg/s per frame. ConfigError if a gyroscope does not lock."""
    return [_run_profile(c, np.asarray(r, float)) for c, r in zip(configs, profiles_dps)]


def multisine(lines_hz=LINES_HZ, line_dps=LINE_DPS, settle_s=SETTLE_S, window_s=WINDOW_S, frame_hz=DEFAULT.frame_hz):
    """Rate (deg/s) per frame, settling time first: value in the middle of each frame."""
    t = (np.arange(round((settle_s + window_s) * frame_hz)) + 0.5) / frame_hz - settle_s
    phase = np.random.default_rng(1).uniform(0, 2 * math.pi, len(lines_hz))
    return line_dps * np.sin(2 * math.pi * np.outer(t, lines_hz) + phase).sum(axis=1)


def fit_line_amplitudes(time_s, values, lines_hz):
    """Complex amplitudes of lines (a - j b of a cos + b sin) by joint least squares with an offset."""
    angle = 2 * math.pi * np.outer(time_s, lines_hz)
    basis = np.hstack([np.cos(angle), np.sin(angle), np.ones((len(time_s), 1))])
    coefficients = np.linalg.lstsq(basis, np.asarray(values, float), rcond=None)[0]
    n = len(lines_hz)
    return coefficients[:n] - 1j * coefficients[n : 2 * n]


def measured_response(run: ProfileRun, rate_dps, lines_hz=LINES_HZ, window_s=WINDOW_S):
    """Word (LSB) per rate (deg/s) of a played multisine at its lines; phase against the row's time."""
    count = round(window_s / run.frame_s)
    t = run.time_s[-count:]
    rate = fit_line_amplitudes(t + 0.5 * run.frame_s, np.asarray(rate_dps)[-count:], lines_hz)
    return fit_line_amplitudes(t, run.columns["rate_word"][-count:], lines_hz) / rate


QUIET = {f"noise.{name}": False for name in ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")}

"""Baseband against the frame engine: start-up, rate steps, a temperature ramp, phase words at reset, partly, fully set.

    python -m testbench.baseband_accuracy [case ..]                   prints the table of docs/parts/averaged.md
    python -m testbench.baseband_accuracy [case ..] --not-retimed     with references that leave at any clock
    python -m testbench.baseband_accuracy [case ..] --twin            the frame engine against itself, see below

Both engines run the same gyroscope with all noise on, from power-on or from one locked state. Per 8 kHz stream: mean
and rms of the difference in units of sigma, the stream's own noise: the frame engine's, about its course at constant
conditions (a polynomial of third degree over four seconds: the slowest loop crosses over at 1 Hz). DAC codes at a
frame's first instant are samples of the carrier, no streams; `phase` is one where there is a motion. phase of x: the
drive mode's lag on theta, from truth and words; frequency: mean of the word. The last two are of the last half second.
Twin: a second frame engine in place of the baseband engine, its drive motion turned by TWIN_RAD at the start: what the
model's own sensitivity makes of a difference that no measurement sees. Cases from lock only.
Source    docs/parts/averaged.md
"""

import cmath
import math
import sys
from typing import NamedTuple

import numpy as np

from analog_frontend import top as plant
from fpga_model.rates import FRAME_CYCLES, FRAME_TICKS, MASTER_HZ, TICK_HZ
from testbench import budget, config, simulate
from testbench.baseband_setup import setup
from testbench.simulation import Simulation
from testbench.window import SLOT_WORD

STREAMS = (
    "adc_drive_sin",
    "adc_drive_cos",
    "adc_sense_sin",
    "adc_sense_cos",
    "adc_temperature",
    "frequency_word",
    "amplitude_word",
    "rate_word",
    "quadrature_code",
    "magnitude",
    "phase",
    "rate_output",
)
STATES = ("state", "lock", "flags")
MEAN_LIMIT, RMS_LIMIT = 0.1, 0.5
PHASE_LIMIT_DEG, FREQUENCY_LIMIT_HZ = 0.003, 1e-4
STEP_S = 0.5
QUIET_FRAMES = 32_000  # four seconds
MOVING = 0.01  # of the largest magnitude: below it the phase is that of noise
NOT_RETIMED = "--not-retimed"
TWIN, TWIN_RAD = "--twin", 1e-8
LATE_FRAMES = 4000  # half a second
SETTLED_S = 1.0
DEG = math.pi / 180


class Case(NamedTuple):
    """What is run from lock: rates (deg/s) of STEP_S each and temperatures (degC) between them; or from power-on."""

    rates_deg_s: tuple
    temps_degc: tuple = (25.0, 25.0)
    compensation: float = 0.0  # part of the budget's phases that the phase words take away
    start_up_s: float = 0.0


CASES = {
    "start-up": Case((), start_up_s=2.5),
    "rate steps": Case((0.0, 30.0, -30.0, 100.0, -100.0, 0.0)),
    "temperature ramp": Case((10.0,) * 6, (25.0, 31.0)),
    "half compensated": Case((0.0, 30.0, -100.0, 0.0), compensation=0.5),
    "compensated": Case((0.0, 30.0, -100.0, 0.0), compensation=1.0),
}


class Found(NamedTuple):
    """Per stream (sigma, mean/sigma, rms/sigma); differences of phase (deg) and frequency (Hz); unequal states."""

    streams: dict
    phase_deg: float
    frequency_hz: float
    states: int


def configuration(case, **values):
    """The default gyroscope with the case's phase words; `values` are changed keys, dots as two underscores."""
    base = config.changed(config.Config(), {key.replace("__", "."): value for key, value in values.items()})
    if not case.compensation:
        return base
    planned = budget.budget(base, 25.0)
    node, loop = planned.node_deg(), planned.loop_deg()
    words = {
        "phase_drive_sine_deg": node["xe1"],
        "phase_drive_ref_deg": -loop["xe2"],
        "phase_sense_sine_deg": node["ye1"],
        "phase_sense_ref_deg": -loop["ye2"],
    }
    return config.changed(base, {f"firmware.{key}": case.compensation * deg for key, deg in words.items()})


def _profiles(case):
    """Rate (rad/s) and temperature (degC) of every frame."""
    n = round(STEP_S * TICK_HZ) // FRAME_TICKS
    rate = np.repeat(np.array(case.rates_deg_s) * DEG, n)
    return rate, np.linspace(*case.temps_degc, len(rate))


def turned(values, angle_rad):
    """State values with the drive motion (x, vx/W) turned by an angle."""
    z = np.copy(values["plant.z"])
    motion = complex(z[plant.X], z[plant.VX]) * cmath.exp(1j * angle_rad)
    z[plant.X], z[plant.VX] = motion.real, motion.imag
    return values | {"plant.z": z}


def _run(case, checked, engine, values):
    """Columns of a case in an engine, from power-on or from the state `values`."""
    sim = Simulation(checked, min(case.temps_degc), max(case.temps_degc), engine=engine)
    if values is None:
        sim.now = (np.zeros(1), np.full(1, case.temps_degc[0]))
        for name, raw in sim.first_writes:
            sim.write(name, raw)
        sim.advance(round(case.start_up_s * TICK_HZ), 0.0, case.temps_degc[0])
        return sim.columns()
    sim.set_state(values)
    rate, temp = _profiles(case)
    sim.advance(len(rate) * FRAME_TICKS, rate, temp)
    return sim.columns()


def _lag_deg(columns, turn_clock):
    """Lag of x on theta per frame (deg, modulo 360); theta is the sum of the words from the first row on."""
    word = columns["frequency_word"]
    advance = turn_clock * word[:-1] + (FRAME_CYCLES - turn_clock) * word[1:]
    theta = np.concatenate([[0], np.cumsum(advance % (1 << 48))]) % (1 << 48) / 2**48
    x = columns["truth_x"] - 1j * columns["truth_vx"]
    return -np.angle(x * np.exp(-2j * np.pi * theta), deg=True)


def compare(case, checked=None, twin=False):
    """`Found` of a case; `twin`: of two frame engines."""
    checked = checked or configuration(case)
    rate, temp = (case.rates_deg_s or (0.0,))[0] * DEG, case.temps_degc[0]
    sim = Simulation(checked, min(case.temps_degc), max(case.temps_degc), engine="frame")
    simulate.start(checked, sim, rate, temp)
    sim.advance(round(SETTLED_S * TICK_HZ), rate, temp)
    values = None if case.start_up_s else sim.state_values()
    sim.advance(QUIET_FRAMES * FRAME_TICKS, rate, temp)
    quiet = sim.columns()
    turn_clock = setup(sim.params).valid + SLOT_WORD + 1
    frame = _run(case, checked, "frame", values)
    baseband = (
        _run(case, checked, "frame", turned(values, TWIN_RAD)) if twin else _run(case, checked, "baseband", values)
    )
    streams = {}
    at = np.arange(QUIET_FRAMES)
    for name in STREAMS:
        last = quiet[name][-QUIET_FRAMES:].astype(float)
        sigma = float(np.std(last - np.polyval(np.polyfit(at, last, 3), at)))
        difference = (baseband[name] - frame[name]).astype(float)
        if name == "phase":
            difference = difference[frame["magnitude"] > MOVING * frame["magnitude"].max()]
        streams[name] = (sigma, difference.mean() / sigma, float(np.sqrt((difference**2).mean())) / sigma)
    late = slice(-LATE_FRAMES, None)
    lag = (_lag_deg(baseband, turn_clock) - _lag_deg(frame, turn_clock) + 180.0) % 360.0 - 180.0
    word = (baseband["frequency_word"] - frame["frequency_word"])[late].mean()
    states = int(sum((baseband[name] != frame[name]).sum() for name in STATES))
    return Found(streams, float(lag[late].mean()), float(word) * MASTER_HZ / 2**48, states)


def failures(found):
    """Lines of what is beyond the limits."""
    out = [f"{n}: mean {m:+.3f} sigma" for n, (_, m, _) in found.streams.items() if not abs(m) < MEAN_LIMIT]
    out += [f"{n}: rms {r:.3f} sigma" for n, (_, _, r) in found.streams.items() if not r < RMS_LIMIT]
    if not abs(found.phase_deg) < PHASE_LIMIT_DEG:
        out.append(f"phase: {found.phase_deg:+.5f} deg")
    if not abs(found.frequency_hz) < FREQUENCY_LIMIT_HZ:
        out.append(f"frequency: {found.frequency_hz:+.6f} Hz")
    return out


def table(results):
    """Markdown: a row per stream, a pair mean / rms per case."""
    lines = ["| stream | sigma | " + " | ".join(results) + " |", "|---|---:|" + "---:|" * len(results)]
    for name in STREAMS:
        cells = [f"{f.streams[name][1]:+.3f} / {f.streams[name][2]:.3f}" for f in results.values()]
        sigma = next(iter(results.values())).streams[name][0]
        lines.append(f"| {name} | {sigma:.1f} | " + " | ".join(cells) + " |")
    lines.append("| phase of x, deg | | " + " | ".join(f"{f.phase_deg:+.5f}" for f in results.values()) + " |")
    lines.append("| frequency, mHz | | " + " | ".join(f"{1e3 * f.frequency_hz:+.4f}" for f in results.values()) + " |")
    lines.append("| frames with another state | | " + " | ".join(str(f.states) for f in results.values()) + " |")
    return "\n".join(lines)


def main(names):
    """Run the named cases, or all, and print the table and what is beyond the limits."""
    values = {"firmware__reference_retimed": False} if NOT_RETIMED in names else {}
    twin = TWIN in names
    chosen = [name for name in names if name not in (NOT_RETIMED, TWIN)]
    chosen = chosen or [name for name, case in CASES.items() if not (twin and case.start_up_s)]
    results = {name: compare(CASES[name], configuration(CASES[name], **values), twin) for name in chosen}
    print(table(results))
    for name, found in results.items():
        for line in failures(found):
            print(f"beyond the limits: {name}: {line}")


if __name__ == "__main__":
    main(sys.argv[1:])

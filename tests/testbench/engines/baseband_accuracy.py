"""Baseband against the frame engine: start-up, rate steps, a temperature ramp, phase words at reset, partly, fully set.

    python -m tests.testbench.engines.baseband_accuracy [case ..]     prints the tables of accuracy
        --not-retimed     with references that leave at any clock
        --board=FILE      a board of docs/boards in place of the default gyroscope
        --anew            the baseband engine anew every half second
        --twins           frame engines among themselves, too

Both engines run the same gyroscope with all noise on, from power-on or from one locked state. Per 8 kHz stream: mean
and rms of the difference in units of sigma, the stream's own noise: the frame engine's, about its course at constant
conditions (a polynomial of third degree over four seconds: the slowest loop crosses over at 1 Hz). DAC codes at a
frame's first instant are samples of the carrier, no streams; `phase` is one where there is a motion. phase of x: the
drive mode's lag on theta, from truth and words; frequency: mean of the word. The last two are of the last half second.
Both from lock only:
    anew    the baseband engine takes the frame engine's state every STEP_S: what it does wrong by itself, before the
            model's own sensitivity makes more of it
    twins   TWINS runs of either engine, the drive motion turned at the start by angles that no measurement sees, all
            compared with each other: what that sensitivity makes of nothing
Source    docs/plant.md
"""

import cmath
import itertools
import math
import sys
from typing import NamedTuple

import numpy as np

from analog_frontend import top as plant
from fpga_model.design_record import Design
from testbench import config
from testbench.engines.baseband_setup import setup
from testbench.engines.window import SLOT_WORD
from testbench.run import budget, simulate
from testbench.run.simulation import Simulation

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
BOARD = "--board="  # a configuration file
ANEW, AMONG = "--anew", "--twins"
TWINS, TWINS_RAD = 12, (1e-8, 1e-7, 1e-6)  # how many, and the largest angle between two of them
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


class Start(NamedTuple):
    """Where a case begins, a second after lock; None from power-on."""

    values: dict
    sigmas: dict
    turn_clock: int
    design: Design


def configuration(case, board=None, **values):
    """The default gyroscope or a board with the case's phase words; `values`: changed keys, dots as two underscores."""
    base = board or config.Config()
    base = config.changed(base, {key.replace("__", "."): value for key, value in values.items()})
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


def _profiles(case, d):
    """Rate (rad/s) and temperature (degC) of every frame."""
    n = round(STEP_S * d.frame_hz)
    rate = np.repeat(np.array(case.rates_deg_s) * DEG, n)
    return rate, np.linspace(*case.temps_degc, len(rate))


def turned(values, angle_rad):
    """State values with the drive motion (x, vx/W) turned by an angle."""
    z = np.copy(values["plant.z"])
    motion = complex(z[plant.X], z[plant.VX]) * cmath.exp(1j * angle_rad)
    z[plant.X], z[plant.VX] = motion.real, motion.imag
    return values | {"plant.z": z}


def _simulation(case, checked, engine):
    return Simulation(checked, min(case.temps_degc), max(case.temps_degc), engine=engine)


def start_of(case, checked):
    """`Start` of a case, and sigma of every stream from four quiet seconds."""
    rate, temp = (case.rates_deg_s or (0.0,))[0] * DEG, case.temps_degc[0]
    sim = _simulation(case, checked, "frame")
    simulate.start(checked, sim, rate, temp)
    d = sim.design
    sim.advance(round(SETTLED_S * simulate.pace(checked) * d.tick_hz), rate, temp)
    values = None if case.start_up_s else sim.state_values()
    sim.advance(QUIET_FRAMES * d.frame_ticks, rate, temp)
    quiet, at, sigmas = sim.columns(), np.arange(QUIET_FRAMES), {}
    for name in STREAMS:
        last = quiet[name][-QUIET_FRAMES:].astype(float)
        sigmas[name] = float(np.std(last - np.polyval(np.polyfit(at, last, 3), at)))
    return Start(values, sigmas, setup(sim.params).valid + SLOT_WORD + 1, d)


def _powered_on(case, checked, engine):
    """Columns of a start-up in an engine."""
    sim = _simulation(case, checked, engine)
    sim.now = (np.zeros(1), np.full(1, case.temps_degc[0]))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    sim.advance(round(case.start_up_s * sim.design.tick_hz), 0.0, case.temps_degc[0])
    return sim.columns()


def lived(case, checked, engine, *states):
    """Columns of a case from lock, in an engine that takes one of `states` after the other, for equal times."""
    sim = _simulation(case, checked, engine)
    rate, temp = _profiles(case, sim.design)
    frames = len(rate) // len(states)
    for k, values in enumerate(states):
        part = slice(k * frames, (k + 1) * frames)
        sim.set_state(values)
        sim.advance(frames * sim.design.frame_ticks, rate[part], temp[part])
    return sim.columns()


def _states(case, checked, values):
    """States of the frame engine at the begin of every STEP_S of a case."""
    sim = _simulation(case, checked, "frame")
    sim.set_state(values)
    rate, temp = _profiles(case, sim.design)
    frames = len(rate) // len(case.rates_deg_s)
    for k in range(len(case.rates_deg_s)):
        yield sim.state_values()
        part = slice(k * frames, (k + 1) * frames)
        sim.advance(frames * sim.design.frame_ticks, rate[part], temp[part])


def _lag_deg(columns, turn_clock, d):
    """Lag of x on theta per frame (deg, modulo 360); theta is the sum of the words from the first row on."""
    word = columns["frequency_word"]
    advance = turn_clock * word[:-1] + (d.frame_clocks - turn_clock) * word[1:]
    turn = 1 << d.dds_bits
    theta = np.concatenate([[0], np.cumsum(advance % turn)]) % turn / turn
    x = columns["truth_x"] - 1j * columns["truth_vx"]
    return -np.angle(x * np.exp(-2j * np.pi * theta), deg=True)


def _found(start, frame, other, since=0):
    """`Found` of two runs that have a state in common at row `since`."""
    streams = {}
    for name, sigma in start.sigmas.items():
        difference = (other[name] - frame[name]).astype(float)
        if name == "phase":
            difference = difference[frame["magnitude"] > MOVING * frame["magnitude"].max()]
        streams[name] = (sigma, difference.mean() / sigma, float(np.sqrt((difference**2).mean())) / sigma)
    late = slice(-LATE_FRAMES, None)
    lags = [_lag_deg({n: v[since:] for n, v in run.items()}, start.turn_clock, start.design) for run in (other, frame)]
    lag = (lags[0] - lags[1] + 180.0) % 360.0 - 180.0
    word = (other["frequency_word"] - frame["frequency_word"])[late].mean()
    states = int(sum((other[name] != frame[name]).sum() for name in STATES))
    lsb_hz = start.design.master_hz / 2**start.design.dds_bits
    return Found(streams, float(lag[late].mean()), float(word) * lsb_hz, states)


def compare(case, checked=None, anew=False):
    """`Found` of a case; `anew`: where the baseband engine takes the frame engine's state every STEP_S."""
    checked = checked or configuration(case)
    start = start_of(case, checked)
    if case.start_up_s:
        return _found(start, *(_powered_on(case, checked, engine) for engine in ("frame", "baseband")))
    states = list(_states(case, checked, start.values)) if anew else [start.values]
    frame, baseband = (lived(case, checked, engine, *states) for engine in ("frame", "baseband"))
    return _found(start, frame, baseband, len(frame["phase"]) * (len(states) - 1) // len(states))


def twins(case, checked=None, rad=TWINS_RAD[0], count=TWINS):
    """`Found` of every two of `count` frame engines, then as many baseband, all turned by 0 .. `rad` at the start."""
    checked = checked or configuration(case)
    start = start_of(case, checked)
    states = [turned(start.values, rad * k / (count - 1)) for k in range(count)]
    runs = [lived(case, checked, engine, values) for engine in ("frame", "baseband") for values in states]
    return {(i, k): _found(start, runs[i], runs[k]) for i, k in itertools.combinations(range(len(runs)), 2)}


def figures(found):
    """Every figure that has a limit, by name: (figure, limit, unit)."""
    out = {f"{n}: mean": (m, MEAN_LIMIT, "sigma") for n, (_, m, _) in found.streams.items()}
    out |= {f"{n}: rms": (r, RMS_LIMIT, "sigma") for n, (_, _, r) in found.streams.items()}
    out["phase of x"] = found.phase_deg, PHASE_LIMIT_DEG, "deg"
    out["frequency"] = found.frequency_hz, FREQUENCY_LIMIT_HZ, "Hz"
    return out


def beyond(found, pairs=None):
    """Names of the figures that are beyond their limits.

    pairs  of `twins`: what two frame engines differ by at most is no error of the engine that is compared; being
           independent of that error, it adds to the limit as the root of the sum of squares
    """
    over = set()
    for name, (value, limit, _) in figures(found).items():
        frames = (max(k for _, k in pairs) + 1) // 2 if pairs else 0
        apart = sizes(pairs, name)[:frames, :frames].max() if pairs else 0.0
        if not abs(value) < math.hypot(limit, apart):
            over.add(name)
    return over


def failures(found):
    """Lines of what is beyond the limits."""
    over = beyond(found)
    return [f"{name} {value:+.5g} {unit}" for name, (value, _, unit) in figures(found).items() if name in over]


def sizes(pairs, name):
    """Magnitudes of a figure of `twins`, (runs, runs)."""
    runs = max(k for _, k in pairs) + 1
    out = np.zeros((runs, runs))
    for (i, k), found in pairs.items():
        out[i, k] = out[k, i] = abs(figures(found)[name][0])
    return out


def among(found, by_rad):
    """Markdown: what is beyond a limit, beside the same of `twins` by their angle.

    Median / largest, of frame engines among themselves, and of baseband engines against frame engines.
    """
    head, groups = [], []
    for rad, pairs in by_rad.items():
        head += [f"frame, {rad:g} rad", f"baseband, {rad:g} rad"]
        groups.append([f for (_, k), f in pairs.items() if k < TWINS])
        groups.append([f for (i, k), f in pairs.items() if i < TWINS <= k])
    lines = ["| figure | limit | baseband | " + " | ".join(head) + " |", "|---|---:|---:|" + "---:|" * len(head)]
    over = beyond(found).union(*map(beyond, groups[0]))
    for name, (value, limit, unit) in figures(found).items():
        if name in over:
            all_sizes = [[abs(figures(f)[name][0]) for f in group] for group in groups]
            cells = [f"{np.median(s):.3f} / {max(s):.3f}" for s in all_sizes]
            lines.append(f"| {name}, {unit} | {limit:g} | {value:+.3f} | " + " | ".join(cells) + " |")
    cells = [f"{sum(bool(beyond(f)) for f in group)} of {len(group)}" for group in groups]
    lines.append("| pairs beyond a limit | | | " + " | ".join(cells) + " |")
    return "\n".join(lines)


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
    anew, pairs = ANEW in names, AMONG in names
    boards = [config.load(name.removeprefix(BOARD)) for name in names if name.startswith(BOARD)]
    chosen = [name for name in names if not name.startswith("--")]
    chosen = [name for name in chosen or CASES if not ((anew or pairs) and CASES[name].start_up_s)]
    results = {}
    for name in chosen:
        case, checked = CASES[name], configuration(CASES[name], *boards, **values)
        results[name] = compare(case, checked, anew)
        if pairs:
            found = among(results[name], {rad: twins(case, checked, rad) for rad in TWINS_RAD})
            print(f"{name}\n\n{found}\n")
    if not pairs:
        print(table(results))
    for name, found in results.items():
        for line in failures(found):
            print(f"beyond the limits: {name}: {line}")


if __name__ == "__main__":
    main(sys.argv[1:])

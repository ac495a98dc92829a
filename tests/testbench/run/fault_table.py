"""Every fault, injected into a locked gyroscope at 100 deg/s: what sees it, how fast, and the rate error meanwhile.

    seen by   the first flag that rises, else `lock` if LOCKED ends, else `summary` if the run warns, else `nothing`
    good for  time until `rate_good` = 0, which a host waits for
    error     of the force word, the largest mean of ERROR_FRAMES frames with `rate_good` = 1 after the fault, in deg/s

Times count from the tick at which the fault begins to the row that shows it. `expected` is what a case is there to
hold: `cases` without it is a list of experiments, with it a list of claims.
Source  docs/faults.md, testbench.commands.faults_page
"""

import functools
from typing import NamedTuple

import numpy as np

from fpga_model import fault_monitor, sequencer
from fpga_model.rates import FRAME_HZ, TICK_HZ
from testbench.config import Config, changed, scenario
from testbench.run import build, simulate
from testbench.run.anomaly_warnings import SETTLE_FRAMES, AnomalyDetector
from testbench.run.simulation import DEG, Simulation

RATE_DPS, TEMP_DEGC = 100.0, 25.0
SETTLED_S = 1.0  # after lock
BEFORE_S = 0.1
LASTS_S = 0.9
RINGS_S = 5.9  # the drive mode rings down with 3 s
DRIFT_STEPS, DRIFT_S = 100, 5.0
ERROR_FRAMES = 8
SPIKE_CODES = 100_000
POWER_ON_S = 3.0
ANALOG, DIGITAL = "analog_sid", "digital_sid"


class Case(NamedTuple):
    """A fault: its name, what sees it first, and how it is made; `channel` names the group of the table."""

    name: str
    expected: str
    faults: tuple = ()  # (begin s, kind, channel, value, duration s) from the fault on
    board: str = ANALOG
    config: tuple = ()  # pairs of section.key and value
    power_on: bool = False  # the configuration itself is the fault, from power-on
    lasts_s: float = LASTS_S
    rate_dps: float = RATE_DPS  # from the fault on


class Row(NamedTuple):
    """What happened."""

    seen_by: str
    seen_ms: float
    state: str  # at the end
    good_ms: float  # until rate_good = 0; inf: it stays 1
    error_dps: float
    warnings: tuple


def _for_good(kind, channel, value=0):
    return ((0.0, kind, channel, value, np.inf),)


def _drift(channel, codes):
    """An offset that grows to `codes` in equal steps; each ends within the tick in which the next begins."""
    step_s = DRIFT_S / DRIFT_STEPS
    for k in range(DRIFT_STEPS):
        lasts_s = step_s - 1e-7 if k < DRIFT_STEPS - 1 else np.inf
        yield (round(k * step_s, 6), "adc_offset", channel, round(codes * (k + 1) / DRIFT_STEPS), lasts_s)


def bursts(kind, channel, value, lasts_s, period_s):
    """A fault that comes and goes."""
    for k in range(round(LASTS_S / period_s)):
        yield (round(k * period_s, 6), kind, channel, value, lasts_s)


def _channels():
    """The four codes of the ADC, one at a time."""
    for name in scenario.ADC_CHANNELS[:4]:
        yield Case(f"{name} frozen", "STUCK", _for_good("adc_frozen", name))
    for name, code in zip(scenario.ADC_CHANNELS, (0, -3_000_000, 0, 0)):
        yield Case(f"{name} stuck at code {code}", "STUCK", _for_good("adc_stuck", name, code))
    for name in scenario.ADC_CHANNELS[:4]:
        yield Case(f"{name} at its rail", "OVER_RANGE", _for_good("adc_over_range", name, 1))
    yield Case("temperature stuck", "nothing", _for_good("adc_stuck", "temperature", 0))
    yield Case("temperature frozen", "nothing", _for_good("adc_frozen", "temperature"))
    for name, expected in zip(scenario.ADC_CHANNELS, ("nothing", "summary", "nothing", "nothing")):
        yield Case(f"{name}: gain 0.9", expected, _for_good("adc_gain", name, round(0.9 * 65536)))
    for name, expected in zip(scenario.ADC_CHANNELS, ("nothing", "summary", "summary", "summary")):
        whole = {"drive_cos": 300_000}.get(name, 30_000)
        yield Case(
            f"{name}: drift of {whole} codes in 5 s", expected, tuple(_drift(name, whole)), lasts_s=DRIFT_S + LASTS_S
        )
    for name in scenario.ADC_CHANNELS[:4]:
        spikes = tuple(bursts("adc_offset", name, SPIKE_CODES, 1e-3, 10e-3))
        yield Case(f"{name}: {SPIKE_CODES} codes for 1 of 10 ms", "summary", spikes)
    yield Case("sense_sin and sense_cos swapped", "QSC_RAIL", _swapped("sense_sin", "sense_cos"))
    yield Case("drive_sin and drive_cos swapped", "lock", _swapped("drive_sin", "drive_cos"))


def _swapped(one, other):
    index = scenario.ADC_CHANNELS.index
    return (*_for_good("adc_swapped", one, index(other)), *_for_good("adc_swapped", other, index(one)))


def _converter():
    """The ADC as a whole."""
    yield Case("ADC silent", "STALE", _for_good("adc_silent", "adc"))
    yield Case("every status word bad", "STALE", _for_good("adc_bad_status", "adc", 0))
    yield Case("one frame with a bad status word", "STALE", ((0.0, "adc_bad_status", "adc", 0, 125e-6),))
    yield Case("a bit lost behind the status word", "lock", _for_good("adc_lost_bit", "adc", 25))
    yield Case("a bit lost in sense_sin", "nothing", _for_good("adc_lost_bit", "adc", 90))
    frozen = tuple((0.0, "adc_frozen", name, 0, 125e-6) for name in scenario.ADC_CHANNELS)
    yield Case("one frame repeated", "nothing", frozen)
    half = tuple((0.0, "adc_frozen", name, 0, 2e-3) for name in scenario.ADC_CHANNELS)
    yield Case("frames repeated for 2 ms", "summary", half)


def _outputs():
    """The DACs."""
    yield Case("drive DAC stuck at 0", "lock", _for_good("dac_stuck", "drive", 0), lasts_s=RINGS_S)
    yield Case("drive DAC stuck at code 10000", "lock", _for_good("dac_stuck", "drive", 10_000), lasts_s=RINGS_S)
    yield Case("drive DAC at its rail", "lock", _for_good("dac_stuck", "drive", 32_767), lasts_s=RINGS_S)
    yield Case("sense DAC stuck at 0", "RATE_SATURATED", _for_good("dac_stuck", "sense", 0))
    yield Case("sense DAC stuck at code 100000", "RATE_SATURATED", _for_good("dac_stuck", "sense", 100_000))
    yield Case("sense DAC at its rail", "RATE_SATURATED", _for_good("dac_stuck", "sense", 524_287))
    for name in scenario.DAC_CODES:
        yield Case(f"{name} DAC stuck at 0 for 5 of 50 ms", "summary", tuple(bursts("dac_stuck", name, 0, 5e-3, 50e-3)))
    yield Case("quadrature DAC stuck at 0", "QSC_RAIL", _for_good("dac_stuck", "quadrature", 0))
    yield Case("quadrature DAC stuck at code 30000", "QSC_RAIL", _for_good("dac_stuck", "quadrature", 30_000))
    yield Case("quadrature DAC at its rail", "QSC_RAIL", _for_good("dac_stuck", "quadrature", 65_535))


def _plant():
    """The gyroscope, its clock, and what it is asked for."""
    yield Case("x not a number", "OVER_RANGE", _for_good("plant_nan", "x"))
    yield Case("y not a number", "OVER_RANGE", _for_good("plant_nan", "y"))
    yield Case("rate beyond the force", "RATE_SATURATED", rate_dps=1000.0)
    dead = (("plant.k_vf_drive_n_per_v", 1e-12),)
    yield Case("no drive force, from power-on", "SEARCH_FAILED", config=dead, power_on=True)
    far = (("firmware.nominal_frequency_hz", 11002.3 + 150.0),)
    yield Case("150 Hz from resonance, from power-on", "SEARCH_FAILED", config=far, power_on=True)
    yield Case("clock 1000 ppm off, from power-on", "nothing", config=(("plant.clock_ppm", 1000.0),), power_on=True)
    much = (("plant.kxy_n_per_m", 0.1),)
    yield Case("quadrature twice the range, from power-on", "QSC_RAIL", config=much, power_on=True)


def _samples():
    """The board without the analog SID."""
    for name in scenario.SAMPLES:
        yield Case(f"sample of {name} frozen", "STALE", _for_good("sample_frozen", name), DIGITAL)
    for name in scenario.SAMPLES:
        yield Case(f"sample of {name} stuck at 0", "STALE", _for_good("sample_stuck", name), DIGITAL)
    for name in scenario.SAMPLES:
        yield Case(f"sample of {name} at its rail", "STALE", _for_good("sample_stuck", name, 131_071), DIGITAL)
    yield Case("drive DAC stuck at 0", "lock", _for_good("dac_stuck", "drive", 0), DIGITAL, lasts_s=RINGS_S)
    yield Case("sense DAC stuck at 0", "RATE_SATURATED", _for_good("dac_stuck", "sense", 0), DIGITAL)
    yield Case("quadrature DAC stuck at 0", "QSC_RAIL", _for_good("dac_stuck", "quadrature", 0), DIGITAL)
    yield Case("x not a number", "STALE", _for_good("plant_nan", "x"), DIGITAL)
    yield Case("y not a number", "STALE", _for_good("plant_nan", "y"), DIGITAL)


def cases():
    """All cases, in the order of the table."""
    return (*_channels(), *_converter(), *_outputs(), *_plant(), *_samples())


@functools.cache
def _locked(board):
    """State of a gyroscope that has settled, as numbers by name."""
    config = changed(Config(), {"firmware.board": board})
    sim = Simulation(config, TEMP_DEGC, TEMP_DEGC)
    if simulate.start(config, sim, RATE_DPS * DEG, TEMP_DEGC) is None:
        raise RuntimeError(f"fault table: board {board} does not lock")
    sim.advance(round(SETTLED_S * TICK_HZ), RATE_DPS * DEG, TEMP_DEGC)
    return sim.state_values()


def run(case):
    """`Row` of a case."""
    config = changed(Config(), {"firmware.board": case.board, **dict(case.config)})
    sim = Simulation(config, TEMP_DEGC, TEMP_DEGC)
    doubts = AnomalyDetector()
    doubts.active, doubts.locked = True, SETTLE_FRAMES
    sim.keep_codes, sim.sinks = False, [doubts]
    if case.power_on:
        simulate.start(config, sim, RATE_DPS * DEG, TEMP_DEGC, limit_s=POWER_ON_S)
        if sim.locked:
            sim.advance(TICK_HZ, RATE_DPS * DEG, TEMP_DEGC)
        return row_of(sim.columns(), 0, doubts.warnings(config), build.nominal(config))
    sim.set_state(_locked(case.board))
    begin = sim.tick
    values = {
        "scenario.seconds": BEFORE_S + case.lasts_s,
        "scenario.rate_dps": [[0.0, RATE_DPS], [BEFORE_S, case.rate_dps]],
        "scenario.rate_shape": "steps",
        "scenario.faults": [[BEFORE_S + fault[0], *fault[1:]] for fault in case.faults],
    }
    simulate.play(sim, scenario.expand(changed(config, values).scenario))
    at = (begin + round(BEFORE_S * TICK_HZ)) * FRAME_HZ / TICK_HZ
    return row_of(sim.columns(), at - -(-begin * FRAME_HZ // TICK_HZ), doubts.warnings(config), build.nominal(config))


def row_of(c, at, warnings, nominal):
    """What the columns show of a fault at frame `at` of them, a fraction where it falls between two rows."""
    first = int(np.ceil(at))
    state, flags = c["state"][first:], c["flags"][first:]
    good = (state == sequencer.LOCKED) & (flags & sequencer.DOUBTFUL == 0)
    seen_by, seen = "summary" if warnings else "nothing", None
    if not first and state[-1] != sequencer.LOCKED:
        seen_by = "lock"
    elif first and not np.all(state == sequencer.LOCKED):
        seen_by, seen = "lock", int(np.argmax(state != sequencer.LOCKED))
    raised = [(int(np.argmax(flags >> k & 1)), k) for k in range(len(fault_monitor.NAMES)) if np.any(flags >> k & 1)]
    if raised and (seen is None or min(raised)[0] <= seen):
        seen, bit = min(raised)
        seen_by = fault_monitor.NAMES[bit]
    late = first - at
    error = 0.0
    if first:
        lsb = nominal["word_v_per_deg_s"] / 10.0 * 2**23
        word = (c["rate_word"] - c["rate_word"][: first - 1].mean()) / lsb
        means = np.convolve(word[first:], np.ones(ERROR_FRAMES) / ERROR_FRAMES, "valid")
        stays = np.convolve(good, np.ones(ERROR_FRAMES), "valid") == ERROR_FRAMES
        error = float(np.abs(means[stays]).max()) if stays.any() else 0.0
    ms = 1e3 / FRAME_HZ
    return Row(
        seen_by,
        np.inf if seen is None else ms * (seen + late),
        sequencer.STATES[int(state[-1])],
        np.inf if good.all() else ms * (int(np.argmin(good)) + late),
        error,
        tuple(warnings),
    )

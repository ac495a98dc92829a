"""The frame engine against the clocked one: every register, every bit of the plant, every code, in any situation."""

import numpy as np
import pytest

from analog_frontend import top as plant
from analog_frontend.parts import adc_serial
from fpga_model import dds, registers, sequencer
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench import flatten
from testbench.engines import engine, frame
from testbench.engines.engine import FROZEN, GAIN, OFFSET, STUCK, SWAPPED
from testbench.run import build
from tests.testbench.bench_setup import configured

CONFIGURATIONS = 48


def rarely(values, fast):
    """`values` as parameters, slow but for the first ones."""
    return [pytest.param(v, marks=() if n < fast else pytest.mark.slow) for n, v in enumerate(values)]


OFFSETS = ("phase_drive_sine", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref")
QUIET = engine.Faults()


def own(state):
    """A copy that shares no array."""
    return state._replace(plant=plant.copy(state.plant))


def everything(state):
    """All that a run continues from, by name."""
    for name, value in flatten.leaves(state):
        if not name.startswith("plant.work"):
            yield name, value


def different(one, other):
    """Names of what differs between two states, to the last bit (a NaN equals a NaN)."""
    pairs = zip(everything(one), everything(other), strict=True)
    return [name for (name, a), (_, b) in pairs if not np.array_equal(np.asarray(a, float), np.asarray(b, float), True)]


class Pair:
    """Both engines on one gyroscope; every `advance` compares all registers, the whole plant and all streams."""

    def __init__(self, params, state):
        self.params, self.clocked, self.frame = params, own(state), own(state)

    def advance(self, ticks, rate_rad_s=0.3, temp_degc=25.0, host=(0, 0, 0), faults=QUIET, probe_ticks=0):
        frames = ticks // FRAME_TICKS + 2
        rate, temp = (np.resize(np.asarray(x, float), frames) for x in (rate_rad_s, temp_degc))
        streams = [engine.streams(ticks, frames, 0, probe_ticks) for _ in range(2)]
        begin = self.clocked.tick
        self.clocked = engine.run(self.params, self.clocked, ticks, rate, temp, host, faults, streams[0])
        self.frame = frame.run(self.params, self.frame, ticks, rate, temp, host, faults, streams[1])
        assert different(self.clocked, self.frame) == [], f"after {ticks} ticks from {begin}"
        for name, a, b in zip(engine.Streams._fields, *streams):
            np.testing.assert_array_equal(a, b, err_msg=f"{name}, {ticks} ticks from {begin}")
        return streams[1]


def write(name, raw):
    entry = registers.BY_NAME[name]
    return 1, entry.address, registers.to_bus(int(raw), entry.fmt)


@pytest.fixture(scope="module")
def locked():
    """(params, state) of the default gyroscope 50 ms after lock, by the frame engine."""
    params = build.params(configured(), 25.0, 25.0)
    state = engine.reset(params, 25.0)
    while state.fpga.control.sequencer.state != sequencer.LOCKED:
        assert state.tick < 3_000_000
        state = advanced(params, state, 50_000)
    return params, advanced(params, state, 50_000)


def advanced(params, state, ticks, rate_rad_s=0.3):
    """The frame engine alone."""
    frames = ticks // FRAME_TICKS + 2
    streams = engine.streams()
    return frame.run(
        params, state, ticks, np.full(frames, rate_rad_s), np.full(frames, 25.0), engine.NO_WRITE, QUIET, streams
    )


def drawn(rng):
    """A random configuration: latencies, re-timing, converter clock, board, delays, noise, effects."""
    free = bool(rng.integers(0, 2))
    values = {
        "firmware__board": rng.choice(["analog_sid", "digital_sid"]),
        "firmware__pipeline_registers": int(rng.integers(0, 9)),
        "firmware__reference_registers": int(rng.integers(0, 4)),
        "firmware__reference_retimed": bool(rng.integers(0, 2)),
        "firmware__frame_latency_drive": int(rng.integers(0, 3)),
        "firmware__frame_latency_sense": int(rng.integers(0, 3)),
        "firmware__quadrature_update_khz": int(rng.choice([500, 1000])),
        "firmware__adc_clock": "free_running" if free else "synchronous",
        "plant__adc_clock_ppm": float(rng.uniform(-4000, 4000)) if free else 0.0,
        "plant__adc_delay_s": float(rng.uniform(0, 100e-6)),
        "plant__sid_switch_s": float(rng.uniform(0, 0.9e-6)),
        "plant__drive_dac_delay_s": float(rng.uniform(0, 0.9e-6)),
        "plant__sense_dac_delay_s": float(rng.uniform(0, 0.9e-6)),
        "plant__drive_dac_glitch_v_s": float(rng.choice([0.0, 1e-9])),
        "plant__fx_hz": float(rng.uniform(10990, 11015)),
        "noise__seed": int(rng.integers(0, 2**62)),
    }
    for source in ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter"):
        values[f"noise__{source}"] = bool(rng.integers(0, 4))
    for effect, size in (("duffing_k3_per_um2", 1e-4), ("drive_cubic_per_v2", 1e-3), ("feedthrough_y", 1e-4)):
        values[f"effects__{effect}"] = float(rng.choice([0.0, size]))
    more = rng.integers(0, 2, size=3)  # drawn last: the configurations of a seed stay what they were otherwise
    values["effects__drive_dac_levels"] = ["element 5/8 = -20.0", "step 3/4 = 3.0", "bit 7 = 0.5"] if more[0] else []
    values["effects__sense_dac_levels"] = ["element 17/32 = 50.0"] if more[1] else []
    wrong_adc = bool(more[2]) and values["firmware__board"] == "analog_sid"
    values["effects__adc_curve"] = [1e-4, 0.0, -2e-4] if wrong_adc else []
    for effect, size in (("adc_turnover", 1e-4), ("adc_gain_tc_per_k", 1e-4), ("adc_memory", 1e-3)):
        values[f"effects__{effect}"] = size * wrong_adc
    values["plant__sid_fall_s"] = float(rng.choice([0.0, 70e-9, -min(values["plant__sid_switch_s"], 70e-9)]))
    return {key: value.item() if hasattr(value, "item") else value for key, value in values.items()}


@pytest.mark.parametrize("seed", rarely(range(CONFIGURATIONS), 10))
def test_random_configurations(locked, seed):
    """Four different phase offsets, random rates, writes and chunks: every register wherever a chunk ends."""
    rng = np.random.default_rng(seed)
    params = build.params(configured(**drawn(rng)), 25.0, 25.0)
    pair = Pair(params, locked[1])
    for name in OFFSETS:
        pair.advance(1, host=write(name, rng.integers(0, 1 << 48)))
    rate = rng.uniform(-5, 5)
    pair.advance(600, rate)
    for _ in range(25):
        pair.advance(int(rng.integers(1, 300)), rng.uniform(-5, 5, 4), probe_ticks=int(rng.choice([0, 40])))
    for name, raw in (("amplitude_setpoint", 2**21), ("rate_bias", 12345), ("control", sequencer.RUN)):
        pair.advance(int(rng.integers(1, 400)), rate, host=write(name, raw))
    pair.advance(2000, rng.uniform(-5, 5, 17))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_clocks_of_one_path(locked, seed):
    """Random configurations with clocks of their own before and behind the product of each path, and from power-on."""
    rng = np.random.default_rng(9000 + seed)
    values = drawn(rng)
    shared = int(rng.integers(0, 5))
    values["firmware__pipeline_registers"] = shared
    for role in ("drive", "sense"):
        values[f"firmware__{role}_sine_registers"] = int(rng.integers(0, 9 - shared))
        values[f"firmware__{role}_code_registers"] = int(rng.integers(0 if role == "drive" else 1, 9))
    params = build.params(configured(**values), 25.0, 25.0)
    assert params.fpga.paths is not None
    pair = Pair(params, locked[1])
    pair.advance(600, rng.uniform(-5, 5))
    for _ in range(25):
        pair.advance(int(rng.integers(1, 300)), rng.uniform(-5, 5, 4), probe_ticks=int(rng.choice([0, 40])))
    for name, raw in (("amplitude_setpoint", 2**21), ("control", sequencer.RUN)):
        pair.advance(int(rng.integers(1, 400)), 0.3, host=write(name, raw))
    pair.advance(2000, rng.uniform(-5, 5, 17))
    pair = Pair(params, engine.reset(params, 25.0))
    for ticks in (1, 3, 17, 100, 999, 3000, 40_000):
        pair.advance(ticks)


def test_a_ring_that_saturates(locked):
    """Both engines, with a temperature between two tables; other codes than those of the linear ring."""
    states = []
    for on in (0, 1):
        pair = Pair(build.params(configured(plant__ring_saturation_on=on), 20.0, 30.0), locked[1])
        for ticks in (1, 124, 999, 3000):
            pair.advance(ticks, 0.3, 26.0)
        states.append(pair.clocked)
    assert different(*states)


@pytest.mark.parametrize("board", rarely(["analog_sid", "digital_sid"], 1))
def test_power_on_and_start_up(board):
    """From reset through power-up, DAC initialisation, kick, search, retune and acquisition; chunks of all lengths."""
    rng = np.random.default_rng(7)
    params = build.params(configured(firmware__board=board), 25.0, 25.0)
    pair = Pair(params, engine.reset(params, 25.0))
    for ticks in (1, 1, 3, 5, 17, 100, 126, 250, 999):
        pair.advance(ticks)
    states = set()
    while pair.clocked.tick < 560_000:
        pair.advance(int(rng.integers(500, 20_000)), rng.uniform(-1, 1))
        states.add(pair.clocked.fpga.control.sequencer.state)
    assert {sequencer.POWER_UP, sequencer.SEARCH, sequencer.ACQUIRE} <= states


FAULTS = {
    "silent": QUIET._replace(silent=1),
    "bad status": QUIET._replace(status=0),
    "lead off": QUIET._replace(status=adc_serial.status_word(lead_off_p=5)),
    "stuck channel": QUIET._replace(channel=(0, STUCK, 0, STUCK, 0), value=(0, -77, 0, 123456, 0)),
    "wrong channels": QUIET._replace(
        channel=(FROZEN, OFFSET, SWAPPED, GAIN, FROZEN), value=(0, -(1 << 21), 3, -9999, 0)
    ),
    "lost bit": QUIET._replace(lost_bit=60, channel=(0, 0, FROZEN, 0, 0)),
    "sample stuck": QUIET._replace(sample=(1, 2), sample_code=(-131072, 0)),
    "sample frozen": QUIET._replace(sample=(2, 0)),
    "drive stuck": QUIET._replace(dac=(1, 0, 0), dac_code=(-3000, 0, 0)),
    "sense stuck": QUIET._replace(dac=(0, 1, 0), dac_code=(0, 100_000, 0)),
    "V_q stuck": QUIET._replace(dac=(0, 0, 1), dac_code=(0, 0, 30_000)),
    "x not a number": QUIET._replace(nan=(1, 0)),
    "y not a number": QUIET._replace(nan=(0, 1)),
}


def on_boards():
    """Each fault on each board; slow where it acts as on the other one, or not at all."""
    for name, fault in FAULTS.items():
        for board in ("analog_sid", "digital_sid"):
            chosen = name == "silent" or (board == "digital_sid") == any(fault.sample)
            yield pytest.param(name, board, marks=() if chosen else pytest.mark.slow)


@pytest.mark.parametrize(("name", "board"), list(on_boards()))
def test_faults(locked, name, board):
    """Each fault while it lasts, and what follows: silence restarts the window from the watchdog, then from both."""
    params = build.params(configured(firmware__board=board), 25.0, 25.0)
    pair = Pair(params, locked[1])
    for ticks in (300, 1, 40, 130, 4000, 77, 9000):
        pair.advance(ticks, faults=FAULTS[name])
    for ticks in (200, 31, 4000, 123, 20_000):
        pair.advance(ticks)


def test_silence_that_ends_anywhere_in_a_frame(locked):
    """A frame that arrives while the window of the watchdog still runs starts it again."""
    params = build.params(configured(firmware__adc_clock="free_running", plant__adc_clock_ppm=3900.0), 25.0, 25.0)
    pair = Pair(params, locked[1])
    for k in range(40):
        pair.advance(700 + 13 * k, faults=FAULTS["silent"])
        pair.advance(150 + 7 * k)


def test_saturated_force_and_lost_lock(locked):
    """1000 deg/s want more than the sense DAC has; a drive frequency of nowhere loses the lock and starts again."""
    pair = Pair(*locked)
    pair.advance(300_000, np.radians(1000.0))
    assert abs(pair.frame.fpga.control.rate_loop.loop.y) == 2**23 - 1
    pair.advance(60_000, host=write("amplitude_setpoint", 1000))
    pair.advance(5_000, host=write("control", 0))
    pair.advance(20_000, host=write("frequency_fixed", dds.word_of_hz(10_900.0)))
    pair.advance(60_000, host=write("control", sequencer.RUN))


@pytest.mark.parametrize("delay_us", rarely(range(8), 3))
def test_a_word_that_changes_twice_in_one_window(locked, delay_us):
    """Lost lock puts the centre back and clears the loop, two clocks apart, while the start-up kick begins."""
    params = build.params(configured(plant__adc_delay_s=delay_us * 1.13e-7, firmware__pipeline_registers=8), 25.0, 25.0)
    pair = Pair(params, locked[1])
    pair.advance(200, host=write("frequency_fixed", dds.word_of_hz(10_940.0)))
    pair.advance(200, host=write("amplitude_setpoint", 1 << 20))
    while pair.frame.fpga.control.sequencer.state != sequencer.KICK:
        pair.advance(5000)
        assert pair.frame.tick < 3_000_000
    pair.advance(500)


@pytest.mark.parametrize("frequency_hz", [0.0, 1.0, 12_345.678, 100_000.0, 3e6])
def test_any_frequency_word(locked, frequency_hz):
    """Open loop at frequencies that no gyroscope has; where quarter turns come too fast, clocked ticks take over."""
    pair = Pair(*locked)
    pair.advance(1, host=write("frequency_fixed", dds.word_of_hz(frequency_hz)))
    pair.advance(1, host=write("amplitude_fixed", 1 << 22))
    pair.advance(3000, host=write("control", sequencer.RUN | sequencer.OPEN_DRIVE))
    pair.advance(3000)


def test_warming_plant(locked):
    """Temperature changes every frame: knots, blended jets, drifting resonances."""
    params = build.params(configured(), 20.0, 30.0)
    pair = Pair(params, locked[1])
    for k in range(20):
        pair.advance(500 + k, 0.3, np.linspace(20 + k / 2, 20.5 + k / 2, 6))


def test_chunks_do_not_matter(locked):
    params, state = locked
    whole = advanced(params, own(state), 30_000)
    parts = own(state)
    for ticks in (1, 7, 124, 125, 126, 617, 5000, 24_000):
        parts = advanced(params, parts, ticks)
    assert different(whole, parts) == []


def test_a_register_that_is_not_what_it_must_be_stops_the_run(locked, monkeypatch):
    """The flush compares; a result that has lost the clocked engine is never returned."""
    params, state = locked
    real = frame._run
    monkeypatch.setattr(frame, "_run", lambda *a: (*real(*a)[:3], 4711))
    with pytest.raises(RuntimeError, match="tick 4711"):
        advanced(params, own(state), 1000)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "values"),
    [
        (60, {}),
        (6, {"firmware__board": "digital_sid", "firmware__adc_clock": "free_running", "plant__adc_clock_ppm": 700.0}),
        (6, {"firmware__reference_retimed": False, "effects__duffing_k3_per_um2": 1e-4, "noise__seed": 3}),
    ],
)
def test_a_minute_from_power_on(seconds, values):
    """Every DAC code of every tick, every frame, and every register each quarter of a second, over a whole minute."""
    params = build.params(configured(**values), 25.0, 25.0)
    pair = Pair(params, engine.reset(params, 25.0))
    for k in range(4 * seconds):
        pair.advance(TICK_HZ // 4, np.radians(100.0 * np.sin(k)))
    assert pair.frame.fpga.control.sequencer.state == sequencer.LOCKED

"""The baseband engine against the frame engine: open loop, a short closed loop, ways in and out, and what it refuses.

All five cases with every limit: test_baseband_accuracy.py, slow.
"""

import json
import math
from pathlib import Path

import numba
import numpy as np
import pytest

from analog_frontend.averaged.averaged import LIMIT_TURNS
from fpga_model import registers, sequencer
from fpga_model.design_record import DEFAULT, Design
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench import config
from testbench.campaign.plan import engines
from testbench.engines import baseband, baseband_setup, engine
from testbench.engines.baseband_setup import JITTER_LIMIT_S, RATE_LIMIT_DEG_S, SIDE_BY_SIDE, drive_hz, most_edges
from testbench.engines.window import SLOT_WORD
from testbench.errors import ConfigError
from testbench.measured.residual import simulator
from testbench.paper.calibration import calibration_boards
from testbench.run import build, simulate
from testbench.run.simulation import FRAME, Simulation
from tests.testbench.bench_setup import QUIET, configured, open_loop, quiet
from tests.testbench.engines import baseband_accuracy
from tests.testbench.engines.baseband_accuracy import (
    DEG,
    Case,
    beyond,
    compare,
    configuration,
    failures,
    figures,
    twins,
)

needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
TEMP_DEGC = 25.0
BOARDS = Path(__file__).resolve().parents[3] / "docs" / "boards"


@pytest.fixture(scope="module")
def locked():
    """State of the default gyroscope a quarter of a second after lock."""
    sim = Simulation(configured(), TEMP_DEGC, TEMP_DEGC, engine="frame")
    simulate.start(sim.config, sim, 0.0, TEMP_DEGC)
    sim.advance(TICK_HZ // 4, 0.0, TEMP_DEGC)
    return sim.state_values()


def on(engine_name, values, **changes):
    sim = Simulation(configured(**changes), TEMP_DEGC, TEMP_DEGC, engine=engine_name)
    sim.set_state(values)
    sim.now = (np.zeros(1), np.full(1, TEMP_DEGC))
    return sim


def lived(engine_name, values, *pieces):
    """Columns of (ticks, deg/s) pieces from a state on one engine."""
    sim = on(engine_name, values)
    for ticks, rate in pieces:
        sim.advance(ticks, rate * DEG, TEMP_DEGC)
    return sim.columns()


# ---- against the frame engine ----------------------------------------------------------------------------------------


@needs_compiler
def test_open_loop_codes_are_those_of_the_plant_of_every_tick():
    """Fixed words, no noise: what is left, DAC codes and the clock of edges, is 1e-5 of the motion."""
    found = _open_loop(quiet(), 11001.5, 0.7, 0.3, 0.5)
    late = slice(-2000, None)
    for drive, names in ((True, ("adc_drive_sin", "adc_drive_cos")), (False, ("adc_sense_sin", "adc_sense_cos"))):
        frame, slow = (np.array([found[e][n][late].mean() for n in names], float) for e in ("frame", "baseband"))
        assert np.hypot(*(slow - frame)) < 1e-5 * np.hypot(*frame), drive


@needs_compiler
def test_one_edge_a_frame_and_a_short_rc_do_not_change_the_gain():
    """At 3.9 kHz a half period is a twelfth of RC: the slope of an output at an edge is not that of its mean."""
    board = config.changed(config.load(BOARDS / "published_3k9.toml"), QUIET)
    found = _open_loop(config.changed(board, {"firmware.reference_retimed": False}), 3925.3, 0.125, 0.0, 4.0)
    late, gain = slice(-4000, None), {}
    for name, columns in found.items():
        volts = math.hypot(*(columns[n][late].mean() for n in ("adc_drive_sin", "adc_drive_cos")))
        gain[name] = volts / np.hypot(columns["truth_x"][late], columns["truth_vx"][late]).mean()
    assert gain["baseband"] == pytest.approx(gain["frame"], rel=1e-7)


def _open_loop(checked, frequency_hz, drive, sense, seconds):
    """Columns of both engines at 0.7 rad/s."""
    found = {}
    for name in ("frame", "baseband"):
        sim = open_loop(checked, frequency_hz, drive, sense)
        sim.engine = name
        sim.advance(round(seconds * TICK_HZ), 0.7, TEMP_DEGC)
        found[name] = sim.columns()
    return found


@needs_compiler
def test_a_closed_loop_with_all_noise_is_within_every_limit():
    found = compare(Case((0.0, 30.0)))
    assert failures(found) == []
    assert found.states == 0
    sigmas = {name: sigma for name, (sigma, _, _) in found.streams.items()}
    assert sigmas["rate_word"] > 100, "noise is on"
    assert sigmas["adc_temperature"] > 10


# frames of 123 ticks begin within a sample of noise
RATES = {
    "52 MHz, DACs at 2 MHz": ("fast_dacs.toml", {}),
    "26 MHz, 123 ticks": ("paper.toml", {"design.frame_ticks": 123, "plant.adc_modulator_hz": 64e6 / 123}),
    "31 MHz, 201 ticks": (
        "paper.toml",
        {
            "design.master_hz": 31_000_000,
            "design.tick_clocks": 31,
            "design.frame_ticks": 201,
            "design.dds_bits": 44,
            "plant.adc_modulator_hz": 64e6 / 201,
        },
    ),
    "26 MHz, ADC read at 6.5 MHz": ("paper.toml", {"design.adc_divider": 4}),
}
FAST = (("52 MHz, DACs at 2 MHz", True), ("26 MHz, 123 ticks", False))  # the rest is slow


@needs_compiler
@pytest.mark.parametrize(
    ("rate", "retimed"),
    [pytest.param(rate, retimed, marks=[pytest.mark.slow] * ((rate, retimed) not in FAST))
     for rate in RATES for retimed in (True, False)],
)  # fmt: skip
def test_other_rates_are_within_every_limit(rate, retimed):
    case, (file, values) = Case((0.0, 30.0)), RATES[rate]
    board = config.changed(config.load(BOARDS / file), values)
    found = compare(case, configuration(case, board, firmware__reference_retimed=retimed))
    assert failures(found) == []
    assert found.states == 0


@needs_compiler
def test_a_dds_of_32_bits_makes_two_frame_engines_part_as_far():
    """Steps of 5.6 mHz: a word that one engine changes a frame earlier. All else is within the limits."""
    case, rad = Case((0.0, 30.0)), 1e-6
    checked = configuration(case, config.load(BOARDS / "low_cost.toml"), firmware__reference_retimed=False)
    found, pairs = compare(case, checked), twins(case, checked, rad, count=2)
    assert found.states == 0
    assert beyond(found) <= {"adc_drive_sin: rms", "frequency_word: rms", "phase: rms"}
    for name in beyond(found):
        frame_engines, limit, _ = figures(pairs[0, 1])[name]
        assert frame_engines > limit
        assert figures(found)[name][0] < 1.5 * frame_engines


@needs_compiler
def test_a_board_whose_basis_is_hard_to_find_keeps_its_codes_idle_and_locked():
    """Board 2 of seed 1: with the sense mode's eigenvector 1e-4 off, IDLE rang up to full scale and no loop locked."""
    checked = config.changed(calibration_boards.draw(config.Config(), 1, 2), {"firmware.reference_retimed": False})
    found = {}
    for name in ("frame", "baseband"):
        sim = Simulation(checked, TEMP_DEGC, TEMP_DEGC, engine=name)
        sim.now = (np.zeros(1), np.full(1, TEMP_DEGC))
        sim.write("control", 0)
        sim.advance(TICK_HZ, 0.0, TEMP_DEGC)
        idle = sim.columns()
        sim.write("control", sequencer.RUN)
        locked_s = simulate.start(checked, sim, 0.0, TEMP_DEGC)
        sim.advance(TICK_HZ // 2, 0.0, TEMP_DEGC)
        found[name] = idle, sim.columns(), locked_s
    (frame_idle, frame, frame_s), (slow_idle, slow, slow_s) = found["frame"], found["baseband"]
    for name in ("adc_drive_sin", "adc_drive_cos", "adc_sense_sin", "adc_sense_cos"):
        assert np.abs(slow_idle[name] - frame_idle[name]).max() <= 20, f"{name}: two steps of the converter"
    assert slow_s == frame_s
    wrong = (slow["amplitude_word"] - frame["amplitude_word"])[-2000:]
    assert np.sqrt((wrong.astype(float) ** 2).mean()) < 0.5 * frame["amplitude_word"][-2000:].std()


def test_a_difference_is_found():
    """The limits bite: a stream that is off by its own sigma fails, and so do phase and frequency."""
    good = baseband_accuracy.Found({"rate_word": (100.0, 0.0, 0.2)}, 0.001, 1e-5, 0)
    assert failures(good) == []
    for bad in (
        good._replace(streams={"rate_word": (100.0, 0.11, 0.2)}),
        good._replace(streams={"rate_word": (100.0, 0.0, 0.51)}),
        good._replace(phase_deg=-0.0031),
        good._replace(frequency_hz=1.1e-4),
        good._replace(streams={"rate_word": (100.0, float("nan"), 0.2)}),
    ):
        assert len(failures(bad)) == 1


def test_what_two_frame_engines_differ_by_adds_to_a_limit_in_squares():
    """0.5 and 1.2 sigma make 1.3; a stream in which frame engines agree keeps its limit."""

    def found(rms, other):
        return baseband_accuracy.Found({"phase": (1.0, 0.0, rms), "rate_word": (1.0, 0.0, other)}, 0.0, 0.0, 0)

    # two engines each: frame 0 and 1, baseband 2 and 3
    pairs = {(0, 1): found(1.2, 0.0), (0, 2): found(9.0, 9.0), (2, 3): found(9.0, 9.0)}
    assert beyond(found(1.29, 0.49), pairs) == set()
    assert beyond(found(1.31, 0.51), pairs) == {"phase: rms", "rate_word: rms"}
    assert beyond(found(1.29, 0.49)) == {"phase: rms"}


# ---- in and out ------------------------------------------------------------------------------------------------------


@needs_compiler
def test_frame_and_baseband_continue_each_other(locked):
    """Four switches in 0.6 s: the streams end where the frame engine's own do."""
    ticks = 100_000 + 37
    frame = lived("frame", locked, *[(ticks, 20.0)] * 6)
    sim = on("frame", locked)
    for k in range(6):
        sim.engine = ("frame", "baseband")[k % 2]
        sim.advance(ticks, 20.0 * DEG, TEMP_DEGC)
    mixed = sim.columns()
    assert np.array_equal(mixed["adc_temperature"], frame["adc_temperature"])
    assert np.array_equal(mixed["state"], frame["state"])
    for name in ("adc_drive_cos", "adc_sense_sin", "adc_sense_cos", "rate_word", "amplitude_word"):
        wrong = (mixed[name] - frame[name]).astype(float)
        sigma = frame[name][-1000:].std()
        assert abs(wrong.mean()) < 0.1 * sigma, name
        assert wrong.std() < 0.5 * sigma, name


@needs_compiler
def test_a_law_of_force_moves_the_words_as_in_the_frame_engine(locked):
    """-2 m Omega vx at y is a rate of Omega; the same force in quadrature; and the drive's voltage at y."""
    newton_s_per_m = -2 * config.Config().plant.coriolis_mass_kg * 20 * DEG
    texts = (f"{newton_s_per_m!r} vx", f"{newton_s_per_m * 6.9e4!r} x", "1e-7 u")

    def words(engine_name, laws=(), rate=0.0):
        sim = on(engine_name, locked, effects__laws=[f"force_y = {text}" for text in laws])
        sim.advance(1_250_000, rate * DEG, TEMP_DEGC)
        columns = sim.columns()
        return np.array([columns[name][-2000:].mean() for name in ("rate_word", "quadrature_code")])

    changes = {}
    for name in ("frame", "baseband"):
        still = words(name)
        changes[name] = [words(name, rate=20.0) - still, *(words(name, [text]) - still for text in texts)]
    # of a force that one word balances alone
    least = 5e-4 * np.abs([changes["frame"][0][0], changes["frame"][2][1]])
    for rate, law, *_ in changes.values():
        assert np.all(np.abs(law - rate) < least)
    for one, other in zip(*changes.values()):
        assert np.all(np.abs(other - one) < least)


@needs_compiler
def test_a_short_chunk_is_the_frame_engine_itself(locked):
    frame, slow = (lived(name, locked, (3 * FRAME_TICKS + 7, 20.0)) for name in ("frame", "baseband"))
    for name, values in frame.items():
        assert np.array_equal(slow[name], values), name


@needs_compiler
def test_a_saved_state_continues_with_the_same_bits(locked):
    one = on("baseband", locked)
    one.advance(200_000, 10.0 * DEG, TEMP_DEGC)
    other = on("baseband", locked)
    other.restore_all(one.dump_all())
    first = len(one.columns()["state"])
    for sim in (one, other):
        sim.advance(150_000, -10.0 * DEG, TEMP_DEGC)
    for name, values in other.columns().items():
        assert np.array_equal(one.columns()[name][first:], values), name
    assert one.codes_sha256() == other.codes_sha256()
    assert one.codes_sha256().startswith("frames:")
    assert one.tail.shape == (2, 0), "there are no codes of single ticks"


@needs_compiler
def test_a_host_write_acts_as_in_the_frame_engine(locked):
    entry = registers.BY_NAME["amplitude_setpoint"]
    ends = []
    for name in ("frame", "baseband"):
        sim = on(name, locked)
        target = int(0.99 * sim.state.fpga.registers.amplitude_setpoint)
        sim.advance(50_000, 0.0, TEMP_DEGC)
        sim.write("amplitude_setpoint", target)
        sim.advance(400_000, 0.0, TEMP_DEGC)
        assert sim.state.fpga.registers.amplitude_setpoint == registers.from_bus(
            registers.to_bus(target, entry.fmt), entry.fmt
        )
        ends.append(sim.columns()["magnitude"])
    assert abs(ends[0][0] - ends[0][-1]) > 1000, "the write has done something"
    assert np.abs(ends[0] - ends[1]).max() < 100


# ---- who else takes it -----------------------------------------------------------------------------------------------


@needs_compiler
def test_a_run_and_a_point_of_a_campaign_take_it():
    class Sink:
        rows = 0

        def add(self, first_frame, frames, truth):
            self.rows += len(frames)

    checked = configured(scenario__seconds=0.3, scenario__rate_dps=50.0, scenario__diagnose=False)
    numbers = {}
    for name in ("frame", "baseband"):
        sink = Sink()
        (numbers[name],) = engines.load(name).run_points([checked], [sink])
        assert sink.rows >= 2400
    assert numbers["baseband"].pop("codes_sha256").startswith("frames:")
    numbers["frame"].pop("codes_sha256")
    assert set(numbers["baseband"]) == set(numbers["frame"])
    assert numbers["baseband"]["lock_time_s"] == pytest.approx(numbers["frame"]["lock_time_s"], abs=1e-3)
    json.dumps(numbers)


@needs_compiler
def test_the_measured_loop_is_lived_again():
    frames = 12_000
    sim = Simulation(configured(), TEMP_DEGC, TEMP_DEGC, engine="frame")
    log = [
        (26 * (k + 1), registers.BY_NAME[n].address, registers.to_bus(int(raw), registers.BY_NAME[n].fmt))
        for k, (n, raw) in enumerate(sim.first_writes)
    ]
    task = simulator.Task(frames, np.full(frames, 0.3), np.full(frames, TEMP_DEGC), np.array(log, np.int64))
    frame, slow = (s().free(configured(), task) for s in (simulator.FrameSimulator, simulator.BasebandSimulator))
    assert simulator.BasebandSimulator.name == "baseband"
    assert set(frame) == set(slow)
    late = slice(-2000, None)
    for name in ("adc_xI", "adc_yI", "adc_yQ", "rate_word"):
        sigma = frame[name][late].std()
        assert abs((slow[name][late] - frame[name][late]).mean()) < 0.1 * sigma, name
    assert not np.array_equal(frame["adc_xI"], slow["adc_xI"]), "they are two engines"


# ---- refusals --------------------------------------------------------------------------------------------------------

OUTSIDE = {
    "firmware.board": {"firmware__board": "digital_sid"},
    "firmware.adc_clock": {"firmware__adc_clock": "free_running", "plant__adc_clock_ppm": 50.0},
    "plant.drive_dac_bow": {"plant__drive_dac_bow": 1e-5},
    "plant.sense_dac_glitch_v_s": {"plant__sense_dac_glitch_v_s": 1e-9},
    "plant.clock_jitter_s": {"plant__clock_jitter_s": 2 * JITTER_LIMIT_S},
    "plant.fx_hz": {"plant__fx_hz": 22_100.0, "plant__fy_hz": 21_961.0},
    "plant.fy_hz": {"plant__fy_hz": 10_400.0},
    "plant.qx": {"plant__qx": 1000.0},
    "plant.sid_r_ohm": {"plant__sid_c_f": 30e-9},
    "effects.drive_dac_levels": {"effects__drive_dac_levels": ["bit 11 = 0.09"]},
    "effects.sense_dac_levels": {"effects__sense_dac_levels": ["step 2/8 = 0.2"]},
    "effects.adc_curve": {"effects__adc_curve": [0.0, 1e-6]},
    "effects.adc_turnover": {"effects__adc_turnover": -1e-6},
    "effects.adc_gain_tc_per_k": {"effects__adc_gain_tc_per_k": 1e-6},
    "effects.adc_memory": {"effects__adc_memory": -1e-6},
}


@pytest.mark.parametrize("key", OUTSIDE)
def test_what_it_cannot_do_is_refused_with_one_line(key):
    values = OUTSIDE[key]
    Simulation(configured(**values), TEMP_DEGC, TEMP_DEGC, engine="clocked")
    with pytest.raises(ConfigError) as refused:
        Simulation(configured(**values), TEMP_DEGC, TEMP_DEGC, engine="baseband")
    text = str(refused.value)
    assert key in text
    assert "baseband" in text
    assert 'use "frame"' in text
    assert "\n" not in text


def test_a_long_read_lowers_the_highest_drive_mode():
    """At a divider of 8 the word changes at clock 1757: 26 MHz / (2 * 1757), less the 150 Hz of its fastest word."""
    slow = configured(design__adc_divider=8)
    Simulation(slow, TEMP_DEGC, TEMP_DEGC, engine="frame")
    with pytest.raises(ConfigError, match=r"plant.fx_hz: 11002.3 Hz is outside 3000 \.\. 7248\.98 Hz"):
        Simulation(slow, TEMP_DEGC, TEMP_DEGC, engine="baseband")


DESIGNS = (
    DEFAULT,
    Design(master_hz=24_000_000, tick_clocks=24),
    Design(master_hz=52_000_000, frame_ticks=250),
    Design(master_hz=31_000_000, tick_clocks=31, frame_ticks=67),
    Design(master_hz=20_000_000, tick_clocks=20, frame_ticks=426),
)


@pytest.mark.parametrize("d", DESIGNS)
def test_no_frame_that_is_done_side_by_side_has_a_fourth_edge(d):
    """Re-timed edges three half periods apart, a tick early, at the fastest word; the first acts behind the samples."""
    limit_hz = LIMIT_TURNS * d.frame_hz
    found = [hz for hz in np.linspace(0.3, 3.0, 2000) * d.frame_hz if most_edges(d, hz) == 0]
    assert 3 * d.master_hz / (2 * (found[-1] + limit_hz)) - d.tick_clocks > d.frame_clocks
    assert found[0] >= SIDE_BY_SIDE[0] * d.frame_hz
    later = (0.5 + baseband_setup.SAMPLED_LATER) * d.frame_clocks
    assert later + d.master_hz / (2 * (found[0] - limit_hz)) + d.tick_clocks < d.frame_clocks
    if d == DEFAULT:
        assert found[0] == pytest.approx(9_500.0, abs=11.0)
        assert found[-1] == pytest.approx(11_750.0, abs=11.0)


@pytest.mark.parametrize("d", DESIGNS)
def test_there_is_room_for_every_edge_outside_of_that_range(d):
    """Edges of one frame at the fastest word, and the one that waits; one crossing at most before the word changes."""
    setup = baseband_setup.setup(build.params(configured(), TEMP_DEGC, TEMP_DEGC))
    ends = drive_hz(d, setup.turn_clock)
    for hz in (*ends, (SIDE_BY_SIDE[0] - 1e-4) * d.frame_hz, (SIDE_BY_SIDE[1] + 1e-4) * d.frame_hz):
        half = d.master_hz / (2 * (hz + LIMIT_TURNS * d.frame_hz))
        assert most_edges(d, hz) >= (d.frame_clocks + d.tick_clocks) / half + 1
    assert d.master_hz / (2 * (ends[1] + LIMIT_TURNS * d.frame_hz)) >= setup.valid + SLOT_WORD + 1
    if d == DEFAULT:
        assert ends == (3_000.0, 22_000.0)


def test_faults_are_refused(locked):
    sim = on("baseband", locked)
    sim.faults = engine.Faults(status=1)
    with pytest.raises(ConfigError, match=r'scenario.faults: .*use "frame"'):
        sim.advance(FRAME_TICKS, 0.0, TEMP_DEGC)


@pytest.mark.parametrize("rate_dps", [RATE_LIMIT_DEG_S + 1, -RATE_LIMIT_DEG_S - 1])
def test_a_rate_that_is_too_high_is_refused(locked, rate_dps):
    sim = on("baseband", locked)
    with pytest.raises(ConfigError, match=r'scenario.rate_dps: .*1000 deg/s.*use "frame"'):
        sim.advance(FRAME_TICKS, rate_dps * DEG, TEMP_DEGC)


@needs_compiler
def test_far_off_resonance_is_refused():
    sim = open_loop(configured(), 11_002.3 + 200.0)
    sim.engine = "baseband"
    with pytest.raises(ConfigError, match=r"frequency_word: \+200.* Hz .*150 Hz.*use scenario"):
        sim.advance(TICK_HZ // 4, 0.0, TEMP_DEGC)


def test_what_a_run_needs_is_made_once():
    sim = Simulation(configured(), TEMP_DEGC, TEMP_DEGC, engine="baseband")
    assert baseband.prepare(sim.params)[0] is baseband.prepare(sim.params)[0]
    assert FRAME["rate_word"] < 9, "the hash of words takes it"

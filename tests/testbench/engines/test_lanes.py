"""The lanes engine against the frame engine: every register, the whole plant, every code, whoever stands beside."""

from pathlib import Path

import numpy as np
import pytest

from analog_frontend.numeric.vector import LANES
from fpga_model import sequencer
from testbench import config
from testbench.engines import engine, frame, lanes
from testbench.engines.engine import FROZEN, OFFSET, STUCK
from testbench.errors import ConfigError
from testbench.run import build, simulate, tolerances
from tests.testbench.bench_setup import configured
from tests.testbench.engines.test_frame import QUIET, advanced, different, drawn, own

BOARDS = Path(__file__).resolve().parents[3] / "docs" / "boards"
REFUSED = "paper_inferred"  # its ring saturates
# what lanes run: no digital board, no errors of the converters' levels
ANALOG = {"firmware__board": "analog_sid"}
ANALOG |= {f"effects__{key}": [] for key in ("drive_dac_levels", "sense_dac_levels", "adc_curve")}
ANALOG |= {f"effects__{key}": 0.0 for key in ("adc_turnover", "adc_gain_tc_per_k", "adc_memory")}


@pytest.fixture(scope="module")
def locked():
    """State of the default gyroscope when it has just locked."""
    params = build.params(configured(), 25.0, 25.0)
    state = engine.reset(params, 25.0)
    while state.fpga.control.sequencer.state != sequencer.LOCKED:
        assert state.tick < 3_000_000
        state = advanced(params, state, 50_000)
    return state


def drawn_group(seed, count, temps=(25.0, 25.0)):
    """Parameters of `count` random gyroscopes."""
    rng = np.random.default_rng(seed)
    return [build.params(configured(**(drawn(rng) | ANALOG)), *temps) for _ in range(count)]


def started(state, params):
    """The state as another gyroscope's: its plant's matrix is made anew."""
    state = own(state)
    state.plant.now[:] = np.inf
    return state


class Group:
    """Gyroscopes in lanes, and each alone on the frame engine; every `advance` compares everything."""

    def __init__(self, params, states):
        self.params, self.engine = params, lanes.Engine(params)
        self.lanes = [started(s, p) for s, p in zip(states, params)]
        self.alone = [started(s, p) for s, p in zip(states, params)]

    def advance(self, ticks, rates, temps=None, faults=None):
        begin, count = self.lanes[0].tick, len(self.params)
        faults = faults or [QUIET] * count
        frames = ticks // self.params[0].fpga.design.frame_ticks + 2
        rates = [np.resize(np.asarray(rate, float), frames) for rate in rates]
        temps = [np.resize(np.asarray(temp, float), frames) for temp in temps or [25.0] * count]
        streams = [[engine.streams(ticks, frames) for _ in range(count)] for _ in range(2)]
        self.lanes = self.engine.run(self.lanes, ticks, rates, temps, faults, streams[0])
        for k, p in enumerate(self.params):
            self.alone[k] = frame.run(
                p, self.alone[k], ticks, rates[k], temps[k], engine.NO_WRITE, faults[k], streams[1][k]
            )
            where = f"gyroscope {k} of {count}, {ticks} ticks from {begin}"
            assert different(self.lanes[k], self.alone[k]) == [], where
            for name, a, b in zip(engine.Streams._fields, streams[0][k], streams[1][k]):
                np.testing.assert_array_equal(a, b, err_msg=f"{name}: {where}")


@pytest.mark.parametrize("seed", range(4))
def test_random_gyroscopes(locked, seed):
    """Latencies, converter clocks, delays, noise, effects and rates at random; chunks of any length."""
    rng = np.random.default_rng(1000 + seed)
    group = Group(drawn_group(seed, LANES), [locked] * LANES)
    for ticks in rng.integers(1, 9000, 4).tolist():
        group.advance(ticks, rng.uniform(-5, 5, (LANES, 9)))


def test_an_edge_waits_for_its_own_gyroscope(locked):
    """Edges that act a tick later, in gyroscopes that come and go while others move: nobody else may take them."""
    late = {"plant__sid_switch_s": 0.93e-6, "firmware__reference_retimed": False}
    apart = {"firmware__adc_clock": "free_running", "plant__adc_clock_ppm": 3000.0}
    group = Group([build.params(configured(**c), 25.0, 25.0) for c in (late, apart, late | apart)], [locked] * 3)
    for ticks in np.random.default_rng(3).integers(200, 700, 60).tolist():
        group.advance(ticks, [0.5] * 3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
def test_two_hundred_gyroscopes_for_a_second(locked, seed):
    rng = np.random.default_rng(5000 + seed)
    group = Group(drawn_group(100 + seed, LANES), [locked] * LANES)
    group.advance(1_000_000, rng.uniform(-5, 5, (LANES, 80)))


@pytest.mark.slow
def test_a_minute_side_by_side(locked):
    """Not within some LSB: equal."""
    group = Group(drawn_group(77, LANES), [locked] * LANES)
    for k in range(60):
        group.advance(1_000_000, np.linspace(-3, 3, LANES) * np.sin(k))


@pytest.mark.parametrize("count", [1, 3])
def test_the_number_of_lanes_changes_nothing(locked, count):
    group = Group(drawn_group(4, count), [locked] * count)
    group.advance(5000, np.linspace(-3, 3, count))


def test_power_on():
    """From the first tick, with the plant at rest and the firmware in reset."""
    params = drawn_group(9, 4)
    group = Group(params, [engine.reset(p, 25.0) for p in params])
    for ticks in (1, 3, 700, 12_345):
        group.advance(ticks, [0.0] * 4)


@pytest.mark.parametrize("path", sorted({*BOARDS.glob("*.toml")} - {BOARDS / f"{REFUSED}.toml"}), ids=lambda p: p.stem)
def test_a_board_of_any_design(path):
    """Plants drawn within its tolerances, from power-on through kick and search."""
    board = config.load(path)
    params = [build.params(tolerances.draw(board, 5, k), 25.0, 25.0) for k in range(3)]
    group = Group(params, [engine.reset(p, 25.0) for p in params])
    for ticks in (1, 777, 20_000, 60_000):
        group.advance(ticks, [0.3] * 3)


def test_a_board_whose_ring_saturates_is_refused():
    params = build.params(config.load(BOARDS / f"{REFUSED}.toml"), 25.0, 25.0)
    with pytest.raises(ConfigError, match=r"lanes: plant\.ring_saturation_on = 1 is run by the other engines only"):
        lanes.Engine([params, params])


def test_boards_of_two_designs_are_refused():
    boards = [config.load(BOARDS / f"{name}.toml") for name in ("paper", "low_cost")]
    with pytest.raises(ConfigError, match=r"all gyroscopes of a group need the same \[design\]"):
        lanes.Engine([build.params(board, 25.0, 25.0) for board in boards])


def test_temperatures_of_their_own(locked):
    """Profiles over a table of temperatures for some, a constant one for others."""
    params = drawn_group(11, 3, (24.0, 26.5)) + drawn_group(12, 2)
    group = Group(params, [locked] * 5)
    ramps = [np.linspace(24.0, 24.0 + k, 40) for k in range(3)]
    group.advance(5000, [0.3] * 5, [*ramps, 25.0, 25.0])


def test_transfers_of_their_own(locked):
    """DACs with a bow beside straight ones."""
    bows = (0.0, 1e-4, -3e-4)
    params = [build.params(configured(plant__drive_dac_bow=b, plant__sense_dac_bow=-b), 25.0, 25.0) for b in bows]
    group = Group(params, [locked] * 3)
    for _ in range(2):
        group.advance(3000, [0.5] * 3)


def test_converters_of_other_bits_beside_the_part(locked):
    """Steps and largest codes of their own; a reference below the signal makes the drive's codes clip."""
    clips = {"design__adc_bits": 17, "plant__adc_vref_v": 2.5}
    others = [{"design__adc_bits": 24}, {"design__adc_bits": 16}, clips, clips | {"plant__signal_gain": -5.0}]
    configs = [configured(), *(configured(design__adc="generic", **other) for other in others)]
    params = [build.params(config, 25.0, 25.0) for config in configs]
    group = Group(params, [locked] * len(params))
    group.advance(36000, [0.5] * len(params))
    codes = [state.fpga.adc.channels[:2] for state in group.lanes]
    assert all(code % 2**8 == 0 for code in codes[2])
    assert min(codes[3]) == -(2**23)
    assert max(codes[4]) == 2**23 - 2**7


def test_faults_of_their_own(locked):
    faults = [
        QUIET,
        QUIET._replace(silent=1),
        QUIET._replace(channel=(FROZEN, STUCK, 0, OFFSET, 0), value=(0, 77, 0, -500, 0), lost_bit=100),
        QUIET._replace(dac=(1, 0, 1), dac_code=(1234, 0, 3000)),
        QUIET._replace(status=0),
        QUIET._replace(nan=(1, 0)),
    ]
    group = Group(drawn_group(13, len(faults)), [locked] * len(faults))
    for _ in range(3):
        group.advance(4321, [0.5] * len(faults), faults=faults)


def simulations(count):
    """Simulations behind their first writes."""
    sims = [simulate.Simulation(configured(noise__seed=k, plant__fx_hz=11000.0 + k), 25.0, 25.0) for k in range(count)]
    for sim in sims:
        sim.now = (np.array([0.0]), np.array([25.0]))
        for name, raw in sim.first_writes:
            sim.write(name, raw)
    return sims


def test_simulations_side_by_side():
    """Streams, hash and rows of `Simulation` are those of each alone."""
    together, alone = simulations(3), simulations(3)
    lanes.Lanes(together).advance(20_000, [0.1, 0.2, np.linspace(0, 1, 160)], [25.0] * 3)
    for sim, rate in zip(alone, (0.1, 0.2, np.linspace(0, 1, 160))):
        sim.advance(20_000, rate, 25.0)
    for a, b in zip(together, alone):
        assert a.codes_sha256() == b.codes_sha256()
        assert different(a.state, b.state) == []
        for name, column in a.columns().items():
            np.testing.assert_array_equal(column, b.columns()[name], err_msg=name)


def test_the_number_of_cores_changes_nothing(monkeypatch):
    """Groups in threads, more threads than groups, several chunks."""
    monkeypatch.setattr(lanes, "CHUNK_TICKS", 4000)
    found, said = [], []
    for count, threads, groups in ((10, 1, [8, 2]), (10, 2, [5, 5]), (10, 3, [4, 4, 2]), (2, 5, [1, 1])):
        sims = simulations(count)
        side = lanes.Lanes(sims, threads)
        assert [len(group) for group in side.groups] == groups
        rates = [np.linspace(0, 0.1 * k, 80) for k in range(count)]
        side.advance(10_000, rates, [25.0] * count, lambda first, done: said.append((first, done)))
        found.append([sim.codes_sha256() for sim in sims])
        assert {sim.tick for sim in sims} == {sims[0].tick}
    assert found[0] == found[1] == found[2]
    assert found[3] == found[0][:2]
    assert sorted(said[:6]) == [(0, 4000), (0, 8000), (0, 10_000), (8, 4000), (8, 8000), (8, 10_000)]


def test_an_error_in_one_core_stops_the_others(monkeypatch):
    monkeypatch.setattr(lanes, "CHUNK_TICKS", 1000)
    sims = simulations(4)
    begun = sims[0].tick

    def fail(first, done):
        if first == 2:
            raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        lanes.Lanes(sims, 2).advance(10**9, [0.0] * 4, [25.0] * 4, fail)
    assert sims[2].tick == begun + 1000
    assert sims[0].tick < begun + 10**9


def test_what_lanes_cannot_do_is_refused():
    analog = build.params(configured(), 25.0, 25.0)
    digital = build.params(configured(firmware__board="digital_sid"), 25.0, 25.0)
    with pytest.raises(ConfigError, match="digital_sid"):
        lanes.Engine([analog, digital])
    with pytest.raises(ConfigError, match=r"lanes: firmware\.notch_hz"):
        lanes.Engine([build.params(configured(firmware__notch_hz=139.0), 25.0, 25.0)])
    with pytest.raises(ValueError, match=r"1 \.\. 8"):
        lanes.Engine([analog] * 9)
    states = [engine.reset(analog, 25.0), engine.reset(analog, 25.0)._replace(tick=125)]
    with pytest.raises(ValueError, match="same tick"):
        lanes.Engine([analog] * 2).run(
            states, 100, [np.zeros(3)] * 2, [np.zeros(3)] * 2, [QUIET] * 2, [engine.streams()] * 2
        )

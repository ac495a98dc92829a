"""A simulation's own matters: engines to choose from, what its state keeps, its tail and its sinks."""

from typing import NamedTuple

import numpy as np
import pytest

from testbench.engines import engine
from testbench.errors import ConfigError
from testbench.run import simulation
from testbench.run.simulation import FRAME, SPECTRUM_TICKS, Simulation
from tests.testbench.bench_setup import configured, quiet


@pytest.fixture
def sim():
    made = Simulation(quiet(), 25.0, 25.0, engine="clocked")
    made.now = (np.zeros(1), np.full(1, 25.0))
    return made


def test_the_engine_is_that_of_the_configuration_unless_named():
    assert Simulation(configured(scenario__engine="clocked"), 25.0, 25.0).engine == "clocked"
    assert Simulation(configured(scenario__engine="clocked"), 25.0, 25.0, engine="frame").engine == "frame"
    assert configured().scenario.engine == "frame"
    assert simulation.runner("clocked") is engine.run


@pytest.mark.parametrize(
    ("effect", "value"),
    [
        ("laws", ["cv_y = 1e-6 u"]),
        ("adc_curve", [1e-4]),
        ("adc_turnover", 1e-5),
        ("adc_gain_tc_per_k", 1e-5),
        ("adc_memory", 1e-4),
    ],
)
def test_effects_of_the_analog_board_are_refused_on_the_digital_one(effect, value):
    values = {f"effects__{effect}": value}
    with pytest.raises(ConfigError, match=r'needs firmware\.board = "analog_sid"$'):
        Simulation(configured(**values, firmware__board="digital_sid"), 25.0, 25.0)
    Simulation(configured(**values), 25.0, 25.0)


def test_scratch_is_neither_saved_nor_restored(sim):
    class Plant(NamedTuple):
        z: np.ndarray
        work: np.ndarray

    before = sim.dump()
    sim.state = sim.state._replace(plant=Plant(np.arange(3.0), np.ones(7)))
    values, layout, _ = sim.dump()
    assert not any("work" in name for name in values)
    other = sim.state.plant._replace(work=np.zeros(100))
    sim.state = sim.state._replace(plant=other)
    assert sim.layout() == layout, "scratch may have any size"
    assert layout != before[1]
    sim.set_state(values | {"plant.z": np.array([7.0, 8.0, 9.0])})
    assert sim.state.plant.z.tolist() == [7.0, 8.0, 9.0]
    assert sim.state.plant.work is other.work


def fake_run(codes):
    """An engine that only writes codes: the number of the tick."""

    def run(p, s, ticks, rate, temp, host, faults, o):
        if codes:
            o.drive_code[:] = np.arange(s.tick, s.tick + ticks) % 30_000
            o.sense_code[:] = -o.drive_code
        o.frames[:, FRAME["rate_word"]] = -(-s.tick // 125) + np.arange(len(o.frames))
        return s._replace(tick=s.tick + ticks)

    return run


def test_the_tail_is_the_last_codes(sim):
    sim._run = fake_run(codes=True)
    assert sim.tail.shape == (2, 0)
    for ticks in (1, 99, 50_000, 240_000, 3, 70_000, 130_000):
        sim.advance(ticks, 0.0, 25.0)
        last = min(sim.tick, SPECTRUM_TICKS)
        want = np.arange(sim.tick - last, sim.tick) % 30_000
        assert np.array_equal(sim.tail, [want, -want])


def test_sinks_get_every_frame_once_and_in_order(sim):
    class Sink:
        def __init__(self):
            self.seen = []

        def add(self, first_frame, frames, truth):
            assert len(frames) == len(truth) > 0
            self.seen += list(range(first_frame, first_frame + len(frames)))
            assert frames[:, FRAME["rate_word"]].tolist() == self.seen[-len(frames) :]

    sim._run = fake_run(codes=False)
    sink = Sink()
    sim.sinks.append(sink)
    for ticks in (1, 124, 1, 100, 125, 250_000, 7):
        sim.advance(ticks, 0.0, 25.0)
    assert sink.seen == list(range(-(-sim.tick // 125)))
    assert sim.columns()["rate_word"].tolist() == sink.seen, "and they stay in memory unless told otherwise"
    sim.keep_rows = False
    sim.advance(1000, 0.0, 25.0)
    assert len(sim.columns()["rate_word"]) < len(sink.seen)


def test_rates_reach_the_frames_they_are_for(sim):
    """One value per frame begun, the first for the frame in progress, in chunks of any length."""
    seen = {}

    def run(p, s, ticks, rate, temp, host, faults, o):
        for frame in range(-(-s.tick // 125), (s.tick + ticks - 1) // 125 + 1):
            seen[frame] = rate[frame - s.tick // 125]
        return s._replace(tick=s.tick + ticks)

    sim._run = run
    sim.advance(60, 0.0, 25.0)
    sim.window = (50_000, 311)
    rates = np.arange(2000.0) / 20
    sim.advance(125 * 1900, rates, 25.0)
    assert [seen[k] for k in range(1, 1900)] == rates[1:1900].tolist()


def test_without_codes_the_rows_are_the_same_and_there_is_no_hash(sim):
    bare = Simulation(quiet(), 25.0, 25.0, engine="clocked")
    bare.keep_codes = False
    for one in (sim, bare):
        one.advance(400, 0.1, 25.0)
    assert bare.tail.shape == (2, 0)
    for name, column in sim.columns().items():
        assert np.array_equal(column, bare.columns()[name]), name
    with pytest.raises(ValueError, match="has no hash, because codes are not kept"):
        bare.codes_sha256()

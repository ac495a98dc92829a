"""Runs side by side against the same runs alone: every number, row and code, whoever stands beside and for how long."""

import functools
import signal
import threading

import numba
import numpy as np
import pytest

from testbench.commands import docs
from testbench.engines import lanes
from testbench.run import side_by_side, simulate
from testbench.run.simulation import Simulation
from tests.testbench.bench_setup import configured
from tests.testbench.engines.test_frame import different

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")

SHORT = {
    "scenario__origin": "power_on",
    "scenario__diagnose": False,
    "scenario__engine": "frame",
    "output__record": False,
    "output__checkpoint_s": 0.0,
}
OF_THE_CLOCK = ("wall_s", "real_time_factor")


def short(seconds, seed, **values):
    """A run from power-on, so long."""
    return configured(**SHORT, scenario__seconds=seconds, noise__seed=seed, **values)


class Rows:
    """A sink that keeps all."""

    def __init__(self):
        self.pieces = []

    def add(self, first_frame, frames, truth):
        self.pieces.append((first_frame, frames.copy(), truth.copy()))

    def bytes(self):
        return [(first, frames.tobytes(), truth.tobytes()) for first, frames, truth in self.pieces]


def played(config, rows, engine_run=None):
    """Numbers of a run, without those of the clock on the wall, and the end of its state."""
    result = simulate.run(config, sinks=(rows,), engine_run=engine_run)
    return {name: value for name, value in result.summary.items() if name not in OF_THE_CLOCK}, result.state


def compared(configs):
    """Play them side by side and one by one; how many ticks went through lanes."""
    rows = [[Rows() for _ in configs] for _ in range(2)]
    together = side_by_side.play([functools.partial(played, *pair) for pair in zip(configs, rows[0])])
    for config, got, mine, other in zip(configs, together, *rows):
        assert not isinstance(got, BaseException), repr(got)
        want = played(config, other)
        assert repr(got[0]) == repr(want[0])
        assert mine.bytes() == other.bytes(), "the same rows in the same pieces: float sums depend on them"
        for name, value in want[1][0].items():
            np.testing.assert_array_equal(got[1][0][name], value, err_msg=name)


@pytest.fixture
def lane_ticks(monkeypatch):
    """Ticks times gyroscopes of each call of the lanes engine."""
    ticks, run = [], lanes.Engine.run

    def counted(self, states, count, *rest):
        ticks.append(count * len(states))
        return run(self, states, count, *rest)

    monkeypatch.setattr(lanes.Engine, "run", counted)
    return ticks


def test_nothing_in_common_but_the_clock(lane_ticks):
    """Lengths, profiles, writes, faults, temperatures, numbers of first writes, and what lanes cannot do at all."""
    compared(
        [
            short(0.015, 1),
            short(0.012, 2, scenario__rate_dps=[[0.0, 0.0], [0.01, 300.0]]),
            short(0.014, 3, scenario__register_writes=[[0.0, "amplitude_setpoint", 99], [0.0071, "control", 1]]),
            short(0.013, 4, scenario__faults=[[0.004, "adc_stuck", "drive_sin", 77, 0.003]]),
            short(0.011, 5, scenario__temperature_degc=[[0.0, 20.0], [0.011, 21.0]], plant__self_heating_k=1.0),
            short(0.016, 6, firmware__phase_drive_sine_deg=3.0, effects__duffing_k3_per_um2=1e-3),
            short(0.006, 7, firmware__board="digital_sid"),
            short(0.006, 8, output__vcd_start_us=2000.0, output__vcd_length_us=50.0),
            short(0.009, 9, scenario__faults=[[0.003, "plant_nan", "x", 0, 0.001]]),
        ]
    )
    assert sum(lane_ticks) > 0.7 * 1e6 * (0.015 + 0.012 + 0.014 + 0.013 + 0.011 + 0.016 + 0.009)


def test_an_engine_is_made_once_for_those_that_stay_together(monkeypatch):
    """However they take turns: making its tables takes as long as thousands of ticks."""
    made, init = [], lanes.Engine.__init__

    def counted(self, params):
        made.append(len(params))
        init(self, params)

    monkeypatch.setattr(lanes.Engine, "__init__", counted)

    def steps(k, engine_run):
        sim = Simulation(configured(noise__seed=k), 25.0, 25.0, engine=engine_run)
        for _ in range(6 if k else 3):
            sim.advance(1500, 0.0, 25.0)

    assert side_by_side.play([functools.partial(steps, k) for k in range(4)]) == [None] * 4
    assert made == [4, 3]


def test_two_go_one_by_one(lane_ticks):
    compared([short(0.004, 1), short(0.004, 2)])
    assert lane_ticks == []


@pytest.mark.slow
def test_from_power_on_over_lock_to_the_diagnosis(lane_ticks):
    """Locks at different times, and the phase meter, which lanes leave to the frame engine."""
    long = SHORT | {"scenario__origin": "lock", "scenario__diagnose": True, "scenario__seconds": 0.1}
    compared(
        [configured(**long, noise__seed=k, plant__fx_hz=11000.0 + 2 * k, plant__qx=9e4 + 1e4 * k) for k in range(4)]
    )
    assert sum(lane_ticks) > 4 * 1e6


def advance_from(config, ahead, ticks, engine_run):
    """A simulation that has come `ahead` by the frame engine before the others see it."""
    sim = Simulation(config, 25.0, 25.0, engine="frame")
    sim.advance(ahead, 0.0, 25.0)
    if engine_run:
        sim.engine = engine_run
    sim.advance(ticks, np.linspace(0.0, 1.0, ticks // 125), 25.0)
    return sim


@pytest.mark.parametrize("ahead", [(0, 7, 999, 0), (0, 5000, 5000, 5200, 12_000), (3000, 0, 0, 0)])
def test_wherever_they_begin(lane_ticks, ahead):
    """Those a little behind catch up, those far ahead are waited for."""
    configs = [configured(noise__seed=k) for k in range(len(ahead))]
    works = [functools.partial(advance_from, c, n, 10_000 + 100 * k) for k, (c, n) in enumerate(zip(configs, ahead))]
    for work, sim in zip(works, side_by_side.play(works)):
        alone = work(None)
        assert different(sim.state, alone.state) == []
        assert sim.codes_sha256() == alone.codes_sha256()
    assert sum(lane_ticks) > 10_000


def test_one_that_fails_leaves_the_others():
    def fails(engine_run):
        sim = Simulation(configured(), 25.0, 25.0, engine=engine_run)
        sim.advance(2000, 0.0, 25.0)
        raise ValueError("no more")

    works = [functools.partial(advance_from, configured(noise__seed=k), 0, 6000) for k in range(3)]
    *sims, problem = side_by_side.play([*works, fails])
    assert (type(problem), str(problem)) == (ValueError, "no more")
    for work, sim in zip(works, sims):
        assert sim.codes_sha256() == work(None).codes_sha256()


def test_an_error_of_the_engine_reaches_every_run(monkeypatch):
    def broken(self, *_):
        raise RuntimeError("the registers of tick 7 are not those of the clocked engine")

    monkeypatch.setattr(lanes.Engine, "run", broken)
    works = [functools.partial(advance_from, configured(noise__seed=k), 0, 6000) for k in range(3)]
    assert [str(problem) for problem in side_by_side.play(works)] == [
        "the registers of tick 7 are not those of the clocked engine"
    ] * 3


def test_an_interrupt_ends_all_of_them():
    def interrupts(engine_run):
        sim = Simulation(configured(), 25.0, 25.0, engine=engine_run)
        sim.advance(2000, 0.0, 25.0)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        sim.advance(10**12, 0.0, 25.0)

    works = [functools.partial(advance_from, configured(noise__seed=k), 0, 10**9) for k in range(2)]
    with pytest.raises(KeyboardInterrupt):
        side_by_side.play([*works, interrupts])
    runs = [thread for thread in threading.enumerate() if thread.name.startswith(side_by_side.NAME)]
    for thread in runs:
        thread.join(120)
    assert not any(thread.is_alive() for thread in runs)


def test_what_can_stand_side_by_side():
    kinds = {
        name: lanes.kind(Simulation(configured(**values), 20.0, 30.0).params)
        for name, values in {
            "plain": {},
            "other": {"plant__fx_hz": 11001.0, "firmware__pipeline_registers": 2, "noise__cv": False},
            "digital": {"firmware__board": "digital_sid"},
        }.items()
    }
    assert kinds["plain"] == kinds["other"]
    assert kinds["plain"] is not None
    assert kinds["digital"] is None


def test_limits_on_the_page():
    page = (docs.ROOT / "docs" / "decisions" / "0013-runs-side-by-side.md").read_text()
    assert f"up to {side_by_side.NEAR_TICKS} ticks behind the others" in page
    assert side_by_side.LEAST_RUNS == 3
    assert f"fewer than three at one tick, or fewer than {side_by_side.LEAST_TICKS} ticks to go" in page
    assert "fewer than three points left" in (docs.ROOT / "docs" / "campaigns.md").read_text()

"""Hostile calls of the public API: one line that names the quantity; what NumPy holds is taken like Python's own."""

import numpy as np
import pytest

from testbench import arguments, budget, config, simulate
from testbench.errors import ConfigError, FileError
from testbench.run.simulation import Simulation
from tests.testbench.bench_setup import configured

NAN, INF = float("nan"), float("inf")
DEFAULT = config.Config()


def sim(lo=20.0, hi=30.0, **more):
    return Simulation(DEFAULT, lo, hi, engine="clocked", **more)


@pytest.fixture(scope="module")
def gyro():
    return sim()


ADVANCE = {
    "ticks = -1 is outside 0 ..": (-1, 0.0, 25.0),
    "ticks = 1000.0 is not an integer": (1e3, 0.0, 25.0),
    "ticks = nan is not an integer": (NAN, 0.0, 25.0),
    "ticks = inf is not an integer": (INF, 0.0, 25.0),
    "ticks = '5' is not an integer": ("5", 0.0, 25.0),
    "ticks = None is not an integer": (None, 0.0, 25.0),
    f"ticks = {1 << 70} is outside": (1 << 70, 0.0, 25.0),
    "probe_ticks = -1 is outside 0 .. 9 ticks": (9, 0.0, 25.0, -1),
    "probe_ticks = 10 is outside 0 .. 9 ticks": (9, 0.0, 25.0, 10),
    "temp_degc = 60 is outside 20 .. 30 degC, which this Simulation was built for": (9, 0.0, 60.0),
    "temp_degc = 19.99 is outside 20 .. 30 degC": (9, 0.0, 19.99),
    "temp_degc = 31 is outside": (9, 0.0, np.array([25.0, 31.0])),
    "temp_degc = nan is outside": (9, 0.0, [25.0, NAN]),
    "temp_degc = array([], dtype=float64) is neither": (9, 0.0, np.zeros(0)),
    "rate_rad_s = nan is outside -174.533 .. 174.533 rad/s": (9, NAN, 25.0),
    "rate_rad_s = -inf is outside": (9, [0.0, -INF], 25.0),
    "rate_rad_s = 1e+300 is outside": (9, 1e300, 25.0),
    "rate_rad_s = [] is neither": (9, [], 25.0),
    "rate_rad_s = 'fast' is neither": (9, "fast", 25.0),
    "rate_rad_s = None is neither": (9, None, 25.0),
    "rate_rad_s = 1j is neither": (9, 1j, 25.0),
    "rate_rad_s = [[0], [1, 2]] is neither": (9, [[0], [1, 2]], 25.0),
}


@pytest.mark.parametrize(("words", "given"), ADVANCE.items(), ids=ADVANCE)
def test_advance_refuses_and_does_nothing(gyro, words, given):
    with pytest.raises(ConfigError) as caught:
        gyro.advance(*given)
    assert str(caught.value).startswith(words)
    assert gyro.tick == 0


CALLS = {
    "temp_lo_degc = nan": lambda _: sim(NAN, 25.0),
    "temp_hi_degc = inf": lambda _: sim(25.0, INF),
    "temp_lo_degc = 500.0": lambda _: sim(500.0, 500.0),
    "temp_lo_degc = 'a'": lambda _: sim("a", 25.0),
    "temp_hi_degc = 20.0 is not a number within 30 .. 125 degC": lambda _: sim(30.0, 20.0),
    "window = 5": lambda _: sim(window=5),
    "window[0] = nan": lambda _: sim(window=(NAN, 5)),
    "window[1] = 0": lambda _: sim(window=(5, 0)),
    "engine = 'x' is not one of": lambda _: Simulation(DEFAULT, 25.0, 25.0, engine="x"),
    "config = 'x.toml' is not a configuration": lambda _: Simulation("x.toml", 25.0, 25.0),
    "config = None": lambda _: simulate.run(None),
    "config = 5": lambda _: budget.budget(5),
    "config = {}": lambda _: config.to_toml({}),
    "config = []": lambda _: config.changed([], {"noise.seed": 1}),
    "config = ()": lambda gyro: simulate.start((), gyro, 0.0, 25.0),
    "resume = True needs directory": lambda _: simulate.run(DEFAULT, resume=True),
    "directory = 5": lambda _: simulate.run(DEFAULT, directory=5),
    "directory = ''": lambda _: simulate.run(DEFAULT, directory=""),
    "limit_s = inf": lambda gyro: simulate.start(DEFAULT, gyro, 0.0, 25.0, limit_s=INF),
    "limit_s = -1.0": lambda gyro: simulate.start(DEFAULT, gyro, 0.0, 25.0, limit_s=-1.0),
    "temp_degc = 60": lambda gyro: simulate.start(DEFAULT, gyro, 0.0, 60.0),
    "start: rate_rad_s and temp_degc": lambda gyro: simulate.start(DEFAULT, gyro, [0.0, 1.0], 25.0),
    "write: 'nothing' is not a writable register": lambda gyro: gyro.write("nothing", 1),
    "write: None": lambda gyro: gyro.write(None, 1),
    "write: control = nan": lambda gyro: gyro.write("control", NAN),
    "write: amplitude_setpoint = -1": lambda gyro: gyro.write("amplitude_setpoint", -1),
    "ticks = 0 is outside 1": lambda gyro: gyro.probe(0, 0.0, 25.0),
    "path = None": lambda gyro: gyro.restore(None),
    "state: lacks chips": lambda gyro: gyro.set_state({}),
    "temp_degc = -300.0": lambda _: budget.budget(DEFAULT, temp_degc=-300.0),
    "frequency_hz = 0.0": lambda _: budget.budget(DEFAULT, frequency_hz=0.0),
    "frequency_hz = 'x'": lambda _: budget.budget(DEFAULT, frequency_hz="x"),
    "path = 5": lambda _: config.load(5),
    "path = ''": lambda _: config.load(""),
    "overrides = 'noise.seed=7' is not a list": lambda _: config.load(overrides="noise.seed=7"),
    "overrides = None": lambda _: config.load(overrides=None),
    "overrides: 5": lambda _: config.load(overrides=[5]),
    "values = None": lambda _: config.changed(DEFAULT, None),
    "values: 'seed' is not of the form": lambda _: config.changed(DEFAULT, {"seed": 1}),
    "values: 5": lambda _: config.changed(DEFAULT, {5: 1}),
    "changed: plant.fx_hz = [0.0, 0.0]": lambda _: config.changed(DEFAULT, {"plant.fx_hz": np.zeros(2)}),
    "changed: output.directory": lambda _: config.changed(DEFAULT, {"output.directory": "a\0b"}),
}


@pytest.mark.parametrize(("words", "call"), CALLS.items(), ids=CALLS)
def test_a_hostile_call_is_one_line(gyro, tmp_path, monkeypatch, words, call):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ConfigError, FileError)) as caught:
        call(gyro)
    assert str(caught.value).startswith(words)
    assert "\n" not in str(caught.value)
    assert gyro.tick == 0
    assert list(tmp_path.iterdir()) == []


def test_an_engine_gets_integers_of_python(monkeypatch):
    """A kernel would be compiled anew for each integer type of NumPy."""
    made, seen = sim(), set()

    def run(p, s, ticks, rate, temp, host, faults, o):
        seen.update((type(ticks), *map(type, host)))
        return s._replace(tick=s.tick + ticks)

    monkeypatch.setattr(made, "_run", run)
    for kind in (np.int32, np.int64, np.uint8, np.array):
        made.advance(kind(9), np.float32(0.1), np.array([20, 30]))
        made.write("control", kind(1))
    assert made.tick == 40
    assert seen == {int}


def test_self_heating_may_exceed_the_range():
    warm = Simulation(configured(plant__self_heating_k=5.0), 25.0, 25.0, engine="clocked")
    warm.advance(300, 0.0, 25.0)
    assert warm.rise_k > 0.0


def test_numpy_numbers_are_taken_by_a_configuration():
    values = {"noise.seed": np.int64(5), "noise.adc": np.bool_(False), "scenario.rate_dps": np.array([[0.0, 3.0]])}
    made = config.changed(DEFAULT, values)
    assert made == config.changed(DEFAULT, {key: arguments.numpy_to_python(value) for key, value in values.items()})
    assert budget.budget(made, np.float32(30), np.int64(11_000)).frequency_hz == 11_000.0

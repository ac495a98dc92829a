"""Random designs over all keys of [design] at once: the frame engine has every register and code of the clocked one.

python -m tests.testbench.engines.test_designs [COUNT] [SEED]    more of them, a line each
"""

import random
import sys

import numpy as np
import pytest

from fpga_model import top as fpga
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench import config
from testbench.errors import ConfigError
from testbench.flatten import format_leaves, leaves
from testbench.measured.record import produce
from testbench.paper.calibration import bench
from testbench.paper.loop import parts
from testbench.run import design_check
from testbench.run.simulation import Simulation

SEED, COUNT = 20261, 4
TICKS_S = 0.05
LOCK_S = 2.5
RATE_RAD_S, TEMP_DEGC = 0.5, 25.0


def drawn(seed):
    """Values of [design], and the ADC's decimation that keeps a conversion as long as a frame."""
    rng = random.Random(seed)
    tick_clocks = rng.randint(26, 32)
    master_hz = rng.randrange(24_000_000, 35_000_000, tick_clocks * 4)
    frame_ticks = rng.choice((100, 125, 150, 200, 250))
    tick_hz = master_hz / tick_clocks
    values = {
        "design.master_hz": master_hz,
        "design.tick_clocks": tick_clocks,
        "design.frame_ticks": frame_ticks,
        "design.dds_bits": rng.randint(34, 48),
        "design.sine_address_bits": rng.randint(5, 11),
        "design.sine_fraction_bits": rng.randint(1, 12),
        "design.sine_bits": rng.randint(13, 20),
    }
    return values | {"plant.adc_decimation": 64, "plant.adc_modulator_hz": 64 * tick_hz / frame_ticks}


def fits(values):
    """The rules of design_check, written down again."""
    d = {name.split(".")[1]: value for name, value in values.items()}
    return (
        d["master_hz"] <= 35e6
        and d["tick_clocks"] >= 26
        and d["dds_bits"] >= 2 + d["sine_address_bits"] + d["sine_fraction_bits"]
        and d["sine_bits"] > d["sine_address_bits"]
    )


def moved(cfg, engine, state=None, seconds=TICKS_S):
    """A simulation moved on from power-on, or from the state of another one."""
    sim = Simulation(cfg, TEMP_DEGC, TEMP_DEGC, engine=engine)
    sim.now = (np.array([RATE_RAD_S]), np.array([TEMP_DEGC]))
    if state is None:
        for name, raw in sim.first_writes:
            sim.write(name, raw)
    else:
        sim.set_state(state)
    sim.advance(round(seconds * sim.design.tick_hz), RATE_RAD_S, TEMP_DEGC)
    return sim


def same(one, two):
    """Whether two simulations have the same codes, registers and plant."""
    a, b = one.state_values(), two.state_values()
    return one.codes_sha256() == two.codes_sha256() and all(np.array_equal(a[key], b[key]) for key in a)


def in_formats(sim):
    """Registers outside their formats."""
    pairs = zip(format_leaves(formats(fpga.State, sim.design)), leaves(sim.state.fpga), strict=True)
    return [(name, value) for (name, fmt), (_, value) in pairs if not fmt.holds(value)]


def examine(values):
    """'' if both engines agree from power-on and from lock, else what differs; raises ConfigError for a refusal."""
    cfg = config.changed(config.Config(), values)
    frame, clocked = moved(cfg, "frame"), moved(cfg, "clocked")
    if not same(frame, clocked):
        return "power-on"
    if wrong := in_formats(clocked):
        return f"formats: {wrong}"
    locked = moved(cfg, "frame", seconds=LOCK_S)
    if not locked.locked:
        return "not locked"
    state = locked.state_values()
    frame, clocked = moved(cfg, "frame", state), moved(cfg, "clocked", state)
    return "" if same(frame, clocked) and not in_formats(clocked) else "lock"


@pytest.mark.parametrize("number", range(COUNT))
def test_a_random_design(number):
    values = drawn(SEED + number)
    if not fits(values):
        with pytest.raises(ConfigError):
            design_check.check(config.changed(config.Config(), values))
        return
    assert examine(values) == ""


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"design.master_hz": 36_000_000}, "SCLK limit of the sense DAC AD5791: its 24 bits take 686 ns"),
        ({"design.tick_clocks": 25}, "AD5791 takes 26 clocks, and there are 25 between two loads"),
        ({"design.dds_bits": 24, "design.sine_fraction_bits": 12, "design.sine_address_bits": 12}, "is below 26"),
        ({"design.sine_bits": 10, "design.sine_address_bits": 10}, "not below sine_bits = 10"),
    ],
)
def test_designs_that_cannot_work(values, said):
    with pytest.raises(ConfigError, match=said):
        Simulation(config.changed(config.Config(), values), TEMP_DEGC, TEMP_DEGC)


@pytest.mark.parametrize("key", ["master_hz", "tick_clocks", "dds_bits", "sine_bits"])
def test_what_is_of_the_default_design_alone_refuses_another(key):
    cfg = config.changed(config.Config(), {f"design.{key}": getattr(DEFAULT, key) + 1 - 2 * (key == "dds_bits")})
    for made in (parts.parts, bench.Bench, lambda c: produce.Board(c, 25.0, 25.0, False)):
        with pytest.raises(ConfigError, match=f"design.{key} = .* of the default design"):
            made(cfg)


def test_the_averaged_plant_takes_word_lengths_and_no_other_rate():
    short = config.changed(config.Config(), {"design.dds_bits": 32, "design.sine_address_bits": 7})
    Simulation(short, TEMP_DEGC, TEMP_DEGC, engine="baseband")
    slow = config.changed(config.Config(), {"design.tick_clocks": 28})
    with pytest.raises(ConfigError, match=r"design\.tick_clocks: 28 is not 26"):
        Simulation(slow, TEMP_DEGC, TEMP_DEGC, engine="baseband")


def test_the_default_design_is_checked_too():
    design_check.check(config.Config())
    assert config.Config().design_record() == DEFAULT


if __name__ == "__main__":
    count, seed = (int(text) for text in (*sys.argv[1:], *("40", "1")[len(sys.argv) - 1 :]))
    bad = ran = refused = 0
    for k in range(seed, seed + count):
        values = drawn(k)
        try:
            wrong = examine(values)
        except (ConfigError, ValueError) as problem:
            refused += 1
            print(k, "refused:", problem)
            continue
        ran += 1
        bad += wrong != ""
        print(k, wrong or "same", *(f"{key.split('.')[1]}={value}" for key, value in values.items()), flush=True)
    print(f"{ran} ran, {refused} refused, {bad} wrong")
    sys.exit(bad > 0)

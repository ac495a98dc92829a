"""Random designs over all keys of [design] at once: the frame engine has every register and code of the clocked one.

python -m tests.testbench.engines.test_designs [COUNT] [SEED]    more of them, a line each
"""

import collections
import random
import sys
from pathlib import Path

import numpy as np
import pytest

from analog_frontend.parts import resonator
from fpga_model import top as fpga
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench import config
from testbench.engines import engine
from testbench.errors import ConfigError
from testbench.flatten import format_leaves, leaves
from testbench.measured.record import produce
from testbench.run import build, design_check
from testbench.run.simulation import Simulation

BOARDS = Path(__file__).parents[3] / "docs" / "boards"
SEED, COUNT, WIDE = 20261, 4, 120
TICKS_S = 0.05
LOCK_S = 2.5
RATE_RAD_S, TEMP_DEGC = 0.5, 25.0
GAINS = (16099211, 7587), (15032895, 1180681), (0, 263936067)  # kp, ki (2^-24) of AGC, FTR, QSC at 8 kHz frames


def drawn(seed):
    """Values of [design], and the ADC's modulator that keeps a conversion as long as a frame."""
    rng = random.Random(seed)
    sense_dac, drive_dac = rng.choice(("AD5791", "DAC8811", "generic")), rng.choice(("DAC8811", "generic"))
    fast = sense_dac == drive_dac == "generic" and rng.random() < 0.5
    tick_clocks = rng.randint({"AD5791": 26, "DAC8811": 18, "generic": 22}[sense_dac], 32)
    slowest, fastest = (51_000_000, 56_000_000) if fast else (20_000_000, 35_000_000)
    master_hz = rng.randrange(slowest, fastest, tick_clocks * 4)
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
        "design.sense_dac": sense_dac,
        "design.sense_dac_bits": rng.randint(14, 20) if sense_dac == "generic" else 20,
        "design.drive_dac": drive_dac,
        "design.drive_dac_bits": rng.randint(12, 16) if drive_dac == "generic" else 16,
        "design.quadrature_dac": "generic" if fast else rng.choice(("DAC82002", "generic")),
        "design.adc": (adc := rng.choice(("ADS1298", "generic"))),
        "design.adc_bits": rng.randint(16, 24) if adc == "generic" else 24,
        "design.coefficient_fraction_bits": rng.randint(20, 24),
        "firmware.quadrature_update_khz": rng.choice((500, 1000)) if fast else 500,
    }
    return values | {"plant.adc_decimation": 64, "plant.adc_modulator_hz": 64 * tick_hz / frame_ticks}


def drawn_wide(seed):
    """As `drawn`, of the whole range of each key and past what works: about every third design can be built."""
    rng = random.Random(seed)
    sense_dac, drive_dac = rng.choice(("AD5791", "DAC8811", "generic", "generic")), rng.choice(("DAC8811", "generic"))
    tick_clocks, frame_ticks, wrong = rng.randint(16, 32), rng.randint(60, 426), rng.random() < 0.1
    master_hz = rng.randint(10_000_000, 60_000_000)
    adc = rng.choice(("ADS1298", "generic"))
    return {
        "design.master_hz": master_hz,
        "design.tick_clocks": tick_clocks,
        "design.frame_ticks": frame_ticks,
        "design.dds_bits": rng.randint(24, 48),
        "design.sine_address_bits": rng.randint(4, 12),
        "design.sine_fraction_bits": rng.randint(1, 12),
        "design.sine_bits": rng.randint(10, 20),
        "design.sense_dac": sense_dac,
        "design.sense_dac_bits": rng.randint(8, 20) if sense_dac == "generic" or wrong else 20,
        "design.drive_dac": drive_dac,
        "design.drive_dac_bits": rng.randint(8, 16) if drive_dac == "generic" or wrong else 16,
        "design.quadrature_dac": rng.choice(("DAC82002", "generic")),
        "design.adc": adc,
        "design.adc_bits": rng.randint(16, 24) if adc == "generic" or wrong else 24,
        "design.coefficient_fraction_bits": rng.choice((24, 24, 20, rng.randint(8, 24))),
        "plant.adc_decimation": 64,
        "plant.adc_modulator_hz": 64 * master_hz / tick_clocks / frame_ticks,
    }


def refusals(values):
    """Why a design cannot work: the rules of data sheets, arithmetic and formats, written down again."""
    d = {name.split(".")[1]: value for name, value in values.items()}
    clock_s = 1 / d["master_hz"]
    tick_s, kinds = d["tick_clocks"] * clock_s, (d["drive_dac"], d["sense_dac"], d["quadrature_dac"])
    least_s = {"AD5791": 1 / 35e6, "DAC8811": 1 / 50e6, "DAC82002": 1 / 50e6, "generic": 1 / 200e6}
    frames = {"AD5791": 26, "DAC8811": 18}
    pll_kp = 2 * np.pi * 3.0 * 2.0 ** (d["dds_bits"] - 24) * clock_s
    pll_ki = pll_kp * 2 * np.pi * 0.6 * tick_s * d["frame_ticks"]
    slower = tick_s * d["frame_ticks"] / 125e-6
    gains = [kp for kp, _ in GAINS] + [ki * slower for _, ki in GAINS] + [pll_kp * 2**24, pll_ki * 2**24]
    unit = 2 ** (24 - d["coefficient_fraction_bits"])
    rules = {
        "bits of a named part": (kinds[0] != "generic" and d["drive_dac_bits"] != 16)
        or (kinds[1] != "generic" and d["sense_dac_bits"] != 20)
        or (d["adc"] != "generic" and d["adc_bits"] != 24),
        "serial clock": any(clock_s < least_s[kind] for kind in kinds),
        "serial frame": any(
            d["tick_clocks"] < frames.get(kind, d[f"{role}_dac_bits"] + 1)
            for role, kind in zip(("drive", "sense"), kinds)
        ),
        "phase word": d["dds_bits"] - 2 < d["sine_address_bits"] + d["sine_fraction_bits"],
        "rows of the table": d["sine_bits"] <= d["sine_address_bits"],
        "integral gain of the frequency loop": pll_ki < 2.0**-25,
        "gains in few bits": any(abs(round(k / unit) * unit - k) > k / 20 for k in map(round, gains)),
        "DRDY in the tick of the last sample": d["adc_conversion_delay_s"] < tick_s,
        "two samples of the modulator in a tick": d["frame_ticks"] <= 64,
    }
    return [name for name, broken in rules.items() if broken]


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
    assert examine(drawn(SEED + number)) == ""


def test_what_is_refused_cannot_work_and_what_can_is_not_refused():
    why = collections.Counter()
    for seed in range(SEED, SEED + WIDE):
        values = drawn_wide(seed)
        expected, said = refusals(values | {"plant.adc_conversion_delay_s": 1.5e-6}), ""
        try:
            Simulation(config.changed(config.Config(), values), TEMP_DEGC, TEMP_DEGC)
        except (ConfigError, ValueError) as problem:
            said = str(problem)
        assert bool(expected) == bool(said), (seed, values, expected, said)
        why.update(expected or ["built"])
    assert why.pop("built") >= WIDE // 4, why
    assert sum(why.values()) >= 20, why


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"design.master_hz": 36_000_000}, "SCLK limit of the sense DAC AD5791: its 24 bits take 686 ns"),
        ({"design.tick_clocks": 25}, "AD5791 takes 26 clocks, and there are 25 between two loads"),
        ({"design.dds_bits": 24, "design.sine_fraction_bits": 12, "design.sine_address_bits": 12}, "is below 26"),
        ({"design.sine_bits": 10, "design.sine_address_bits": 10}, "not below sine_bits = 10"),
        ({"design.master_hz": 52_000_000, "design.sense_dac": "generic"}, "SCLK limit of the drive DAC DAC8811"),
        ({"design.tick_clocks": 16, "design.sense_dac": "DAC8811"}, "DAC8811 takes 18 clocks, and there are 16"),
        ({"design.sense_dac_bits": 18}, 'sense_dac_bits = 18 bits needs design.sense_dac = "generic"'),
        ({"design.adc_bits": 18}, 'adc_bits = 18 bits needs design.adc = "generic"'),
        ({"design.adc": "generic", "plant.adc_step_code": 1}, 'adc_step_code = 1 needs design.adc = "ADS1298"'),
        (
            {"design.coefficient_fraction_bits": 14},
            "agc: ki = 0.0004522 is 5.52 % off in 14 fraction bits; the limit is 5",
        ),
        ({"design.coefficient_fraction_bits": 10}, "agc: ki = 0.0004522 is 100 % off in 10 fraction bits"),
        ({"design.dds_bits": 25, "design.sine_address_bits": 8}, "frequency loop with dds_bits = 25 bits: ki_per_s: "),
        ({"design.frame_ticks": 64, "plant.adc_decimation": 64, "plant.adc_modulator_hz": 1e6}, "may hold one sample"),
        ({"design.master_hz": 16_000_000, "plant.adc_modulator_hz": 512e3 * 16 / 26}, "outside 1.625e-06 s"),
    ],
)
def test_designs_that_cannot_work(values, said):
    with pytest.raises((ConfigError, ValueError), match=said):
        Simulation(config.changed(config.Config(), values), TEMP_DEGC, TEMP_DEGC)


@pytest.mark.parametrize("name", ["low_cost", "fast_dacs"])
def test_a_board_of_another_design(name):
    """It locks, rests at its amplitude, and gives the rate; both engines have the same bits, from power-on and lock."""
    cfg = config.changed(config.load(BOARDS / f"{name}.toml"), {"output.record": False})
    frame, clocked = moved(cfg, "frame"), moved(cfg, "clocked")
    assert same(frame, clocked)
    locked = moved(cfg, "frame", seconds=LOCK_S)
    assert locked.locked
    x, vx = (locked.columns()[f"truth_{name}"][-2000:] for name in ("x", "vx"))
    amplitude = np.sqrt(np.mean(x**2 + (vx * resonator.SCALE_HZ / 11002.3) ** 2))
    assert abs(amplitude * 1e6 / cfg.firmware.amplitude_um - 1) < 2e-3
    state, word = locked.state_values(), locked.columns()["rate_word"][-2000:].mean()
    locked.advance(round(0.5 * locked.design.tick_hz), -RATE_RAD_S, TEMP_DEGC)
    per_dps = (word - locked.columns()["rate_word"][-1000:].mean()) / np.degrees(2 * RATE_RAD_S)
    nominal = build.word_per_deg_s(cfg)
    assert abs(per_dps / nominal - 1) < 0.03, "phase errors cost up to two per cent"
    assert same(moved(cfg, "frame", state), moved(cfg, "clocked", state))


@pytest.mark.parametrize(("name", "khz"), [("paper", 500), ("fast_dacs", 500), ("fast_dacs", 1000)])
def test_frames_of_v_q_are_as_many_as_the_key_says(name, khz):
    """Falls of SYNC in a millisecond behind the power-on of the DACs, clock by clock."""
    cfg = config.changed(config.load(BOARDS / f"{name}.toml"), {"firmware.quadrature_update_khz": khz})
    ticks = round(1e-3 * cfg.design_record().tick_hz)
    sim = Simulation(cfg, TEMP_DEGC, TEMP_DEGC, window=(0, ticks), engine="clocked")
    sim.now = (np.zeros(1), np.full(1, TEMP_DEGC))
    sim.advance(ticks, 0.0, TEMP_DEGC)
    sync = sim.rows[:, engine.PIN_COLUMNS.index("quadrature_sync_n")]
    falls = np.flatnonzero(np.diff(sync) < 0)
    apart = round(cfg.design_record().master_hz / (1e3 * khz))
    # a frame is no whole number of loads: the last of one and the first of the next are further apart
    assert np.bincount(np.diff(falls)).argmax() == apart
    assert np.diff(falls).min() == apart
    assert len(falls) == pytest.approx(khz, rel=0.02)


@pytest.mark.parametrize("key", ["master_hz", "tick_clocks", "dds_bits", "sine_bits"])
def test_what_is_of_the_default_design_alone_refuses_another(key):
    cfg = config.changed(config.Config(), {f"design.{key}": getattr(DEFAULT, key) + 1 - 2 * (key == "dds_bits")})
    with pytest.raises(ConfigError, match=f"design.{key} = .* of the default design"):
        produce.Board(cfg, 25.0, 25.0, False)


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

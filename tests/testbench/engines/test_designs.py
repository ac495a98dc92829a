"""Random designs over all keys of [design] at once: both engines have the same bits, registers are in proven ranges.

python -m tests.testbench.engines.test_designs [COUNT] [SEED]    more of them, a line each
"""

import collections
import math
import random
import sys
from pathlib import Path

import numpy as np
import pytest

from analog_frontend.parts import resonator
from fpga_model import top as fpga
from fpga_model import wiring
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench import config
from testbench.engines import chips, engine
from testbench.errors import ConfigError
from testbench.flatten import format_leaves, leaves
from testbench.golden.ranges import ranges
from testbench.golden.stimulus import blocks
from testbench.measured.record import produce
from testbench.run import budget, build, design_check
from testbench.run.simulation import Simulation

BOARDS = Path(__file__).parents[3] / "docs" / "boards"
SEED, COUNT, WIDE, BUILT = 20261, 4, 100, 15
QUICK = (3,)  # of the random designs; the board fast_dacs has the generic DACs and the converter that it lacks
ROLES = frozenset(wiring.instances())
TICKS_S = 0.05
WINDOW_TICKS = 1000  # whose registers are kept at once, at every clock
LOCK_S = 2.5
RATE_RAD_S, TEMP_DEGC = 0.5, 25.0
GAINS = (16099211, 7587), (15032895, 1180681), (0, 263936067)  # kp, ki (2^-24) of AGC, FTR, QSC at 8 kHz frames


def frame_drawn(rng, role, bits, room):
    """Frame, divider and latch of a generic DAC whose frame ends within `room` clocks."""
    divider = rng.choice([n for n in (1, 1, 2, 3, 4) if n * bits + 1 <= room])
    latch, lead = rng.choice(("SYNC", "LDAC", "load")), rng.randint(0, 3)
    most = min(24, (room - 1 - lead - (latch == "LDAC")) // divider)
    if most < bits:
        latch, lead, most = "SYNC", 0, min(24, (room - 1) // divider)
    frame = rng.randint(bits, most)
    tail = rng.randint(0, min(15, frame - bits))
    keys = {
        "divider": divider,
        "frame_bits": frame,
        "command": rng.getrandbits(min(16, frame - bits - tail)),
        "tail_bits": tail,
        "lead_clocks": lead,
        "latch": latch,
    }
    return {f"design.{role}_dac_{key}": value for key, value in keys.items()}


def loads_apart(tick_hz, khz):
    """Ticks from one frame of V_q to the next: the least power of two that keeps them below the rate."""
    return next(2**k for k in range(6) if tick_hz <= 1e3 * khz * 2**k)


def adc_clocks(master_hz, divider, word_bits, channels, tail):
    """Clocks from the fall of DRDY to the end of the tail, or of the 8 kHz work, behind the last bit."""
    return 4 + divider * (1 + channels) * word_bits + max(tail or math.ceil(master_hz * 2.056e-6), 60)


def readout_drawn(rng, adc, adc_bits, master_hz, room):
    """Divider of the ADC, and words, channels and tail of a generic one, whose frame ends within `room` clocks."""
    keys = {"adc_word_bits": 24, "adc_channels": 8, "adc_tail_clocks": 0}
    if adc == "generic":
        tail = rng.choice((0, rng.randint(1, 300)))
        keys = {"adc_word_bits": rng.randint(adc_bits, 24), "adc_channels": rng.randint(5, 8), "adc_tail_clocks": tail}
    fit = [n for n in (2, 4, 8) if adc_clocks(master_hz, n, *keys.values()) <= room]
    return {f"design.{key}": value for key, value in ({"adc_divider": rng.choice(fit)} | keys).items()}


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
        "design.dds_bits": (dds_bits := rng.randint(34, 48)),
        "design.sine_address_bits": rng.randint(5, 11),
        "design.sine_fraction_bits": rng.randint(1, 12),
        "design.sine_bits": rng.randint(13, 20),
        "design.sense_dac": sense_dac,
        "design.sense_dac_bits": rng.randint(14, 20) if sense_dac == "generic" else 20,
        "design.drive_dac": drive_dac,
        "design.drive_dac_bits": rng.randint(12, 16) if drive_dac == "generic" else 16,
        "design.quadrature_dac": "generic" if fast else rng.choice(("DAC82002", "generic")),
        "design.adc": (adc := "generic" if fast else rng.choice(("ADS1298", "generic"))),
        "design.adc_bits": rng.randint(16, 24) if adc == "generic" else 24,
        "design.coefficient_fraction_bits": rng.randint(20, 24),
        "design.cordic_iterations": rng.randint(8, 24),
        "design.cordic_guard_bits": rng.randint(0, 8),
        "design.accumulator_fraction_bits": rng.randint(max(12, 56 - dds_bits), 24),
        "firmware.quadrature_update_khz": rng.choice((500, 1000)) if fast else 500,
    }
    v_q_ticks = loads_apart(tick_hz, values["firmware.quadrature_update_khz"])
    for role, room in (("drive", tick_clocks), ("sense", tick_clocks), ("quadrature", v_q_ticks * tick_clocks)):
        if values[f"design.{role}_dac"] == "generic":
            values |= frame_drawn(rng, role, values.get(f"design.{role}_dac_bits", 16), room)
    values |= readout_drawn(rng, adc, values["design.adc_bits"], master_hz, tick_clocks * frame_ticks)
    return values | {"plant.adc_decimation": 64, "plant.adc_modulator_hz": 64 * tick_hz / frame_ticks}


def drawn_wide(seed):
    """As `drawn`, of the whole range of each key and past what works: about every fifth design can be built."""
    rng = random.Random(seed)
    sense_dac, drive_dac = rng.choice(("AD5791", "DAC8811", "generic", "generic")), rng.choice(("DAC8811", "generic"))
    tick_clocks, frame_ticks, wrong = rng.randint(16, 32), rng.randint(60, 426), rng.random() < 0.1
    master_hz = rng.randint(10_000_000, 60_000_000)
    adc, quadrature_dac, frames = rng.choice(("ADS1298", "generic")), rng.choice(("DAC82002", "generic")), {}
    for role, kind in (("drive", drive_dac), ("sense", sense_dac), ("quadrature", quadrature_dac)):
        if rng.random() < (0.4 if kind == "generic" else 0.02):
            tail = rng.choice((0, 0, 1, 2))
            frames |= {
                f"design.{role}_dac_divider": rng.choice((1, 1, 1, 2)),
                f"design.{role}_dac_frame_bits": rng.choice((0, 0, 0, 16 + tail, 20 + tail)),
                f"design.{role}_dac_command": rng.choice((0, 0, 0, 0, 0, 1)),
                f"design.{role}_dac_tail_bits": tail,
                f"design.{role}_dac_lead_clocks": rng.choice((0, 1, 3)),
                f"design.{role}_dac_latch": rng.choice(("SYNC", "LDAC", "load")),
            }
    return frames | {
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
        "design.quadrature_dac": quadrature_dac,
        "design.adc": adc,
        "design.adc_bits": rng.randint(16, 24) if adc == "generic" or wrong else 24,
        "design.coefficient_fraction_bits": rng.choice((24, 24, 24, 20, 20, rng.randint(8, 24))),
        "design.cordic_iterations": rng.randint(8, 24),
        "design.cordic_guard_bits": rng.randint(0, 8),
        "design.accumulator_fraction_bits": rng.choice((24, 24, 20, rng.randint(8, 24))),
        "design.adc_divider": rng.choice((2, 2, 4, 8)),
        "design.adc_word_bits": rng.choice((24, 24, rng.randint(16, 24))) if adc == "generic" or wrong else 24,
        "design.adc_channels": rng.randint(5, 8) if adc == "generic" or wrong else 8,
        "design.adc_tail_clocks": rng.choice((0, rng.randint(1, 511))) if adc == "generic" or wrong else 0,
        "plant.adc_decimation": 64,
        "plant.adc_modulator_hz": 64 * master_hz / tick_clocks / frame_ticks,
    }


def refusals(values):
    """Why a design cannot work: the rules of data sheets, arithmetic and formats, written down again."""
    d = {name.split(".")[1]: value for name, value in values.items()}
    clock_s = 1 / d["master_hz"]
    tick_s, kinds = d["tick_clocks"] * clock_s, (d["drive_dac"], d["sense_dac"], d["quadrature_dac"])
    least_s = {"AD5791": 1 / 35e6, "DAC8811": 1 / 50e6, "DAC82002": 1 / 50e6, "generic": 1 / 200e6}
    high_s = {"AD5791": 10e-9, "DAC8811": 10e-9, "DAC82002": 9e-9, "generic": 2.5e-9}
    sheets = {"AD5791": (24, 0, 1), "DAC8811": (16, 1, 0), "DAC82002": (24, 0, 0)}  # bits, lead, clock to LDAC
    own = {"frame_bits": 0, "command": 0, "tail_bits": 0, "lead_clocks": 0, "latch": "SYNC"}
    foreign, torn, slow, thin, long = False, False, False, False, False
    for role, kind, room in zip(("drive", "sense", "quadrature"), kinds, (1, 1, loads_apart(1 / tick_s, 500))):
        k = {key: d.get(f"{role}_dac_{key}", value) for key, value in own.items()}
        n, code = d.get(f"{role}_dac_divider", 1), d.get(f"{role}_dac_bits", 16)
        used = code + k["tail_bits"]
        bits, lead, wait = sheets.get(kind, (k["frame_bits"] or used, k["lead_clocks"], k["latch"] == "LDAC"))
        foreign |= kind != "generic" and k != own
        torn |= kind == "generic" and (bits > 24 or bits < used or k["command"] >= 2 ** max(bits - used, 0))
        slow |= n * clock_s < least_s[kind]
        thin |= clock_s / 2 < high_s[kind]
        # lead, whole periods of SCLK, LDAC's clock, and one in which SYNC or LDAC is high again
        long |= lead + n * bits + wait + 1 > room * d["tick_clocks"]
    pll_kp = 2 * np.pi * 3.0 * 2.0 ** (d["dds_bits"] - 24) * clock_s
    pll_ki = pll_kp * 2 * np.pi * 0.6 * tick_s * d["frame_ticks"]
    slower = tick_s * d["frame_ticks"] / 125e-6
    kis = [round(ki) for ki in (*(ki * slower for _, ki in GAINS), pll_ki * 2**24)]
    gains = [*(kp for kp, _ in GAINS), round(pll_kp * 2**24), *kis]
    readout = tuple(d[f"adc_{key}"] for key in ("word_bits", "channels", "tail_clocks"))
    unit, least = (2 ** (24 - d[f"{kind}_fraction_bits"]) for kind in ("coefficient", "accumulator"))
    rules = {
        "bits of a named part": (kinds[0] != "generic" and d["drive_dac_bits"] != 16)
        or (kinds[1] != "generic" and d["sense_dac_bits"] != 20)
        or (d["adc"] != "generic" and d["adc_bits"] != 24),
        "frame of a named part": foreign,
        "code, tail and command in a frame": torn,
        "serial clock": slow,
        "pulse of the serial clock": thin,
        "serial frame": long,
        "serial clock of the ADC": d["adc"] != "generic" and d["adc_divider"] * clock_s < 50e-9,
        "readout of a named part": d["adc"] != "generic" and readout != (24, 8, 0),
        "code in a word": d["adc_bits"] > d["adc_word_bits"],
        "readout before the next conversion": adc_clocks(d["master_hz"], d["adc_divider"], *readout)
        > d["tick_clocks"] * d["frame_ticks"],
        "phase word": d["dds_bits"] - 2 < d["sine_address_bits"] + d["sine_fraction_bits"],
        "rows of the table": d["sine_bits"] <= d["sine_address_bits"],
        "integral gain of the frequency loop": pll_ki < 2.0**-25,
        "gains in few bits": any(abs(round(k / unit) * unit - k) > k / 20 for k in gains),
        "an error of one LSB in the integrator": any(0 < 2 * round(k / unit) * unit <= least for k in kis),
        "DRDY in the tick of the last sample": d["adc_conversion_delay_s"] < tick_s,
        "two samples of the modulator in a tick": d["frame_ticks"] <= 64,
    }
    return [name for name, broken in rules.items() if broken]


SAME = {  # a part, and a generic DAC with its numbers
    "quadrature": ("DAC82002", {"frame_bits": 24, "command": 8}),
    "sense": ("AD5791", {"frame_bits": 24, "command": 1, "latch": "LDAC"}),
    "drive": ("DAC8811", {"lead_clocks": 1}),
}


def with_numbers_of(*roles):
    """A board with a generic DAC with the numbers of its part in these roles; with none, that with the parts.

    Its sine has 19 bits: only the default design leaves its reset value in the scale of the rate output.
    """
    values = {f"design.{role}_dac": "generic" for role in roles} | {"design.sine_bits": 19}
    values |= {f"design.{role}_dac_{key}": v for role in roles for key, v in SAME[role][1].items()}
    return config.changed(config.Config(), values)


def moved(cfg, engine, state=None, seconds=TICKS_S, seen=None):
    """A simulation moved on from power-on, or from the state of another one.

    seen  list that takes the least and the largest value of every register at any clock
    """
    sim = Simulation(cfg, TEMP_DEGC, TEMP_DEGC, engine=engine)
    sim.now = (np.array([RATE_RAD_S]), np.array([TEMP_DEGC]))
    if state is None:
        for name, raw in sim.first_writes:
            sim.write(name, raw)
    else:
        sim.set_state(state)
    ticks = round(seconds * sim.design.tick_hz)
    step = ticks if seen is None else WINDOW_TICKS
    ends = []
    for done in range(0, ticks, step):
        sim.window = None if seen is None else (sim.tick, step)
        sim.advance(min(step, ticks - done), RATE_RAD_S, TEMP_DEGC)
        if seen is not None:
            rows, sim.rows = sim.rows[:, -sim.register_count :], None
            ends += [rows.min(axis=0), rows.max(axis=0)]
    if seen is not None:
        seen[:] = [np.min(ends, axis=0), np.max(ends, axis=0)]
    return sim


def same(one, two):
    """Whether two simulations have the same codes, registers and plant."""
    a, b = one.state_values(), two.state_values()
    return one.codes_sha256() == two.codes_sha256() and all(np.array_equal(a[key], b[key]) for key in a)


def proven(cfg, roles=ROLES):
    """[(register, least, most)] of every register of the firmware, proven for this design and its parameters.

    roles  instances that are proven; registers of the others may hold anything
    """
    firmware = build.firmware(cfg)
    known, found = blocks.firmware_blocks(firmware), {}
    for role in roles:
        module, _ = wiring.instances()[role]
        block = known[module.__name__.rpartition(".")[2]]
        params = block.cases.get(role.rpartition(".")[2], next(iter(block.cases.values())))
        analysis = ranges.analyse(block, params)
        assert analysis.sound, (role, analysis.problems)
        found |= {f"{role}.{r.name}".replace(".", "_"): r.proven for r in analysis.registers}
    names = [name for name, _ in format_leaves(formats(fpga.State, firmware.design))]
    limits = [(name, *found.pop(name.replace(".", "_"), (-np.inf, np.inf))) for name in names]
    assert not found
    return limits


def beyond(limits, seen):
    """Registers that were outside their proven ranges."""
    return [(name, lo, hi) for (name, lo, hi), a, b in zip(limits, *seen, strict=True) if a < lo or b > hi]


def examine(values, roles=ROLES):
    """'' if both engines agree, within proven ranges, from power-on and from lock; raises ConfigError for a refusal."""
    cfg = config.changed(config.Config(), values)
    limits, seen = proven(cfg, roles), []
    frame, clocked = moved(cfg, "frame"), moved(cfg, "clocked", seen=seen)
    if not same(frame, clocked):
        return "power-on"
    if wrong := beyond(limits, seen):
        return f"ranges: {wrong}"
    locked = moved(cfg, "frame", seconds=LOCK_S)
    if not locked.locked:
        return "not locked"
    state = locked.state_values()
    frame, clocked = moved(cfg, "frame", state), moved(cfg, "clocked", state, seen=seen)
    if not same(frame, clocked):
        return "lock"
    return f"ranges in lock: {wrong}" if (wrong := beyond(limits, seen)) else ""


@pytest.mark.parametrize("number", QUICK)
def test_a_random_design(number):
    """But for the ranges of the sequencer, whose proof takes longer than all else."""
    assert examine(drawn(SEED + number), ROLES - {"control.sequencer"}) == ""


@pytest.mark.slow
@pytest.mark.parametrize("number", range(COUNT))
def test_a_random_design_with_the_ranges_of_its_sequencer(number):
    assert examine(drawn(SEED + number)) == ""


def test_a_code_that_the_next_load_puts_out_is_in_the_state_at_any_end():
    """V_q every fourth tick, by a load that puts out the frame before it: two loads are longer than a flush."""
    values = {"master_hz": 29843496, "quadrature_dac": "generic", "quadrature_dac_divider": 3,
              "quadrature_dac_frame_bits": 24, "quadrature_dac_command": 1, "quadrature_dac_tail_bits": 7,
              "quadrature_dac_lead_clocks": 2, "quadrature_dac_latch": "load"}  # fmt: skip
    values = {f"design.{key}": value for key, value in values.items()} | {
        "firmware.quadrature_update_khz": 500,
        "plant.adc_modulator_hz": 64 * 29843496 / 3250,
    }
    cfg = config.changed(config.Config(), values)
    state = moved(cfg, "frame", seconds=LOCK_S).state_values()
    for k in range(12):
        one, other = (moved(cfg, engine, state, seconds=0.02 + k * 9.3e-6) for engine in ("frame", "clocked"))
        assert same(one, other), one.tick % 125


def test_a_register_beyond_its_proven_range_is_seen():
    """The proof of a sine of 12 bits against the values of one of 18."""
    limits, seen = proven(config.changed(config.Config(), {"design.sine_bits": 12}), ["drive_sine"]), []
    moved(config.Config(), "clocked", seconds=0.005, seen=seen)
    assert {name.rpartition(".")[2] for name, _, _ in beyond(limits, seen)} >= {"base", "y"}


@pytest.mark.parametrize("count", [WIDE, pytest.param(4 * WIDE, marks=pytest.mark.slow)])
def test_what_is_refused_cannot_work_and_what_can_is_not_refused(count):
    why = collections.Counter()
    for seed in range(SEED, SEED + count):
        values = drawn_wide(seed)
        expected, said = refusals(values | {"plant.adc_conversion_delay_s": 1.5e-6}), ""
        try:
            Simulation(config.changed(config.Config(), values), TEMP_DEGC, TEMP_DEGC)
        except (ConfigError, ValueError) as problem:
            said = str(problem)
        assert bool(expected) == bool(said), (seed, values, expected, said)
        why.update(expected or ["built"])
    assert why.pop("built") >= count * BUILT / WIDE, why
    assert sum(why.values()) >= 20, why


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"design.master_hz": 36_000_000}, "SCLK limit of the sense DAC AD5791: its 24 bits take 686 ns"),
        ({"design.tick_clocks": 25}, "AD5791 takes 26 clocks, and there are 25 between two loads"),
        ({"design.dds_bits": 24, "design.sine_fraction_bits": 12, "design.sine_address_bits": 12}, "is below 26"),
        ({"design.sine_bits": 10, "design.sine_address_bits": 10}, "not below sine_bits = 10"),
        ({"design.master_hz": 52_000_000, "design.sense_dac": "generic"}, "SCLK limit of the drive DAC DAC8811"),
        (
            {"design.master_hz": 52_000_000} | {f"design.{role}_dac": "generic" for role in chips.Chips._fields},
            "adc_divider = 2 is above 20000000 Hz, the SCLK limit of the ADC ADS1298; set adc_divider = 4",
        ),
        ({"design.tick_clocks": 16, "design.sense_dac": "DAC8811"}, "DAC8811 takes 18 clocks, and there are 16"),
        (
            {"design.drive_dac": "generic", "design.drive_dac_divider": 2},
            "serial frame of the drive DAC generic takes 33 clocks, and there are 26 between two loads",
        ),
        (
            {"design.sense_dac": "generic", "design.sense_dac_frame_bits": 24, "design.sense_dac_lead_clocks": 2},
            "serial frame of the sense DAC generic takes 27 clocks, and there are 26",
        ),
        (
            {"design.quadrature_dac_divider": 3},
            "serial frame of the V_q DAC DAC82002 takes 73 clocks, and there are 52 between two loads",
        ),
        (
            {"design.drive_dac": "generic", "design.drive_dac_frame_bits": 12},
            "drive_dac_frame_bits = 12 bits: code and tail take 16 bits, and 24 is the limit",
        ),
        (
            {"design.sense_dac": "generic", "design.sense_dac_frame_bits": 22, "design.sense_dac_command": 4},
            "sense_dac_command = 4 does not fit the 2 bits before the code of a frame of 22 bits",
        ),
        ({"design.sense_dac_latch": "load"}, 'sense_dac_latch = load needs design.sense_dac = "generic"'),
        (
            {
                "design.master_hz": 64_000_000,
                "design.quadrature_dac_divider": 2,
                "design.tick_clocks": 32,
                "design.drive_dac": "generic",
                "design.sense_dac": "generic",
            },
            "SCLK is high for half a clock, 7.81 ns, below the 9 ns of the V_q DAC DAC82002",
        ),
        ({"design.sense_dac_bits": 18}, 'sense_dac_bits = 18 bits needs design.sense_dac = "generic"'),
        ({"design.adc_word_bits": 16}, 'adc_word_bits = 16 bits needs design.adc = "generic"'),
        ({"design.adc_channels": 5}, 'adc_channels = 5 needs design.adc = "generic"'),
        ({"design.adc_tail_clocks": 60}, 'adc_tail_clocks = 60 clocks needs design.adc = "generic"'),
        (
            {"design.adc": "generic", "design.adc_word_bits": 18, "design.adc_bits": 20},
            "adc_word_bits = 18 bits is below adc_bits = 20: a word must hold a code",
        ),
        (
            {"design.adc_divider": 8, "design.frame_ticks": 66, "plant.adc_modulator_hz": 64e6 / 66},
            "adc_divider = 8 clocks: 9 words of 24 bits take 1732 clocks, with the longer of tail, 54, and 8 kHz work, "
            "60: 1792, and there are 1716 between two conversions",
        ),
        (
            {
                "design.adc": "generic",
                "design.adc_word_bits": 16,
                "design.adc_bits": 16,
                "scenario.faults": [[0.0, "adc_lost_bit", "adc", 96, 1.0]],
            },
            "adc_lost_bit = 96 is outside 17 .. 95 bits, the five channels of words of 16 bits",
        ),
        ({"design.adc_bits": 18}, 'adc_bits = 18 bits needs design.adc = "generic"'),
        ({"design.adc": "generic", "plant.adc_step_code": 1}, 'adc_step_code = 1 needs design.adc = "ADS1298"'),
        (
            {"design.coefficient_fraction_bits": 14},
            "agc: ki = 0.0004522 is 5.52 % off in 14 fraction bits; the limit is 5",
        ),
        ({"design.coefficient_fraction_bits": 10}, "agc: ki = 0.0004522 is 100 % off in 10 fraction bits"),
        (
            {"design.accumulator_fraction_bits": 10},
            "agc: ki = 0.0004522 rounds an error of 1 LSB to zero in 10",
        ),
        (
            {"design.accumulator_fraction_bits": 18, "design.dds_bits": 36},
            "frequency_tracker: ki = .* to zero in 18 fraction bits; ki must be above 1.907e-06, half an LSB",
        ),
        ({"design.cordic_iterations": 7}, "cordic_iterations = 7 is below the limit 8 rotations"),
        ({"design.cordic_iterations": 25}, "cordic_iterations = 25 is above the limit 24 rotations"),
        ({"design.cordic_guard_bits": 9}, "cordic_guard_bits = 9 is above the limit 8 bits"),
        ({"design.accumulator_fraction_bits": 25}, "accumulator_fraction_bits = 25 is above the limit 24 bits"),
        ({"design.dds_bits": 25, "design.sine_address_bits": 8}, "frequency loop with dds_bits = 25 bits: ki_per_s: "),
        ({"design.frame_ticks": 64, "plant.adc_decimation": 64, "plant.adc_modulator_hz": 1e6}, "may hold one sample"),
        ({"design.master_hz": 16_000_000, "plant.adc_modulator_hz": 512e3 * 16 / 26}, "outside 1.625e-06 s"),
    ],
)
def test_designs_that_cannot_work(values, said):
    with pytest.raises((ConfigError, ValueError), match=said):
        Simulation(config.changed(config.Config(), values), TEMP_DEGC, TEMP_DEGC)


@pytest.mark.parametrize("divider", [2, 8])
def test_faults_of_the_adc_in_words_of_other_length(divider):
    """Codes and status that 16 bits do not hold, a lost bit: both engines cut them alike, and the codes are these."""
    readout = {"adc_divider": divider, "adc_word_bits": 16, "adc_bits": 16, "adc_channels": 5, "adc_tail_clocks": 200}
    cfg = config.changed(config.Config(), {"design.adc": "generic"} | {f"design.{k}": v for k, v in readout.items()})
    sims = [Simulation(cfg, TEMP_DEGC, TEMP_DEGC, engine=name) for name in ("frame", "clocked")]
    stuck = (0x123456, -0x123456, 0x7FFFFF, -1, 0x0F0F0F)
    for sim in sims:
        sim.now = (np.array([RATE_RAD_S]), np.array([TEMP_DEGC]))
        faults = engine.Faults(status=0xCFFFFF, channel=(engine.STUCK,) * 5, value=stuck)
        for lost_bit in (0, 40):
            sim.faults = faults._replace(lost_bit=lost_bit)
            sim.advance(5000, RATE_RAD_S, TEMP_DEGC)
            line = "".join(f"{code % 2**24:024b}"[:16] for code in stuck)
            if lost_bit:
                line = line[: lost_bit - 16] + line[lost_bit - 15 :] + "0"
            codes = [int(line[at : at + 16], 2) << 8 for at in range(0, 80, 16)]
            adc = sim.state.fpga.adc
            assert [code % 2**24 for code in adc.channels] == [*codes, 0, 0, 0]
            assert (adc.status, adc.ok) == (0xCFFF00, 1)
    assert same(*sims)


def test_a_generic_adc_with_the_numbers_of_the_part_is_read_like_it():
    """At 40 MHz the part's tail is 83 clocks, where 54 would be 1.35 us instead of 2.056 us."""
    for hz, clocks in ((26_000_000, 54), (40_000_000, 83)):
        values = {"design.master_hz": hz, "design.drive_dac": "generic", "design.sense_dac": "generic"}
        records = [config.changed(config.Config(), values | {"design.adc": adc}) for adc in ("ADS1298", "generic")]
        assert [cfg.design_record().adc_tail_clocks for cfg in records] == [clocks, clocks]


def test_a_generic_dac_with_the_numbers_of_a_part_is_that_part():
    """V_q's is its part in all parameters; the others differ by coding, control word and what they put out first."""
    named, generic = chips.dac_chips(config.Config().design), chips.dac_chips(with_numbers_of(*SAME).design)
    assert generic.quadrature[1:4] == named.quadrature[1:4]
    for role, only in (("sense", ("control",)), ("drive", ("flip",))):
        a, b = getattr(named, role).master, getattr(generic, role).master
        assert tuple(key for key in a._fields if getattr(a, key) != getattr(b, key)) == only
    a, b = named.sense.part, generic.sense.part
    differing = [key for key in a._fields if getattr(a, key) != getattr(b, key)]
    assert differing == ["control_value", "clamp_mask", "power_on_code", "needs_control"]


def test_a_generic_dac_with_the_numbers_of_a_part_gives_its_bits():
    """From power-on for V_q's; from lock for all: codes, and the whole state but for the registers of the frame."""
    own, state = with_numbers_of(), moved(with_numbers_of(), "frame", seconds=LOCK_S).state_values()
    assert same(moved(own, "clocked"), moved(with_numbers_of("quadrature"), "clocked"))
    sims = [moved(cfg, "clocked", state) for cfg in (own, with_numbers_of(*SAME))]
    assert sims[0].codes_sha256() == sims[1].codes_sha256()
    names = [name for name, _ in leaves(sims[0].state.fpga)]
    (a, b) = ([v for _, v in leaves(sim.state.fpga)] for sim in sims)
    assert {name for name, one, two in zip(names, a, b) if one != two} <= {"drive_dac.shift"}, "offset binary"
    assert all(np.array_equal(one, two) for one, two in zip(sims[0].state.plant.z, sims[1].state.plant.z))


@pytest.mark.parametrize("key", ["divider", "latch", "tail_bits", "lead_clocks"])
def test_what_the_frame_costs_is_in_the_budget_and_in_the_phase(key):
    """Clocks of the frame and its latch, counted here, are those by which the budget's xe1 and ye1 grow."""
    base = {"design.drive_dac": "generic", "design.sense_dac": "generic"}
    base |= {"design.drive_dac_bits": 12, "design.sense_dac_bits": 12}
    value, clocks = {"divider": (2, 12), "latch": ("load", 26 - 12), "tail_bits": (5, 5), "lead_clocks": (3, 3)}[key]
    plain = config.changed(config.Config(), base)
    for role, node in (("drive", "xe1"), ("sense", "ye1")):
        other = config.changed(plain, {f"design.{role}_dac_{key}": value})
        before, after = (budget.budget(cfg).node_deg()[node] for cfg in (plain, other))
        assert after - before == pytest.approx(360 * 11002.3 * clocks / 26e6, rel=1e-9)


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
    with pytest.raises(ConfigError, match=f"design.{key} = .* only the default design"):
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

"""The plant around the reference RTL: no difference, the same world as the model's own, planted slips caught."""

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from fpga_model import fault_monitor, registers, sequencer, top
from fpga_model.rates import FRAME_HZ, TICK_CYCLES
from fpga_model.top import Pins
from testbench.commands.main import app
from testbench.config import Config, changed, load, scenario
from testbench.engines.engine import PIN_COLUMNS
from testbench.errors import ConfigError, FileError
from testbench.flatten import leaves
from testbench.golden import divergence
from testbench.golden.loop import library, lockstep, run
from testbench.golden.loop.by_edge import Model, Plant
from testbench.golden.recording import make_recordings
from testbench.run import build, simulate
from testbench.run.simulation import Simulation
from tests.testbench.engines.test_designs import BOARDS
from tests.testbench.golden import benching
from tests.testbench.rtl.test_rtl import RTL, icarus
from tests.testbench.rtl.test_rtl_top import INPUTS, OUTPUTS, Board, hexed, under_icarus

pytestmark = pytest.mark.skipif(
    any(shutil.which(name) is None for name in library.TOOLS), reason="no verilator or compiler: no loop around RTL"
)
QUICK_FRAMES = 620  # the quick gyroscope locks within 500
SLIP_TICKS = 1000
# File, right, wrong: slips on the way to every kind of pin, and one in a counter that nothing sees for long
QUICK_SLIP = ("spi_dac.v", "(r_left == 5'd1)", "(r_left == 5'd2)")
SLIPS = (
    ("watchdog.v", ": r_age + 10'd1", ": r_age + (r_age == 10'd50 ? 10'd2 : 10'd1)"),
    ("top.v", "off_sense_ref (r_registers_phase_sense_ref", "off_sense_ref (48'd1"),
    ("dds.v", "r_phase + word", "r_phase + word + 48'd1"),
    ("references.v", "r_signs     <= signs", "r_signs     <= ~signs"),
    ("spi_dac.v", "assign o_sdin = |(", "assign o_sdin = ~|("),
    ("spi_adc.v", "(r_count == LAST_CLOCK)", "(r_count == LAST_CLOCK - ONE)"),
)


def quick_story():
    """(Config, firmware): the quick gyroscope of the recordings to lock, a rate, an ADC that is silent for frames."""
    seconds = QUICK_FRAMES / FRAME_HZ
    faults = [[(QUICK_FRAMES - 25) / FRAME_HZ, "adc_silent", "adc", 0, 10 / FRAME_HZ]]
    rates = [[0.0, 0.0], [540 / FRAME_HZ, 300.0]]
    given = {"seconds": seconds, "origin": "power_on", "rate_dps": rates, "rate_shape": "steps", "faults": faults}
    config = changed(Config(), make_recordings.QUICK | {f"scenario.{key}": value for key, value in given.items()})
    return config, make_recordings.quick_firmware(config)


# Interpreted, because compiling the loop takes longer than a test may: some ticks with the design's own limit of the
# watchdog, then with another one, whose first effect is a difference
INTERPRETED = """
import json, sys
from testbench.golden.loop import library, run
from tests.testbench.golden.test_loop import quick_story

config, firmware = quick_story()
for limit in (firmware.watchdog.limit, 5):
    with library.Design(sys.argv[1]) as design:
        firmware = firmware._replace(watchdog=firmware.watchdog._replace(limit=limit))
        sim = run.Loop(config, 25.0, 25.0, design, firmware)
        try:
            sim.advance(12, 0.0, 25.0)
            sim.finish()
            print(json.dumps({"rows": sim.compared_row_count}))
        except run.Difference as found:
            print(json.dumps({**found.to_dict(), "text": found.text()}))
"""


@pytest.mark.slow
def test_some_ticks_interpreted_and_a_parameter_that_differs(quick):
    done = subprocess.run(
        [sys.executable, "-c", INTERPRETED, str(quick[2])],
        cwd=RTL.parents[1], env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    same, other = (json.loads(line) for line in done.stdout.splitlines())
    assert same == {"rows": 12 * TICK_CYCLES + 1}
    assert other["tick"] in (5, 6, 7)
    assert {"register": "watchdog.stale", "expected": 1, "got": 0} in other["differs"]
    assert other["text"].startswith(f"tick {other['tick']}, clock {other['clock']} (")


def alone(config, firmware, engine, window=None):
    """The same scenario with the model's own firmware."""
    timeline = scenario.expand(config.scenario)
    sim = Simulation(config, *timeline.temp_degc.limits(), window, engine)
    sim.params = sim.params._replace(fpga=firmware)
    sim.now = (np.array([timeline.rate_before_rad_s]), np.array([timeline.temp_before_degc]))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    simulate.play(sim, timeline)
    return sim


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """(config, firmware, path of the library) of the quick gyroscope."""
    config, firmware = quick_story()
    return config, firmware, library.build(RTL, firmware, tmp_path_factory.mktemp("loop"), level=0)


@pytest.mark.slow
def test_no_register_differs_from_power_on_through_lock_rate_and_fault(quick):
    """And what the plant went through is, to the last code, what it goes through with the model in its place."""
    config, firmware, path = quick
    with library.Design(path) as design:
        outcome = run.run_lockstep(config, design, firmware)
    assert outcome.difference is None, outcome.text()
    ticks = round(outcome.seconds * 1e6)
    assert outcome.rows == ticks * TICK_CYCLES + 1
    assert {"KICK", "SEARCH", "ACQUIRE", "BALANCE", "LOCKED"} <= set(outcome.states)
    assert "STALE" in outcome.flags
    assert outcome.codes_sha256 == alone(config, firmware, "frame").codes_sha256()
    assert outcome.text().startswith(f"PASS {outcome.rows} rows of 217 registers and 13 pins, no difference")


@pytest.mark.slow
def test_a_design_with_another_parameter_is_caught_at_its_first_effect(quick):
    """The first row that differs is that of two models, one with each limit of the watchdog."""
    config, firmware, path = quick
    other = firmware._replace(watchdog=firmware.watchdog._replace(limit=50))
    config = changed(config, {"scenario.seconds": 0.001, "scenario.faults": [], "scenario.rate_dps": 0.0})
    kept = [len(PIN_COLUMNS) + k for k in range(len(library.REGISTERS))] + [
        PIN_COLUMNS.index(name) for name in Pins._fields
    ]
    right, wrong = (alone(config, p, "clocked", (0, SLIP_TICKS)).rows[:, kept] for p in (other, firmware))
    first = int(np.flatnonzero(np.any(right != wrong, axis=1))[0])
    assert first > 50 * TICK_CYCLES
    with library.Design(path) as design:
        found = run.run_lockstep(config, design, other).difference
    values = zip(library.NAMES, right[first].tolist(), wrong[first].tolist(), strict=True)
    assert (found.row, found.wrong) == (first, [value for value in values if value[1] != value[2]])


@pytest.mark.slow
@pytest.mark.parametrize("slip", [QUICK_SLIP, *SLIPS], ids=lambda slip: slip[0])
@icarus
def test_a_planted_slip_is_caught_at_its_first_effect(slip, tmp_path):
    """The first row that differs is that which Icarus finds with the inputs of a run without RTL."""
    name, right, wrong = slip
    text = (RTL / name).read_text()
    assert text.count(right) == 1
    rtl = tmp_path / "rtl"
    shutil.copytree(RTL, rtl)
    (rtl / name).write_text(text.replace(right, wrong))
    config, firmware = quick_story()
    config = changed(config, {"scenario.seconds": SLIP_TICKS * 1e-6, "scenario.faults": [], "scenario.rate_dps": 0.0})
    outcome = run.run(config, rtl, tmp_path / "built", firmware=firmware, level=0)
    first, values = first_under_icarus(config, firmware, slip, tmp_path)
    assert outcome.difference is not None
    assert outcome.difference.row == first
    assert outcome.difference.wrong == values
    assert outcome.difference.row == outcome.difference.tick * TICK_CYCLES + outcome.difference.clock
    (line, *_) = outcome.text().splitlines()
    register, expected, got = values[0]
    assert re.fullmatch(
        rf"FAIL tick {first // 26}, clock {first % 26} \(\S+ us\): {register}: expected {expected}, got {got}", line
    )


@pytest.mark.slow
@icarus
def test_the_bundle_of_a_difference_shows_it_again(tmp_path):
    """Without plant and model, in Icarus: the same clock, register and values; the right design passes."""
    name, right, wrong = SLIPS[0]
    rtl = tmp_path / "rtl"
    shutil.copytree(RTL, rtl)
    (rtl / name).write_text((RTL / name).read_text().replace(right, wrong))
    config, firmware = quick_story()
    config = changed(config, {"scenario.seconds": SLIP_TICKS * 1e-6, "scenario.faults": [], "scenario.rate_dps": 0.0})
    found = run.run(config, rtl, tmp_path / "built", firmware=firmware, level=0).difference
    divergence.write(tmp_path / "package", found)
    bundle = tmp_path / "package" / "bundle" / "top" / "loop"
    said = benching.make(bundle, "SIM=icarus", f"RTL={rtl}", "PYTHON=false")
    ((register, expected, got),) = found.wrong
    line = f"clock {found.row}: r_{register.replace('.', '_')}: expected {expected:x}, got {got:x} (hex) [icarus]"
    assert said.returncode != 0
    assert said.stdout.splitlines()[0] == line
    said = benching.make(bundle, "SIM=icarus", f"RTL={RTL}", "PYTHON=false")
    assert said.returncode == 0, said.stdout
    assert said.stdout.startswith("PASS top/loop: ")


def first_under_icarus(config, firmware, slip, folder):
    """(row, [(name, expected, got)]) of the first row of the slipped design that is not the clocked engine's."""
    ticks = SLIP_TICKS
    sim = alone(config, firmware, "clocked", (0, ticks))
    rows, writes = sim.rows, build.register_writes(config)
    pins, regs = rows[:, : len(PIN_COLUMNS)], rows[:, len(PIN_COLUMNS) :]
    stim = np.zeros((len(rows) + 2, len(INPUTS)), np.int64)
    column = {name: k for k, (name, _) in enumerate(INPUTS)}
    stim[:2, column["rst"]] = stim[:2, column["drdy_n"]] = 1
    for name in ("drdy_n", "dout"):
        stim[2:, column[name]] = pins[:, PIN_COLUMNS.index(name)]
    for k, (name, raw) in enumerate(writes):
        entry = registers.BY_NAME[name]
        at = 2 + k * TICK_CYCLES
        for key, value in (("write", 1), ("address", entry.address), ("data", registers.to_bus(int(raw), entry.fmt))):
            stim[at, column[key]] = value
    name, right, wrong = slip
    text = (RTL / name).read_text().replace(right, wrong)
    found = under_icarus(Board(firmware, len(stim), ()), stim, folder, {name: text})[2:]
    kept = [PIN_COLUMNS.index(name.removeprefix("o_")) for name, _ in OUTPUTS[len(library.REGISTERS) :]]
    wanted = hexed(np.column_stack([regs, pins[:, kept]]), [fmt for _, fmt in OUTPUTS])
    first = next(n for n, (a, b) in enumerate(zip(found, wanted, strict=True)) if a != b)
    values, a, b = [], int(found[first], 16), int(wanted[first], 16)
    for (_, fmt), label in zip(reversed(OUTPUTS), reversed(library.NAMES), strict=True):
        mask = (1 << fmt.width) - 1
        if (a ^ b) & mask:
            got, expected = (v - mask - 1 if fmt.s and v > mask >> 1 else v for v in (a & mask, b & mask))
            values.insert(0, (label, expected, got))
        a, b = a >> fmt.width, b >> fmt.width
    return first, values


def test_the_difference_says_what_stood_before():
    before = np.zeros((3, len(library.NAMES)), np.int64)
    before[:, 4] = 7, 8, 9
    found = run.Difference(2 * TICK_CYCLES + 5, [(library.NAMES[4], 9, -9), *[("x", 1, 0)] * 9], before)
    assert (found.tick, found.clock) == (2, 5)
    lines = found.text().splitlines()
    assert lines[0] == "tick 2, clock 5 (2.192 us): dds.drive_sine: expected 9, got -9"
    assert lines[-2:] == ["  and 2 more", "  dds.drive_sine in the model, clock by clock up to this one: 7, 8, 9"]
    assert found.to_dict()["differs"][0] == {"register": "dds.drive_sine", "expected": 9, "got": -9}


@pytest.mark.slow
def test_after_reset_the_design_holds_the_reset_values(quick):
    with library.Design(quick[2]) as design:
        values = design.read()
    assert values[: len(library.REGISTERS)].tolist() == [int(value) for _, value in leaves(top.State())]
    assert len(values) == lockstep.SIGNAL_COUNT


def test_bad_input_is_one_clear_error(tmp_path, monkeypatch):
    with pytest.raises(FileError, match=r"top\.v: no design: this file must hold the module gyro_top"):
        library.sources(tmp_path)
    shutil.copytree(RTL, tmp_path / "rtl")
    path = tmp_path / "rtl" / "top.v"
    path.write_text(re.sub(r"\br_rates_slot\b", "r_rates_solt", path.read_text()))
    with pytest.raises(FileError, match=r"top\.v: port r_rates_slot is missing"):
        library.build(tmp_path / "rtl", build.firmware(Config()), tmp_path / "built")
    with pytest.raises(ConfigError, match=r"firmware\.notch_hz: the Verilog of the whole design has no notch"):
        run.run(changed(Config(), {"firmware.notch_hz": 139.0}), RTL)
    with pytest.raises(ConfigError, match=r"scenario\.origin: the loop around RTL begins at power-on"):
        run.run_lockstep(Config(), None, None)
    monkeypatch.setattr(library.shutil, "which", lambda name: None if name == "verilator" else name)
    with pytest.raises(ConfigError, match="verilator: not installed"):
        library.build(RTL, build.firmware(Config()), tmp_path / "other")


def test_the_story_is_what_it_says():
    config = run.story()
    timeline = scenario.expand(config.scenario)
    seen = {round(float(rate) / simulate.DEG) for rate in timeline.rate_rad_s.frame_values(0, timeline.frames)}
    assert seen == {-300, 0, 300}
    assert [event.name for event in timeline.events] == ["adc_silent", "adc_silent"]
    assert timeline.ticks == 3_000_000
    assert scenario.expand(run.story(0.01).scenario).events == ()


@pytest.mark.slow
def test_the_command_prints_json(tmp_path):
    done = CliRunner().invoke(app, ["golden", "loop", "--rtl", str(RTL), "--seconds", "0.001", "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    assert found["difference"] is None
    assert found["rows"] == round(found["seconds"] * 26e6) + 1
    assert (found["registers"], found["pins"]) == (217, 13)


@pytest.mark.slow
def test_three_seconds_without_a_difference(tmp_path):
    """Power-on, lock, +300 and -300 deg/s, an ADC that is silent: the default firmware and gyroscope."""
    outcome = run.run(run.story(), RTL)
    assert outcome.difference is None, outcome.text()
    assert outcome.seconds >= 3.0
    assert outcome.rows == round(outcome.seconds * 26e6) + 1
    assert outcome.locked
    assert "STALE" in outcome.flags
    assert set(outcome.states) >= {"POWER_UP", "KICK", "SEARCH", "LOCKED"}
    assert set(outcome.states) <= set(sequencer.STATES)
    assert set(outcome.flags) <= set(fault_monitor.NAMES)


def of_board(name, seconds):
    """Configuration of a board of the repository from power-on, with 100 deg/s behind lock if there is time."""
    values = {"origin": "power_on", "seconds": seconds, "rate_dps": [[0.0, 0.0], [1.7, 100.0]], "rate_shape": "steps"}
    return changed(load(BOARDS / f"{name}.toml"), {f"scenario.{key}": value for key, value in values.items()})


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.stem for path in BOARDS.glob("*.toml")))
def test_no_register_of_any_board_differs_for_half_a_second(name):
    config = of_board(name, 0.5)
    outcome = run.run(config, RTL)
    assert outcome.difference is None, outcome.text()
    assert outcome.seconds >= 0.5
    assert outcome.rows == round(outcome.seconds * config.design.master_hz) + 1
    assert set(outcome.states) >= {"POWER_UP", "KICK"}


@pytest.mark.slow
def test_a_board_of_another_design_locks_around_the_rtl_and_takes_a_step():
    outcome = run.run(of_board("low_cost", 1.9), RTL)
    assert outcome.difference is None, outcome.text()
    assert outcome.locked
    assert "LOCKED" in outcome.states


@pytest.mark.slow
def test_a_slip_in_another_design_is_caught_at_its_tick_and_time(tmp_path):
    shutil.copytree(RTL, tmp_path / "rtl")
    path = tmp_path / "rtl" / "top.v"
    path.write_text(path.read_text().replace(".FRAME_TICKS(FRAME_TICKS)", ".FRAME_TICKS(125)"))
    outcome = run.run(of_board("fast_dacs", 0.002), tmp_path / "rtl", level=0)
    assert outcome.difference.text().startswith("tick 125, clock 0 (62.500 us): rates.frame: expected 125, got 0")


def example(rtl, ticks):
    """Exit code and output of the cocotb example around the design in a folder."""
    path = RTL / "example" / "test_closed_loop.py"
    given = {**os.environ, "RTL": str(rtl), "TICKS": str(ticks), "PYTHONPATH": os.pathsep.join(sys.path)}
    del given["PYTEST_CURRENT_TEST"]  # the runner of cocotb believes it is in pytest
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, env=given, timeout=600)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
@icarus
def test_the_example_closes_the_loop_from_cocotb():
    pytest.importorskip("cocotb")
    code, said = example(RTL, 4)
    assert code == 0, said
    assert "PASS 104 edges, 230 registers and pins at each" in said


@icarus
@pytest.mark.slow
def test_the_example_names_tick_and_clock_of_a_slip(tmp_path):
    pytest.importorskip("cocotb")
    shutil.copytree(RTL, tmp_path / "rtl")
    path = tmp_path / "rtl" / "rates.v"
    text = path.read_text()
    (right,) = re.findall(r"LAST_CYCLE = TICK_CLOCKS - 1", text)
    path.write_text(text.replace(right, "LAST_CYCLE = TICK_CLOCKS - 2"))
    code, said = example(tmp_path / "rtl", 4)
    assert code == 1
    assert re.search(
        r"FAIL tick 0, clock 25: r_rates_tick: expected 11001, got 00000 \(binary\); \d+ more differ", said
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "low_cost"])
def test_plant_by_edge_is_the_plant_of_the_loop(name):
    """Codes of 300 ticks, edge by edge with the model's own pins, against the clocked engine."""
    ticks, config = 300, of_board(name, 0.001)
    plant = Plant(config)
    model, codes = Model(plant), []
    for _ in range(ticks):
        for _ in range(config.design.tick_clocks):
            held, given = model.expected(), plant.inputs()
            model.edge(given)
            after = model.expected()
            plant.edge({name: after[f"o_{name}"] for name in Pins._fields})
            assert len(held) == 230
        codes.append((plant.chips.drive.code, plant.chips.sense.code))
    sim = Simulation(config, 25.0, 25.0, engine="clocked")
    sim.now = (np.zeros(1), np.full(1, 25.0))
    for register, raw in sim.first_writes:
        sim.write(register, raw)
    done = sim.tick
    streams = sim.advance(ticks - done, 0.0, 25.0)
    assert codes[done:] == list(zip(streams.drive_code.tolist(), streams.sense_code.tolist()))
    assert [int(v) for _, v in leaves(model.state)] == [int(v) for _, v in leaves(sim.state.fpga)]

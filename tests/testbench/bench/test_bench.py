"""What `make bench` times: each kernel runs here once and does what it says; it is timed only when asked for."""

import ast
import contextlib
import itertools
import json

import numba
import numpy as np
import pytest

from analog_frontend import linear
from analog_frontend.effects import catalogue
from fpga_model import sequencer
from testbench.bench import engine_stages, kernels, many, measure_speed, peers
from testbench.console import markdown, results
from tests.testbench.bench import ports_off

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
TICKS = 25_000


# ---- kernels ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def locked():
    return kernels.Bench(TICKS)


def test_clocked_engine(benchmark, locked):
    before = locked.sim.tick
    benchmark(locked.run_clocked)
    assert (locked.sim.tick - before) % TICKS == 0
    assert locked.sim.tick > before
    assert locked.sim.locked


def test_frame_engine(benchmark):
    sim = kernels.gyroscope("frame")
    assert sim.engine == "frame"
    before = sim.tick
    benchmark(kernels.advance, sim, TICKS)
    assert sim.tick > before
    assert sim.locked


def test_the_first_call_contains_the_frame_engine(monkeypatch):
    done = []
    monkeypatch.setattr(kernels, "gyroscope", lambda *_, **__: "gyroscope")
    monkeypatch.setattr(kernels, "advance", lambda *_: done.append("advance"))
    monkeypatch.setattr(kernels.warmup, "wait", lambda: done.append("wait"))
    kernels.first_call()
    assert done == ["advance", "wait", "advance"]


@pytest.mark.slow
def test_firmware_alone(benchmark, locked):
    before = locked.digital[0]
    benchmark(locked.firmware)
    after = locked.digital[0]
    assert after.control.sequencer.state == sequencer.LOCKED, "fixed codes near the set-points are no fault"
    assert after.control.sequencer.faults.flags == 0
    turned = (after.dds.phase - before.dds.phase) & kernels.PHASE_MASK
    assert turned, "the DDS runs"
    assert after.adc.channels != before.adc.channels or after.control != before.control, "frames arrive"


@pytest.mark.slow
def test_plant_alone(benchmark, locked):
    caps = locked.plant.caps.copy()
    benchmark(locked.plant_only)
    # drive codes that repeat are not a loop: the amplitude wanders, slowly
    assert 1e-6 < np.hypot(locked.plant.z[6], locked.plant.z[7]) < 1e-5
    assert np.all(np.any(locked.plant.caps != caps, axis=1)), "all four demodulators work"
    assert np.all(locked.plant.late_count == 0)


def test_references_of_the_plant_bench_toggle_twice_a_period(locked):
    """As many edges as the drive frequency says: the work of a tick is that of the real loop."""
    word, ticks = locked.word, 4000
    quadrants = [((tick * 26 * word) & kernels.PHASE_MASK) >> 46 for tick in range(ticks)]
    edges = 2 * sum(a != b for a, b in itertools.pairwise(quadrants))
    assert edges == pytest.approx(4 * 2 * word * 26e6 / 2**48 * ticks * 1e-6, abs=3)


@pytest.mark.slow
def test_a_process_answers_with_the_cpu_time_of_either_engine():
    with contextlib.closing(kernels.Served()) as served:
        frame, clocked = (served.cpu_s(name, 2_000) for name in ("frame", "clocked"))
        assert 0.0 < frame
        assert 1e-4 < clocked
    assert served.process.returncode == 0


@pytest.mark.slow
def test_the_source_without_compiler_answers_with_its_cpu_time():
    with contextlib.closing(kernels.Served(locked=False, NUMBA_DISABLE_JIT="1")) as interpreted:
        assert interpreted.cpu_s("clocked", 2) > 1e-5
    assert interpreted.process.returncode == 0


# ---- roof ------------------------------------------------------------------------------------------------------------


def test_multiplications_of_a_tick():
    """The sum of the docstring, and its part that linear.py lists."""
    assert measure_speed.pairs_per_tick() == pytest.approx(243.84)
    assert linear.FORCED_COUNT == 14
    table = [
        float(line.split()[-1]) for line in measure_speed.pairs_per_tick.__doc__.splitlines() if "  " in line.strip()
    ]
    assert sum(table) == pytest.approx(243.84)
    assert measure_speed.lane_pairs_per_tick() == pytest.approx(237.84)


# ---- tables ----------------------------------------------------------------------------------------------------------

RESULT = {
    "frame_rt": 30.0,
    "baseband_rt": 300.0,
    "baseband_codes_rt": 250.0,
    "lanes_rt_per_core": 60.0,
    "lanes_codes_rt": 50.0,
    "clocked_rt": 0.75,
    "verilator_closed_rt": None,
    "icarus_rt": 0.003,
    "python_rt": 0.001,
    "roof_single_rt": 120.0,
    "roof_lanes_rt": 122.7,
    "firmware_rt": 1.5,
    "plant_rt": 7.5,
    "peak_pairs_per_s": 55.9e9,
    "pairs_per_tick": 243.84,
    "spread": {
        "frame_rt": [29.0, 31.0],
        "baseband_rt": [290.0, 310.0],
        "baseband_codes_rt": [240.0, 260.0],
        "lanes_rt_per_core": [59.0, 61.0],
        "lanes_codes_rt": [49.0, 51.0],
        "clocked_rt": [0.4, 0.8],
        **{f"{name}_rt": [1.0, 2.0] for name in ("icarus", "python", "roof_single", "roof_lanes", "firmware", "plant")},
    },
    "missing": {"verilator_closed_rt": "verilator is not installed"},
    "first_call_cold_s": 25.04,
    "first_call_warm_s": 1.26,
    "growth": {"seconds": {"1": 0.03, "4": 0.0303}, "noise": {"none": 0.02, "all": 0.03}, "effects": {"none": 0.03}},
    "stages_ns": {**{name: 2.0 for _, name in engine_stages.STAGES}, "engine": 40.0},
    "cores": {"lanes engine, threads": {"1": 0.044, "2": 0.0225}, "frame engine, processes": {"1": 0.05, "2": 0.025}},
    "memory_bytes_per_lane": {"arrays": 321_000.0, "process": 5_250_000.0},
    "run_cpu_s": 0.1,
    "versions": {"python": "3.13.0", "numba": "0.68.1", "verilator": None},
    "cpu": "A processor",
}


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """Function: what the site shows of a measurement."""
    monkeypatch.setattr(results, "FOLDER", tmp_path)

    def written(result):
        results.write_results("speed", measure_speed.COMMAND, measure_speed.result_tables(result))
        return results.results_markdown("speed")

    return written


def test_the_tables_are_the_measurement(shown):
    part = shown(RESULT)
    assert "Measured on A processor; python 3.13.0, numba 0.68.1." in part
    assert "| frame_rt | 30 | 29 .. 31 | 0.0333 s | 1 | 0.025 |" in part
    assert "| baseband_codes_rt | 250 | 240 .. 260 | 0.004 s | 0.12 | 0.003 |" in part
    assert "| clocked_rt | 0.75 | 0.4 .. 0.8 | 1.33 s | 40 | 1 |" in part
    assert "| icarus_rt | 0.003 | 1 .. 2 | 333 s | 1e+04 | 250 |" in part
    assert "(verilator is not installed) | verilator_closed_rt | - | - | - | - | - |" in part
    assert "| firmware_rt | 1.5 | 1 .. 2 | 0.667 s | | |" in part
    assert "| first_call_cold_s | | | 25.0 s | | |" in part
    assert "| 8 kHz window | 2.0 ns | 5 % |" in part
    assert "Roof: 244 multiplications with an addition each per tick, and 55.9e9 such pairs" in part
    assert "| seconds | 4 | 30.3 ms | 1.01 |" in part
    assert "| noise | all | 30 ms | 1.50 |" in part
    assert "| lanes engine, threads | 2 | 22.5 ms | 1.96 |" in part
    assert "| frame engine, processes | 2 | 25 ms | 2.00 |" in part
    assert "takes 321 kB in the arrays of its group, and 5.2 MB of the process" in part
    assert "takes 0.100 s of CPU." in part
    assert "not measured" in shown(RESULT | {"peak_pairs_per_s": None})


def test_a_measurement_is_written_whole(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(measure_speed, "ROOT", tmp_path)
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    monkeypatch.setattr(measure_speed, "measure", lambda: RESULT)
    assert measure_speed.main() == 0
    assert json.loads((tmp_path / "build" / "bench.json").read_text()) == RESULT
    assert "0.75" in results.results_markdown("speed")
    assert "Speed, one core" in capsys.readouterr().out


def test_all_take_turns():
    times, order = iter([1e-3, 2e-3, 1e-3, 2e-3, 9.0, 9.0]), []

    def work(name):
        order.append(name)
        return next(times)

    spent = measure_speed.rounds({"a": lambda: work("a"), "b": lambda: work("b")}, 3)
    assert spent == {"a": [1e-3, 1e-3, 9.0], "b": [2e-3, 2e-3, 9.0]}
    assert order == ["a", "b"] * 3


def test_a_measurement_is_the_median_and_closes_its_processes(tmp_path, monkeypatch):
    """Three processes that take 1, 2 and 9 s for the same work; no comparator, no compiler."""
    closed = []

    class Fake:
        ticks = 1_000_000

        def __init__(self, locked=True, **environment):
            self.locked = locked
            self.spent = 4.0 if not locked else next(spent)

        def cpu_s(self, engine_name, ticks):
            return self.spent

        def close(self):
            closed.append(self)

        def firmware(self):
            pass

        plant_only = firmware
        advance = None

    # the first three are taken by the bench itself and by the lanes, with codes and without
    spent = itertools.chain([0.0, 0.0, 0.0], iter([1.0, 2.0, 9.0]))
    absent = peers.Missing("no compiler")
    monkeypatch.setattr(kernels, "Served", Fake)
    monkeypatch.setattr(kernels, "Bench", Fake)
    monkeypatch.setattr(kernels, "SideBySide", Fake)
    monkeypatch.setattr(kernels, "gyroscope", lambda name, codes=True: None)
    monkeypatch.setattr(kernels, "cpu_s", lambda work, *ticks: 0.5)
    missing = dict.fromkeys(measure_speed.PEER_KEYS.values(), str(absent))
    monkeypatch.setattr(measure_speed, "comparators", lambda sim, folder: ({}, dict(missing)))
    monkeypatch.setattr(peers, "build_peak", lambda folder: (_ for _ in ()).throw(absent))
    result = measure_speed.speeds(tmp_path, repeats=3, processes=3)
    assert result["frame_rt"] == measure_speed.FRAME_TICKS_TIMED / 1e6 / 2.0
    assert result["clocked_rt"] == 0.5
    assert result["spread"]["clocked_rt"] == pytest.approx([1 / 9, 1.0])
    assert result["firmware_rt"] == result["plant_rt"] == 2.0
    assert (
        result["lanes_rt_per_core"]
        == result["lanes_codes_rt"]
        == measure_speed.LANES * measure_speed.LANES_TICKS / 1e6 / 0.5
    )
    assert result["python_rt"] == measure_speed.PYTHON_TICKS / 1e6 / 4.0
    assert result["baseband_rt"] == result["baseband_codes_rt"] == measure_speed.BASEBAND_TICKS_TIMED / 1e6 / 0.5
    assert (
        result["roof_single_rt"] is result["roof_lanes_rt"] is result["icarus_rt"] is result["peak_pairs_per_s"] is None
    )
    assert result["missing"] == missing | dict.fromkeys(measure_speed.ROOFS, "no compiler")
    assert len(closed) == 4


def test_a_missing_tool_leaves_a_null_and_its_reason(tmp_path, monkeypatch):
    def absent(folder):
        raise peers.Missing("no compiler")

    monkeypatch.setattr(measure_speed.peers, "BUILDERS", dict.fromkeys(peers.BUILDERS, absent))
    works, missing = measure_speed.comparators(kernels.gyroscope("frame"), tmp_path)
    assert works == {}
    assert missing == dict.fromkeys(measure_speed.PEER_KEYS.values(), "no compiler")


@pytest.mark.slow
def test_every_stage_takes_time():
    """Rough on purpose: stages are timed in a few frames here, so only a stage that does nothing would be seen."""
    result = engine_stages.measure(repeats=1, frames=40)
    assert set(result) == {"engine", *(name for _, name in engine_stages.STAGES)}
    assert all(value > 0.05 for value in result.values())


def test_growth_covers_every_source_and_effect():
    from testbench import config

    assert set(measure_speed.SOURCES) == set(config.Noise.model_fields) - {"seed"}
    laws = {effect.INFO.name for effect in catalogue.LAWS}
    assert set(measure_speed.EFFECTS) == set(config.Effects.model_fields) - laws


def test_the_documented_numbers_come_from_a_measurement():
    """docs/results/speed.json holds a table with every key, written by the command that it names."""
    page = results.results_markdown("speed")
    assert f"Measured with `{measure_speed.COMMAND}`" in page
    for key, _ in (*measure_speed.SPEEDS, *measure_speed.FIRST_CALLS):
        assert f"| {key} |" in page
    assert f"{measure_speed.pairs_per_tick():.0f} multiplications" in page
    page = (markdown.ROOT / "docs" / "speed.md").read_text()
    long, short = measure_speed.PEER_TICKS["verilator"] / 1e6, measure_speed.PEER_TICKS["icarus"] / 1e3
    assert f"over {long:g} s (Icarus: {short:g} ms)" in page


# ---- many gyroscopes -------------------------------------------------------------------------------------------------


def test_cores_are_timed_by_the_clock_on_the_wall(monkeypatch):
    """A call that takes as long on two cores as on one serves twice the gyroscopes: half the time for each."""

    class Fake:
        def __init__(self, *arguments):
            pass

        def advance(self, ticks):
            clock.append(clock[-1] + 0.8)

        def ask(self, engine_name, ticks):
            asked.append(engine_name)

        def answer(self):
            clock.append(clock[-1] + (0.1 if len(asked) == 1 else 0.05))
            asked.pop()

        def close(self):
            pass

    clock, asked = [0.0], []
    monkeypatch.setattr(kernels, "SideBySide", Fake)
    monkeypatch.setattr(kernels, "Served", Fake)
    monkeypatch.setattr(many, "core_counts", lambda: [1, 2])
    monkeypatch.setattr(many.time, "perf_counter", lambda: clock[-1])
    found = many.cores(repeats=3, ticks=1_000_000)
    assert found[many.THREADS] == {"1": pytest.approx(0.1), "2": pytest.approx(0.05)}
    assert found[many.PROCESSES] == {"1": pytest.approx(0.1), "2": pytest.approx(0.075)}


@pytest.mark.parametrize(("cores", "counts"), [(1, [1]), (2, [1, 2]), (6, [1, 2, 4, 6]), (None, [1])])
def test_numbers_of_cores(monkeypatch, cores, counts):
    monkeypatch.setattr(many.os, "cpu_count", lambda: cores)
    assert many.core_counts() == counts


def test_groups_in_threads_take_the_work_of_both_cores():
    side = kernels.SideBySide(4, 2)
    assert [len(group) for group in side.lanes.groups] == [2, 2]
    before = side.sims[0].tick
    side.advance(2000)
    assert {sim.tick for sim in side.sims} == {before + 2000}


@pytest.mark.slow
def test_a_whole_run_is_timed():
    assert many.run(repeats=1, seconds=0.01) > 0.01


@pytest.mark.slow
def test_memory_of_a_gyroscope_in_lanes():
    found = many.memory((1, 3), 200_000)
    assert 1e4 < found["arrays"] < 1e6
    assert found["arrays"] < found["process"] < 1e8


def test_a_process_that_fails_is_no_measurement():
    assert kernels.output("print(1); print(2)") == "2"
    with pytest.raises(RuntimeError, match="a process of the benchmark failed, exit code 3"):
        kernels.output("import sys; sys.exit(3)")


def test_every_test_of_a_port_can_be_cut_out(tmp_path):
    """What is counted against is the plant of today: a test that has moved would make the cut a whole one."""
    whole, cut = (ports_off.copied(tmp_path / name, name == "cut") for name in ("whole", "cut"))
    for name in {name for name, _, _ in ports_off.CUTS}:
        assert (whole / name).read_bytes() == (ports_off.ROOT / name).read_bytes()
        ast.parse((cut / name).read_text())
    changed = sum(
        a != b
        for name in {name for name, _, _ in ports_off.CUTS}
        for a, b in zip((whole / name).read_text().splitlines(), (cut / name).read_text().splitlines(), strict=True)
    )
    assert changed == len(ports_off.CUTS)


def test_a_test_of_a_port_that_is_not_there_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(ports_off, "CUTS", (("analog_frontend/top.py", "if nothing:", "if False:"),))
    with pytest.raises(ValueError, match="stands there 0 times, not once"):
        ports_off.copied(tmp_path, True)

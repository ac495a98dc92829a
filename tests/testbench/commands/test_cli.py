"""Command line: quick help, one line per mistake, one JSON object, tables that show budget and paper."""

import json
import math
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from testbench.commands import main as cli
from testbench.console import progress as progress_bar
from testbench.run.budget import PAPER_DEG, Budget, Row
from testbench.run.outputs import Result
from testbench.storage.record import Column, Record
from testbench.storage.record_read import read_record
from testbench.storage.state_file import load_state
from testbench.storage.vcd import Signal
from testbench.version import VERSION

ROOT = Path(__file__).resolve().parents[3]
HEAVY = ("numpy", "numba", "scipy", "matplotlib", "h5py", "mpmath")


def gyro(capsys, *argv):
    """(exit code, standard output, standard error) of a command line in this process."""
    with pytest.raises(SystemExit) as caught:
        cli.main(list(argv))
    said = capsys.readouterr()
    return caught.value.code, said.out, said.err


SUMMARY = {
    "locked": True,
    "lock_time_s": 1.112,
    "drive_frequency_hz": 11002.2976,
    "amplitude_m": 5.0001e-6,
    "phase_deg": {"xe1": 3.7612, "xe2": 1.25, "ye1": 9.23, "ye2": 1.56},
    "paper_deg": dict(PAPER_DEG),
    "budget_deg": {"xe1": 3.7611, "xe2": 1.2501, "ye1": 9.2299, "ye2": 1.56},
    "loop_phase_deg": {"xe2": 0.93, "ye2": 1.24},
    "rate_lsb_per_dps": 8651.2,
    "quadrature_v": math.nan,
    "real_time_factor": 1.3,
    "codes_sha256": "ab" * 32,
}


def fake_budget(config, temp_degc=None):
    extra = Row(
        "extra frame", 1e-6 * config.firmware.frame_latency_sense, 3.96 * config.firmware.frame_latency_sense, "a guess"
    )
    rows = [Row("pipeline", 1e-7, 0.4), extra]
    loop = [Row("switch", -80e-9, -0.32)]
    return Budget(11002.3, dict.fromkeys(PAPER_DEG, rows), {"xe2": loop, "ye2": loop}, dict(PAPER_DEG), "")


@pytest.fixture
def fakes(monkeypatch):
    """A simulation that takes no time; `calls` keeps the configurations it was given."""
    calls = []

    def run(config, progress=None, directory=None, resume=False):
        calls.append(config)
        progress("run", 1, 2)
        time_s = np.arange(100) / 8000
        record = Record({"adc_yI": Column(np.arange(100, dtype=np.int32), "code", 1, 3250)}, config_toml="# text")
        window = (
            (np.zeros((5, 1), np.int64), [Signal("pins.a", 1)], 0, 26_000_000) if config.output.vcd_length_us else None
        )
        plots = {"rate_step": {"time_s": time_s, "rate_dps": time_s, "stimulus_dps": time_s}}
        return Result(SUMMARY, ("ye2 is unexplained by 0.004 deg",), record, plots, window, ({"a": 1}, "layout", {}))

    module = types.ModuleType("testbench.run.simulate")
    module.run = run
    monkeypatch.setitem(sys.modules, "testbench.run.simulate", module)
    monkeypatch.setattr("testbench.run.simulate", module, raising=False)
    monkeypatch.setattr("testbench.run.budget.budget", fake_budget)
    return calls


# ---- help ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "seen"),
    [
        ({}, ["1", "1", None]),
        ({"OPENBLAS_NUM_THREADS": "2"}, ["2", None, None]),
        ({"OMP_NUM_THREADS": "2"}, [None, None, "2"]),
    ],
)
def test_blas_has_one_thread_unless_the_user_says_otherwise(given, seen):
    """Of a process of the command, and of those that it starts; not of the package as a library."""
    names = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"
    code = f"""
import json, os, sys
import testbench
before = [os.environ.get(name) for name in {names}]
import testbench.commands
assert "numpy" not in sys.modules
import numpy
threads = len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 0
print(json.dumps([before, [os.environ.get(name) for name in {names}], threads]))
"""
    env = {k: v for k, v in os.environ.items() if k not in names} | {"PYTHONPATH": str(ROOT)} | given
    said = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout
    before, after, threads = json.loads(said)
    assert before == [given.get(name) for name in names]
    assert after == seen
    assert given or threads <= 1


def test_help_imports_nothing_heavy():
    script = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from testbench.commands import main as cli
try:
    cli.main(["run", "--help"])
except SystemExit as end:
    assert end.code == 0
print("HEAVY", sorted(set({HEAVY}) & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "HEAVY []" in done.stdout
    for option in ("--config", "--set", "--seconds", "--rate-dps", "--temperature-degc", "--seed", "--engine", "--out"):
        assert option in done.stdout
    for option in ("--no-noise", "--resume", "--vcd", "--json"):
        assert option in done.stdout


def test_the_budget_loads_no_compiler():
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "testbench.commands.main", "budget"],
        capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    assert "testbench.run.budget" in done.stderr
    assert "numba" not in done.stderr


def test_the_version(capsys):
    assert gyro(capsys, "--version") == (0, f"gyro {VERSION}\n", "")


# ---- mistakes --------------------------------------------------------------------------------------------------------

MISTAKES = [
    (["run", "--seconds", "fast"], "--seconds"),
    (["run", "--wobble"], "--wobble"),
    (["run", "extra"], "extra"),
    (["walk"], "walk"),
    (["run", "--config", "none.toml"], "none.toml: cannot be read: No such file or directory"),
    (["run", "--set", "plant.fx_hz"], "--set: 'plant.fx_hz' is not of the form"),
    (
        ["run", "--set", "plant.fx_khz=11"],
        "--set: plant.fx_khz is not a known key; this quantity is in Hz: plant.fx_hz = 11000",
    ),
    (["budget", "--set", "plant.qx=-1"], "--set: plant.qx = -1 is below the limit 100"),
    (["run", "--rate-dps", "5000"], "--rate-dps: scenario.rate_dps = 5000 is above the limit 1000 deg/s"),
    (["run", "--rate-dps", "nan"], "--rate-dps: scenario.rate_dps = nan: the value is not finite"),
    (["run", "--seconds", "0"], "--seconds: scenario.seconds = 0.0 is below the limit 0.001 s"),
    (["run", "--seed", "-1"], "--seed: noise.seed = -1 is below the limit 0"),
    (["run", "--engine", "warp"], '--engine: scenario.engine = "warp" is none of "frame" | "clocked"'),
    (["run", "--vcd", "3"], "--vcd: '3' is not of the form START_US:LENGTH_US"),
    (["run", "--vcd", "0:1e9"], "--vcd: output.vcd_length_us = 1000000000.0 is above the limit 10000 us"),
    (
        ["run", "--set", "output.columns=['rate_wrod']"],
        '--set: output.columns[0] = "rate_wrod" is not a column of the record; did you mean rate_word?',
    ),
    (["run", "--set", "output.columns=rate_word"], '--set: output.columns = "rate_word" is not a list of names'),
    (["run", "--set", "output.decimate=8001"], "--set: output.decimate = 8001 is above the limit 8000 frames"),
    (["run", "--resume-run", "none"], "none: holds no interrupted run with a checkpoint; start the run again"),
    (["run", "--set", "noise.seed=1\nb=2"], r"--set: 'noise.seed=1\nb=2' has '\n' in its value"),
    (["run", "--set", "output.directory=a\0b"], r"--set: 'output.directory=a\x00b' contains a NUL character"),
    (["run", "--set", "output.directory="], '--set: output.directory = "" is not the name of a folder'),
    (["run", "--out", ""], "--out: is empty"),
    (["measured", "record", "plan.toml", "--out="], "--out: is empty"),
    (["golden", "verify", ""], "argument 3: is empty"),
    (["golden", "verify", "a\0b"], r"argument 3: 'a\x00b' contains a NUL character"),
    (["budget", "--temperature-degc", "300"], "--temperature-degc: scenario.temperature_degc = 300 is above"),
]


@pytest.mark.parametrize(("argv", "words"), MISTAKES, ids=[" ".join(argv) for argv, _ in MISTAKES])
def test_a_mistake_is_one_line_and_exit_code_2(capsys, tmp_path, monkeypatch, fakes, argv, words):
    monkeypatch.chdir(tmp_path)
    code, out, err = gyro(capsys, *argv)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith("gyro: ")
    assert words in err
    assert os.listdir(tmp_path) == []
    assert fakes == []


def test_an_unwritable_folder_is_found_before_the_run(capsys, tmp_path, fakes):
    (tmp_path / "file").write_text("")
    code, out, err = gyro(capsys, "run", "--out", str(tmp_path / "file"))
    assert (code, out, fakes) == (2, "", [])
    assert err == f"gyro: {tmp_path / 'file'}: cannot be written: File exists\n"


def test_a_file_that_cannot_be_written_at_the_end_is_one_line(capsys, tmp_path, fakes):
    (tmp_path / "run.h5").mkdir()
    code, out, err = gyro(capsys, "run", "--out", str(tmp_path), "--json")
    assert (code, out) == (2, "")
    assert err == f"gyro: {tmp_path / 'run.h5'}: cannot be written: Is a directory\n"


def test_a_mistake_shows_no_traceback_from_a_shell(tmp_path):
    command = [sys.executable, "-m", "testbench.commands.main", "run", "--set", "firmware.pipeline_registers=12"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "gyro: --set: firmware.pipeline_registers = 12 is above the limit 8 registers\n"


def test_an_interrupt_is_one_line(capsys, tmp_path, fakes, monkeypatch):
    def interrupted(config, **_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["testbench.run.simulate"], "run", interrupted)
    assert gyro(capsys, "run", "--out", str(tmp_path)) == (130, "", "gyro: interrupted\n")


@pytest.mark.parametrize(
    ("size", "words"), [("", ""), ("Unable to allocate 179. MiB", ": Unable to allocate 179. MiB")]
)
def test_a_lack_of_memory_is_one_line(capsys, tmp_path, fakes, monkeypatch, size, words):
    def greedy(*_, **__):
        raise MemoryError(size)

    monkeypatch.setattr(sys.modules["testbench.run.simulate"], "run", greedy)
    monkeypatch.setattr("testbench.run.budget.budget", greedy)
    for argv in (["run", "--out", str(tmp_path / "out")], ["budget"]):
        want = f"gyro: out of memory{words}; end other programs, or raise the limit (ulimit -v)\n"
        assert gyro(capsys, *argv) == (2, "", want)
    assert os.listdir(tmp_path / "out") == []


@pytest.mark.parametrize("threads", ["0", "-2", " 00 "])
def test_a_count_of_threads_that_numba_refuses_is_one_line(capsys, monkeypatch, threads):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    code, out, err = gyro(capsys, "budget")
    assert (code, out) == (2, "")
    assert err == f"gyro: NUMBA_NUM_THREADS = {threads.strip()} is below the limit 1 thread\n"


def test_a_bug_keeps_its_traceback(capsys, tmp_path, fakes, monkeypatch):
    def broken(config, **_):
        raise ZeroDivisionError

    monkeypatch.setattr(sys.modules["testbench.run.simulate"], "run", broken)
    with pytest.raises(ZeroDivisionError):
        cli.main(["run", "--out", str(tmp_path)])


# ---- progress --------------------------------------------------------------------------------------------------------


@pytest.fixture
def bar(monkeypatch):
    """(progress, its task, a clock to turn): as on a terminal, from the first call on."""
    clock = types.SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress_bar, "SHOW_PROGRESS_AFTER_S", 0.0)
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: clock.now)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with cli.Progress() as progress:
        progress("compiling", 0, 1)
        progress._bar.get_time = lambda: clock.now
        yield progress, lambda: progress._bar.tasks[0], clock


def test_time_left_follows_from_the_work_that_was_seen(bar):
    """A run that is continued in its middle: 500 of 1000 are done when it starts, then 10 a second."""
    progress, task, clock = bar
    progress("scenario", 500, 1000)
    assert (task().completed, task().speed) == (500, None)
    for done in range(510, 601, 10):
        clock.now += 1.0
        progress("scenario", done, 1000)
    assert task().time_remaining == pytest.approx(400 / 10, rel=0.2)


def test_many_reports_cost_little(bar, monkeypatch):
    progress, task, clock = bar
    drawn = []
    plain = progress._bar.update
    monkeypatch.setattr(progress._bar, "update", lambda *a, **k: (drawn.append(k), plain(*a, **k)))
    for done in range(1001):
        clock.now += 0.001
        progress("scenario", done, 1000)
    assert len(drawn) <= 12
    assert task().completed == 1000


# ---- run -------------------------------------------------------------------------------------------------------------


def test_json_is_one_object_with_the_promised_keys(capsys, tmp_path, fakes):
    code, out, err = gyro(
        capsys, "run", "--seconds", "2", "--rate-dps", "100", "--seed", "1", "--json", "--out", str(tmp_path)
    )
    assert (code, err) == (0, "")
    assert out.count("\n") == 1
    data = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert {*SUMMARY, "files"} == set(data)
    assert data["quadrature_v"] is None
    assert data["phase_deg"] == SUMMARY["phase_deg"]
    assert (fakes[0].scenario.seconds, fakes[0].scenario.rate_dps, fakes[0].noise.seed) == (2.0, 100.0, 1)
    assert sorted(Path(name).name for name in data["files"]) == ["rate_step.png", "run.h5", "run.html", "state.h5"]
    assert sorted(os.listdir(tmp_path)) == ["rate_step.png", "run.h5", "run.html", "state.h5"]
    assert read_record(tmp_path / "run.h5").streams["adc_yI"].data.tolist() == list(range(100))
    assert load_state(tmp_path / "state.h5", "layout") == ({"a": 1}, {})


def test_the_options_reach_the_configuration(capsys, tmp_path, fakes):
    path = tmp_path / "config.toml"
    path.write_text("[firmware]\npipeline_registers = 1\n[noise]\nseed = 5\n[scenario]\nrate_dps = [[0, 1], [1, 2]]\n")
    argv = ["run", "--config", str(path), "--set", "plant.fx_hz=11010", "--set", "firmware.pipeline_registers=2"]
    argv += ["--temperature-degc", "-20", "--no-noise", "--engine", "clocked", "--resume", "s.h5", "--vcd", "5:0.2"]
    code, _, err = gyro(capsys, *argv, "--out", str(tmp_path / "new" / "folder"))
    assert (code, err) == (0, "")
    config = fakes[0]
    assert (config.firmware.pipeline_registers, config.plant.fx_hz, config.noise.seed) == (2, 11010.0, 5)
    assert config.scenario.rate_dps == [[0, 1], [1, 2]]
    assert config.scenario.temperature_degc == -20.0
    assert not any(value for key, value in config.noise.model_dump().items() if key != "seed")
    assert (config.scenario.resume, config.scenario.engine) == ("s.h5", "clocked")
    assert (config.output.vcd_start_us, config.output.vcd_length_us) == (5.0, 0.2)
    assert {"run.vcd", "run.gtkw", "run.sucl"} <= set(os.listdir(tmp_path / "new" / "folder"))


def test_outputs_can_be_switched_off(capsys, tmp_path, fakes):
    off = [part for key in ("record", "pictures", "html", "state") for part in ("--set", f"output.{key}=false")]
    code, out, _ = gyro(capsys, "run", "--json", "--out", str(tmp_path), *off)
    assert code == 0
    assert json.loads(out)["files"] == []
    assert os.listdir(tmp_path) == []


def test_a_person_sees_measured_budget_and_paper(capsys, tmp_path, fakes):
    code, out, err = gyro(capsys, "run", "--out", str(tmp_path))
    assert (code, err) == (0, "")
    for node, paper in (("xe1", "3.7647"), ("xe2", "1.2459"), ("ye1", "8.8814"), ("ye2", "1.5560")):
        line = next(line for line in out.splitlines() if line.strip().startswith(node))
        assert f"{SUMMARY['phase_deg'][node]:.4f}" in line
        assert f"{SUMMARY['budget_deg'][node]:.4f}" in line
        assert paper in line
    assert re.search(r"scale factor +8651\.20 +LSB/\(deg/s\)", out)
    assert re.search(r"quadrature voltage V_q +nan +V", out)
    assert "ye2 is unexplained by 0.004 deg" in out
    assert str(tmp_path / "run.h5") in out.replace("\n", "")
    html = (tmp_path / "run.html").read_text()
    assert "8.8814" in html
    assert "extra frame" in html


# ---- budget ----------------------------------------------------------------------------------------------------------


def test_the_budget_as_json(capsys, fakes):
    code, out, err = gyro(capsys, "budget", "--json")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data["phase_deg"] == dict.fromkeys(("xe1", "xe2", "ye1", "ye2"), pytest.approx(4.36))
    assert data["loop_phase_deg"] == {"xe2": pytest.approx(4.04), "ye2": pytest.approx(4.04)}
    assert data["without_assumptions_deg"]["ye1"] == pytest.approx(0.4)
    assert data["paper_deg"] == {"xe1": 3.7647, "xe2": 1.2459, "ye1": 8.8814, "ye2": 1.556}
    row = data["rows"]["xe1"][1]
    assert row == {"what": "extra frame", "clocks": 26.0, "ns": 1000.0, "deg": 3.96, "assumed": "a guess"}
    for node, rows in data["rows"].items():
        assert sum(row["deg"] for row in rows) == pytest.approx(data["phase_deg"][node])


def test_the_budget_for_a_person(capsys, fakes):
    code, out, err = gyro(capsys, "budget")
    assert (code, err) == (0, "")
    assert re.search(r"pipeline +2\.60 +100\.00 +0\.4000", out)
    assert re.search(r"extra frame +26\.00 +1000\.00 +3\.9600 +a guess", out)
    assert re.search(r"node phase xe2 +28\.60 +1100\.00 +4\.3600", out)
    assert re.search(r"loop phase xe2' +26\.52 +1020\.00 +4\.0400", out)
    assert re.search(r"without re-timed references and extra frames +0\.4000", out)
    assert re.search(r"the paper measured \(node phase\) +3\.7647 +contradicted", out)


def test_the_real_budget_adds_up_and_names_its_assumptions(capsys):
    code, out, err = gyro(capsys, "budget", "--json")
    assert (code, err) == (0, "")
    data = json.loads(out)
    for node, rows in data["rows"].items():
        assert sum(row["deg"] for row in rows) == pytest.approx(data["phase_deg"][node], abs=1e-9)
        for row in rows:
            assert row["clocks"] == pytest.approx(row["ns"] * 0.026, abs=1e-9)
    for node, rows in data["loop_rows"].items():
        total = data["phase_deg"][node] + sum(row["deg"] for row in rows)
        assert total == pytest.approx(data["loop_phase_deg"][node], abs=1e-9)
    frame_deg = 360 * data["frequency_hz"] * 1e-6
    grid_deg = frame_deg * 13.5 / 26
    without = data["without_assumptions_deg"]
    assert without["xe1"] - data["phase_deg"]["xe1"] == pytest.approx(grid_deg, abs=1e-6)
    assert without["ye1"] - data["phase_deg"]["ye1"] == pytest.approx(grid_deg - frame_deg, abs=1e-6)
    assert (without["xe2"], without["ye2"]) == (data["phase_deg"]["xe2"], data["phase_deg"]["ye2"])

"""Runs that are killed in the middle of anything continue to the same files; memory does not grow with time."""

import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numba
import numpy as np
import pytest

from testbench import config
from testbench.commands import main as cli
from testbench.errors import ConfigError, FileError
from testbench.run import nodes, outputs, simulate
from testbench.storage import checkpoint, files, identity, record_read, spool, state_file
from tests.testbench.bench_setup import configured
from tests.testbench.command import gyro

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}

# Runs the command line and kills itself at the n-th time that something is about to be complete.
KILLED = """
import os, signal, sys
from testbench.commands import main as cli
from testbench.run import outputs
from testbench.storage import files, record, spool, state_file

where, left = sys.argv[1], int(sys.argv[2])

def strike(before=None):
    global left
    left -= 1
    if left == 0:
        if before:
            before()
        os.kill(os.getpid(), signal.SIGKILL)

def wrap(owner, name, matches=lambda *_: True, half=None):
    plain = getattr(owner, name)
    def wrapped(*args):
        if matches(*args):
            strike(half and (lambda: half(plain, *args)))
        return plain(*args)
    setattr(owner, name, wrapped)

if where == "rows":
    def half(plain, made, rows):
        data = rows.tobytes()
        with open(made.path, "ab") as file:
            file.write(data[: len(data) // 2 - 3])
    wrap(spool.Spool, "_write", half=half)
elif where == "checkpoint written":
    wrap(files, "publish", lambda path: path.name == "checkpoint.h5")
elif where == "checkpoint begun":
    wrap(state_file, "seal", lambda path: path.name == "checkpoint.h5.part")
elif where == "record":
    wrap(record.RecordWriter, "_finish")
elif where == "report":
    wrap(outputs, "_pictures")
cli.main(sys.argv[3:])
"""


def numbers_drawn(result, folder):
    """Instead of pictures, which take longer than the runs, files with what they would show."""
    paths = [(name, folder / f"{name}.png") for name in result.plots]
    for name, path in paths:
        path.write_bytes(pickle.dumps(result.plots[name]))
    return paths


@pytest.fixture(scope="module", autouse=True)
def undrawn():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outputs, "_pictures", numbers_drawn)
        yield


@pytest.fixture(scope="module")
def locked(tmp_path_factory):
    """(state file, tick) of a gyroscope that has just locked."""
    checked = configured()
    sim = simulate.Simulation(checked, 25.0, 25.0)
    assert simulate.start(checked, sim, 0.1, 25.0) is not None
    path = tmp_path_factory.mktemp("locked") / "state.h5"
    state_file.save_state(path, *sim.dump())
    return path, sim.tick


def command(locked, *more):
    """A run with a fault, a write and a profile across its checkpoints, and a window that ends before the first one."""
    state, tick = locked
    settings = (
        "output.checkpoint_s=0.1",
        "output.decimate=7",
        "scenario.rate_dps=[[0, 0], [0.5, 90]]",
        'scenario.register_writes=[[0.25, "phase_drive_sine", 29300000000]]',
        'scenario.faults=[[0.17, "dac_stuck", "quadrature", 30000, 0.2], [0.31, "adc_stuck", "sense_cos", 5, 0.001]]',
    )
    sets = [part for text in settings for part in ("--set", text)]
    return ["run", "--resume", str(state), "--seconds", "0.5", "--vcd", f"{tick + 30_000}:12", *sets, *more]


def short(locked, *more):
    """A run of 10 ms."""
    return ["run", "--resume", str(locked[0]), "--seconds", "0.01", "--set", "scenario.diagnose=false", *more]


def done(folder, argv, *prefix):
    """The finished process of a command line in `folder`."""
    start = [sys.executable, *(prefix or ("-m", "testbench.commands.main"))]
    return subprocess.run([*start, *argv], cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)


def run_here(folder, argv):
    """Standard output of a command line that succeeds in this process, whose engine is loaded."""
    got = gyro(*argv, folder=folder)
    assert got.returncode == 0, got.stderr
    return got.stdout


def killed(folder, where, nth, argv):
    got = done(folder, argv, "-c", KILLED, where, str(nth))
    assert got.returncode == -signal.SIGKILL, (where, got.stderr)


def numbers(text):
    """The object of --json without what a clock on the wall decides."""
    return {key: v for key, v in json.loads(text).items() if key not in ("wall_s", "real_time_factor")}


def plain(path):
    """Bytes of a file; of a record without its identity, its date and the seal over them."""
    data = path.read_bytes()
    if path.name == "run.h5":
        with h5py.File(path, "r") as file:
            data = data[: -files.SEAL_BYTES].replace(file.attrs["record_id"].encode(), b"")
            data = data.replace(file.attrs["created_utc"].encode(), b"")
    return data


@pytest.fixture(scope="module")
def uncut(locked, tmp_path_factory):
    folder = tmp_path_factory.mktemp("uncut")
    return numbers(run_here(folder, command(locked, "--out", "out", "--json"))), folder / "out"


@pytest.fixture(scope="module")
def interrupted(locked, tmp_path_factory):
    """The folder of a run that was killed in the middle of a write of rows."""
    folder = tmp_path_factory.mktemp("interrupted")
    killed(folder, "rows", 3, command(locked, "--out", "out"))
    return folder / "out"


TURNS = [("checkpoint begun", 1), ("checkpoint written", 2), ("rows", 1), ("record", 1), ("report", 1)]


@pytest.mark.parametrize(
    "turns", [pytest.param([], id="once"), pytest.param(TURNS, id="at every turn", marks=pytest.mark.slow)]
)
def test_a_killed_run_ends_in_the_same_bytes(interrupted, uncut, tmp_path, turns):
    """Killed in the middle of a write of rows, then where `turns` say, each time in what continued it."""
    shutil.copytree(interrupted, tmp_path / "out")
    again = ["run", "--resume-run", "out", "--json"]
    for where, nth in turns:
        killed(tmp_path, where, nth, again)
        assert (tmp_path / "out" / checkpoint.FOLDER / "checkpoint.h5").exists()
    want, folder = uncut
    assert numbers(run_here(tmp_path, again)) == want
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(path.name for path in (tmp_path / "out").iterdir())
    assert {"run.h5", "state.h5", "run.vcd", "startup.png", "rate_step.png"} <= set(names)
    for name in set(names) - {"run.html"}:
        assert plain(tmp_path / "out" / name) == plain(folder / name), name


@pytest.mark.parametrize(("owner", "name", "nth"), [(spool.Spool, "_write", 3), (nodes, "read", 1)])
def test_a_run_out_of_memory_says_how_to_continue(locked, uncut, tmp_path, monkeypatch, owner, name, nth):
    """In the middle of a write of rows, and in the diagnosis: one line, and the run continues to the same codes."""
    plain, calls = getattr(owner, name), []

    def wanting(*given):
        calls.append(given)
        if len(calls) == nth:
            raise MemoryError("Unable to allocate 179. MiB")
        return plain(*given)

    monkeypatch.setattr(owner, name, wanting)
    got = gyro(*command(locked, "--out", "out", "--json"), folder=tmp_path)
    lack = "gyro: out of memory: Unable to allocate 179. MiB; to continue: gyro run --resume-run out\n"
    assert got == (2, "", lack)
    assert numbers(run_here(tmp_path, ["run", "--resume-run", "out", "--json"])) == uncut[0]


def test_the_record_of_a_continued_run_is_whole(uncut):
    have = record_read.read_record(uncut[1] / "run.h5")
    assert have.tables["segments"]["name"].data.tolist() == ["scenario", "diagnosis"]
    scenario, diagnosis = have.tables["segments"]["edge"].data.tolist()
    assert (diagnosis - scenario) / 26 == 500_000
    first = have.streams["rate_word_sum"]
    assert 0 <= first.edge0 - scenario < 3250, "a run that starts from a state file starts late"
    assert (first.den, first.attrs["frames"]) == (7 * 3250, 7)


@pytest.mark.slow
def test_a_killed_run_without_checkpoint_has_nothing_to_continue(locked, tmp_path, capsys, monkeypatch):
    killed(tmp_path, "rows", 1, command(locked, "--set", "output.checkpoint_s=0", "--out", "out"))
    monkeypatch.chdir(tmp_path)
    said = refused(capsys, "run", "--resume-run", "out")
    assert said == "gyro: out: holds no interrupted run with a checkpoint; start the run again\n"


def test_an_interrupt_says_how_to_continue(locked, tmp_path):
    argv = command(locked, "--seconds", "3000", "--out", "out")
    process = subprocess.Popen(
        [sys.executable, "-m", "testbench.commands.main", *argv],
        cwd=tmp_path,
        env=ENVIRONMENT,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        waited = time.monotonic() + 120
        while not (tmp_path / "out" / checkpoint.FOLDER / "checkpoint.h5").exists():
            assert time.monotonic() < waited
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "gyro: to continue: gyro run --resume-run out\ngyro: interrupted\n"
    assert os.listdir(tmp_path / "out") == [checkpoint.FOLDER]


# ---- refusals --------------------------------------------------------------------------------------------------------


def refused(capsys, *argv):
    with pytest.raises(SystemExit) as caught:
        cli.main(list(argv))
    said = capsys.readouterr()
    assert (caught.value.code, said.out) == (2, "")
    return said.err


def test_a_continued_run_takes_no_other_settings(capsys, interrupted):
    for other in (["--seed", "2"], ["--no-noise"], ["--set", "plant.fx_hz=11000"], ["--out", "elsewhere"]):
        said = refused(capsys, "run", "--resume-run", str(interrupted), *other)
        assert "--resume-run: the interrupted run keeps its configuration" in said


def test_a_changed_configuration_is_refused(capsys, interrupted, tmp_path):
    shutil.copytree(interrupted, tmp_path / "out")
    path = tmp_path / "out" / checkpoint.FOLDER / "config.toml"
    path.write_text(path.read_text().replace("duffing_k3_per_um2 = 0.0", "duffing_k3_per_um2 = 1e-9"))
    said = refused(capsys, "run", "--resume-run", str(tmp_path / "out"))
    assert re.search(r"checkpoint\.h5: belongs to another configuration than .*config\.toml\n", said)
    assert checkpoint.Partial(tmp_path / "out").resumable()


def test_a_damaged_checkpoint_is_refused(capsys, interrupted, tmp_path):
    shutil.copytree(interrupted, tmp_path / "out")
    path = tmp_path / "out" / checkpoint.FOLDER / "checkpoint.h5"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    said = refused(capsys, "run", "--resume-run", str(tmp_path / "out"))
    assert re.search(r"checkpoint\.h5: R15 / expected the file that was written, found damage\n", said)


def test_a_new_run_in_the_folder_of_an_unfinished_one_is_refused_unless_told(locked, interrupted, tmp_path, capsys):
    shutil.copytree(interrupted, tmp_path / "out")
    kept = contents(tmp_path / "out")
    argv = short(locked, "--out", "out")
    got = gyro(*argv, folder=tmp_path)
    assert (got.returncode, got.stdout) == (2, "")
    assert (
        got.stderr == "gyro: out: holds an unfinished run; --resume-run out continues it, --discard starts a new run\n"
    )
    assert contents(tmp_path / "out") == kept
    run_here(tmp_path, [*argv, "--discard"])
    assert checkpoint.FOLDER not in os.listdir(tmp_path / "out")


def contents(folder):
    """{path: bytes} of all files but the lock."""
    return {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file() and p.name != "lock"}


@pytest.mark.parametrize("argv", [["--resume-run", "out"], ["--seconds", "0.01", "--discard", "--out", "out"]])
def test_a_living_run_has_its_folder_alone(interrupted, tmp_path, argv):
    shutil.copytree(interrupted, tmp_path / "out")
    kept = contents(tmp_path / "out")
    living = checkpoint.Partial(tmp_path / "out")
    living.hold()
    got = gyro("run", *argv, folder=tmp_path)
    assert (got.returncode, got.stdout) == (2, "")
    assert got.stderr.startswith(f"gyro: out: another run is using this folder: process {os.getpid()} on ")
    assert contents(tmp_path / "out") == kept
    living.release()


FLIPS = 40  # bits; the slow set tries 500


def flipped(path, rng, end=None):
    """Change one bit of a file, before byte `end`."""
    data = bytearray(path.read_bytes())
    bit = int(rng.integers(8 * (end or len(data))))
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)
    return bit // 8


@pytest.mark.parametrize("count", [FLIPS, pytest.param(500, marks=pytest.mark.slow)])
def test_one_bit_flipped_in_any_file_of_an_unfinished_run_is_refused_or_without_effect(interrupted, tmp_path, count):
    """What is read is what was written, or nothing is read: rows, checkpoint, window and configuration."""
    whole = reading(interrupted)
    assert whole.recording.spool.rows > 100
    want = [rows.tobytes() for rows in whole.recording.spool.row_blocks()]
    names = sorted(path.name for path in (interrupted / checkpoint.FOLDER).iterdir() if path.name != "lock")
    assert names == ["checkpoint.h5", "config.toml", "rows.bin", "window.bin"]
    rng, refusals = np.random.default_rng(count), dict.fromkeys(names, 0)
    size = whole.recording.spool.rows * whole.recording.spool.dtype.itemsize
    for k in range(count):
        folder = tmp_path / str(k)
        shutil.copytree(interrupted, folder)
        name = names[k % len(names)]
        flipped(folder / checkpoint.FOLDER / name, rng, size if name == "rows.bin" else None)
        try:
            job = reading(folder)
        except (FileError, ConfigError):
            refusals[name] += 1
            continue
        finally:
            shutil.rmtree(folder)
        assert job.sim.codes_sha256() == whole.sim.codes_sha256()
        assert (job.config, job.position, job.sim.tick) == (whole.config, whole.position, whole.sim.tick)
        assert np.array_equal(job.sim.rows, whole.sim.rows)
        assert name != "rows.bin"
    assert refusals["rows.bin"] == refusals["window.bin"] == count // len(names)
    assert len(want) == 1


def reading(folder):
    """`simulate.Run` as it continues in a folder."""
    partial = checkpoint.open_partial(folder)
    try:
        return simulate.Run(config.load(partial.config), partial, resume=True)
    finally:
        partial.release()


def test_rows_that_change_while_a_run_is_at_work_are_found_before_the_record_is_sealed(interrupted, tmp_path):
    shutil.copytree(interrupted, tmp_path / "out")
    job = reading(tmp_path / "out")
    flipped(job.partial.rows, np.random.default_rng(1))
    with pytest.raises(FileError, match=r"rows\.bin: rows 0 \.\. \d+ differ from what was written"):
        job.recording.write(tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def test_a_record_whose_rows_are_not_those_of_the_hash_is_not_written(locked, tmp_path):
    checked = config.load(
        overrides=["scenario.seconds=0.02", "scenario.diagnose=false", f"scenario.resume={locked[0]}"]
    )
    result = simulate.run(checked)
    spool = result.record.spool
    spool.flush()
    spool._memory[0]["rate_word"][7] += 1
    with pytest.raises(FileError, match=r"run\.h5: its rows do not match codes_sha256; the record was not written"):
        result.record.write(tmp_path / "run.h5")
    spool._memory[0]["rate_word"][7] -= 1
    result.record.write(tmp_path / "run.h5")


def test_what_another_version_saved_is_continued_only_if_told_and_the_record_says_so(
    locked, interrupted, tmp_path, monkeypatch
):
    mine = identity.identity()
    monkeypatch.setattr(identity, "identity", lambda: mine | {"code": "f" * 64, "numpy": "9.9"})
    shutil.copytree(interrupted, tmp_path / "out")
    new = short(locked, "--out", "two")
    for argv in (["run", "--resume-run", "out"], new):
        got = gyro(*argv, folder=tmp_path)
        assert got.returncode == 2
        said = f"was saved by code {mine['code'][:12]}, numpy {mine['numpy']}, this is code {'f' * 12}, numpy 9.9; "
        assert said + "--across-versions continues despite the difference" in got.stderr
    for argv, folder in ((["run", "--resume-run", "out"], "out"), (new, "two")):
        run_here(tmp_path, [*argv, "--across-versions"])
        record = record_read.read_record(tmp_path / folder / "run.h5")
        assert json.loads(record.attrs["continues"]) == [mine]
        assert "across_versions = true" in record.config_toml


def test_content_does_not_depend_on_where_the_output_lies(locked, tmp_path):
    for folder in ("one", "two/deeper"):
        run_here(tmp_path, short(locked, "--out", folder))
    one, two = (record_read.read_record(tmp_path / folder / "run.h5") for folder in ("one", "two/deeper"))
    assert one.content_sha256 == two.content_sha256
    layout = simulate.Simulation(configured(), 25.0, 25.0).layout()
    states = [state_file.load_state(tmp_path / folder / "state.h5", layout)[1] for folder in ("one", "two/deeper")]
    assert states[0] == states[1]


# ---- memory ----------------------------------------------------------------------------------------------------------

PEAKS = """
import resource, sys
from testbench import config, simulate

sets = ["scenario.seconds=6", "scenario.diagnose=false", "output.checkpoint_s=0.5", f'scenario.resume="{sys.argv[1]}"']
job = simulate.Run(config.load(overrides=sets), sys.argv[2])
job.start(None)
begin, seen = job.sim.tick, {}

def say(text, done, total):
    seen.setdefault(done // 1_000_000, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)

job.play_scenario(say)
print(seen[2], seen[6], job.recording.spool.rows)
"""


def test_memory_does_not_grow_with_simulated_time(locked, tmp_path):
    """All columns, checkpoints twice a second; without streams to the disk, 4 s would be 6 MB."""
    got = done(tmp_path, [], "-c", PEAKS, str(locked[0]), str(tmp_path / "out"))
    assert got.returncode == 0, got.stderr
    early_kb, late_kb, rows = map(int, got.stdout.split())
    assert rows > 6 * 8000 - 8192
    assert late_kb - early_kb < 3000


PEAK = """
import atexit, re, sys
from testbench.commands import main as cli

atexit.register(lambda: print(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1], file=sys.stderr))
cli.main(sys.argv[1:])
"""


@pytest.mark.parametrize("engine", ["frame", pytest.param("baseband", marks=pytest.mark.slow)])
def test_the_peak_of_a_run_is_below_500_mb(engine, tmp_path):
    """That of the process itself, once kernels are compiled: getrusage would count what the parent has at the fork."""
    simulate.Simulation(configured(), 25.0, 25.0, engine=engine).advance(1000, 0.0, 25.0)
    argv = f"run --seconds 1 --rate-dps 100 --seed 1 --engine {engine} --out out".split()
    got = done(tmp_path, argv, "-c", PEAK)
    assert got.returncode == 0, got.stderr
    assert int(got.stderr.split()[-1]) * 1024 < 500e6


def test_a_window_larger_than_what_users_may_hand_over_is_read_back(tmp_path, monkeypatch):
    partial = checkpoint.Partial(tmp_path)
    rows = np.arange(200_000).reshape(-1, 4)
    partial.hold()
    digest = partial.keep_window(rows)
    monkeypatch.setenv("GYRO_INPUT_MB", "1")
    np.testing.assert_array_equal(partial.load_window(4, digest), rows)
    partial.release()

"""The plant port: examples of its page, the C++ plant of the comparators, identity, one line for each bad library."""

import json
import re
import shutil
import subprocess

import numba
import numpy as np
import pytest

from analog_frontend import top as plant
from fpga_model import bound
from testbench import flatten
from testbench.bench import kernels, peers
from testbench.campaign.plan import plan as campaign_plan
from testbench.config import Config, changed, to_toml
from testbench.engines import window
from testbench.errors import ConfigError, FileError
from testbench.measured.record import check_tables, from_run, load_record, produce
from testbench.measured.record import recording_plan as plans
from testbench.port import plant_loader
from testbench.port.plant import Plant
from testbench.run import simulate
from testbench.run.simulation import Simulation
from testbench.storage import record_read
from testbench.storage.record import Record
from tests.testbench.bench_setup import configured, quiet
from tests.testbench.command import gyro

pytestmark = [
    pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted"),
    pytest.mark.skipif(shutil.which("gcc") is None or shutil.which("g++") is None, reason="not installed: gcc, g++"),
]
HEADER = peers.SOURCES.parents[1] / "analog_frontend" / "port"
PAGE = peers.SOURCES.parents[1] / "docs" / "plant_port.md"
HERE = PAGE.parents[1] / "tests" / "testbench" / "port"


def example(language):
    if language == "python":
        return (PAGE.parent / "plant_port" / "plant.py").read_text()
    return re.search(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


def compiled(folder, name, text=None, changes=(), options=()):
    """Path of a shared library made of `text`, or of the C example with (old, new) `changes`."""
    text = text or example("c")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    source = folder / f"{name}.c"
    source.write_text(text)
    made = source.with_suffix(".so")
    command = ["gcc", "-O1", "-std=c99", "-Wall", "-Werror", "-ffp-contract=off", "-shared", "-fPIC", f"-I{HEADER}"]
    subprocess.run([*command, *options, source, "-o", made, "-lm"], check=True)
    return made


@pytest.fixture(scope="module")
def resonator(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("c"), "resonator")


@pytest.fixture(scope="module")
def resonator_py(tmp_path_factory):
    path = tmp_path_factory.mktemp("python") / "plant.py"
    path.write_text(example("python"))
    return path


def simulation(path, engine="frame", **values):
    return Simulation(quiet(scenario__plant=str(path), **values), 25.0, 25.0, engine=engine)


def started(path, ticks, engine="frame", cut=0, **values):
    """A simulation from power-on to `ticks`, in two calls behind tick `cut`."""
    sim = simulation(path, engine, **values)
    sim.now = np.zeros(1), np.full(1, 25.0)
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    for until in (cut, ticks):
        if until > sim.tick:
            sim.advance(until - sim.tick, 0.0, 25.0)
    return sim


def test_the_c_example_locks_and_the_engines_and_cuts_agree(resonator):
    assert len(example("c").splitlines()) < 80
    sim = started(resonator, 1_000_000)
    assert sim.locked
    x = sim.columns()["truth_x"][-800:]
    assert np.abs(x).max() == pytest.approx(5e-6, rel=0.05)
    begins = [started(resonator, 40_000, *how).codes_sha256() for how in (("frame",), ("clocked",), ("frame", 777))]
    assert len(set(begins)) == 1


def test_the_python_example_is_the_same_plant_and_its_state_continues(resonator, resonator_py):
    """Rounding of libm and of LLVM may differ: motion agrees to 1e-9, not bit for bit."""
    c, py = (started(path, 60_000) for path in (resonator, resonator_py))
    a, b = (sim.columns()["truth_x"] for sim in (c, py))
    assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    kept = started(resonator_py, 30_000)
    values, other = kept.dump_all(), simulation(resonator_py)
    other.restore_all(values)
    other.advance(30_000, 0.0, 25.0)
    assert other.codes_sha256() == py.codes_sha256()


def test_the_plant_of_the_comparators_behind_the_port_has_the_frame_engines_bits(tmp_path):
    made = tmp_path / "board.so"
    options = ["-std=c++17", "-O1", "-ffp-contract=off", "-shared", "-fPIC", f"-I{HEADER}", f"-I{peers.SOURCES}"]
    subprocess.run(["g++", *options, HERE / "board_plant.cpp", "-o", made], check=True)
    own = kernels.gyroscope("frame")
    peers.export(own, kernels.RATE_RAD_S, tmp_path)
    (tmp_path / "own.txt").write_text(str(tmp_path / "state.bin"))
    there = {"scenario.plant": str(made), "scenario.plant_file": str(tmp_path / "own.txt")}
    sims = [own, *(kernels.gyroscope(engine, locked=False, changes=there) for engine in ("frame", "clocked"))]
    locked, ticks = own.state, (20_000, 20_000, 2_500)
    for sim in sims[1:]:
        clock = sim.state.plant.adc.clock
        sim.state = locked._replace(plant=plant.copy(locked.plant))
        sim.state.plant.adc.clock[:] = clock
    out = [sim.advance(n, kernels.RATE_RAD_S, kernels.TEMP_DEGC) for sim, n in zip(sims, ticks)]
    assert len(np.unique(out[0].drive_code)) > 100, "the loop works"
    for streams, n in zip(out[1:], ticks[1:]):
        assert (streams.drive_code == out[0].drive_code[:n]).all()
        assert (streams.sense_code == out[0].sense_code[:n]).all()
        assert (streams.frames == out[0].frames[: n // 125]).all()
        # m/s and back; the first row is of the state that was handed over
        assert streams.truth[1:] == pytest.approx(out[0].truth[1 : n // 125], rel=4e-16, abs=0.0)
        assert (streams.truth[:, ::2] == out[0].truth[: n // 125, ::2]).all()
    assert list(flatten.leaves(own.state.fpga)) == list(flatten.leaves(sims[1].state.fpga))


LIVING = "adc->code[2 + k] = now / FRAME * 7919 % 13 - 6 + k;"  # of a sense mode that has only noise
MOVING = "int64_t m = now / FRAME + (now < FRAME || into > LATE + 1) + k;"
LINE = "adc->code[k] = p->code[k];"
PLAN = {"repeats": 2, "condition": [{"id": "rest", "settle_s": 0.01, "seconds": 0.05}]}


def planned(path, **values):
    return plans.with_plant(plans.from_dict(PLAN | values), path)


def test_a_record_of_a_foreign_plant_is_accepted_and_its_firmware_replays(tmp_path):
    path = compiled(tmp_path, "living", changes=[(LINE, f"{LINE} {LIVING}")])
    (tmp_path / "plan.toml").write_text('repeats = 2\n[[condition]]\nid = "rest"\nsettle_s = 0.01\nseconds = 0.05\n')
    done = gyro("measured", "record", "plan.toml", "--plant", path, "-o", "record.h5", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    loaded = load_record.load(tmp_path / "record.h5")
    made = loaded.record
    assert made.attrs["plant_sha256"] == plant_loader.open_library(path).sha256
    assert made.attrs["plant_unseen"] == ""
    # DRDY 10 clocks behind the frame's end, and the read
    assert made.streams["adc_xI"].edge0 == 10 + window.valid_clocks(configured().design_record())
    assert loaded.residual.first is None
    assert {finding.rule for finding in loaded.findings} == {"R27"}, "its sensor of the temperature is at 0"


def test_a_record_refuses_what_it_could_not_hold(resonator, tmp_path):
    for values, line in (
        ({"truth": {"plant.qy": 1.9e5}}, r"\[truth\] plant\.qy: the plant library does not read this key"),
        ({"condition": [{"id": "a", "counter_s": 0.1}]}, r"condition a: counter_s = 0\.1 s"),
    ):
        with pytest.raises(ConfigError, match=line):
            produce.record(planned(resonator, **values))
    moving = [
        (LINE, f"{LINE} {LIVING}"),
        ("{FRAME * CLOCKS + LATE,", "{FRAME * CLOCKS + LATE + 1,"),
        (
            "adc->drdy[k] = (now < FRAME || into > LATE ? FRAME * CLOCKS : 0)",
            f"{MOVING} adc->drdy[k] = m * FRAME * CLOCKS",
        ),
        ("+ LATE - into + k * FRAME * CLOCKS;", "+ LATE + m % 2 - now * CLOCKS;"),
    ]
    with pytest.raises(ConfigError, match="comes at another clock of its frame"):
        produce.record(planned(compiled(tmp_path, "moving", changes=moving)))
    early = [("{FRAME * CLOCKS + LATE, 2", "{2000, 2")]
    with pytest.raises(ConfigError, match="DRDY falls first at 2000 clocks; a record needs"):
        produce.record(planned(compiled(tmp_path, "early", changes=early)))


def test_two_libraries_run_one_after_the_other_on_the_same_kernels(resonator, tmp_path):
    other = compiled(tmp_path, "resonator", changes=[("1.8574e12", "1.9e12")])
    hashes = [started(path, 20_000).codes_sha256() for path in (resonator, other, resonator)]
    assert hashes[0] == hashes[2] != hashes[1]
    assert plant_loader.open_library(other).sha256 != plant_loader.open_library(resonator).sha256
    # what was loaded stays what runs, also where the file is overwritten in place
    before = started(other, 20_000).codes_sha256()
    other.write_bytes(resonator.read_bytes())
    assert started(other, 20_000).codes_sha256() == hashes[0] != before


BAD = {
    "no library": (None, "cannot be loaded as a shared library"),
    "missing": (
        [("gyro_plant_step(", "another_step(")],
        "exports no gyro_plant_step; gyro_plant.h lists what is needed",
    ),
    "version": (
        [("return GYRO_PLANT_ABI", "return 7")],
        "gyro_plant_abi is 7, expected 1: compile it with the current header",
    ),
    "create": ([("if (*own)", "if (!*own)"), ("*own ?", "!*own ?")], "a resonance has no use for a file of its own"),
    "status": ([("> 1e-4", "> 1e-12")], "m is outside -1e-4 .. 1e-4 m"),
    "code": (
        [("adc->code[k] = p->code[k]", "adc->code[2] = 9000000")],
        "code of adc_sense_sin is 9000000, outside -8388608 .. 8388607",
    ),
    "promise": (
        [("LATE - into + k", "LATE - into - (now > 150) + k")],
        "drdy is 3259 clocks, expected 3260 as announced before",
    ),
    "apart": ([("k * FRAME * CLOCKS;", "k;")], "clocks are less than 800 apart"),
    "first": ([("{FRAME * CLOCKS + LATE, 2", "{LATE, 2")], "drdy = 10, 6510 clocks; the first falls 26 clocks"),
    "nan": ([("motion[1] = p->vx", "motion[2] = NAN")], "motion y is not finite"),
    "save": (
        [
            (
                "\nint32_t gyro_plant_reset(",
                "\nint64_t gyro_plant_state_size(void *p) { return 0; }\nint32_t gyro_plant_reset(",
            )
        ],
        "exports no gyro_plant_load; state_size, save and load belong together",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_library_is_one_line(name, tmp_path):
    changes, line = BAD[name]
    if changes is None:
        path = tmp_path / "bad.so"
        path.write_text("no library")
    else:
        path = compiled(tmp_path, "bad", changes=changes)
    with pytest.raises(FileError, match=re.escape(line)) as caught:
        started(path, 20_000)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (("KEYS =", "Keys ="), "defines no KEYS; expected KEYS, create, reset and step"),
        (
            ("@numba.cfunc(STATUS(DOUBLES, INTEGERS", "@numba.njit(STATUS(DOUBLES, INTEGERS"),
            "step is not a numba",
        ),
        (("p = np.zeros(17)", "p = np.zeros(-1)"), "create: ValueError: negative dimensions are not allowed"),
        (("import numba", "import nothing_of_this_name"), "ModuleNotFoundError: No module named"),
    ],
)
def test_a_bad_python_file_is_one_line(change, line, tmp_path):
    path = tmp_path / "bad.py"
    path.write_text(example("python").replace(*change))
    with pytest.raises(FileError, match=line):
        simulation(path)


def test_what_a_library_does_not_read_is_refused_or_told(resonator):
    with pytest.raises(ConfigError, match=r"does not read effects\.feedthrough_y = 0\.001; remove this effect"):
        simulation(resonator, effects__feedthrough_y=0.001)
    told = Plant(configured(scenario__plant=str(resonator), plant__qx=1.9e5, plant__qy=1.9e5, noise__seed=7), "frame")
    assert told.unseen == {"plant.qy": 1.9e5}
    for values, line in (
        ({"scenario__engine": "baseband"}, "baseband"),
        ({"firmware__board": "digital_sid"}, "analog_sid"),
        ({"scenario__faults": [[0.1, "plant_nan", "x", 0, 0.1]]}, "plant_nan"),
    ):
        with pytest.raises(ConfigError, match=line):
            Plant(configured(scenario__plant=str(resonator), **values), values.get("scenario__engine", "frame"))
    with pytest.raises(ConfigError, match=r"plant_file needs scenario\.plant"):
        configured(scenario__plant_file="x")
    with pytest.raises(ConfigError, match="phases cannot be measured"):
        simulation(resonator).probe(1000, 0.0, 25.0)


def test_no_file_can_name_a_library(resonator, tmp_path):
    line = "scenario.plant names a library that would be executed; only the option --plant may name one"
    checked = quiet(scenario__plant=str(resonator))
    (tmp_path / "config.toml").write_text(to_toml(checked))
    done = gyro("run", "--config", "config.toml", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"gyro: config.toml: {line}\n")
    for command in ("run", "budget", "loop"):
        done = gyro(command, "--set", f"scenario.plant={resonator}", folder=tmp_path)
        assert (done.returncode, done.stderr) == (2, f"gyro: --set: {line}\n"), command
    with pytest.raises(ConfigError, match=line):
        changed(Config(), {"scenario.plant": str(resonator)})
    (tmp_path / "campaign.toml").write_text('[set]\nscenario.plant = "a.so"\n[axes.seed]\nnoise.seed = [1, 2]\n')
    with pytest.raises(ConfigError, match=r"scenario\.plant: a campaign runs the built-in plant only"):
        campaign_plan.read(tmp_path / "campaign.toml")
    plan = from_run.plan_from_config(checked)
    assert (plan.model.scenario.plant, plan.truth.scenario.plant) == ("", str(resonator))
    with pytest.raises(ConfigError, match=line):
        check_tables.stated_config(Record({}, {}, to_toml(checked), "simulated", 0.0))


def stop_at(seconds):
    """A progress that ends the run, as Ctrl-C does."""

    def progress(part, done, total):
        if part == "scenario" and done > seconds * 1e6:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_run_goes_on_to_the_same_codes_with_its_plant_named_again(resonator_py, tmp_path):
    values = {"scenario__origin": "power_on", "scenario__seconds": 0.5, "output__checkpoint_s": 0.1}
    checked = quiet(scenario__plant=str(resonator_py), output__html=False, output__pictures=False, **values)
    uncut = simulate.run(checked).summary["codes_sha256"]
    with pytest.raises(KeyboardInterrupt):
        simulate.run(checked, stop_at(0.25), tmp_path / "cut")
    done = gyro("run", "--resume-run", "cut", folder=tmp_path)
    assert (done.returncode, "only the option --plant may name one" in done.stderr) == (2, True)
    done = gyro("run", "--resume-run", "cut", "--plant", resonator_py, "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["codes_sha256"] == uncut
    record = record_read.read_record(tmp_path / "cut" / "run.h5")
    assert record.attrs["plant_sha256"] == found["plant_sha256"] == plant_loader.open_library(resonator_py).sha256
    assert "plant_file_sha256" not in record.attrs
    assert found["plant_file_sha256"] is None


def test_a_plant_that_was_replaced_behind_its_compilation_is_refused(monkeypatch):
    monkeypatch.setattr(bound, "outdated_functions", lambda: ["analog_frontend.top.block"])
    with pytest.raises(RuntimeError, match=r"analog_frontend\.top\.block was compiled before a function that it calls"):
        Simulation(quiet(), 25.0, 25.0)


def test_a_state_continues_only_with_its_plant_and_the_command_says_which(resonator_py, tmp_path):
    changed = tmp_path / "other.py"
    changed.write_text(resonator_py.read_text().replace("1.8574e12", "1.9e12"))
    run = ["run", "--no-noise", "--seconds", "0.01", "--set", "scenario.origin=power_on", "--set", "output.html=false"]
    run += ["--set", "output.pictures=false"]
    done = gyro(*run, "--plant", resonator_py, "--out", "a", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert plant_loader.open_library(resonator_py).sha256 in done.stdout
    for path, line in ((changed, "another plant cannot continue it"), (None, "this is plant none")):
        options = ["--plant", path] if path else []
        done = gyro(*run, *options, "--out", "b", "--resume", "a/state.h5", "--across-versions", folder=tmp_path)
        assert (done.returncode, line in done.stderr) == (2, True), done.stderr
        assert len(done.stderr.strip().splitlines()) == 1

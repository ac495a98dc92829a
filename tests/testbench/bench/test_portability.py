"""Same bits everywhere: what is compared, what is found, and one comparison of all targets (slow)."""

import json
import math
import subprocess
import sys
import types

import numba
import numpy as np
import pytest
from numba import njit

from analog_frontend.effects import catalogue
from testbench.config import Config
from testbench.console import markdown, results
from testbench.run.simulation import Simulation
from tests.testbench.bench import portability
from tests.testbench.bench.portability import CASES, TARGETS, Target

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="looks at machine code, or runs a closed loop")
ONE, OTHER = ["a" * 64, "b" * 64], ["c" * 64, "b" * 64]
VERSIONS = {"python": "3.11.7", "numba": "0.61.0", "llvmlite": "0.44.0", "numpy": "2.0.0", "scipy": "1.13.0"}


def run_of(environment="A", target="native", marks=None, fused=0, c_functions=()):
    """A run as `measure` gives it."""
    cases = {"default": {"marks": marks or {"10000": ONE, "60000000": ONE}, "locked": True}}
    code = {"bits": 512, "fused": fused, "c_functions": list(c_functions)}
    return {
        "environment": environment,
        "target": target,
        "versions": VERSIONS,
        "code": code,
        "cases": cases,
        "wall_s": 1.0,
    }


# ---- what a process does ---------------------------------------------------------------------------------------------


def test_hashes_are_taken_at_decades_and_at_the_end():
    assert portability.marks_of(10_000) == [10_000]
    assert portability.marks_of(200_000) == [10_000, 100_000, 200_000]
    assert portability.marks_of(60_000_000) == [10_000, 100_000, 1_000_000, 10_000_000, 60_000_000]


def test_the_varied_case_is_the_same_however_it_is_cut():
    case = CASES[1]
    whole = portability.stimulus(case, 0, 125 * 3000)
    for tick in (0, 1, 124, 125, 10_000, 250_001):
        for all_values, values in zip(whole, portability.stimulus(case, tick, 12_500)):
            np.testing.assert_array_equal(values[:100], all_values[tick // 125 :][:100])
    rate, temp = whole
    assert rate.max() - rate.min() > 3.0
    assert case.temp_degc[0] <= temp.min() < temp.max() <= case.temp_degc[1]
    # exact: no library can round these
    assert np.all(rate * 512 == np.round(rate * 512))
    assert np.all(temp * 512 == np.round(temp * 512))


def test_the_cases_leave_nothing_off():
    values = CASES[1].values
    # the catalogue's effects are laws; the digital board refuses errors of the analog board's converter
    elsewhere = {effect.INFO.name for effect in catalogue.LAWS}
    elsewhere |= {key for key in Config().effects.model_dump() if key.startswith("adc_")}
    used = {key.split(".")[1] for key in values if key.startswith("effects.")}
    assert used == set(Config().effects.model_dump()) - elsewhere
    assert values["firmware.board"] == "digital_sid"
    assert values["firmware.adc_clock"] == "free_running"
    assert all(v for k, v in Config().noise.model_dump().items() if k != "seed"), "the default has all noise"


@compiled
def test_marks_do_not_change_a_run():
    found = portability.hashes(CASES[0], "clocked", 20_000)
    sim = Simulation(Config(), 25.0, 25.0, engine="clocked")
    sim.now = (np.zeros(1), np.full(1, 25.0))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    sim.advance(20_000 - sim.tick, 0.0, 25.0)
    assert found["marks"]["20000"] == [sim.codes_sha256(), portability.state_sha256(sim)]
    assert found["marks"]["20000"] != found["marks"]["10000"]
    sim.state.plant.z[3] = np.nextafter(sim.state.plant.z[3], 1.0)
    assert found["marks"]["20000"][1] != portability.state_sha256(sim), "one bit of one double is seen"


@compiled
def test_the_varied_case_runs():
    marks = portability.hashes(CASES[1], "clocked", 11_000)["marks"]
    assert list(marks) == ["10000", "11000"]


# ---- machine code ----------------------------------------------------------------------------------------------------


def test_what_rounds_differently_is_found_in_assembler():
    text = "\tvmulpd\t%zmm1, %zmm2, %zmm3\n\tmovabsq\t$floor, %rax\n\tcallq\t*%rax\n\tmovabsq\t$numba_unpickle, %rax\n"
    assert portability.machine_code([text]) == {"bits": 512, "fused": 0, "c_functions": []}
    for fused in ("vfmadd213sd %xmm1", "vfnmsub231pd %ymm1", "fmadd d0, d1, d2, d3", "fmla v0.2d, v1.2d, v2.2d"):
        assert portability.machine_code([text, f"\t{fused}\n"])["fused"] == 1, fused
    for call in ("\tmovabsq\t$exp, %rax\n", "\tcallq\texp\n", "\tbl\texp\n"):
        assert portability.machine_code([text, call])["c_functions"] == ["exp"], call
    assert portability.machine_code([])["bits"] == 0


@compiled
# kernels that other tests of this process took from the cache have no assembler any more; a real run compiles all
@pytest.mark.filterwarnings("ignore:Inspection disabled")
def test_a_kernel_that_calls_the_c_library_would_be_seen():
    @njit
    def bad(x):
        return math.exp(x)

    bad(1.0)
    modules = {"testbench.bad": types.SimpleNamespace(bad=bad), "elsewhere": types.SimpleNamespace(bad=bad)}
    texts = list(portability.compiled_texts(modules))
    assert len(texts) == 1
    assert "exp" in portability.machine_code(texts)["c_functions"]


# ---- processes -------------------------------------------------------------------------------------------------------


def test_a_child_inherits_no_setting(monkeypatch):
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    monkeypatch.setenv("NUMBA_OPT", "0")
    monkeypatch.setenv("GYRO_CACHE", "0")
    native, haswell, *_ = (portability.environment_of(target, "somewhere") for target in TARGETS)
    assert [k for k in native if k.startswith("NUMBA_")] == []
    assert native["GYRO_CACHE"] == "somewhere"
    assert (haswell["NUMBA_CPU_NAME"], haswell["NUMBA_CPU_FEATURES"]) == ("haswell", "")


@pytest.mark.slow
def test_tests_of_the_core_are_run_and_a_failure_is_a_problem(tmp_path):
    good, bad = tmp_path / "test_good.py", tmp_path / "test_bad.py"
    good.write_text("def test_one():\n    pass\n")
    bad.write_text("def test_one():\n    assert False\n")
    said = []
    found = [portability.core_tests([sys.executable], said.append, [str(path)])[0] for path in (good, bad)]
    assert [one["passed"] for one in found] == [True, False]
    assert [one["tests"][:8] for one in found] == ["1 passed", "1 failed"]
    assert len(said) == 2


def test_haswell_exists_on_its_architecture_only():
    assert [t.name for t in portability.targets("x86_64")] == ["native", "haswell", "generic", "interpreted"]
    assert [t.name for t in portability.targets("AMD64")] == ["native", "haswell", "generic", "interpreted"]
    assert [t.name for t in portability.targets("aarch64")] == ["native", "generic", "interpreted"]


@pytest.mark.parametrize(
    ("code", "result"),
    [
        ("print('noise'); print('{\"cases\": {}}')", {"cases": {}}),
        ("raise SystemExit('no such engine')", {"error": "no such engine"}),
        ("raise SystemExit(3)", {"error": "exit code 3"}),
        ("import os, signal; os.kill(os.getpid(), signal.SIGILL)", {"error": "ended by SIGILL"}),
    ],
)
def test_a_process_ends_in_a_result_or_in_one_line(monkeypatch, code, result):
    monkeypatch.setattr(portability, "CHILD", code)
    assert portability.play(sys.executable, TARGETS[0], "clocked", 10_000) == result


def test_the_interpreter_runs_ten_milliseconds_only(monkeypatch):
    monkeypatch.setattr(portability, "CHILD", "import sys; print(sys.argv[2])")
    assert portability.play(sys.executable, Target("native", {}), "clocked", 60_000_000) == 60_000_000
    assert portability.play(sys.executable, Target("interpreted", {}), "clocked", 60_000_000) == 10_000


def test_every_interpreter_meets_every_target(monkeypatch):
    monkeypatch.setattr(portability, "play", lambda interpreter, *_: {"cases": {}, "who": interpreter})
    said = []
    runs = portability.measure(["one", "two"], "clocked", 10_000, said.append)
    names = [t.name for t in portability.targets(portability.platform.machine())]
    assert [(r["environment"], r["who"], r["target"]) for r in runs] == [
        (letter, who, name) for letter, who in (("A", "one"), ("B", "two")) for name in names
    ]
    assert len(said) == len(runs)


# ---- judgement -------------------------------------------------------------------------------------------------------


def test_equal_runs_are_no_problem():
    short = run_of("B", "interpreted", {"10000": ONE})
    assert portability.problems([run_of(), run_of(target="generic"), short]) == []


@pytest.mark.parametrize(
    ("run", "line"),
    [
        (
            run_of("B", marks={"10000": ONE, "60000000": OTHER}),
            "B native: default: unequal codes at 60 s beside A native",
        ),
        (run_of("B", marks={"10000": OTHER, "60000000": OTHER}), "B native: default: unequal codes at 0.01 s beside A"),
        (
            run_of("B", marks={"10000": ["c", "d"]}),
            "B native: default: unequal codes and state at 0.01 s beside A native",
        ),
        (run_of("B", marks={"20000": ONE}), "B native: default: no instant in common with A native"),
        (run_of("B", fused=7), "B native: 7 fused multiply-adds"),
        (run_of("B", c_functions=("exp", "sin")), "B native: kernels call exp, sin"),
        ({"environment": "B", "target": "generic", "error": "ended by SIGILL"}, "B generic: ended by SIGILL"),
    ],
)
def test_each_problem_is_one_line(run, line):
    (found,) = portability.problems([run_of(), run])
    assert found.startswith(line)


def test_a_first_run_that_fails_is_the_only_problem():
    failed = {"environment": "A", "target": "native", "error": "ended by SIGILL"}
    assert portability.problems([failed, run_of("A", "generic")]) == ["A native: ended by SIGILL"]


# ---- the lowest versions ---------------------------------------------------------------------------------------------

PROJECT = '[project]\ndependencies = ["numpy>={}"]\n[project.optional-dependencies]\ntest = ["pytest-xdist>=3.6.1"]\n'


def test_lower_bounds_become_versions():
    assert portability.lowest(PROJECT.format("2.0")) == ["numpy==2.0", "pytest-xdist==3.6.1"]
    with pytest.raises(ValueError, match=r"'numpy>=2.0,!=2.1' is not of the form name>=version"):
        portability.lowest(PROJECT.format("2.0,!=2.1"))


def test_every_dependency_has_a_lower_bound_and_no_upper_one_without_a_reason():
    pinned = portability.lowest((markdown.ROOT / "pyproject.toml").read_text())
    assert {"numba", "numpy", "scipy", "h5py"} <= {text.split("==")[0] for text in pinned}
    capped = [line for line in (markdown.ROOT / "pyproject.toml").read_text().splitlines() if ",<" in line]
    assert [line.split(">=")[0].strip(' "') for line in capped] == ["cocotb"]
    assert all("# " in line for line in capped), "an upper bound has its reason behind it"


def test_an_environment_that_cannot_be_made_is_one_line(monkeypatch, tmp_path):
    def refuse(step, **_):
        failed = "pip" in step
        return subprocess.CompletedProcess(step, int(failed), "", "WARNING: x\nERROR: No matching distribution\n")

    monkeypatch.setattr(portability.subprocess, "run", refuse)
    with pytest.raises(ValueError, match=r"^the lowest versions on Python 3\S+: ERROR: No matching distribution$"):
        portability.make_old(tmp_path / "old")


# ---- showing ---------------------------------------------------------------------------------------------------------


def result_of(runs):
    return {
        "cpu": "A processor",
        "engine": "frame",
        "seconds": 60.0,
        "problems": portability.problems(runs),
        "runs": runs,
    }


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """Function: what the site shows of a measurement."""
    monkeypatch.setattr(results, "FOLDER", tmp_path)

    def written(result):
        results.write_results("portability", *portability.stored_results(result))
        return results.results_markdown("portability")

    return written


def test_the_tables_are_the_measurement(shown):
    short = run_of("B", "interpreted", {"10000": ONE})
    short["code"]["bits"] = 0
    part = shown(result_of([run_of(), short]))
    assert "Measured with `python -m tests.testbench.bench.portability --engine frame --seconds 60`." in part
    assert "Measured on A processor." in part
    assert "| B | 3.11.7 | 0.61.0 | 0.44.0 | 2.0.0 | 1.13.0 |" in part
    assert "| A | native | 512 | 0 | aaaaaaaa | aaaaaaaa |" in part
    assert "| B | interpreted | | | aaaaaaaa | |" in part
    assert "All hashes equal, and so is every register and every double of the state at each mark." in part


def test_a_failed_run_shows(shown):
    failed = {"environment": "B", "target": "generic", "error": "ended by SIGILL"}
    part = shown(result_of([run_of(), failed]))
    assert "| B | generic | | | failed | failed |" in part
    assert "B generic: ended by SIGILL" in part


@pytest.mark.parametrize(("marks", "code"), [({"10000": ONE}, 0), ({"10000": OTHER}, 1)])
def test_the_exit_code_says_whether_all_are_equal(tmp_path, monkeypatch, capsys, marks, code):
    monkeypatch.setattr(portability, "ROOT", tmp_path)
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    monkeypatch.setattr(portability, "measure", lambda *_: [run_of(), run_of("B", marks=marks)])
    assert portability.main(["--engine", "clocked", "--also", sys.executable]) == code
    assert json.loads((tmp_path / "build" / "portability.json").read_text())["seconds"] == 60.0
    assert not (tmp_path / "portability.json").exists()
    assert portability.main(["--engine", "clocked", "--page"]) == code
    assert "aaaaaaaa" in results.results_markdown("portability")
    assert "Hash of all codes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (["--seconds", "0.001"], "--seconds = 0.001 is outside 0.01 to 3600 s"),
        (["--seconds", "nan"], "--seconds = nan is outside 0.01 to 3600 s"),
        (["--engine", "warp"], "--engine = warp is none of "),
        (["--engine", "clocked", "--also", "/nowhere/python"], "--also = /nowhere/python is not an interpreter"),
    ],
)
def test_a_mistake_is_one_line(given, line, capsys):
    with pytest.raises(SystemExit) as raised:
        portability.main(given)
    assert raised.value.code == 2
    assert f"error: {line}" in capsys.readouterr().err


def test_the_page_holds_a_measurement():
    """docs/results/portability.json holds the tables, the command that wrote them, and no difference."""
    page = results.results_markdown("portability")
    assert "Measured with `python -m tests.testbench.bench.portability" in page
    assert "All hashes equal" in page
    for target in TARGETS:
        assert f"| A | {target.name} |" in page
        assert f"| B | {target.name} |" in page


@pytest.mark.slow
@compiled
def test_all_targets_give_the_same_bits():
    runs = portability.measure([sys.executable], "clocked", 20_000, lambda _: None)
    assert portability.problems(runs) == []

"""The same bits everywhere: one hash of all codes, whatever compiles the kernels.

    native        code for the processor at hand, with AVX-512 if it has that
    haswell       code for AVX2, without AVX-512
    generic       code for any processor of the architecture: SSE2 on x86-64
    interpreted   the same source run by CPython, without compiler, for its first 10 ms

Each runs in a fresh process with an empty cache of its own, in this interpreter and in others (`--also`, `--make-old`).
What is compared: every DAC and ADC code and word of the loops, and at each mark every register and double of the state.
With `--tests` each interpreter also runs the fast tests of CORE: at the lowest versions and at those at hand.

    python -m tests.testbench.bench.portability [--seconds 60] [--engine NAME] [--also PYTHON ..]
        [--make-old DIR] [--tests] [--page]

prints a table and writes build/portability.json; exit code 1 if anything differs.
Source  docs/portability.md
"""

import argparse
import hashlib
import json
import os
import platform
import re
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np

from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench.bench.machine import cpu, versions
from testbench.config import Config, Scenario, changed
from testbench.console.markdown import ROOT
from testbench.console.results import write_results
from testbench.console.text_table import Table
from testbench.run.simulation import Simulation
from testbench.storage.files import write_text

COMMAND = "python -m tests.testbench.bench.portability"
SECONDS, SECONDS_LIMIT = 60.0, 3600.0
INTERPRETED_TICKS = 10_000
VARIED_TICKS = 2_000_000
SHOWN = 8  # hexadecimal digits of a hash in a table


class Target(NamedTuple):
    """What compiles the kernels: environment of the process."""

    name: str
    environment: dict


TARGETS = (
    Target("native", {}),
    # without the second variable Numba keeps the features of the host, AVX-512 among them
    Target("haswell", {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}),
    Target("generic", {"NUMBA_CPU_NAME": "generic"}),
    Target("interpreted", {"NUMBA_DISABLE_JIT": "1"}),
)


class Case(NamedTuple):
    """A configuration, run from power-on: its values, longest time in ticks, range of temperatures."""

    name: str
    values: dict
    limit_ticks: Any
    temp_degc: tuple


CASES = (
    Case("default", {}, None, (25.0, 25.0)),
    Case(
        "varied",
        {
            "firmware.board": "digital_sid",
            "firmware.adc_clock": "free_running",
            "plant.adc_clock_ppm": 37.0,
            "effects.duffing_k3_per_um2": 1e-5,
            "effects.drive_cubic_per_v2": 1e-4,
            "effects.feedthrough_y": 1e-5,
            "effects.laws": ["force_x = -1e6 x^3", "force_y = 1e-12 u^3 temp"],
            "effects.drive_dac_levels": ["element 5/8 = -2.0", "bit 7 = 0.1"],
            "effects.sense_dac_levels": ["step 3/4 = 0.3"],
        },
        VARIED_TICKS,
        (24.0, 26.0),
    ),
)


# ---- in the process that is looked at --------------------------------------------------------------------------------


class Nowhere:
    """A sink that keeps nothing: a minute of rows is not needed."""

    def add(self, first_frame, frames, truth):
        pass


def marks_of(ticks):
    """Ticks at which hashes are taken: 10 ms, 0.1 s, 1 s, ... and the end."""
    marks, mark = [], INTERPRETED_TICKS
    while mark < ticks:
        marks.append(mark)
        mark *= 10
    return [*marks, ticks]


def stimulus(case, tick, ticks):
    """Rate (rad/s) and temperature (degC) of each frame; the varied case moves both, in exact doubles."""
    lo, hi = case.temp_degc
    if lo == hi:
        return 0.0, lo
    frame = tick // FRAME_TICKS + np.arange(ticks // FRAME_TICKS + 2)
    return (frame % 1600 - 800) / 512.0, lo + (frame % 1024) * ((hi - lo) / 1024)


def state_sha256(sim):
    """Hash of every register and every double that a run continues from."""
    digest = hashlib.sha256()
    for name, value in sorted(sim.state_values().items()):
        value = np.asarray(value)
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value, value.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def hashes(case, engine, ticks):
    """{tick: [hash of codes, hash of state]} of a run from power-on."""
    ticks = min(ticks, case.limit_ticks or ticks)
    sim = Simulation(changed(Config(), case.values), *case.temp_degc, engine=engine)
    sim.sinks.append(Nowhere())
    sim.now = tuple(np.atleast_1d(v)[:1] for v in stimulus(case, 0, FRAME_TICKS))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    found = {}
    for mark in marks_of(ticks):
        sim.advance(mark - sim.tick, *stimulus(case, sim.tick, mark - sim.tick))
        found[str(mark)] = [sim.codes_sha256(), state_sha256(sim)]
    return {"marks": found, "locked": bool(sim.locked)}


REGISTERS = (("zmm", 512), ("ymm", 256), ("xmm", 128))
FUSED = re.compile(r"\b(?:v?fn?m(?:add|sub)\w*|fml[as])\b")
CALLED = re.compile(r"(?:\bmovabs\w*[ \t]+\$|\bcallq?[ \t]+|\bbl[ \t]+)([A-Za-z]\w*)")
NOT_C = ("Py", "numba_", "NRT_")
# C functions whose result has no freedom: one exact answer, or none at all
EXACT = {"floor", "ceil", "trunc", "rint", "sqrt", "fabs", "memset", "memcpy", "memmove"}


def machine_code(texts):
    """What counts in assembler texts: widest vector register (bits), fused multiply-adds, C functions that round."""
    widest, fused, called = 0, 0, set()
    for text in texts:
        widest = max([widest, *(bits for name, bits in REGISTERS if name in text)])
        fused += len(FUSED.findall(text))
        called |= {name for name in CALLED.findall(text) if not name.startswith(NOT_C)}
    return {"bits": widest, "fused": fused, "c_functions": sorted(called - EXACT)}


def compiled_texts(modules):
    """Assembler of every kernel of {name: module} compiled for calls from Python, with all that it calls."""
    seen = set()
    for name, module in list(modules.items()):
        if name.split(".")[0] in ("fpga_model", "analog_frontend", "testbench"):
            for item in vars(module).values():
                options = getattr(item, "targetoptions", None)
                if options is None or options.get("no_cpython_wrapper") or id(item) in seen:
                    continue
                seen.add(id(item))
                if not options.get("forceinline"):
                    yield from (result.library.get_asm_str() for result in item.overloads.values())


def child(engine, ticks):
    """Run all cases in this process and print what came out as one JSON object."""
    cases = {case.name: hashes(case, engine, ticks) for case in CASES}
    print(json.dumps({"versions": versions(), "code": machine_code(compiled_texts(sys.modules)), "cases": cases}))


# ---- many processes --------------------------------------------------------------------------------------------------

CHILD = "import sys; from tests.testbench.bench.portability import child; child(sys.argv[1], int(sys.argv[2]))"


def targets(machine):
    """The targets that exist on a kind of machine."""
    return [t for t in TARGETS if t.name != "haswell" or machine.lower() in ("x86_64", "amd64")]


def environment_of(target, cache):
    """Environment of a child: nothing of ours or Numba's but what the target says."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "GYRO_"))}
    return inherited | {"PYTHONPATH": str(ROOT), "GYRO_CACHE": str(cache)} | target.environment


def failure(done):
    """One line about a process that failed."""
    if done.returncode < 0:
        return f"ended by {signal.Signals(-done.returncode).name}"
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return lines[-1] if lines else f"exit code {done.returncode}"


def play(interpreter, target, engine, ticks):
    """One process; what `child` prints, or {"error": line}."""
    ticks = min(ticks, INTERPRETED_TICKS) if target.name == "interpreted" else ticks
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [str(interpreter), "-c", CHILD, engine, str(ticks)],
            env=environment_of(target, cache),
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
    return {"error": failure(done)} if done.returncode else json.loads(done.stdout.splitlines()[-1])


def measure(interpreters, engine, ticks, say=print):
    """All processes, one after the other: [{"environment": letter, "target": name, ...}]."""
    runs = []
    for letter, interpreter in zip("ABCDEFGHIJKLMNOPQRSTUVWXYZ", interpreters):
        for target in targets(platform.machine()):
            began = time.perf_counter()
            run = {"environment": letter, "target": target.name} | play(interpreter, target, engine, ticks)
            runs.append(run | {"wall_s": round(time.perf_counter() - began, 1)})
            say(f"{letter} {target.name}: {run.get('error', 'done')} ({runs[-1]['wall_s']} s)")
    return runs


def problems(runs):
    """One line for each run that failed, may round otherwise, or differs from the first one."""
    found = []
    first = runs[0].get("cases", {})
    for run in runs:
        name = f"{run['environment']} {run['target']}"
        if "error" in run:
            found.append(f"{name}: {run['error']}")
            continue
        if run["code"]["fused"]:
            found.append(
                f"{name}: {run['code']['fused']} fused multiply-adds; they round once where others round twice"
            )
        if run["code"]["c_functions"]:
            found.append(f"{name}: kernels call {', '.join(run['code']['c_functions'])}; C libraries round differently")
        for case, result in run["cases"].items():
            wanted = first.get(case, {}).get("marks", {})
            common = [mark for mark in result["marks"] if mark in wanted]
            if first and not common:
                found.append(f"{name}: {case}: no instant in common with {runs[0]['environment']} {runs[0]['target']}")
            for mark in common:
                pairs = zip(("codes", "state"), result["marks"][mark], wanted[mark])
                unequal = [which for which, mine, other in pairs if mine != other]
                if unequal:
                    what = f"unequal {' and '.join(unequal)} at {int(mark) / TICK_HZ:g} s"
                    found.append(f"{name}: {case}: {what} beside {runs[0]['environment']} {runs[0]['target']}")
                    break
    return found


# Firmware, plant, engines, files and configuration: what a version of a library can change
CORE = ("tests/fpga_model", "tests/analog_frontend", "tests/testbench/engines", "tests/testbench/storage",
        "tests/testbench/config")  # fmt: skip
# lowest versions meet the newest of what they depend on, which warns them
PYTEST = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "2", "--dist", "loadfile", "--benchmark-disable",
          "-W", "ignore::DeprecationWarning")  # fmt: skip


def core_tests(interpreters, say=print, core=CORE):
    """[{"environment": letter, "passed": bool, "tests": last line of pytest}], one interpreter after the other."""
    found = []
    for letter, interpreter in zip("ABCDEFGHIJKLMNOPQRSTUVWXYZ", interpreters):
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [str(interpreter), *PYTEST, *core], env=environment, cwd=ROOT, capture_output=True, text=True
        )
        lines = [line for line in done.stdout.splitlines() if line.strip()] or [failure(done)]
        found.append({"environment": letter, "passed": done.returncode == 0, "tests": lines[-1].strip("= ")})
        say(f"{letter} tests: {lines[-1]}")
    return found


# ---- the lowest versions ---------------------------------------------------------------------------------------------


# Simulators' companions: they run bundles, not this project, and some are no wheels
COMPANIONS = {"apytypes", "cocotb", "vunit-hdl"}


def lowest(text):
    """Requirements `name==version` of the lower bounds in a pyproject.toml, those for tests included.

    All but COMPANIONS, which have nothing to do with numbers.
    """
    project = tomllib.loads(text)["project"]
    pinned = []
    for requirement in project["dependencies"] + project["optional-dependencies"]["test"]:
        found = re.fullmatch(r"([A-Za-z][\w.-]*)>=(\d+(?:\.\d+)*)(,<\d+)?", requirement)
        if not found:
            raise ValueError(f"pyproject.toml: {requirement!r} is not of the form name>=version[,<version]")
        if found[1] not in COMPANIONS:
            pinned.append(f"{found[1]}=={found[2]}")
    return pinned


def make_old(folder):
    """A virtual environment of this Python with the lowest versions; returns its interpreter."""
    folder = Path(folder)
    pip = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary=:all:")
    python = folder.absolute() / "bin" / "python"
    steps = (
        (sys.executable, "-m", "venv", str(folder)),
        (str(python), *pip, *lowest((ROOT / "pyproject.toml").read_text())),
    )
    for step in steps:
        done = subprocess.run(step, capture_output=True, text=True)
        if done.returncode:
            errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or [failure(done)]
            raise ValueError(f"the lowest versions on Python {platform.python_version()}: {errors[-1]}")
    return python


# ---- showing ---------------------------------------------------------------------------------------------------------


def ends(runs):
    """{case: (first mark, last mark)} over all runs."""
    marks = {}
    for run in runs:
        for case, result in run.get("cases", {}).items():
            marks.setdefault(case, set()).update(int(mark) for mark in result["marks"])
    return {case: sorted({min(found), max(found)}) for case, found in marks.items()}


def result_tables(result):
    """Environments, and hashes of all codes: two tables."""
    runs = result["runs"]
    columns = [(case, mark) for case, marks in ends(runs).items() for mark in marks]
    known = {run["environment"]: run["versions"] for run in runs if "versions" in run}
    names = list(next(iter(known.values()), {}))
    environments = [(letter, *found.values()) for letter, found in known.items()]
    rows = []
    for run in runs:
        cells = ["failed"] * len(columns)
        code = run.get("code", {"bits": 0, "fused": 0})
        if "cases" in run:
            marks = [run["cases"][case]["marks"].get(str(mark)) for case, mark in columns]
            cells = [found[0][:SHOWN] if found else "" for found in marks]
        compiled = code["bits"] > 0
        rows.append(
            (
                run["environment"],
                run["target"],
                str(code["bits"]) if compiled else "",
                "" if not compiled else str(code["fused"]),
                *cells,
            )
        )
    heads = ("", "code", "bits", "fused", *(f"{case}, {mark / TICK_HZ:g} s" for case, mark in columns))
    lines = result["problems"] or [
        "All hashes equal, and so is every register and every double of the state at each mark."
    ]
    tested = {test["environment"]: test["tests"] for test in result.get("tests", ())}
    if tested:
        names = [*names, "fast tests of the core"]
        environments = [(*row, tested.get(row[0], "")) for row in environments]
    return [
        Table("Environments", ("", *names), environments, numeric=()),
        Table("Hash of all codes, first digits", heads, rows, " ".join(lines), tuple(range(2, len(heads)))),
    ]


def stored_results(result):
    """(command, tables) that docs/results/portability.json holds."""
    environments, found = (table._replace(title="") for table in result_tables(result))
    command = f"{COMMAND} --engine {result['engine']} --seconds {result['seconds']:g}"
    return command, [environments._replace(note=f"Measured on {result['cpu']}."), found]


def _engines():
    return get_args(Scenario.model_fields["engine"].annotation)


def arguments(given):
    """Checked arguments; exits with one line and code 2."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.testbench.bench.portability", description="The same bits everywhere?"
    )
    parser.add_argument("--seconds", type=float, default=SECONDS, help="simulated time of the default configuration")
    parser.add_argument("--engine", default="frame", help="engine of all runs")
    parser.add_argument("--also", nargs="+", default=[], metavar="PYTHON", help="interpreters of other environments")
    parser.add_argument("--make-old", metavar="DIR", help="make an environment of the lowest versions, and run it too")
    parser.add_argument("--tests", action="store_true", help="run the fast tests of the core in each of them, too")
    parser.add_argument("--page", action="store_true", help="store the tables in docs/results/portability.json")
    options = parser.parse_args(given)
    least = INTERPRETED_TICKS / TICK_HZ
    if not least <= options.seconds <= SECONDS_LIMIT:
        parser.error(f"--seconds = {options.seconds:g} is outside {least:g} to {SECONDS_LIMIT:g} s")
    if options.engine not in _engines():
        parser.error(f"--engine = {options.engine} is none of {' | '.join(_engines())}")
    for python in options.also:
        if not os.access(python, os.X_OK) or Path(python).is_dir():
            parser.error(f"--also = {python} is not an interpreter that can be run")
    return options


def main(given=None):
    """Measure, print, write; returns the exit code."""
    options = arguments(given)
    interpreters = [sys.executable, *(Path(python).absolute() for python in options.also)]
    try:
        if options.make_old:
            interpreters.append(make_old(options.make_old))
    except (OSError, ValueError) as problem:
        print(f"--make-old = {options.make_old}: {problem}", file=sys.stderr)
        return 2
    ticks = round(options.seconds * TICK_HZ)

    def say(line):
        print(line, file=sys.stderr, flush=True)

    # not needed by the children, which another environment may run
    from testbench.console.show import print_tables

    runs = measure(interpreters, options.engine, ticks, say)
    tests = core_tests(interpreters, say) if options.tests else []
    result = {
        "cpu": cpu(),
        "engine": options.engine,
        "seconds": options.seconds,
        "problems": problems(runs) + [f"{t['environment']} tests: {t['tests']}" for t in tests if not t["passed"]],
        "runs": runs,
        "tests": tests,
    }
    print_tables(result_tables(result))
    (ROOT / "build").mkdir(exist_ok=True)
    write_text(ROOT / "build" / "portability.json", json.dumps(result, indent=1) + "\n")
    written = ["build/portability.json"]
    if options.page:
        write_results("portability", *stored_results(result))
        written.append("docs/results/portability.json")
    print(f"written: {', '.join(written)}")
    return 1 if result["problems"] else 0


if __name__ == "__main__":
    sys.exit(main())

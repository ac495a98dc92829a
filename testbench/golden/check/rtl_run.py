"""Run somebody's design with a bundle's stimulus and bring back every register of every row.

    build the design with a logging bench (loggers.py) in a temporary folder --> run --> rows.txt --> columns

The bundle is only read: what the design may open is copied. Simulators run in a process group of their own, which is
killed when the time is over or when it writes without end. Icarus, Verilator and GHDL; what they say about ports is
said again in one line.
Source  docs/golden.md (checking a design)
"""

import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model.fixed import Fmt
from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, design_entry
from testbench.golden.bundles.benches import PARTS
from testbench.golden.check import loggers
from testbench.golden.check.compare import BEFORE, Column, against

TIMEOUT_S = 120.0
LINES = 5  # of a tool's complaint that are shown
SAID_BYTES = 1 << 22  # a design that prints more than this is stopped


class Simulator(NamedTuple):
    """A simulator: its program, the suffix of its designs, and how it is built and run."""

    program: str
    suffix: str


SIMULATORS = {
    "icarus": Simulator("iverilog", "v"),
    "verilator": Simulator("verilator", "v"),
    "ghdl": Simulator("ghdl", "vhd"),
}
# What the tools say of ports and parameters: (pattern, our words)
SAYINGS = (
    (r"Port \d+ \((?P<port>\w+)\) of \S+ expects (?P<has>\d+) bits, got (?P<want>\d+)", "width"),
    (r"port connection '(?P<port>\w+)' expects (?P<has>\d+) bits .* generates (?P<want>\d+) bits", "width"),
    (r"port ``(?P<port>\w+)'' is not a port of", "absent"),
    (r"%Error-PINNOTFOUND: \S+ Pin not found: '(?P<port>\w+)'", "absent"),
    (r"parameter (?P<port>\w+) not found in", "no parameter"),
    (r"Parameter pin (?:not found|is not an .*): '(?P<port>\w+)'", "no parameter"),
    (r"dangling input port \d+ \((?P<port>\w+)\)", "extra"),
    (r"%Warning-PINMISSING: \S+ Cell has missing pin: '(?P<port>\w+)'", "extra"),
    (r"log\.vhd:\d+:\d+: no declaration for \"(?P<port>\w+)\"", "absent"),
    (r"log\.vhd:(?P<line>\d+):\d+: actual constraints don't match formal ones", "vhdl width"),
    (r"log\.vhd:(?P<line>\d+):\d+: can't associate .*", "vhdl width"),
    (r"log\.vhd:\d+:\d+: no actual for (?:port|generic) \"(?P<port>\w+)\"", "extra"),
)


class _Runner:
    """Commands in one folder, all within one time limit."""

    def __init__(self, folder, timeout_s):
        self.folder, self.timeout_s = folder, timeout_s
        self.end = time.monotonic() + timeout_s

    def __call__(self, *command):
        """(exit code, what it said); raises FileError when the time is over."""
        said = self.folder / "said.txt"
        with open(said, "wb") as out:
            process = subprocess.Popen(
                [str(word) for word in command],
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                self._wait(process, said, command)
            finally:
                # also what the tool has started and left behind
                try:
                    os.killpg(process.pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
                process.wait()
        with open(said, "rb") as out:
            return process.returncode, out.read(SAID_BYTES).decode("utf-8", "replace")

    def _wait(self, process, said, command):
        pause_s = 0.002
        while True:
            try:
                process.wait(pause_s)
                return
            except subprocess.TimeoutExpired:
                pause_s = min(2 * pause_s, 0.1)
            if time.monotonic() > self.end:
                raise FileError(
                    f"{Path(command[0]).name}: stopped after {self.timeout_s:g} s: the design hangs or is slow"
                )
            if said.stat().st_size > SAID_BYTES:
                raise FileError(f"{Path(command[0]).name}: stopped: the design prints more than {SAID_BYTES >> 20} MiB")


def _complaints(said, bench, manifest):
    """Our words for what a tool says about ports; sorted out once each, in order."""
    widths = {p["name"]: p["width"] for p in manifest["inputs"]}
    widths |= {name: p["width"] for name, p in loggers.results(manifest)}
    widths |= {name: width for name, width, _, _ in loggers.parameters(manifest)}
    widths |= {name: 32 for name, _ in design_entry.told(manifest)}
    out = {}
    # only what is said of the bench: a part inside the design may have ports of the same names
    for line in (line for line in said.splitlines() if re.search(r"(^|\s)log\.v(hd)?:\d", line)):
        for pattern, kind in SAYINGS:
            found = re.search(pattern, line)
            if not found:
                continue
            words = found.groupdict()
            port = words.get("port") or loggers.port_of_line(bench, int(words["line"]))
            if port not in widths and kind != "extra":
                continue
            out[port] = {
                "width": f"port {port} has {words.get('has')} bits, the bundle has {widths.get(port)}",
                "vhdl width": f"port {port} is not of the {widths.get(port)} bits of the bundle",
                "absent": f"port {port} is missing",
                "no parameter": f"parameter {port} is missing",
                "extra": f"input {port} is not in the bundle and stays open",
            }[kind]
    return list(out.values())


def _first_lines(said):
    """The lines of a tool's output that tell most: those with an error, else the first."""
    lines = [line.rstrip() for line in said.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()]
    return "\n".join(f"  {line}" for line in (errors or lines)[:LINES]) or "  (it said nothing)"


def _sources(rtl, block, suffix):
    rtl = Path(rtl)
    wanted = rtl / f"{block}.{suffix}"
    if not rtl.is_dir():
        raise FileError(f"{rtl}: not a folder")
    if not wanted.is_file():
        raise FileError(f"{wanted}: no design: gyro_{block} is looked for there")
    parts = [rtl / f"{part}.{suffix}" for part in PARTS.get(block, ())]
    return [path.resolve() for path in (*parts, wanted) if path.is_file()]


def choose(sim, rtl, block):
    """Name of the simulator: the one asked for, or one that is installed for the design that is there."""
    if sim is not None and sim not in SIMULATORS:
        raise ConfigError(f"sim: {sim!r} is not one of {', '.join(SIMULATORS)}")
    names = [sim] if sim else [k for k, s in SIMULATORS.items() if (Path(rtl) / f"{block}.{s.suffix}").is_file()]
    if not names:
        raise FileError(f"{Path(rtl)}: no design: neither {block}.v nor {block}.vhd with module or entity gyro_{block}")
    for name in names:
        if shutil.which(SIMULATORS[name].program):
            return name
    raise FileError(f"{SIMULATORS[names[0]].program}: not installed; {names[0]} is needed to run the design")


def _build(sim, run, bench, sources):
    """Build `bench` and the design; returns the command that simulates, and what the tools said."""
    if sim == "icarus":
        where = [word for folder in dict.fromkeys(path.parent for path in sources) for word in ("-I", folder)]
        done = run("iverilog", "-g2012", "-Wportbind", "-s", loggers.TOP, "-I", ".", *where, "-o", "log.vvp", bench,
                   *sources)  # fmt: skip
        return ("vvp", "-n", "log.vvp"), *done
    if sim == "verilator":
        where = [f"-I{folder}" for folder in dict.fromkeys(path.parent for path in sources)]
        flags = ("-Wno-fatal", "-Wno-lint", "-Wno-style", "-Wwarn-WIDTH", "-Wwarn-PINMISSING")
        done = run("verilator", "--binary", "--timing", *flags, "-I.", *where, "--top-module", loggers.TOP, "--Mdir",
                   "built", "-o", "log", bench, *sources)  # fmt: skip
        return (run.folder / "built" / "log",), *done
    known = [name for name in ("params_pkg.vhd",) if (run.folder / name).is_file()]
    code, said = run("ghdl", "-a", "--std=08", *known, *sources)
    if code == 0:
        code, said = run("ghdl", "-a", "--std=08", bench)
    if code == 0:
        code, more = run("ghdl", "-e", "--std=08", loggers.TOP)
        said += more
    return ("ghdl", "-r", "--std=08", loggers.TOP), code, said


def _columns(path, manifest):
    """{name: Column} of rows.txt: a word with anything but hexadecimal digits in it is unknown."""
    ports = manifest["registers"] + manifest["outputs"]
    lines = path.read_text("ascii", "replace").splitlines() if path.is_file() else []
    values = np.zeros((len(ports), len(lines)), np.int64)
    known = np.zeros((len(ports), len(lines)), bool)
    masks = [((1 << p["width"]) - 1, Fmt(*p["fmt"])) for p in ports]
    for n, line in enumerate(lines):
        words = line.split()
        if len(words) != len(ports):
            raise FileError(f"{path.name}: row {n} has {len(words)} words instead of {len(ports)}")
        for k, word in enumerate(words):
            try:
                value = int(word, 16)
            except ValueError:
                continue
            mask, fmt = masks[k]
            value &= mask
            values[k, n] = value - mask - 1 if fmt.s and value > fmt.hi else value
            known[k, n] = True
    return {p["name"]: Column(values[k], known[k]) for k, p in enumerate(ports)}


def log(folder, manifest, rtl, sim=None, timeout_s=TIMEOUT_S):
    """{port: Column} of every register and pin of the design in folder `rtl`.

    folder    of a verified bundle with this manifest
    rtl       folder with BLOCK.v or BLOCK.vhd
    sim       icarus, verilator or ghdl; None takes one that is installed and fits
    Raises FileError with one clear message if the design does not build, run or end, ConfigError for a wrong argument.
    """
    block = manifest["block"]
    if not 0 < timeout_s <= 86400:
        raise ConfigError(f"timeout: {timeout_s} s is outside 0 .. 86400 s")
    sim = choose(sim, rtl, block)
    simulator = SIMULATORS[sim]
    sources = _sources(rtl, block, simulator.suffix)
    if shutil.which(simulator.program) is None:
        raise FileError(f"{simulator.program}: not installed; {sim} is needed to run the design")
    roms = sorted(name for name in manifest["sha256"] if name.startswith("rom/") and name.endswith(".hex"))
    bench = getattr(loggers, "vhdl" if simulator.suffix == "vhd" else "verilog")(manifest, roms[0] if roms else None)
    with tempfile.TemporaryDirectory(prefix="gyro-check-") as place:
        place = Path(place).resolve()
        for name in ("stim.hex", "params.vh", "params.svh", "params_pkg.vhd", *roms):
            if name in manifest["sha256"]:
                (place / name).parent.mkdir(exist_ok=True)
                shutil.copyfile(Path(folder) / name, place / name)
        name = f"log.{simulator.suffix}"
        (place / name).write_text(bench)
        run = _Runner(place, timeout_s)
        command, code, said = _build(sim, run, name, sources)
        complaints = _complaints(said, bench, manifest)
        if code or complaints:
            why = "; ".join(complaints)
            raise FileError(
                f"{sources[-1]}: {why}" if why else f"{sources[-1]}: does not build under {sim}:\n{_first_lines(said)}"
            )
        code, said = run(*command)
        columns = _columns(place / loggers.ROWS, manifest)
        rows = len(next(iter(columns.values())).values)
        if rows < manifest["n"]:
            raise FileError(
                f"{sources[-1]}: the simulation ended after {rows} of {manifest['n']} rows:\n{_first_lines(said)}"
            )
    return columns


def check(folder, rtl, sim=None, timeout_s=TIMEOUT_S, before=BEFORE):
    """Compare the design in folder `rtl` with the bundle in `folder`; returns a `compare.Report`."""
    golden = bundle.read(folder)
    if golden.manifest["block"] == "top":
        raise FileError(f"{folder}: top is compared by its own bench for now: make -C {folder} check RTL={rtl}")
    return against(golden, log(folder, golden.manifest, rtl, sim, timeout_s), before)

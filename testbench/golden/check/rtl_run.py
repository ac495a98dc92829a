"""Run somebody's design with a bundle's stimulus and bring back every register of every row.

    build the design with a logging bench (loggers.py) in a temporary folder --> run --> rows.txt --> columns

The bundle is only read: what the design may open is copied. Simulators run in a process group of their own, which is
killed when the time is over or when it writes without end. Icarus, Verilator and GHDL; what they say about ports is
said again in one line.
Source  docs/golden.md (checking a design)
"""

import itertools
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from fpga_model.fixed import Fmt
from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, design_entry
from testbench.golden.check import design_run, loggers
from testbench.golden.check.compare import BEFORE, Column, compare_bundle
from testbench.golden.foreign import comparison_scope

TIMEOUT_S = 120.0
LINES = 5  # of a tool's complaint that are shown
MOST_OUTPUT_BYTES = 1 << 22  # a design that prints more than this is stopped


# What the tools say of ports and parameters: (pattern, our words)
PORT_MESSAGE_PATTERNS = (
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
    (r"wrap\.vhd:\d+:\d+: can't associate '\w+' with (?:port|generic) \"(?P<port>\w+)\"", "vhdl type"),
    (r"(?:log|wrap)\.vhd:\d+:\d+: port \"(?P<port>\w+)\" is not an interface name", "absent"),
    (r"(?:Unknown module type: |containing module: '|unit \")(?P<port>\w+)", "no module"),
    (r"log\.vhd:\d+:\d+: no actual for port \"(?P<port>\w+)\"", "extra"),
    (r"(?:log|wrap)\.vhd:\d+:\d+: no actual for generic \"(?P<port>\w+)\"", "no value"),
    (r": Port \d+ \((?P<port>\w+)\) of \S+ is connected to", "output"),
    (r"log\.vhd:(?P<line>\d+):\d+: only 'in' ports may be associated with expression", "output"),
    (r"%Warning-UNDRIVEN: \S+ Signal is not driven: '(?:d_)?(?P<port>\w+)'", "undriven"),
)
UNDRIVEN = "has no driver: the design declares it as an input, or does not assign it"


class Runner:
    """Commands in one folder, all within one time limit."""

    def __init__(self, folder, timeout_s, output_limit_bytes=MOST_OUTPUT_BYTES):
        self.folder, self.timeout_s, self.output_limit_bytes = folder, timeout_s, output_limit_bytes
        self.end = time.monotonic() + timeout_s

    def __call__(self, *command):
        """(exit code, what it said); raises FileError when the time is over."""
        output_path = self.folder / "said.txt"
        with open(output_path, "wb") as out:
            process = subprocess.Popen(
                [str(word) for word in command],
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                self._wait(process, output_path, command)
            finally:
                # also what the tool has started and left behind
                try:
                    os.killpg(process.pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
                process.wait()
        with open(output_path, "rb") as out:
            return process.returncode, out.read(self.output_limit_bytes).decode("utf-8", "replace")

    def _wait(self, process, output_path, command):
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
            if output_path.stat().st_size > self.output_limit_bytes:
                limit_mib = self.output_limit_bytes >> 20
                raise FileError(f"{Path(command[0]).name}: stopped: the design prints more than {limit_mib} MiB")


def _complaints(tool_output, texts, manifest, design):
    """Our words for what a tool says about ports; sorted out once each, in order. `texts` are {file: text} of ours."""
    widths = {p["name"]: p["width"] for p in manifest["inputs"]}
    widths |= {name: p["width"] for name, p in loggers.logged_ports(manifest)}
    parameters = {name: width for name, width, _, _ in loggers.parameters(manifest)}
    parameters |= {name: 32 for name, _ in design_entry.rtl_parameters(manifest)}
    widths |= parameters
    widths |= design.widths()
    out, spelled = {}, {name.lower(): name for name in widths}
    # only what is said of the bench: a part inside the design may have ports of the same names
    for line in tool_output.splitlines():
        location_match = re.search(r"(?:^|[\s/])((?:log|wrap)\.v(?:hd)?):\d", line)
        for pattern, kind in PORT_MESSAGE_PATTERNS if location_match else ():
            message_match = re.search(pattern, line)
            if not message_match:
                continue
            words = message_match.groupdict()
            port = words.get("port") or loggers.port_of_line(texts.get(location_match[1], ""), int(words["line"]))
            port = spelled.get(port, port)  # GHDL says names in lower case
            if port not in widths and kind not in ("extra", "no value", "no module"):
                continue
            if kind == "absent" and port in parameters:
                kind = "no parameter"
            out[port] = {
                "width": f"port {port} has {words.get('has')} bits, {design.interface_source} has {widths.get(port)}",
                "vhdl width": f"port {port} does not have the {widths.get(port)} bits of {design.interface_source}",
                "vhdl type": f"{port} has another type than {design.interface_source} says; set `type` in its entry",
                "absent": f"port {port} is missing",
                "no module": f"no module or entity {port}; name yours with --top, or with `top` in a map",
                "no parameter": f"parameter {port} is missing; list those of your design in [parameters] of a map",
                "extra": f"input {port} is not in {design.interface_source}, so nothing drives it",
                "no value": f"parameter {port} is not in {design.interface_source}; "
                "give it a value in [constants] of a map",
                "output": f"port {port} is an output of the design, but an input in {design.interface_source}",
                "undriven": f"port {port} {UNDRIVEN}",
            }[kind]
    hint = design.hint([port for port, words in out.items() if words == f"port {port} is missing"])
    return [*out.values(), *hint]


def first_lines(tool_output):
    """The lines of a tool's output that tell most: those with an error, else the first."""
    lines = [line.rstrip() for line in tool_output.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()]
    return "\n".join(f"  {line}" for line in (errors or lines)[:LINES]) or "  (no output)"


def _build(sim, run, ours, design):
    """Build the design with our files, the bench last of them; (command that simulates, exit code, what was said)."""
    sources = design.sources
    if sim == "icarus":
        where = [word for folder in sources.includes for word in ("-I", folder)]
        macros = [f"-D{macro}" for macro in sources.defines]
        result = run("iverilog", "-g2012", "-Wportbind", "-s", loggers.TOP, "-I", ".", *where, *macros, "-o", "log.vvp",
                   *ours, *sources.files)  # fmt: skip
        return ("vvp", "-n", "log.vvp"), *result
    if sim == "verilator":
        where = [f"-I{folder}" for folder in sources.includes] + [f"-D{macro}" for macro in sources.defines]
        flags = ("-Wno-fatal", "-Wno-lint", "-Wno-style", "-Wwarn-WIDTH", "-Wwarn-PINMISSING", "-Wwarn-UNDRIVEN")
        result = run("verilator", "--binary", "--timing", *flags, "-I.", *where, "--top-module", loggers.TOP, "--Mdir",
                   "built", "-o", "log", *ours, *sources.files)  # fmt: skip
        return (run.folder / "built" / "log",), *result
    steps = [("work", name) for name in ("params_pkg.vhd",) if (run.folder / name).is_file()]
    steps += [(library or design.library, file) for file, library in zip(sources.files, sources.libraries)]
    for library, group in itertools.groupby([*steps, *(("work", name) for name in ours)], lambda step: step[0]):
        code, tool_output = run("ghdl", "-a", "--std=08", f"--work={library}", *(file for _, file in group))
        if code:
            break
    else:
        code, more = run("ghdl", "-e", "--std=08", loggers.TOP)
        tool_output += more
    return ("ghdl", "-r", "--std=08", loggers.TOP), code, tool_output


def _columns(path, result_ports, what):
    """{name: Column} of rows.txt: a word with anything but hexadecimal digits in it is unknown.

    FileError that names the design, `what`, for a port that is z in every bit and row: nothing drives it
    """
    ports = [p for _, p in result_ports]
    lines = path.read_text("ascii", "replace").splitlines() if path.is_file() else []
    values = np.zeros((len(ports), len(lines)), np.int64)
    valid_words = np.zeros((len(ports), len(lines)), bool)
    masks = [((1 << p["width"]) - 1, Fmt(*p["fmt"])) for p in ports]
    floating = set(range(len(ports)))
    for n, line in enumerate(lines):
        words = line.split()
        if len(words) != len(ports):
            raise FileError(f"{path.name}: row {n} has {len(words)} words instead of {len(ports)}")
        for k, word in enumerate(words):
            if k in floating and word.strip("zZ"):
                floating.remove(k)
            try:
                value = int(word, 16)
            except ValueError:
                continue
            mask, fmt = masks[k]
            value &= mask
            values[k, n] = value - mask - 1 if fmt.s and value > fmt.hi else value
            valid_words[k, n] = True
    if lines and floating:
        raise FileError(f"{what}: port {result_ports[min(floating)][0]} {UNDRIVEN}")
    return {p["name"]: Column(values[k], valid_words[k]) for k, p in enumerate(ports)}


def log(folder, manifest, rtl, sim=None, timeout_s=TIMEOUT_S):
    """{port: Column} of every register and pin of the design in folder `rtl`, whose ports have the bundle's names."""
    return simulate_columns(
        folder, bundle.read(folder).stim, design_run.select_design(manifest, rtl, design_run.Choice(sim)), timeout_s
    )


def _write_run_files(folder, stim, design, work_folder):
    """Put what the simulation opens into a folder; {name: text} of what is compiled besides the design."""
    manifest = design.manifest
    roms = sorted(name for name in manifest["sha256"] if name.startswith("rom/") and name.endswith(".hex"))
    for name in ("params.vh", "params.svh", "params_pkg.vhd", *roms):
        if name in manifest["sha256"]:
            (work_folder / name).parent.mkdir(exist_ok=True)
            shutil.copyfile(Path(folder) / name, work_folder / name)
    widths = [p["width"] for p in manifest["inputs"]]
    (work_folder / "stim.hex").write_text(bundle.hex_text(bundle.pack(stim, widths), sum(widths)))
    suffix = "vhd" if design.language == "vhdl" else "v"
    language = getattr(loggers, design.language)
    bench = language(manifest, roms[0] if roms else None, design.level, design.module)
    texts = {f"wrap.{suffix}": design.wrapper} if design.wrapper else {}
    texts[f"log.{suffix}"] = bench
    for name, text in texts.items():
        (work_folder / name).write_text(text)
    return texts


def simulate_columns(folder, stim, design, timeout_s=TIMEOUT_S):
    """{port: Column} of what the level of a `design_run.Design` judges, for rows of stimulus.

    folder  of the verified bundle
    Raises FileError with one clear message if the design does not build, run or end, ConfigError for a wrong argument.
    """
    if not 0 < timeout_s <= 86400:
        raise ConfigError(f"timeout: {timeout_s} s is not above 0 and at most 86400 s")
    last = design.sources.files[-1]
    with tempfile.TemporaryDirectory(prefix="gyro-check-") as work_folder:
        work_folder = Path(work_folder).resolve()
        texts = _write_run_files(folder, stim, design, work_folder)
        run = Runner(work_folder, timeout_s)
        command, code, tool_output = _build(design.sim, run, list(texts), design)
        complaints = _complaints(tool_output, texts, design.manifest, design)
        if code or complaints:
            why = "; ".join(complaints)
            raise FileError(
                f"{last}: {why}" if why else f"{last}: does not build under {design.sim}:\n{first_lines(tool_output)}"
            )
        code, tool_output = run(*command)
        columns = _columns(work_folder / loggers.ROWS, loggers.logged_ports(design.manifest, design.level), last)
        rows = len(next(iter(columns.values())).values)
        if rows < design.manifest["n"]:
            raise FileError(
                f"{last}: the simulation ended after {rows} of {design.manifest['n']} rows:\n{first_lines(tool_output)}"
            )
    return columns


def _check_port_activity(columns, comparison, design):
    """Refuse a design whose ports rest where the model's move: it is not clocked, or stays in reset."""
    golden = comparison.golden
    names = [p["name"] for p in golden.manifest["registers"] + golden.manifest["outputs"]]
    moves = [n for n in columns if len(np.unique(golden.exp[comparison.care[:, names.index(n)], names.index(n)])) > 1]
    if not moves:
        return
    last = design.sources.files[-1]
    if all(not columns[name].valid.any() for name in moves):
        if design.port_map is None:
            return
        raise FileError(f"{last}: every port is unknown (x) in every row: the design is not clocked, or never reset")
    # rows behind a clock without reset: with the other polarity they show the reset alone
    names = [p["name"] for p in golden.manifest["inputs"]]
    reset = golden.stim[:, names.index("rst")] != 0 if "rst" in names else np.zeros(len(golden.exp), bool)
    after = np.r_[False, ~reset[:-1]]
    if not all(columns[n].valid[after].all() and len(np.unique(columns[n].values[after])) == 1 for n in moves):
        return
    if any(len(np.unique(columns[n].values[columns[n].valid])) > 1 for n in moves):
        active = design.port_map.reset[1] if design.port_map else 1
        raise FileError(
            f"{last}: ports change only where rst is active: the reset has the other polarity; "
            f"set active = {1 - active} in [reset] of a map"
        )
    raise FileError(
        f"{last}: no port changes in {len(golden.exp)} rows: the design stays in reset, has no clock or never starts"
    )


def check(folder, rtl, sim=None, timeout_s=TIMEOUT_S, before=BEFORE, choice=None):
    """Compare the design in folder `rtl` with the bundle in `folder`; returns a `compare.Report`.

    choice  `design_run.Choice`: level, map, latency, list of files; else a design with the bundle's names
    """
    golden = bundle.read(folder)
    if golden.manifest["block"] == "top":
        raise FileError(f"{folder}: bundle of the whole design; use top_run.check")
    design = design_run.select_design(golden.manifest, rtl, choice or design_run.Choice(sim))
    comparison = comparison_scope.build_scope(golden, design.level, design.style, design.clocks)
    design = design._replace(manifest=comparison.golden.manifest)
    columns = simulate_columns(folder, comparison.golden.stim, design, timeout_s)
    _check_port_activity(columns, comparison, design)
    aligned_columns = {
        p["name"]: comparison_scope.remove_latency(comparison, columns[p["name"]], name)
        for name, p in loggers.logged_ports(design.manifest, design.level)
    }
    report = compare_bundle(comparison.golden, aligned_columns, before, comparison)
    return report._replace(notes=design.notes())

"""Run somebody's whole design with the bench of its bundle, and find the first clock that differs, and why.

    bundle of the level --> its check.sh --> rows and signatures equal, or the first frame that differs
    frames around it    --> a bundle with a row at each of their clocks --> its check.sh --> every value that differs

Source  docs/golden.md (the whole design), docs/foreign_designs.md
"""

import re
import shutil
import tempfile
from pathlib import Path

import numpy as np

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, design_bundle
from testbench.golden.bundles.adapted_bundle import write_pin_bundle
from testbench.golden.check import compare, design_run
from testbench.golden.check.compare import Column, Report
from testbench.golden.check.rtl_run import TIMEOUT_S, Runner, first_lines
from testbench.golden.diagnosis.design_graph import report_name
from testbench.golden.recording import recording, replay_recording
from testbench.golden.stimulus import levels

ROW = re.compile(r"clock (\d+): (\w+): expected (\w+), got (\w+) \(hex\)")
FRAME = re.compile(r"frame (\d+) \(clocks ")
PASSED = re.compile(r"PASS \S+: (\d+) clocks, (\d+) rows .* (\d+) of \d+ frames")
UNREAD = ("ports/", "vec.csv", "golden.")  # files that no bench opens
FRAMES_BEFORE, FRAMES_AFTER = (
    2,
    2,
)  # frames around the one that differs: a waveform has two, 8 kHz work needs some behind
MOST_OUTPUT_BYTES = 1 << 28


def _bench(folder, level, work_folder, choice):
    """(folder in `work_folder`, manifest) of the bench of a level: what it opens is copied, or written for the pins."""
    bench, manifest = work_folder / "bench", bundle.read(folder).manifest
    if level != "registers" and (manifest["registers"] or _has_custom_names(choice) or choice.latency):
        return bench, write_pin_bundle(folder, level, bench, choice.map, choice.top, choice.latency)
    for name in manifest["sha256"]:
        if not name.startswith(UNREAD):
            (bench / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(folder) / name, bench / name)
    return bench, manifest


def _has_custom_names(choice):
    """Whether a design has names of its own."""
    return choice.map is not None or choice.top is not None


def _write_file_list(sources, work_folder):
    """A list of the files of a design, whose folder need not have a file top."""
    path = work_folder / "design.f"
    lines = [f"+incdir+{folder}" for folder in sources.includes] + [str(file) for file in sources.files]
    path.write_text("\n".join(lines) + "\n")
    return path


def _run_check_script(run, bench, sim, rtl, files, level, frames=()):
    """What check.sh says of a design; FileError if nothing was compared."""
    environment_settings = [f"RTL={Path(rtl).resolve()}", f"LEVEL={level}", f"TIMEOUT={run.timeout_s:g}", *frames]
    environment_settings += [f"FILES={Path(files).resolve()}"] if files else []
    code, text = run("env", *environment_settings, "sh", bench / "check.sh", sim)
    if code == 0 or (code == 1 and ("rows differ" in text or "frames differ" in text)):
        return text
    if "stopped after" in text:
        raise FileError(f"{sim}: stopped after {run.timeout_s:g} s: the design hangs or is slow")
    raise FileError(f"{rtl}: nothing was compared under {sim}:\n{first_lines(text)}")


def _parse_port_value(word, port):
    """Number of a hexadecimal word of a port; None: unknown."""
    try:
        raw = int(word, 16)
    except ValueError:
        return None
    return raw - (1 << port["width"]) if port["signed"] and raw >> (port["width"] - 1) else raw


def prefixed_manifest(manifest):
    """Manifest in which registers and pins have different names (`design_graph.report_name`)."""
    registers = [{**p, "name": report_name(p["name"])} for p in manifest["registers"]]
    return {**manifest, "registers": registers, "schema": compare.SCHEMA}


def _reported_columns(golden, text):
    """{port: Column} of a design: golden values, and in their place those that its bench names."""
    manifest, first = golden.manifest, int(golden.at[0])
    ports = {p["name"]: p for p in manifest["inputs"]} | dict(levels.compared_ports(manifest, "registers"))
    columns = [Column(c.copy(), np.ones(len(c), bool)) for c in np.column_stack([golden.stim, golden.exp]).T]
    columns_by_port = dict(zip(ports, columns, strict=True))
    for clock, name, _, got in ROW.findall(text):
        value = _parse_port_value(got, ports[name])
        column, row = columns_by_port[name], int(clock) - first
        column.values[row], column.valid[row] = value or 0, value is not None
    manifest = prefixed_manifest(manifest)
    names = [p["name"] for k in ("inputs", "registers", "outputs") for p in manifest[k]]
    return dict(zip(names, columns, strict=True))


def check(folder, rtl, timeout_s=TIMEOUT_S, choice=design_run.AS_OURS):
    """Compare the whole design in folder `rtl` with a bundle of `top`; returns a `compare.Report`.

    choice  `design_run.Choice`: sim, level, files; map, top and latency at the pins
    The run ends after the frames by default of its simulator: `rows` counts the rows up to there. `differing` counts
    the rows of the frames around the first difference.
    """
    if not 0 < timeout_s <= 86400:
        raise ConfigError(f"timeout: {timeout_s} s is not above 0 and at most 86400 s")
    manifest = bundle.read(folder).manifest
    level = choice.level or design_bundle.bundle_level(manifest)
    if level not in levels.LEVELS or (level == "registers" and not manifest["registers"]):
        raise ConfigError(f"level: {level!r} is not a level of {folder}")
    if _has_custom_names(choice) and level == "registers":
        raise ConfigError("--map, --top: the whole design may have other port names at --level pins only")
    design = design_run.select_design(manifest, rtl, choice._replace(level=level))
    sim = design.sim
    with tempfile.TemporaryDirectory(prefix="gyro-check-") as work_folder:
        work_folder = Path(work_folder).resolve()
        bench, manifest = _bench(folder, level, work_folder, choice)
        run = Runner(work_folder, timeout_s, MOST_OUTPUT_BYTES)
        files = choice.files or (_write_file_list(design.sources, work_folder) if _has_custom_names(choice) else None)
        text = _run_check_script(run, bench, sim, rtl, files, level)
        differs = "FAIL " in text
        window_report = _compare_window(text, run, bench, sim, rtl, files, level, manifest) if differs else None
    count = int(re.search(r"(?:of|all) (\d+) rows", text)[1] if differs else PASSED.search(text)[2])
    ports = tuple(p["name"] for k in ("registers", "outputs") for p in prefixed_manifest(manifest)[k])
    delays = {f"o_{name}": k for name, k in manifest.get("clocks", {}).items()}
    if window_report is None:
        window_report = Report("top", manifest["case"], count, 0, ports, (), level, 0, {}, {}, None, ())
    return window_report._replace(
        level=level,
        rows=count,
        golden_rows=manifest["n"],
        judged_rows=count,
        ports=ports,
        clocks=delays,
        notes=design.notes(),
    )


def _compare_window(text, run, bench, sim, rtl, files, level, manifest):
    """`Report` of every clock of the frames around the first that a bench names."""
    clocks = manifest["frame_cycles"]
    frames = [int(number) for number in FRAME.findall(text)]
    row = ROW.search(text)
    frames += [int(row[1]) // clocks] if row else []
    begin, end = max(min(frames) - FRAMES_BEFORE, 0), min(min(frames) + FRAMES_AFTER + 1, manifest["frames"])
    clock_window = recording.Window(begin * clocks, (end - begin) * clocks, "differs")
    r, window = (
        design_bundle.shorten_recording(design_bundle.read_bundle_recording(bench, manifest), end, (clock_window,)),
        run.folder / "window",
    )
    at = np.arange(clock_window.first, clock_window.first + clock_window.count)
    more = {path.name: path.read_text() for path in bench.glob("golden_top.v*")}
    clocks = design_bundle.pin_delays(bench, manifest)
    design_bundle.write(
        r, window, at, "design" in manifest, design_bundle.bundle_level(manifest), clock_window.count, more, clocks
    )
    golden = bundle.read(window)
    got = _reported_columns(golden, _run_check_script(run, window, sim, rtl, files, level, ("FRAMES=0",)))
    window_manifest, exp = golden.manifest, golden.exp
    if not window_manifest["registers"] and not clocks:
        # a diagnosis of the pins needs the registers of the model
        rows = replay_recording.run(r.params, r.stimulus, r.frames, at, registers=False)
        block, exp = (
            design_bundle.build_top_block({r.name: r.params}, r.params.design),
            np.column_stack([rows.registers, exp]),
        )
        window_manifest = window_manifest | {"registers": [bundle.port(p) for p in block.registers]}
    window_manifest = prefixed_manifest(window_manifest)
    report = compare.compare(
        window_manifest,
        dict(zip([p["name"] for p in window_manifest["inputs"]], golden.stim.T.copy())),
        dict(zip([p["name"] for p in window_manifest["registers"] + window_manifest["outputs"]], exp.T.copy())),
        got,
        terms=compare.Terms(level, clock_window.first),
    )
    if report.passed:
        raise FileError(
            f"{rtl}: frame {min(frames)} differs in the first run of {sim}, but not in the second: not deterministic"
        )
    return report

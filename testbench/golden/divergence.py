"""What a check or a loop leaves of a difference: a waveform of the last two frames, a bundle to replay, the diagnosis.

    window.vcd, window.gtkw      golden signals and those of the design, up to the row that differs; of a check further
    bundle/top/CASE              vectors of the whole design: inputs from power-on, every clock of these frames as a row
    bundle/BLOCK/CASE            vectors of a block: those of its bundle up to the end of the waveform
    diagnosis.txt, .json         the report

A loop's model is replayed on the inputs that the design was given; until the difference both are one. Its diagnosis
reads the rows behind the difference, too (`loop.after_divergence`).
Source  docs/golden.md (what a difference leaves), docs/rtl.md (a design with the pins alone)
"""

from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.golden.bundles import bundle, export, recompute
from testbench.golden.bundles import design_bundle as bundles
from testbench.golden.check import compare, top_run
from testbench.golden.diagnosis.design_graph import report_name
from testbench.golden.recording import board_pins, recording, replay_recording
from testbench.storage import vcd
from testbench.storage.files import write_text

CASE = "loop"
PINS = len(board_pins.WIDTHS)
BUILD_SUBFOLDER = f"{bundle.BUILD}/divergence"  # in the bundle of a block
FRAMES = 2  # of 8 kHz before the row that differs
AFTER = 64  # rows of a block behind it


def _write_waveform(folder, waveform, first, at, top, clock_hz, expanded):
    """Write the waveform of (signals, rows, valid masks) from row `first` on; its set-up has the marker at row `at`."""
    path, (signals, rows, valid_masks) = folder / "window.vcd", waveform
    vcd.write_vcd(path, rows, signals, first_edge=first, top=top, clock_hz=clock_hz, is_valid=valid_masks)
    marker_ps = int(vcd.picoseconds(at - first, clock_hz))
    vcd.write_gtkw(folder / "window.gtkw", path, signals, top=top, expanded=expanded, marker_ps=marker_ps)


def write(folder, difference):
    """Write the package of a `run.Difference` into a folder; returns its `compare.Report`."""
    folder, observation, row = Path(folder), difference.recorded, difference.row
    design, end = difference.design, row + len(difference.recorded.continuation.values)
    first, frames = max(row + 1 - FRAMES * design.frame_clocks, 0), row // design.frame_clocks + 1
    record = recording.Recording(CASE, observation.params, frames, frames, observation.stimulus, (), "")
    window = recording.Window(first, row + 1 - first, "up to the row that differs")
    out, at = folder / "bundle" / bundles.STEM / CASE, np.arange(first, row + 1)
    manifest = bundles.write(bundles.shorten_recording(record, frames, (window,)), out, at, names_design=True)
    golden = replay_recording.run(
        observation.params, observation.stimulus, -(-end // design.frame_clocks), np.arange(first, end)
    )
    golden = np.column_stack([golden.inputs, golden.registers, golden.pins])
    report = _report(observation, top_run.prefixed_manifest(manifest) | {"n": end - first}, golden, first, row)
    # behind the difference there was no plant
    end = row + 1
    block = _use_port_names(bundles.build_top_block({CASE: observation.params}, design))
    _write_package(folder, block, golden[: end - first], report, first, end)
    return report


def _report(observation, manifest, golden, first, row):
    """`compare.Report` of what a `run.Recorded` shows from row `first` on; up to `row` it is golden."""
    kinds = ("inputs", "registers", "outputs") if observation.observed_indices[0] == 0 else ("inputs", "outputs")
    visible_names = [p["name"] for kind in kinds for p in manifest[kind]]
    names = [p["name"] for kind in ("inputs", "registers", "outputs") for p in manifest[kind]]
    yours, count = golden.copy(), len(manifest["inputs"])
    yours[row - first :] = np.column_stack(observation.continuation)
    if "registers" not in kinds:
        for rows in (golden, yours):
            rows[:, -PINS:] = board_pins.read(rows[:, -PINS:])
    columns, mine = dict(zip(names, golden.T.copy(), strict=True)), dict(zip(names, yours.T.copy(), strict=True))
    input_columns = {name: columns.pop(name) for name in names[:count]}
    terms = compare.Terms("registers" if "registers" in kinds else "pins", first)
    return compare.compare(manifest, input_columns, columns, {name: mine[name] for name in visible_names}, terms=terms)


def _use_port_names(block):
    """The block of the whole design with the names of a report."""
    return block._replace(registers=tuple(p._replace(name=report_name(p.name)) for p in block.registers))


def _build_waveform(block, rows, report, first, end):
    """(signals, rows, valid masks) of a block: inputs, what differs, the rest; two signals of a port that is shown.

    rows  golden inputs and results from row `first` to `end`
    """
    waves, span = [], slice(first - report.first_row, end - report.first_row)
    columns = rows.T
    results = {port.name for port in (*block.registers, *block.pins)}
    kinds = [*("in" for _ in block.columns), *("reg" for _ in block.registers), *("pin" for _ in block.pins)]
    for kind, port, column in zip(kinds, (*block.columns, *block.registers, *block.pins), columns, strict=True):
        # an input may have the name of a register, which is then the one that is compared
        mine = None if kind == "in" and port.name in results else report.got.get(port.name)
        name = f"{kind}.{port.name}"
        order = (port.name not in report.differing, name != f"{kind}.{report.divergence.port}") if kind != "in" else ()
        if mine is None:
            waves.append((order, vcd.Signal(name, port.width, port.signed), column, np.ones(end - first, bool)))
            continue
        waves.append((order, vcd.Signal(f"{name}.golden", port.width, port.signed), column, np.ones(end - first, bool)))
        waves.append((order, vcd.Signal(f"{name}.yours", port.width, port.signed), mine.values[span], mine.valid[span]))
    _, signals, values, valid_masks = zip(*sorted(waves, key=lambda one: one[0]), strict=True)
    return signals, np.column_stack(values), np.column_stack(valid_masks)


def write_block(folder, bundle_folder, report):
    """Write the package of a `compare.Report` that differs, on the bundle `bundle_folder`; returns its folder.

    Raises FileError for a bundle that this version cannot compute again, and for what cannot be written.
    """
    folder, bundle_folder, d = Path(folder), Path(bundle_folder), report.divergence
    golden = bundle.read(bundle_folder)
    manifest, begin, at = golden.manifest, report.first_row, d.before[-1][0]
    block = recompute.manifest_block(bundle_folder / bundle.MANIFEST, manifest)
    end = min(d.cycle + 1 + AFTER, begin + report.rows)
    # from the reset on: a design has states that no port shows
    stim, out = golden.stim[begin:end], folder / "bundle" / block.stem / report.case
    export.write(block, report.case, stim, [("window", 0, len(stim))], None, out)
    if not np.array_equal(bundle.read(out).exp, golden.exp[begin:end]):
        raise FileError(
            f"{bundle_folder}: the model computes other rows; list them with gyro golden verify --recompute"
        )
    first = max(begin, at + 1 - FRAMES * block.record.frame_clocks)
    rows = np.column_stack([golden.stim, golden.exp])[first:end]
    return _write_package(folder, block, rows, report, first, end)


def write_top(folder, bundle_folder, report):
    """The same of a report on the whole design; returns its folder."""
    folder, bundle_folder, at = Path(folder), Path(bundle_folder), report.divergence.before[-1][0]
    manifest = bundle.read(bundle_folder).manifest
    r, pins_only = bundles.read_bundle_recording(bundle_folder, manifest), report.level != "registers"
    clocks, begin = manifest["frame_cycles"], report.first_row
    end = min(at + 1 + AFTER, begin + len(next(iter(report.got.values())).values))
    first = max(begin, at + 1 - FRAMES * clocks)
    window = recording.Window(first, end - first, "around the row that differs")
    cut = bundles.shorten_recording(r, -(-end // clocks), (window,))
    out, level = folder / "bundle" / bundles.STEM / report.case, "pins" if pins_only else "registers"
    latency_clocks = bundles.pin_delays(bundle_folder, manifest) | {
        name.removeprefix("o_"): k for name, k in report.clocks.items()
    }
    bundles.write(cut, out, np.arange(first, end), "design" in manifest, level, clocks=latency_clocks)
    golden, block = bundle.read(out), bundles.build_top_block({r.name: r.params}, r.params.design)
    block = block._replace(registers=()) if pins_only else _use_port_names(block)
    rows = np.column_stack([golden.stim, golden.exp])
    return _write_package(folder, block, rows, report, first, end)


def _write_package(folder, block, rows, report, first, end):
    """Write waveform, set-up and report of rows from `first` to `end`; returns the folder."""
    waveform = _build_waveform(block, rows, report, first, end)
    open_groups = ("in", *(f"{kind}.{name}" for name in report.differing for kind in ("in", "reg", "pin")))
    at = report.divergence.before[-1][0]
    _write_waveform(folder, waveform, first, at, f"gyro_{block.stem}", block.record.master_hz, open_groups)
    write_text(folder / "diagnosis.txt", report.text())
    write_text(folder / "diagnosis.json", report.to_json())
    return folder

"""Golden bundles of the whole firmware: recordings replayed, rows at listed clocks, a signature of every frame.

    at.hex                 clocks of the rows: dense windows, and first clocks of frames
    stim.hex, exp.hex      inputs, and registers with pins, at these clocks; ports/ and vec.csv hold the same
    sig.hex                signature of all registers and pins in all clocks of each frame
    adc.hex                per conversion: clock (32 bits), status (24), eight codes (24 each)
    host.hex               per event: clock (32), 1 for a reset or 0 for a write (4), address (8), data (48)
    sar.hex                per tick: sample x, sample y (18 each); empty where both rest at 0

    pins/                  the bundle of the pins alone, for `make check LEVEL=pins`

A bundle of level `pins` has no registers: its rows and signatures are of the pins as a board reads them. A pin may come
some clocks later there: `clocks` of the manifest.

The manifest is of schema `gyro-golden-replay/1.0`: as of the blocks, and `frames`, how many words each of these files
has, `windows` with what they show, and the hash of the recording. No step of an export computes in floating point.
Source  docs/golden.md (the whole design)
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model import spi_adc, top
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench.errors import ConfigError, FileError
from testbench.flatten import format_leaves, leaves
from testbench.golden.bundles import benches, bundle, bundle_provenance, design_entry, scores, top_benches
from testbench.golden.bundles.bundle import PINS
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, REPORTED_ROWS
from testbench.golden.foreign.comparison_scope import MOST_CLOCKS
from testbench.golden.recording import board_pins, board_recording, recording, replay_recording, signature
from testbench.golden.stimulus import blocks, levels
from testbench.golden.stimulus.blocks import Port, port_name
from testbench.storage import inputs, vcd
from testbench.version import VERSION

STEM = "top"
CASES = ("reset", "story", "story_digital", "power_on", "registers")
assert PINS == levels.LEVELS[0], "the folder of a level has its name"
MAX_WINDOW = 100_000  # rows of `window`: 440 MB of registers in hexadecimal would be no help


@dataclass
class Param:
    """Entry of a parameter in a manifest."""

    name: str
    raw: int


@dataclass
class WindowEntry:
    """Entry of a window in a manifest."""

    clock: int
    rows: int
    shows: str


def _rules():
    """{register of top: (rounding, overflow)} from the blocks that it is made of."""
    register_rules = {}

    def walk(record, path):
        stem = type(record).__module__.rpartition(".")[2]
        if stem in blocks.BLOCKS:
            for port in blocks.BLOCKS[stem].registers:
                register_rules[f"{port_name(path)}_{port.name}"] = (port.rounding, port.overflow)
        elif hasattr(record, "_fields"):
            for name, item in zip(record._fields, record):
                walk(item, f"{path}.{name}" if path else name)

    walk(top.State(), "")
    return register_rules


def build_top_block(params, design=None):
    """The whole design as a `blocks.Block`; `params` are {case: Params or None}, `design` as there."""
    register_rules, record = _rules(), design or DEFAULT
    state, design_blocks = top.reset(record), blocks.design_blocks(record)
    registers = [
        Port(port_name(path), fmt, int(reset), *register_rules.get(port_name(path), (None, None)))
        for (path, reset), (_, fmt) in zip(leaves(state), format_leaves(formats(top.State, record)), strict=True)
    ]
    return blocks.Block(
        stem=STEM,
        design=design,
        inputs=tuple(Port(name, fmt) for name, fmt in zip(top.Inputs._fields, top.INPUTS_FMT)),
        state=state,
        registers=tuple(registers),
        pins=tuple(Port(name, fmt) for name, fmt in zip(top.Pins._fields, top.PINS_FMT)),
        cases=params,
        run=None,
        latency={"adc_valid": spi_adc.read_clocks(record)},
        idle={"drdy_n": 1},
        roms=(*design_blocks["sine"].roms, *design_blocks["cordic"].roms),
    )


def row_clocks(r):
    """Clocks of the rows of a recording: its windows, and the first clock of every `row_every`th frame."""
    pieces = [np.arange(0, r.frames, r.row_every) * r.params.design.frame_clocks]
    pieces += [np.arange(w.first, w.first + w.count) for w in r.windows]
    return np.unique(np.concatenate(pieces))


def _hex(rows, widths):
    """Text of packed words, one per row; each width is a multiple of a digit, or the words are short."""
    return bundle.hex_text(bundle.pack(rows, widths), sum(widths))


# Columns of the words that a bench replays: bits of each, and how many of them, from the first, have no sign
REPLAYED = {
    "adc": ((CLOCK_BITS, *[24] * (recording.ADC_COLUMNS - 1)), 2),
    "host": ((CLOCK_BITS, 4, 8, 48), 4),
    "sar": ((18, 18), 0),
}


def _inputs_hex(stimulus):
    """{path: text} of what the bench replays."""
    return {f"{name}.hex": _hex(getattr(stimulus, name), widths) for name, (widths, _) in REPLAYED.items()}


def read_bundle_recording(folder, manifest):
    """The recording that a bundle was made from, as its own files and manifest say; FileError where they cannot be one.

    folder    a bundle of the whole design that was read
    """
    path = Path(folder) / bundle.MANIFEST
    stimulus = {}
    for name, (widths, unsigned) in REPLAYED.items():
        ports = [{"width": width, "signed": k >= unsigned} for k, width in enumerate(widths)]
        words = bundle.replayed_words(folder, manifest, name)
        stimulus[name] = np.ascontiguousarray(bundle.unpack(words, ports)).reshape(-1, len(widths))
    params = inputs.validate_data(manifest.get("params"), list[Param], path)
    design = design_entry.manifest_design(path, manifest) or DEFAULT
    try:
        raw = recording.params_from(path, [p.name for p in params], [p.raw for p in params], design)
    except FileError:
        count = len(recording.param_names())
        raise FileError(
            f"{path}: params: are not the {count} parameters of this version's design; export it again"
        ) from None
    windows = inputs.validate_data(manifest["windows"], list[WindowEntry], path)
    bundle_recording = recording.Recording(
        manifest["case"], raw, manifest["frames"], 1,
        replay_recording.Stimulus(**stimulus), tuple(recording.Window(w.clock, w.rows, w.shows) for w in windows), "",
    )  # fmt: skip
    recording.check(path, bundle_recording)
    return bundle_recording


def _window_waveform_writer(design, windows, at, rows):
    """Function that writes golden.vcd, of the dense windows at their own times, and golden.gtkw into a folder."""
    vcd_signals = [vcd.Signal(f"in.{p.name}", p.width, p.signed) for p in design.columns]
    vcd_signals += [vcd.Signal(f"reg.{p.name}", p.width, p.signed) for p in design.registers]
    vcd_signals += [vcd.Signal(f"out.{p.name}", p.width, p.signed) for p in design.pins]
    dense = np.zeros(len(at), bool)
    for w in windows:
        dense |= (at >= w.first) & (at < w.first + w.count)

    def write(folder):
        waves, setup = folder / "golden.vcd", folder / "golden.gtkw"
        vcd.write_vcd(waves, rows[dense], vcd_signals, top=design.stem, edges=at[dense])
        vcd.write_gtkw(setup, waves, vcd_signals, top=design.stem, expanded=("in", "out"))
        for path in (waves, setup):
            path.write_bytes(path.read_bytes().replace(f"ftr-gyro {VERSION}".encode(), b"ftr-gyro", 1))

    return write


def _replay_manifest(design, r, at, counts, clocks):
    ports = {
        "inputs": [bundle.port(p) for p in design.columns],
        "registers": [bundle.port(p) for p in design.registers],
        "outputs": [bundle.port(p) for p in design.pins],
    }
    params = [{"name": name, "raw": raw, "fmt": list(fmt)} for name, raw, fmt in blocks.case_parameters(design, r.name)]
    recorded, d, entry = recording.sha256(r), design.record, design_entry.entry(design)
    identity = {"block": STEM, "case": r.name, "params": params, "recording": recorded, **ports, **entry}
    return {
        "schema": bundle.REPLAY_SCHEMA,
        "block": STEM,
        "case": r.name,
        "clock": {"name": "clk", "hz": d.master_hz},
        "reset": {"name": blocks.RESET_INPUT, "active": 1, "cycles": benches.RESET_CYCLES},
        "sample": "before rising edge",
        "n": len(at),
        "frames": r.frames,
        "frame_cycles": d.frame_clocks,
        "tick_cycles": d.tick_clocks,
        "conversions": counts["conversions"],
        "host_events": counts["host_events"],
        "samples": counts["samples"],
        "signature": {
            "polynomial": f"{signature.POLYNOMIAL:x}",
            "row_bits": signature.padded_width(counts["out_width"]),
            "reset": "every frame",
        },
        "windows": [{"clock": w.first, "rows": w.count, "shows": w.shows} for w in r.windows],
        **ports,
        "params": params,
        "levels": levels.levels_entry(design),
        **entry,
        "latency": design.latency,
        "recording_sha256": recorded,
        "seed": None,
        "config_sha256": hashlib.sha256(bundle.canonical(identity).encode()).hexdigest(),
        **({"clocks": clocks} if clocks else {}),
        "provenance": bundle_provenance.provenance(),
    }


def bundle_level(manifest):
    """Level of a bundle of the whole design: `pins` if it has no registers."""
    return "registers" if manifest["registers"] else "pins"


def pin_delays(folder, manifest):
    """{pin: clocks that it comes later} of a bundle of the pins."""
    path = Path(folder) / bundle.MANIFEST
    clocks = inputs.validate_data(manifest.get("clocks", {}), dict[str, int], path)
    pins = [p.name for p in build_top_block({}).pins]
    for name, k in clocks.items():
        if name not in pins or not 0 < k <= MOST_CLOCKS or manifest["registers"]:
            raise FileError(f"{path}: clocks: {name} = {k} is not a pin that comes 1 .. {MOST_CLOCKS} clocks later")
    return clocks


class ReplayReference(NamedTuple):
    """What of a replay is judged: the block, expected rows, a signature of each frame, {pin: clocks it comes later}."""

    design: blocks.Block
    exp: np.ndarray
    signatures: list
    clocks: dict


def write(
    r, folder, at=None, names_design=False, level="registers", most_reported_rows=REPORTED_ROWS, more=None, clocks=None
):
    """Replay a recording and write its bundle, with rows at the clocks `at` (None: its own); returns the manifest.

    names_design    the manifest names the design, even if it is the default one
    level           `pins`: rows and signatures are of the pins alone
    most_reported_rows  rows that differ of which the benches name every port
    more            {path: text} of further files
    clocks          {pin: clocks that it comes later}, of level `pins`
    """
    d, pins_only = r.params.design, level == "pins"
    design = build_top_block({r.name: r.params}, d if names_design or d != DEFAULT else None)
    at = row_clocks(r) if at is None else at
    rows = replay_recording.run(r.params, r.stimulus, r.frames, at, board_pins.Board(clocks), not pins_only)
    blocks.check(design.columns, rows.inputs, f"{STEM}: stimulus")
    blocks.check(design.registers, rows.registers, f"{STEM}: register")
    blocks.check(design.pins, rows.pins, f"{STEM}: output")
    pins = ReplayReference(design._replace(registers=()), rows.board, rows.board_signatures.tolist(), clocks or {})
    if pins_only:
        replay_reference, pin_bundle_files = pins, {}
    else:
        signatures = [signature.remainder_signature(words) for words in rows.remainders]
        replay_reference = ReplayReference(design, np.column_stack([rows.registers, rows.pins]), signatures, {})
        texts = _pin_bundle_texts(r, pins, at, rows.inputs, most_reported_rows)
        pin_bundle_files = {f"{PINS}/{name}": text for name, text in texts.items()}
    files, counts = _files(r, replay_reference, at, rows.inputs, most_reported_rows)
    port_pairs = [(p.name, p) for p in design.columns] + benches.result_port_pairs(replay_reference.design)
    both = np.column_stack([rows.inputs, replay_reference.exp])
    files |= {
        **bundle.port_files(port_pairs, both),
        "vec.csv": bundle.csv_text("clock", at, [name for name, _ in port_pairs], both),
        **pin_bundle_files,
        **(more or {}),
    }
    manifest = _replay_manifest(replay_reference.design, r, at, counts, replay_reference.clocks)
    writer = _window_waveform_writer(replay_reference.design, r.windows, at, both)
    return bundle.write(Path(folder), manifest, files, [writer], scores.note_score)


def _pin_bundle_texts(r, replay_reference, at, stim, most_reported_rows):
    """{path: text} of a bundle within another one: what `check.sh` needs, and a manifest without its origin."""
    files, counts = _files(r, replay_reference, at, stim, most_reported_rows)
    manifest = _replay_manifest(replay_reference.design, r, at, counts, replay_reference.clocks)
    del manifest["provenance"]
    return files | {bundle.MANIFEST: bundle.manifest_text(bundle.seal_manifest(manifest, files))}


def _files(r, replay_reference, at, stim, most_reported_rows):
    """({path: text} of what the benches open and of the benches, counts)."""
    design, exp, _, clocks = replay_reference
    driven, result_ports = [(p.name, p) for p in design.columns], benches.result_port_pairs(design)
    counts = {
        "frames": r.frames,
        "conversions": len(r.stimulus.adc),
        "host_events": len(r.stimulus.host),
        "samples": len(r.stimulus.sar),
        "out_width": sum(p.width for _, p in result_ports),
        "shown_rows": most_reported_rows,
    }
    files = {
        "at.hex": _hex(at[:, None], [CLOCK_BITS]),
        "stim.hex": _hex(stim, [p.width for _, p in driven]),
        "exp.hex": _hex(exp, [p.width for _, p in result_ports]),
        "sig.hex": bundle.hex_text(replay_reference.signatures, signature.DEGREE),
        **_inputs_hex(r.stimulus),
        **top_benches.top_bench_texts(design, r.name, len(at), counts, clocks),
    }
    return files, counts


def export_case(case, folder):
    """Write the bundle of one case; returns its manifest."""
    return write(recording.load(case), folder)


BOARD_CASES = ("reset", "power_on")
BOARD_FRAMES, MOST_FRAMES = 400, 80_000  # of a loop that is closed for an export


def check_frames(frames):
    """Raise ConfigError for a length of which no loop is closed."""
    if not 1 <= frames <= MOST_FRAMES:
        raise ConfigError(f"--frames = {frames} is outside 1 .. {MOST_FRAMES}")


def check_board(firmware, frames):
    """Raise ConfigError for what `export_board` cannot write."""
    check_frames(frames)
    board_recording.check(firmware)


def export_board(firmware, config, case, folder, frames=BOARD_FRAMES, progress=None):
    """Write the bundle of one of BOARD_CASES of a board; returns its manifest.

    reset     codes of the shipped case, in the frames of the board: no plant
    power_on  the loop of the board is closed for so many frames from power-on
    Raises ConfigError for a firmware that the RTL of the whole design has not.
    """
    check_board(firmware, frames)
    from testbench.golden.recording import make_recordings  # it knows plant and engine, which no other export does

    if case == "reset":
        r = make_recordings.reset_case(recording.load("story"), firmware)
    else:
        loop_case = make_recordings.Case(config, lambda _: firmware, frames, row_every=max(1, frames // BOARD_FRAMES))
        r = make_recordings.record_closed_loop(case, loop_case, progress)
    return write(r._replace(windows=make_recordings.find_windows(r)), folder, names_design=True)


def shorten_recording(r, frames, windows):
    """The first frames of a recording, with rows at these windows and at the first clock."""
    adc, host, sar = r.stimulus
    d = r.params.design
    end = frames * d.frame_clocks
    return r._replace(
        frames=frames,
        row_every=frames,
        windows=windows,
        stimulus=replay_recording.Stimulus(adc[adc[:, 0] < end], host[host[:, 0] < end], sar[: end // d.tick_clocks]),
    )


def window(folder, clock, count, out=None):
    """Bundle of the same case with every clock of one place as a row, and nothing behind it; (folder, manifest).

    folder  a bundle of the whole design
    clock   first clock
    count   clocks
    out     folder to write; FOLDER_CLOCK beside `folder` if None, beside the bundle where it lies in one
    Raises ConfigError if the place is outside the case, FileError if the bundle is of another recording.
    """
    folder = Path(folder)
    manifest = bundle.verify(folder)
    if manifest["schema"] != bundle.REPLAY_SCHEMA:
        raise ConfigError(
            f"{folder}: already has a row for every clock of {manifest['block']}; give a bundle of the whole design"
        )
    r = _load_shipped_case(folder, manifest) if "design" not in manifest else read_bundle_recording(folder, manifest)
    end = manifest["frames"] * manifest["frame_cycles"]
    if not 1 <= count <= MAX_WINDOW:
        raise ConfigError(f"--count: {count} is outside 1 .. {MAX_WINDOW} clocks")
    if not 0 <= clock <= end - count:
        raise ConfigError(f"--clock: {clock} .. {clock + count - 1} is outside 0 .. {end - 1}, the clocks of {r.name}")
    frames = -(-(clock + count) // manifest["frame_cycles"])
    cut = shorten_recording(r, frames, (recording.Window(clock, count, "asked for"),))
    out = _default_window_folder(folder, clock) if out is None else Path(out)
    return out, write(
        cut, out, names_design="design" in manifest, level=bundle_level(manifest), clocks=pin_delays(folder, manifest)
    )


def _default_window_folder(folder, clock):
    """FOLDER_CLOCK; a bundle in another one must not grow there: BUNDLE_FOLDER_CLOCK beside that."""
    outer = folder.parent
    if (outer / bundle.MANIFEST).exists():
        return outer.with_name(f"{outer.name}_{folder.name}_{clock}")
    return folder.with_name(f"{folder.name}_{clock}")


def _load_shipped_case(folder, manifest):
    """The recording of this version that a bundle is of; FileError if it is of another."""
    if manifest["case"] not in CASES:
        raise FileError(f"{folder}: case {manifest['case']!r} is not one of {', '.join(CASES)}")
    r = recording.load(manifest["case"])
    if recording.sha256(r) != manifest["recording_sha256"]:
        raise FileError(f"{folder}: is of another recording of {r.name} than that of this version; export it again")
    return r

"""Golden bundles of blocks: stimulus through the model, and everything an HDL bench needs, as one folder per case.

The whole design, `top`, is exported by `testbench.golden.bundles.top` from recordings.
Source  docs/golden.md
"""

import contextlib
import hashlib
from pathlib import Path

import numpy as np

from testbench.errors import ConfigError
from testbench.golden.bundles import benches, bundle, bundle_provenance, design_bundle, design_entry, scores
from testbench.golden.coverage import coverage_evidence
from testbench.golden.ranges import range_report
from testbench.golden.stimulus import blocks, stimulus
from testbench.storage import vcd
from testbench.storage.files import atomic_outputs, replace_folder
from testbench.version import VERSION


def _build_manifest(block, case, stim, exp, families, seed):
    interface_entries = design_entry.interface(block, case)
    case_entries = {"block": block.stem, "case": case}
    identity = case_entries | {k: v for k, v in interface_entries.items() if k not in ("unused_params", "levels")}
    return {
        "schema": bundle.SCHEMA,
        **case_entries,
        "clock": {"name": "clk", "hz": block.record.master_hz},
        "reset": {"name": blocks.RESET_INPUT, "active": 1, "cycles": benches.RESET_CYCLES},
        "sample": "before rising edge",
        "n": len(stim),
        **interface_entries,
        "rules": block.rules,
        "latency": block.latency,
        "seed": seed,
        "families": [list(family) for family in families],
        # arguments that goals cannot be met are of the default design
        **({} if block.design else {"coverage": coverage_evidence.summary(block, case, stim, exp)}),
        "config_sha256": hashlib.sha256(bundle.canonical(identity).encode()).hexdigest(),
        "provenance": bundle_provenance.provenance(),
    }


def _vector_texts(block, stim, exp):
    """{path: text}: packed words, one file per port, and decimal."""
    inputs, result_ports = [(p.name, p) for p in block.columns], benches.result_port_pairs(block)
    in_widths, out_widths = [p.width for _, p in inputs], [p.width for _, p in result_ports]
    out_width = sum(out_widths)
    files = {
        "stim.hex": bundle.hex_text(bundle.pack(stim, in_widths), sum(in_widths)),
        "exp.hex": bundle.hex_text(bundle.pack(exp, out_widths), out_width),
        "mask.hex": bundle.hex_text([(1 << out_width) - 1] * len(exp), out_width),
    }
    both = np.column_stack([stim, exp])
    files |= bundle.port_files(inputs + result_ports, both)
    files["vec.csv"] = bundle.csv_text("row", np.arange(len(stim)), [name for name, _ in inputs + result_ports], both)
    return files


def _waveform_writer(block, stim, exp):
    """Function that writes golden.vcd and golden.gtkw into a folder."""
    vcd_signals = [vcd.Signal(f"in.{p.name}", p.width, p.signed) for p in block.columns]
    vcd_signals += [vcd.Signal(f"reg.{p.name}", p.width, p.signed) for p in block.registers]
    vcd_signals += [vcd.Signal(f"out.{p.name}", p.width, p.signed) for p in block.pins]
    rows = np.column_stack([stim, exp])

    def write(folder):
        waves, setup = folder / "golden.vcd", folder / "golden.gtkw"
        vcd.write_vcd(waves, rows, vcd_signals, top=block.stem)
        vcd.write_gtkw(setup, waves, vcd_signals, top=block.stem, expanded=("in", "reg", "out"))
        # the version belongs to the provenance: a release must not change the hash of a vector
        for path in (waves, setup):
            path.write_bytes(path.read_bytes().replace(f"ftr-gyro {VERSION}".encode(), b"ftr-gyro", 1))

    return write


def write(block, case, stim, families, seed, folder):
    """Bundle of a case with these rows of stimulus, written to `folder`; returns its manifest."""
    regs, pins = blocks.run(block, case, stim)
    exp = np.column_stack([regs, pins])
    files = {**_vector_texts(block, stim, exp), **benches.bench_texts(block, case, len(stim))}
    manifest = _build_manifest(block, case, stim, exp, families, seed)
    manifest["ranges"] = range_report.range_entry(block, case, regs, pins)
    files["RANGES.md"] = range_report.text(f"{block.stem}/{case}", manifest["ranges"])
    return bundle.write(folder, manifest, files, [_waveform_writer(block, stim, exp)], scores.note_score)


def export_case(block, case, folder, seed=stimulus.SEED):
    """Write the bundle of one case; returns its manifest."""
    stim, families = stimulus.make(block, case, seed)
    return write(block, case, stim, families, seed, folder)


def select_blocks(name, extra_block_names=(), blocks_by_stem=blocks.BLOCKS):
    """Blocks of a name or `all`; raises ConfigError otherwise. `extra_block_names` are known to the caller, too."""
    if name == "all":
        return list(blocks_by_stem.values())
    if name not in blocks_by_stem:
        raise ConfigError(f"block: {name!r} is not one of all, {', '.join([*blocks_by_stem, *extra_block_names])}")
    return [blocks_by_stem[name]]


def folder_makefile(block):
    """Makefile of a block's folder: the same goals in every case."""
    return f"""# Every case of {block.stem}: make check RTL=folder (absolute), SIM=... for one simulator
CASES = {" ".join(block.cases)}

check clean:
	@status=0; for case in $(CASES); do $(MAKE) --no-print-directory -C $$case $@ || status=1; done; exit $$status

.PHONY: check clean
"""


def export(name, out, progress=None, config=None, frames=design_bundle.BOARD_FRAMES):
    """Write the bundles of a block, of `top`, or of all, together; returns [(folder, manifest)].

    config  path of a configuration: the blocks of its design, also with its parameters
    frames  of the whole design of a configuration from power-on
    """
    settings, firmware = (None, None) if config is None else design_entry.read_board_config(config)
    blocks_by_stem = blocks.BLOCKS if config is None else blocks.firmware_blocks(firmware)
    if config is not None and name in ("all", design_bundle.STEM):
        design_bundle.check_board(firmware, frames)
    selected_blocks = [] if name == design_bundle.STEM else select_blocks(name, [design_bundle.STEM], blocks_by_stem)
    if name in ("all", design_bundle.STEM):
        selected_blocks.append(
            design_bundle.build_top_block(
                dict.fromkeys(design_bundle.CASES if config is None else design_bundle.BOARD_CASES)
            )
        )
    written_bundles, todo = [], [(block, case) for block in selected_blocks for case in block.cases]
    with atomic_outputs(), contextlib.ExitStack() as stack:
        # all at the begin, so that a folder that another process writes is refused before hours are spent
        new = {b.stem: stack.enter_context(replace_folder(Path(out) / b.stem, keep=True)) for b in selected_blocks}
        for n, (block, case) in enumerate(todo):
            if progress is not None:
                progress(f"{block.stem}/{case}", n, len(todo))
            folder = new[block.stem] / case
            if block.stem != design_bundle.STEM:
                manifest = export_case(block, case, folder)
            elif config is None:
                manifest = design_bundle.export_case(case, folder)
            else:
                manifest = design_bundle.export_board(firmware, settings, case, folder, frames)
            written_bundles.append((Path(out) / block.stem / case, manifest))
        for block in selected_blocks:
            (new[block.stem] / "Makefile").write_text(folder_makefile(block))
    return written_bundles

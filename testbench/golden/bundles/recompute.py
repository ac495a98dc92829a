"""A bundle computed again from its own stimulus and parameters: what its hashes cannot prove.

A hash is only as true as who wrote it: with a changed row, new hashes and a new seal a bundle still verifies. Here the
model computes every row again, and every file that follows from the rows, and the first difference is the error.
Files that carry no number (benches, scripts, waves, reports) are compared if the same code wrote them; a bundle of
another version may have others, and `Proof.other` says which.
Source  docs/golden.md
"""

import fnmatch
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model import block as registry
from fpga_model.fixed import Fmt, formats
from testbench import flatten
from testbench.errors import FileError
from testbench.golden.bundles import bundle, design_bundle, design_entry, export
from testbench.golden.recording import recording
from testbench.golden.stimulus import blocks
from testbench.storage import inputs

NUMBERS = ("*.hex", "rom/*", "vec.csv", "params*")  # files that carry rows, tables or parameters
CODE = ("version", "git")
# What a manifest must share with that of this version, whatever wrote it
IDENTITY = ("schema", "clock", "reset", "n", "inputs", "registers", "outputs", "params", "design", "design_params",
            "signature", "clocks")  # fmt: skip
UNSEALED = ("provenance", "sha256", "manifest_sha256")


@dataclass
class Param:
    """Entry of a parameter in a manifest."""

    name: str
    raw: int
    fmt: list[int]


class Proof(NamedTuple):
    """Rows and files that were computed again and are equal; code (None: this) and files that were not compared."""

    rows: int
    files: int
    code: str | None
    other: tuple

    def text(self):
        """One line without the folder."""
        equality_text = f"computed again: {self.rows} rows and {self.files} files are equal"
        if self.code is None:
            return equality_text
        return f"{equality_text}; written by {self.code}: {len(self.other)} benches, scripts and pages are not compared"


def _check_manifest_entry(path, key, stored, computed):
    """FileError at the first difference of an entry of the manifest."""
    if stored == computed:
        return
    if isinstance(stored, list) and isinstance(computed, list):
        for one, other in zip(stored, computed):
            _check_manifest_entry(path, key, one, other)
        raise FileError(f"{path}: {key}: {len(stored)} entries, this version has {len(computed)}")
    raise FileError(f"{path}: {key}: is {str(stored)[:120]}, this version computes {str(computed)[:120]}")


def manifest_block(path, manifest):
    """The block of a manifest, with its case; FileError where this version has none such."""
    stem, case = manifest["block"], manifest["case"]
    design = design_entry.manifest_design(path, manifest)
    block = (blocks.BLOCKS if design is None else blocks.design_blocks(design)).get(stem)
    if block is None or (case not in block.cases and design is None):
        raise FileError(f"{path}: {stem}/{case} is not a block and case of this version")
    if case in block.cases:
        return block
    # parameters of a board: what the manifest says, in this version's formats
    shape = formats(registry.block_modules()[stem].Params, design)
    param_entries = inputs.validate_data(manifest.get("params"), list[Param], path)
    raw = {p.name: p.raw for p in param_entries}
    required_params = [{"name": name, "fmt": list(fmt)} for name, fmt in registry.required_parameters(shape, raw)]
    _check_manifest_entry(path, "params", [{"name": p.name, "fmt": p.fmt} for p in param_entries], required_params)
    for p in param_entries:
        if not Fmt(*p.fmt).holds(p.raw):
            raise FileError(f"{path}: params: {p.name} = {p.raw} is outside its format {Fmt(*p.fmt)}")
    example_params = next(iter(block.cases.values()))
    return block._replace(cases={case: flatten.rebuild(example_params, registry.raws(shape, raw))})


def _rewrite_block(old_bundle, path, folder):
    """Write the bundle of a block again from the rows of one that was read."""
    manifest = old_bundle.manifest
    case, block = manifest["case"], manifest_block(path, manifest)
    ports = {"inputs": block.columns, "registers": block.registers, "outputs": block.pins}
    for key, block_ports in ports.items():
        _check_manifest_entry(path, key, manifest[key], [bundle.port(p) for p in block_ports])
    params = [{"name": name, "raw": raw, "fmt": list(fmt)} for name, raw, fmt in blocks.case_parameters(block, case)]
    _check_manifest_entry(path, "params", manifest.get("params"), params)
    export.write(block, case, old_bundle.stim, manifest.get("families", ()), manifest.get("seed"), folder)


def _rewrite_top(old_bundle, path, folder):
    """The same for a bundle of the whole design: its recording, replayed."""
    r = design_bundle.read_bundle_recording(path.parent, old_bundle.manifest)
    names_design = "design" in old_bundle.manifest
    shipped = recording.load(r.name) if r.name in design_bundle.CASES and not names_design else None
    if shipped is not None and shipped.frames == r.frames and recording.sha256(shipped) != recording.sha256(r):
        raise FileError(f"{path}: is of another recording of {r.name} than that of this version")
    clocks = design_bundle.pin_delays(path.parent, old_bundle.manifest)
    design_bundle.write(
        r, folder, old_bundle.at, names_design, design_bundle.bundle_level(old_bundle.manifest), clocks=clocks
    )


def _check_rows(folder, name, stored_rows, computed_rows, at, ports):
    """FileError at the first row and port that differ."""
    if np.array_equal(stored_rows, computed_rows):
        return
    row = int(np.flatnonzero((stored_rows != computed_rows).any(axis=1))[0])
    k = int(np.flatnonzero(stored_rows[row] != computed_rows[row])[0])
    where = f"row {row}" if at[row] == row else f"row {row} (clock {at[row]})"
    raise FileError(
        f"{folder / name}: {where}, port {ports[k]['name']}: holds {stored_rows[row, k]}, "
        f"the model computes {computed_rows[row, k]}"
    )


def _first_different_line(one, other):
    """First line in which two files differ."""
    lines = [path.read_bytes().split(b"\n") for path in (one, other)]
    return next((n for n, (a, b) in enumerate(zip(*lines), 1) if a != b), min(map(len, lines)))


def _numbers(name):
    return any(fnmatch.fnmatch(name, pattern) for pattern in NUMBERS)


def _check_files(folder, again, stored_hashes, computed_hashes, has_equal_code):
    """Names of files that were not compared; FileError at the first that is missing, added or other."""
    skipped_files = []
    for name in sorted(stored_hashes.keys() | computed_hashes.keys(), key=lambda name: (not _numbers(name), name)):
        if stored_hashes.get(name) == computed_hashes.get(name):
            continue
        if not has_equal_code and not _numbers(name):
            skipped_files.append(name)
        elif name not in computed_hashes:
            raise FileError(f"{folder / name}: this version writes no such file")
        elif name not in stored_hashes:
            raise FileError(f"{folder / name}: missing: this version writes it")
        else:
            line = _first_different_line(folder / name, again / name)
            raise FileError(f"{folder / name}: line {line} differs from what this version writes")
    return skipped_files


def _code(manifest):
    """What wrote a bundle; no hash covers it."""
    origin = manifest.get("provenance")
    return tuple(origin.get(key) for key in CODE) if isinstance(origin, dict) else (None, None)


def recompute(folder):
    """`Proof` of a bundle; raises FileError with the first row and port, entry or line that the model has otherwise."""
    folder = Path(folder)
    manifest = bundle.verify(folder)
    old_bundle, path = bundle.read(folder), folder / bundle.MANIFEST
    replay = manifest["schema"] == bundle.REPLAY_SCHEMA
    with tempfile.TemporaryDirectory(prefix="gyro-recompute-") as temporary_folder:
        again = Path(temporary_folder) / "again"
        try:
            (_rewrite_top if replay else _rewrite_block)(old_bundle, path, again)
        except ValueError as problem:
            raise FileError(f"{folder}: cannot be computed again: {problem}") from None
        new_bundle = bundle.read(again)
        results = manifest["registers"] + manifest["outputs"]
        _check_rows(folder, "exp.hex", old_bundle.exp, new_bundle.exp, old_bundle.at, results)
        _check_rows(folder, "stim.hex", old_bundle.stim, new_bundle.stim, old_bundle.at, manifest["inputs"])
        _check_rows(folder, "mask.hex", old_bundle.mask, new_bundle.mask, old_bundle.at, results)
        code, mine = _code(manifest), _code(new_bundle.manifest)
        stored_hashes = manifest["sha256"]
        skipped_files = _check_files(folder, again, stored_hashes, new_bundle.manifest["sha256"], code == mine)
        keys = (
            IDENTITY if code != mine else [k for k in manifest.keys() | new_bundle.manifest.keys() if k not in UNSEALED]
        )
        for key in sorted(keys):
            _check_manifest_entry(path, key, manifest.get(key), new_bundle.manifest.get(key))
    writer_version = None if code == mine else f"version {code[0]}, git {str(code[1])[:12]}"
    return Proof(len(old_bundle.exp), len(stored_hashes) - len(skipped_files), writer_version, tuple(skipped_files))

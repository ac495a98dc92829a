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
from testbench.golden.bundles import bundle, design_entry, export, top
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
        same = f"computed again: {self.rows} rows and {self.files} files are equal"
        if self.code is None:
            return same
        return f"{same}; written by {self.code}: {len(self.other)} benches, scripts and pages are not compared"


def _same_entry(path, key, given, own):
    """FileError at the first difference of an entry of the manifest."""
    if given == own:
        return
    if isinstance(given, list) and isinstance(own, list):
        for one, other in zip(given, own):
            _same_entry(path, key, one, other)
        raise FileError(f"{path}: {key}: {len(given)} entries, this version has {len(own)}")
    raise FileError(f"{path}: {key}: {str(given)[:120]} is not {str(own)[:120]}, as this version computes it")


def block_of(path, manifest):
    """The block of a manifest, with its case; FileError where this version has none such."""
    stem, case = manifest["block"], manifest["case"]
    design = design_entry.of_manifest(path, manifest)
    block = (blocks.BLOCKS if design is None else blocks.design_blocks(design)).get(stem)
    if block is None or (case not in block.cases and design is None):
        raise FileError(f"{path}: {stem}/{case} is no block and case of this version")
    if case in block.cases:
        return block
    # parameters of a board: what the manifest says, in this version's formats
    shape = formats(registry.declared()[stem].Params, design)
    given = inputs.checked(manifest.get("params"), list[Param], path)
    raw = {p.name: p.raw for p in given}
    wanted = [{"name": name, "fmt": list(fmt)} for name, fmt in registry.asked(shape, raw)]
    _same_entry(path, "params", [{"name": p.name, "fmt": p.fmt} for p in given], wanted)
    for p in given:
        if not Fmt(*p.fmt).holds(p.raw):
            raise FileError(f"{path}: params: {p.name} = {p.raw} is outside its format {Fmt(*p.fmt)}")
    like = next(iter(block.cases.values()))
    return block._replace(cases={case: flatten.rebuild(like, registry.raws(shape, raw))})


def _block_again(found, path, folder):
    """Write the bundle of a block again from the rows of one that was read."""
    manifest = found.manifest
    case, block = manifest["case"], block_of(path, manifest)
    ports = {"inputs": block.columns, "registers": block.registers, "outputs": block.pins}
    for key, own in ports.items():
        _same_entry(path, key, manifest[key], [bundle.port(p) for p in own])
    params = [{"name": name, "raw": raw, "fmt": list(fmt)} for name, raw, fmt in blocks.case_parameters(block, case)]
    _same_entry(path, "params", manifest.get("params"), params)
    export.write(block, case, found.stim, manifest.get("families", ()), manifest.get("seed"), folder)


def _top_again(found, path, folder):
    """The same for a bundle of the whole design: its recording, replayed."""
    r = top.replayed(path.parent, found.manifest)
    of_board = "design" in found.manifest
    shipped = recording.load(r.name) if r.name in top.CASES and not of_board else None
    if shipped is not None and shipped.frames == r.frames and recording.sha256(shipped) != recording.sha256(r):
        raise FileError(f"{path}: is of another recording of {r.name} than this version has")
    clocks = top.late_of(path.parent, found.manifest)
    top.write(r, folder, found.at, of_board, top.level_of(found.manifest), clocks=clocks)


def _same_rows(folder, name, given, own, at, ports):
    """FileError at the first row and port that differ."""
    if np.array_equal(given, own):
        return
    row = int(np.flatnonzero((given != own).any(axis=1))[0])
    k = int(np.flatnonzero(given[row] != own[row])[0])
    where = f"row {row}" if at[row] == row else f"row {row} (clock {at[row]})"
    raise FileError(
        f"{folder / name}: {where}, port {ports[k]['name']}: holds {given[row, k]}, the model computes {own[row, k]}"
    )


def _line_of(one, other):
    """First line in which two files differ."""
    lines = [path.read_bytes().split(b"\n") for path in (one, other)]
    return next((n for n, (a, b) in enumerate(zip(*lines), 1) if a != b), min(map(len, lines)))


def _numbers(name):
    return any(fnmatch.fnmatch(name, pattern) for pattern in NUMBERS)


def _same_files(folder, again, given, own, same_code):
    """Names of files that were not compared; FileError at the first that is missing, added or other."""
    left = []
    for name in sorted(given.keys() | own.keys(), key=lambda name: (not _numbers(name), name)):
        if given.get(name) == own.get(name):
            continue
        if not same_code and not _numbers(name):
            left.append(name)
        elif name not in own:
            raise FileError(f"{folder / name}: this version writes no such file")
        elif name not in given:
            raise FileError(f"{folder / name}: missing: this version writes it")
        else:
            line = _line_of(folder / name, again / name)
            raise FileError(f"{folder / name}: line {line} is not what the model computes")
    return left


def _code(manifest):
    """What wrote a bundle; no hash covers it."""
    origin = manifest.get("provenance")
    return tuple(origin.get(key) for key in CODE) if isinstance(origin, dict) else (None, None)


def recompute(folder):
    """`Proof` of a bundle; raises FileError with the first row and port, entry or line that the model has otherwise."""
    folder = Path(folder)
    manifest = bundle.verify(folder)
    found, path = bundle.read(folder), folder / bundle.MANIFEST
    replay = manifest["schema"] == bundle.REPLAY_SCHEMA
    with tempfile.TemporaryDirectory(prefix="gyro-recompute-") as place:
        again = Path(place) / "again"
        try:
            (_top_again if replay else _block_again)(found, path, again)
        except ValueError as problem:
            raise FileError(f"{folder}: cannot be computed again: {problem}") from None
        own = bundle.read(again)
        results = manifest["registers"] + manifest["outputs"]
        _same_rows(folder, "exp.hex", found.exp, own.exp, found.at, results)
        _same_rows(folder, "stim.hex", found.stim, own.stim, found.at, manifest["inputs"])
        _same_rows(folder, "mask.hex", found.mask, own.mask, found.at, results)
        code, mine = _code(manifest), _code(own.manifest)
        given = manifest["sha256"]
        left = _same_files(folder, again, given, own.manifest["sha256"], code == mine)
        keys = IDENTITY if code != mine else [k for k in manifest.keys() | own.manifest.keys() if k not in UNSEALED]
        for key in sorted(keys):
            _same_entry(path, key, manifest.get(key), own.manifest.get(key))
    named = None if code == mine else f"version {code[0]}, git {str(code[1])[:12]}"
    return Proof(len(found.exp), len(given) - len(left), named, tuple(left))

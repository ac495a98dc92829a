"""A golden bundle on disk: one folder per block and case, whole or absent, and refused when it was touched.

    manifest.json        schema, ports, reset, latency, families, SHA-256 of every other file and of itself
    stim.hex             inputs of each row, first port in the most significant bits
    exp.hex, mask.hex    registers, then outputs, and which of their bits are compared
    ports/NAME.hex       the same, one port per file;   vec.csv  the same in decimal

A bundle of the whole design (`gyro-golden-replay/1.0`) has rows at the clocks of at.hex only and compares all bits of
them: no mask.hex. It has sig.hex, a signature per frame, and what its bench replays: adc.hex, host.hex, sar.hex.

Words are lower-case two's complement hexadecimal of ceil(width / 4) digits, one per line, with a final newline:
what $readmemh, hread and Python read alike. The hash of the manifest leaves `provenance` out.
Source  docs/conventions.md (rows)
"""

import hashlib
import json
import os
import re
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from testbench.errors import FileError
from testbench.storage.files import replace_folder
from testbench.storage.inputs import file_sha256, read_json, read_text, validate_data

SCHEMA = "gyro-golden/1.0"
REPLAY_SCHEMA = "gyro-golden-replay/1.0"
MANIFEST = "manifest.json"
BUILD = "build"
PINS = "pins"  # folder in a bundle of the whole design: the bundle of this level
WORDS = ("stim", "exp", "mask")
HEX = np.frombuffer(b"0123456789abcdef", np.uint8)
# Files of a replay: bits of a word, and the key of the manifest that counts them
REPLAYED = {"at": (32, "n"), "sig": (64, "frames"), "adc": (248, "conversions"), "host": (92, "host_events"),
            "sar": (36, "samples")}  # fmt: skip


class Bundle(NamedTuple):
    """A bundle that was read: the manifest, and int64 rows of inputs, of registers and outputs, and their mask.

    at          clocks of the rows
    signatures  of the frames, of the whole design; empty for a block
    """

    manifest: dict
    stim: np.ndarray
    exp: np.ndarray
    mask: np.ndarray
    at: np.ndarray
    signatures: tuple = ()


def digits(width):
    """Hexadecimal digits of a word."""
    return -(-width // 4)


def total(port_entries):
    """Width of ports packed side by side; `port_entries` as in the manifest."""
    return sum(port["width"] for port in port_entries)


def _column_bit_positions(widths):
    """Bytes of a row of columns that end at its last bit, and (byte, bit within it, bits unused of 64) per column."""
    size = -(-sum(widths) // 8)
    ends = 8 * size - np.cumsum(widths[::-1])[::-1]
    return size, [(*divmod(int(at), 8), 64 - width) for at, width in zip(ends, widths)]


def pack(rows, widths):
    """One Python integer per row: the columns side by side, the first in the most significant bits."""
    size, column_positions = _column_bit_positions(widths)
    packed = np.zeros((len(rows), size + 8), np.uint8)
    for column, (byte, bit, unused) in zip(rows.T, column_positions, strict=True):
        aligned_bits = column.astype(np.uint64) << unused
        packed[:, byte : byte + 8] |= (aligned_bits >> bit).astype(">u8").view(np.uint8).reshape(-1, 8)
        packed[:, byte + 8] |= (aligned_bits << 8 - bit).astype(np.uint8) if bit else 0
    return [int.from_bytes(row.tobytes(), "big") for row in packed[:, :size]]


def unpack(words, port_entries):
    """int64 rows from packed words; the inverse of `pack`."""
    size, column_positions = _column_bit_positions([port["width"] for port in port_entries])
    rows, packed = np.zeros((len(words), len(port_entries)), np.int64), np.zeros((len(words), size + 8), np.uint8)
    word_bytes = np.frombuffer(b"".join([word.to_bytes(size, "big") for word in words]), np.uint8)
    packed[:, :size] = word_bytes.reshape(len(words), size)
    for k, (byte, bit, unused) in enumerate(column_positions):
        aligned_bits = packed[:, byte : byte + 8].copy().view(">u8")[:, 0].astype(np.uint64) << bit
        aligned_bits |= packed[:, byte + 8] >> 8 - bit if bit else np.uint8(0)
        rows[:, k] = aligned_bits.view(np.int64) >> unused if port_entries[k]["signed"] else aligned_bits >> unused
    return rows


def hex_text(words, width):
    """Lines of a hex file."""
    count = digits(width)
    return "".join([f"{word:0{count}x}\n" for word in words])


def port(block_port):
    """Entry of a `blocks.Port` in the manifest."""
    return {
        "name": block_port.name,
        "width": block_port.width,
        "signed": block_port.signed,
        "fmt": list(block_port.fmt),
        "reset": block_port.reset,
        "rounding": block_port.rounding,
        "overflow": block_port.overflow,
    }


def port_files(port_pairs, rows):
    """{path: text} of one hex file per port; `port_pairs` is (name, Port) for each column of `rows`."""
    files = {}
    for k, (name, block_port) in enumerate(port_pairs):
        words = (rows[:, k] & ((1 << block_port.width) - 1)).astype(">u8").view(np.uint8).reshape(-1, 8)
        lines = np.full((len(words), 17), ord("\n"), np.uint8)
        lines[:, 0:16:2], lines[:, 1:16:2] = HEX[words >> 4], HEX[words & 15]
        files[f"ports/{name}.hex"] = lines[:, 16 - digits(block_port.width) :].tobytes().decode("ascii")
    return files


def csv_text(first, numbers, names, rows):
    """Text of vec.csv: a header, and one line per row with its number in front."""
    both = np.column_stack([numbers, rows]).tolist()
    return "\n".join([",".join([first, *names]), *(",".join(map(str, row)) for row in both)]) + "\n"


def canonical(data):
    """JSON with one spelling only, for hashing."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def seal(manifest):
    """SHA-256 of a manifest without its provenance and without this very entry."""
    sealed_entries = {k: v for k, v in manifest.items() if k not in ("provenance", "manifest_sha256")}
    return hashlib.sha256(canonical(sealed_entries).encode()).hexdigest()


def vectors_sha256(manifest):
    """SHA-256 of a bundle's vectors alone: what benches, scripts, goals and names of it do not change."""
    vectors = {name: manifest["sha256"][name] for name in (f"{word}.hex" for word in hex_stems(manifest))}
    return hashlib.sha256(canonical(vectors).encode()).hexdigest()


def seal_manifest(manifest, files):
    """The whole manifest of files: {path: text or bytes}."""
    raw = {name: files[name] if isinstance(files[name], bytes) else files[name].encode() for name in sorted(files)}
    full = {**manifest, "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in raw.items()}}
    return {**full, "manifest_sha256": seal(full)}


def manifest_text(manifest):
    """Text of manifest.json."""
    return json.dumps(manifest, indent=1, ensure_ascii=True) + "\n"


def _fill(part, manifest, files, trees, make_provenance):
    """Write a bundle into the new folder `part`; returns the whole manifest."""
    for name, text in files.items():
        path = part / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode())
    for write_tree in trees:
        write_tree(part)
    written = {path.relative_to(part).as_posix(): path.read_bytes() for path in part.rglob("*") if path.is_file()}
    full = seal_manifest(manifest, written)
    if make_provenance is not None:
        full["provenance"] = {**full["provenance"], **make_provenance(full)}
    (part / MANIFEST).write_bytes(manifest_text(full).encode())
    return full


def write(folder, manifest, files, trees=(), make_provenance=None):
    """Write a bundle as a whole; a bundle that was there is replaced.

    manifest            without hashes
    files               {relative path: text}
    trees               functions of the new folder that write further files into it
    make_provenance     function of the sealed manifest: entries that its provenance gets besides
    """
    with replace_folder(folder, MANIFEST) as part:
        return _fill(part, manifest, files, trees, make_provenance)


def _inside(folder, name):
    """Path of a bundle's file; raises FileError if the name leaves the folder."""
    pure = PurePosixPath(name)
    if not name or pure.is_absolute() or ".." in pure.parts or "\\" in name or ":" in name:
        raise FileError(f"{folder}: file name {name!r} in {MANIFEST} is outside the bundle")
    path = folder / name
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
        present = path.is_file()
    except (OSError, RuntimeError, ValueError) as problem:
        raise FileError(f"{folder}: file name {name[:80]!r} in {MANIFEST} is not valid: {problem}") from None
    if not inside:
        raise FileError(f"{folder}: {name} is a link to a place outside the bundle")
    if not present:
        raise FileError(f"{path}: missing")
    return path


def _unlisted_paths(folder, manifest):
    """Paths in the folder that the manifest does not list; what benches leave is in build/."""
    manifest_names = {MANIFEST, *manifest["sha256"]}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if (
            name.parts[0] != BUILD
            and name.parts[:2] != (PINS, BUILD)
            and name.as_posix() not in manifest_names
            and (path.is_symlink() or not path.is_dir())
        ):
            yield path


REQUIRED = {"schema": str, "block": str, "case": str, "n": int, "inputs": list, "registers": list, "outputs": list,
            "reset": dict, "clock": dict, "sha256": dict, "manifest_sha256": str}  # fmt: skip
REPLAY_REQUIRED = {"frames": int, "frame_cycles": int, "conversions": int, "host_events": int, "samples": int,
                   "recording_sha256": str, "windows": list}  # fmt: skip
PORT_KEYS = {"name": str, "width": int, "signed": bool}


def hex_stems(manifest):
    """Names of the hex files that a bundle must have."""
    return (*WORDS[:2], *REPLAYED) if manifest["schema"] == REPLAY_SCHEMA else WORDS


def _read_manifest(folder):
    path = folder / MANIFEST
    if not os.path.exists(path):
        # a folder that `wrap` has written beside the cases is no bundle
        cases = [part.parent.name for part in folder.glob(f"*/{MANIFEST}") if b'"manifest_sha256"' in part.read_bytes()]
        if cases:
            raise FileError(f"{folder}: the folder of a block; give that of a case: {', '.join(sorted(cases))}")
        raise FileError(f"{path}: cannot be read: no such file; a bundle is a folder DIR/BLOCK/CASE")
    manifest = read_json(path)
    schema = manifest.get("schema")
    if schema not in (SCHEMA, REPLAY_SCHEMA):
        raise FileError(f"{path}: schema is {schema!r}, not {SCHEMA!r}")
    for key, kind in (REQUIRED | (REPLAY_REQUIRED if schema == REPLAY_SCHEMA else {})).items():
        if not isinstance(manifest.get(key), kind) or isinstance(manifest.get(key), bool):
            raise FileError(f"{path}: {key} is missing or not of type {kind.__name__}")
    validate_data(manifest["sha256"], dict[str, str], f"{path}: sha256")
    port_entries = manifest["inputs"] + manifest["registers"] + manifest["outputs"]
    for port in port_entries:
        if not isinstance(port, dict) or any(type(port.get(k)) is not kind for k, kind in PORT_KEYS.items()):
            raise FileError(f"{path}: a port lacks name, width or sign: {str(port)[:80]}")
        if not 1 <= port["width"] <= 63:
            raise FileError(f"{path}: port {port['name']}: width {port['width']} is outside 1 .. 63 bits")
    for group in ("inputs", "registers", "outputs"):
        names = [port["name"] for port in manifest[group]]
        if len(set(names)) != len(names):
            raise FileError(f"{path}: {group}: duplicate port {max(names, key=names.count)}")
    for key in ("n", *(key for _, key in REPLAYED.values() if schema == REPLAY_SCHEMA)):
        if manifest[key] < 0:
            raise FileError(f"{path}: {key} is {manifest[key]}, below 0 rows")
    return manifest


def _read_hex_words(path, width, count):
    """Words of a hex file; raises FileError at the first line that is not one."""
    text = read_text(path, encoding="ascii")
    if not text.endswith("\n") and count:
        raise FileError(f"{path}: truncated: no newline at its end")
    lines = text.split("\n")[:-1]
    if len(lines) != count:
        raise FileError(f"{path}: {len(lines)} rows, expected {count}")
    expected = digits(width)
    if not re.fullmatch(rf"(?:[0-9a-f]{{{expected}}}\n)*", text):
        bad = next(n for n, line in enumerate(lines) if not re.fullmatch(rf"[0-9a-f]{{{expected}}}", line))
        error_text = f"{lines[bad][:80]!r} is not {expected} lower-case hexadecimal digits"
        raise FileError(f"{path}: line {bad + 1}: {error_text}")
    words = [int(line, 16) for line in lines]
    for n, word in enumerate(words):
        if word >> width:
            raise FileError(f"{path}: line {n + 1}: more than {width} bits")
    return words


def verify(folder, strict=True):
    """Manifest of a bundle after every hash and every name has been checked; raises FileError with one clear line.

    strict  also refuse files that are not of the bundle, outside of build/: a tool may read them instead of its own
    """
    folder = Path(folder)
    manifest = _read_manifest(folder)
    if manifest["manifest_sha256"] != seal(manifest):
        raise FileError(f"{folder / MANIFEST}: SHA-256 does not match: the manifest was changed")
    for name in (f"{word}.hex" for word in hex_stems(manifest)):
        if name not in manifest["sha256"]:
            raise FileError(f"{folder / MANIFEST}: {name} is not listed")
    for name, expected in manifest["sha256"].items():
        path = _inside(folder, name)
        if file_sha256(path) != expected:
            raise FileError(f"{path}: SHA-256 does not match the manifest: the file was changed")
    for path in _unlisted_paths(folder, manifest) if strict else ():
        raise FileError(f"{path}: is not a file of this bundle; move it elsewhere or into {BUILD}/")
    return manifest


def read(folder):
    """Verify a bundle and read its rows; logs and notes beside them are left alone."""
    folder = Path(folder)
    manifest = verify(folder, strict=False)
    results = manifest["registers"] + manifest["outputs"]
    bare = [{**port, "signed": False} for port in results]
    count = manifest["n"]
    if manifest["schema"] == REPLAY_SCHEMA:
        return _read_replay(folder, manifest, results)
    stim, exp, mask = (
        unpack(_read_hex_words(folder / f"{name}.hex", total(port_entries), count), port_entries)
        for name, port_entries in zip(WORDS, (manifest["inputs"], results, bare), strict=True)
    )
    return Bundle(manifest, stim, exp, mask, np.arange(count))


def replayed_words(folder, manifest, name):
    """Words of a file of `REPLAYED`, of a bundle that was verified."""
    width, key = REPLAYED[name]
    return _read_hex_words(Path(folder) / f"{name}.hex", width, manifest[key])


def _read_replay(folder, manifest, results):
    words = {name: replayed_words(folder, manifest, name) for name in REPLAYED}
    at, end = np.array(words["at"], np.int64), manifest["frames"] * manifest["frame_cycles"]
    if len(at) and (at[-1] >= end or (np.diff(at) <= 0).any()):
        raise FileError(f"{folder / 'at.hex'}: the clocks do not strictly increase within 0 .. {end - 1}")
    for name in ("adc", "host"):
        clocks = np.array([word >> (REPLAYED[name][0] - 32) for word in words[name]], np.int64)
        if len(clocks) and (clocks[-1] >= end or (np.diff(clocks) <= 0).any()):
            raise FileError(f"{folder / name}.hex: the clocks do not strictly increase within 0 .. {end - 1}")
    stim, exp = (
        unpack(_read_hex_words(folder / f"{name}.hex", total(port_entries), manifest["n"]), port_entries)
        for name, port_entries in (("stim", manifest["inputs"]), ("exp", results))
    )
    mask = np.tile(np.array([(1 << port["width"]) - 1 for port in results], np.int64), (len(at), 1))
    return Bundle(manifest, stim, exp, mask, at, tuple(words["sig"]))

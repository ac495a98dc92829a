"""Rows of a record on their way to the disk while a run is in progress, so that memory does not grow with time.

    engine -- frames --> [block of rows] --> rows.bin, fixed-size little-endian rows --> (at the end) run.h5

A plain file of rows, not HDF5: one that was killed in the middle of a write is cut to the length that the last
checkpoint names and continued. The HDF5 file is made from it in one pass and does not show how often that happened.
A SHA-256 of every block of READ_ROWS rows is kept in memory and in the checkpoint: rows that another program has
changed are found when the run continues and when the record is made.

With `decimate` a row stands for n frames. Codes and words are summed exactly, which keeps their Allan deviation at
multiples of n frames what it is; their name gets the ending "_sum", so that nobody takes them for single codes. Of the
state and of what oscillates at the drive frequency the first frame is kept; of the fault flags all that were raised, of
the locks those that held throughout. A last group of fewer than n frames is left out.
Source  docs/record.md
"""

import collections
import contextlib
import hashlib
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.engines import engine
from testbench.errors import FileError
from testbench.storage import inputs
from testbench.storage.code_hash import WORDS
from testbench.storage.files import explain
from testbench.storage.record import Column, RecordWriter

BLOCK_ROWS = 8192  # frames gathered before they are written
READ_ROWS = 1 << 16
SUM, FIRST, ANY, ALL = "sum", "first", "any", "all"
RULES = {
    "state": FIRST,
    "flags": ANY,
    "lock": ALL,
    "drive_dac_code": FIRST,
    "sense_dac_code": FIRST,
}


class Field(NamedTuple):
    """A column of the record: where it comes from, what it is, and what becomes of n frames of it."""

    name: str
    index: int
    truth: bool
    unit: str
    dtype: np.dtype
    attrs: dict
    rule: str


def _register_fields(design):
    for k, (name, lsb, fmt) in enumerate(engine.FRAME_COLUMNS):
        lsb, fmt = lsb.format(**design._asdict()), fmt.for_design(design)
        unit = "code" if "code" in name or name.startswith("adc") else "word"
        narrow = fmt.lo >= -(1 << 31) and fmt.hi < 1 << 31
        dtype = np.dtype("<i4" if narrow else "<i8")
        yield Field(name, k, False, unit, dtype, {"lsb": lsb, "format": str(fmt)}, RULES.get(name, SUM))


def _truth_fields():
    for k, (name, unit) in enumerate(engine.TRUTH_COLUMNS):
        yield Field(f"truth_{name}", k, True, unit, np.dtype("<f8"), {"tap": "truth"}, FIRST)


HASHED = tuple(name for name, _, _ in engine.FRAME_COLUMNS[:WORDS])  # what the hash of codes covers
FIELDS = {field.name: field for field in (*_register_fields(DEFAULT), *_truth_fields())}


def select_fields(names, decimate, design=DEFAULT, lsb=None):
    """{name in the record: Field} of `[output] columns` (none: all) with rows of `decimate` frames.

    lsb  {name: text} of columns whose LSB depends on the board
    """
    field_by_name = {field.name: field for field in (*_register_fields(design), *_truth_fields())}
    fields = [field_by_name[name] for name in FIELDS if not names or name in names]
    fields = [f._replace(attrs=f.attrs | {"lsb": lsb[f.name]}) if f.name in (lsb or {}) else f for f in fields]
    if decimate == 1:
        return {field.name: field for field in fields}
    out = {}
    for field in fields:
        attrs = {**field.attrs, "frames": decimate, "kept": field.rule}
        dtype = np.dtype("<i8") if field.rule == SUM else field.dtype
        name = f"{field.name}_sum" if field.rule == SUM else field.name
        out[name] = field._replace(dtype=dtype, attrs=attrs)
    return out


def _reduce_groups(column_values, decimate, rule):
    """One value for each group of `decimate`."""
    groups = column_values.reshape(-1, decimate)
    if rule == SUM:
        return groups.sum(axis=1)
    if rule == ANY:
        return np.bitwise_or.reduce(groups, axis=1)
    if rule == ALL:
        return np.bitwise_and.reduce(groups, axis=1)
    return groups[:, 0]


class Spool:
    """A sink of `simulation.Simulation` that writes the columns of a record to a file, or keeps them in memory.

    columns, decimate  of [output]
    path               the file; None keeps the rows in memory
    rows               if not None, the file exists already and continues behind so many rows
    design             design record of the firmware
    lsb                {name: text} of columns whose LSB depends on the board
    """

    def __init__(self, columns=(), decimate=1, path=None, rows=None, design=DEFAULT, lsb=None):
        self.fields = select_fields(columns, decimate, design, lsb)
        self.frame_clocks, self.clock_hz = design.frame_clocks, design.master_hz
        self.dtype = np.dtype([(name, field.dtype) for name, field in self.fields.items()])
        self.decimate = decimate
        self.path = path
        self.first_frame = -1
        self.rows = 0
        self._held, self._held_rows = [], 0
        self._memory = []
        self._digests, self._open, self._open_rows = [], hashlib.sha256(), 0
        if path is None:
            return
        try:
            with open(path, "wb" if rows is None else "r+b") as file:
                size, file_bytes = (rows or 0) * self.dtype.itemsize, os.fstat(file.fileno()).st_size
                if file_bytes < size:
                    raise FileError(f"{path}: has {file_bytes} bytes, its checkpoint states {size}")
                file.truncate(size)
        except OSError as problem:
            raise explain(path, problem) from None

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        if self.first_frame < 0:
            self.first_frame = first_frame
        self._held.append((frames, truth))
        self._held_rows += len(frames)
        if self._held_rows >= max(BLOCK_ROWS, self.decimate):
            self.flush()

    def flush(self):
        """Write all whole groups of frames."""
        if not self._held:
            return
        frames, truth = (np.concatenate(pieces) for pieces in zip(*self._held))
        rows = len(frames) // self.decimate
        used = rows * self.decimate
        out = np.empty(rows, self.dtype)
        for name, field in self.fields.items():
            field_values = (truth if field.truth else frames)[:used, field.index]
            out[name] = field_values if self.decimate == 1 else _reduce_groups(field_values, self.decimate, field.rule)
        self._write(out)
        self.rows += rows
        self._held = [(frames[used:], truth[used:])]
        self._held_rows = len(frames) - used

    def _write(self, rows):
        if self.path is None:
            self._memory.append(rows)
            return
        self._hash(rows)
        try:
            with open(self.path, "r+b", buffering=0) as file:
                file.seek(0, os.SEEK_END)
                unwritten_bytes = memoryview(rows).cast("B") if len(rows) else b""
                while unwritten_bytes:
                    unwritten_bytes = unwritten_bytes[file.write(unwritten_bytes) :]
        except OSError as problem:
            raise explain(self.path, problem) from None

    def _hash(self, rows):
        """Add rows to the digests of their blocks."""
        while len(rows):
            take = rows[: READ_ROWS - self._open_rows]
            self._open.update(take.data)
            self._open_rows, rows = self._open_rows + len(take), rows[len(take) :]
            if self._open_rows == READ_ROWS:
                self._digests.append(self._open.digest())
                self._open, self._open_rows = hashlib.sha256(), 0

    def _read(self):
        """(rows, SHA-256) of every block in the file."""
        with inputs.open_input(self.path) as file:
            while block := file.read(READ_ROWS * self.dtype.itemsize):
                yield np.frombuffer(block, self.dtype), hashlib.sha256(block).digest()

    def _check_block(self, k, block_digest, saved_digest):
        """FileError if block k is another than the one that was written."""
        if block_digest != saved_digest:
            raise FileError(
                f"{self.path}: rows {k * READ_ROWS} .. {min((k + 1) * READ_ROWS, self.rows) - 1} differ from what "
                "was written: another program changed the file; start the run again with --discard"
            )

    def row_blocks(self):
        """Rows from the first one on, in arrays of READ_ROWS; the last one may be shorter."""
        self.flush()
        if self.path is None:
            rows = np.concatenate([np.empty(0, self.dtype), *self._memory])
            yield from (rows[k : k + READ_ROWS] for k in range(0, len(rows), READ_ROWS))
            return
        size, written = os.path.getsize(self.path), self.rows * self.dtype.itemsize
        if size != written:
            raise FileError(
                f"{self.path}: has {size} bytes, but {written} were written; another run may use this folder"
            )
        block_digests = [*self._digests, self._open.digest()]
        for k, (rows, block_digest) in enumerate(self._read()):
            self._check_block(k, block_digest, block_digests[k])
            yield rows

    # ---- checkpoints -------------------------------------------------------------------------------------------------

    def dump(self):
        """Whole groups on the disk, safe from a loss of power; the frames of the group that has begun."""
        self.flush()
        if self.path is not None:
            try:
                with open(self.path, "rb") as file:
                    os.fsync(file.fileno())
            except OSError as problem:
                raise explain(self.path, problem) from None
        frames, truth = self._held[0] if self._held else (np.zeros((0, 1), np.int64), np.zeros((0, 1)))
        joined_digests = b"".join([*self._digests, self._open.digest()])
        spool_state = {"rows": self.rows, "first_frame": self.first_frame, "frames": frames, "truth": truth}
        return spool_state | {"sha256": np.frombuffer(joined_digests, np.uint8)}

    def restore(self, spool_state):
        """Continue where `dump` was, in a file that was opened with its `rows`; FileError if they are others."""
        self.rows, self.first_frame = spool_state["rows"], spool_state["first_frame"]
        if self.path is not None:
            saved_digests = spool_state.get("sha256", np.zeros(0, np.uint8)).tobytes()  # version 0.1.0 kept none
            for k, (rows, digest) in enumerate(self._read()):
                self._check_block(k, digest, saved_digests[32 * k : 32 * k + 32] if saved_digests else digest)
                self._hash(rows)
        if len(spool_state["frames"]):
            self._held, self._held_rows = [(spool_state["frames"], spool_state["truth"])], len(spool_state["frames"])


class Recording:
    """A record whose columns lie in a spool; `write` makes the HDF5 file."""

    def __init__(self, spool, config_toml, clock_ppm, record_id=None, created_utc=None):
        self.spool = spool
        self.config_toml = config_toml
        self.clock_ppm = clock_ppm
        self.attrs = {}
        self.codes = None  # `CodeHash` of the run, if the record is to be checked against it
        self.partial = None  # who holds the folder as long as these rows are needed
        self.record_id = record_id or str(uuid4())
        self.created_utc = created_utc or datetime.now(UTC).isoformat(timespec="seconds")
        self.tables = {}

    @property
    def streams(self):
        """{name: record.Column}, all in memory: for runs of seconds."""
        blocks = list(self.spool.row_blocks())
        rows = np.concatenate(blocks) if blocks else np.zeros(0, self.spool.dtype)
        return {
            name: Column(np.ascontiguousarray(rows[name]), field.unit, *self._rate(), field.attrs, self.spool.clock_hz)
            for name, field in self.spool.fields.items()
        }

    def _rate(self):
        """num, den, edge0 of every column."""
        return (
            1,
            self.spool.frame_clocks * self.spool.decimate,
            self.spool.frame_clocks * max(self.spool.first_frame, 0),
        )

    def _append(self, writer, progress):
        """Write all rows, and yield them block by block."""
        written_rows = 0
        for rows in self.spool.row_blocks():
            writer.append(**{name: rows[name] for name in self.spool.fields})
            written_rows += len(rows)
            if progress:
                progress("record", written_rows, self.spool.rows)
            yield rows

    def _check_codes(self, path, blocks):
        """FileError if rows that were written are not those of the hash of codes; compared where all words are kept."""
        complete = self.spool.decimate == 1 and set(HASHED) <= set(self.spool.fields)
        if self.codes is None or not self.codes.complete or not complete:
            collections.deque(blocks, 0)
            return
        words = (np.stack([rows[name] for name in HASHED], axis=1) for rows in blocks)
        if not self.codes.has_words(words):
            raise FileError(f"{path}: its rows do not match codes_sha256; the record was not written")

    def write(self, path, progress=None):
        """Write the record, whose rows must be those of the hash of codes; returns its content hash."""
        head = {"attrs": self.attrs, "record_id": self.record_id, "created_utc": self.created_utc}
        head["clock_hz"] = self.spool.clock_hz
        with RecordWriter(path, self.config_toml, "simulated", self.clock_ppm, **head) as writer:
            for name, field in self.spool.fields.items():
                num, den, edge0 = self._rate()
                compress = field.dtype.kind != "f"  # noise does not compress, and takes the longest to try
                writer.stream(name, field.unit, field.dtype, num, den, edge0, compress=compress, **field.attrs)
            self._check_codes(path, self._append(writer, progress))
            for name, columns in self.tables.items():
                writer.table(name, columns)
        return writer.content_sha256


def remove(path):
    """Remove the file of a spool if there is one."""
    with contextlib.suppress(OSError):
        Path(path).unlink()

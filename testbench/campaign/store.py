"""The folder of a campaign's results. Only whole files have their names; everything else can be lost at any moment.

    store.json                schema and a random name, by which a worker knows that it sees the same folder
    points/ab/cdef...h5       a finished point, by its address; whole because it is renamed into place
    states/HASH.h5            state files that points start from
    plans/NAME.json           plans that were run here
    results/NAME.nc, .csv     their results, made anew from the points at the end of each run
    journal/HOST-PID.jsonl    who began, wrote and finished what, when: a line each, with a checksum
    rejected/                 points that were not what their address says; computed again
    claims/ADDRESS            locked by the process that is at work on the point
    lock                      locked by the one campaign that may be at work here

What a process is about to write as a point it declares in its journal, with the SHA-256 of the file. A point that was
changed afterwards is found by that (`verify`), and what a damaged line declared is found by the point's own contents.
Locks are those of the operating system (flock): a process that is killed has none. A claim is what makes a point run
once, even if a worker of a campaign that was killed is still at it: the next one waits, then finds the point there.
Source  docs/campaigns.md
"""

import contextlib
import hashlib
import json
import os
import socket
import time
import uuid
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from fpga_model import shared_files
from testbench.errors import FileError
from testbench.storage import inputs
from testbench.storage.files import explain, hold_lock, refuse_foreign_links, write_bytes

SCHEMA = "gyrostore/1"
FOLDERS = ("points", "states", "plans", "results", "journal", "claims")
MOST_LINE_BYTES = 1 << 16  # of a journal
CRC = ', "crc": "'

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


@dataclass
class Head:
    """store.json."""

    schema: str
    name: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]


class Event(BaseModel):
    """A line of a journal: when, what, which process, of which point; `sha256` of the file that is about to be it."""

    model_config = ConfigDict(strict=True)
    t: Annotated[float, Field(allow_inf_nan=False)]
    event: Literal["start", "write", "finish", "fail"]
    pid: int
    point: Sha256
    error: str = ""
    sha256: Sha256 | None = None


class Store:
    """A store that exists. `Store.open_folder` opens one, or makes it."""

    def __init__(self, path, name):
        self.path, self.name = Path(path), name

    @classmethod
    def open_folder(cls, path, create=False):
        """The store in a folder; an empty or missing folder becomes one with `create`."""
        path = Path(path).resolve()
        head = path / "store.json"
        for folder in FOLDERS:
            refuse_foreign_links(path / folder)
        try:
            if not head.exists():
                cls._create_head_file(path, head, create)
            if create:
                for folder in FOLDERS:
                    (path / folder).mkdir(exist_ok=True)
        except OSError as problem:
            raise explain(problem.filename or path, problem) from None
        data = inputs.read_json(head)
        if data.get("schema") != SCHEMA:
            raise FileError(f"{head}: schema {str(data.get('schema'))[:40]!r}; this version reads {SCHEMA}")
        return cls(path, inputs.validate_data(data, Head, head).name)

    @staticmethod
    def _create_head_file(path, head, create):
        """Make store.json; of two that do so at once the first one counts."""
        strange = path.is_dir() and any(not p.name.startswith(head.name) for p in path.iterdir())
        if head.exists():
            return  # made by another process a moment ago, and with it what else is here
        if strange or (path.exists() and not path.is_dir()):
            raise FileError(f"{path}: is neither empty nor a store of campaigns; choose another folder")
        if not create:
            raise FileError(f"{path}: is not a store of campaigns; gyro campaign run creates one")
        path.mkdir(parents=True, exist_ok=True)
        name = uuid.uuid4().hex
        part = path / f"{head.name}.{name}"
        try:
            part.write_text(json.dumps({"schema": SCHEMA, "name": name}))
            with contextlib.suppress(FileExistsError):
                os.link(part, head)
        finally:
            part.unlink(missing_ok=True)

    # ---- points ------------------------------------------------------------------------------------------------------

    def point_path(self, address):
        """Path of a point."""
        return self.path / "points" / address[:2] / f"{address[2:]}.h5"

    def has(self, address):
        """True if the point is finished."""
        return self.point_path(address).exists()

    def addresses(self):
        """Addresses of all finished points, sorted."""
        return sorted(f"{p.parent.name}{p.stem}" for p in (self.path / "points").glob("??/*.h5"))

    def publish(self, address, data):
        """Declare a point in the journal, and write it whole or not at all."""
        self.journal("write", point=address, sha256=hashlib.sha256(data).hexdigest())
        write_bytes(self.point_path(address), data)

    @contextlib.contextmanager
    def claim(self, address):
        """Keep every other process from this point; waits while another one has it."""
        path = self.path / "claims" / address
        try:
            lock = shared_files.wait_for_lock(path, "runs this point")
        except OSError as problem:
            raise explain(path, problem) from None
        with lock:
            yield
            # whoever waited for this file sees the point, and needs no claim
            if self.has(address):
                with contextlib.suppress(OSError):
                    path.unlink()

    def reject(self, address):
        """Move what stands in the place of a point to rejected/, whatever it is; returns where it is now."""
        folder = self.path / "rejected"
        rejected_path = folder / f"{address}.{uuid.uuid4().hex[:8]}"
        try:
            folder.mkdir(exist_ok=True)
            os.rename(self.point_path(address), rejected_path)
        except OSError as problem:
            raise explain(self.point_path(address), problem) from None
        return rejected_path

    # ---- journal -----------------------------------------------------------------------------------------------------

    def journal(self, event, **what):
        """Append a line to this process's journal; one write, so that a line is whole or absent."""
        text = json.dumps({"t": round(time.time(), 6), "event": event, "pid": os.getpid()} | what)[:-1]
        path = self.path / "journal" / f"{socket.gethostname()}-{os.getpid()}.jsonl"
        try:
            handle = shared_files.open_regular(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            with open(handle, "ab", buffering=0) as file:
                file.write(f'{text}{CRC}{zlib.crc32(text.encode()):08x}"}}\n'.encode())
        except OSError as problem:
            raise explain(path, problem) from None

    def lines(self, faults):
        """`Event`s of all journals, in no order; `faults` takes one line of text for each that cannot be read."""
        for path in sorted((self.path / "journal").glob("*.jsonl")):
            try:
                with inputs.open_input(path, inputs.most_bytes()) as file:
                    for number, line in enumerate(iter(lambda f=file: f.readline(MOST_LINE_BYTES), b""), 1):
                        try:
                            event = _event(line, f"{path}:{number}")
                        except FileError as problem:
                            faults.append(str(problem))
                        else:
                            yield event
            except FileError as problem:
                faults.append(str(problem))

    def events(self):
        """All whole lines of all journals, by time."""
        return sorted(self.lines([]), key=lambda event: event.t)

    def journal_hashes(self):
        """{address: {SHA-256 of a file that was written as this point}} of all journals."""
        return hashes_by_address(self.lines([]))

    # ---- one campaign at a time --------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def hold_lock(self):
        """Be the one campaign at work here, or FileError that says who is."""
        with hold_lock(self.path / "lock", f"{self.path}: another campaign is running in this store"):
            yield

    def owner(self):
        """Who is, or was last, at work here."""
        return shared_files.lock_owner(self.path / "lock")

    def busy(self):
        """True while a campaign is at work here."""
        return shared_files.is_locked(self.path / "lock")


def hashes_by_address(events):
    """{address: {SHA-256 of a file that was written as this point}} of events."""
    out = {}
    for event in events:
        if event.sha256:
            out.setdefault(event.point, set()).add(event.sha256)
    return out


def _event(line, error_prefix):
    """`Event` of a line of a journal; FileError if its checksum, its form or its end is not as it was written."""
    text, _, crc = line.partition(CRC.encode())
    if not line.endswith(b"\n") or (crc and crc != b'%08x"}\n' % zlib.crc32(text)):
        raise FileError(f"{error_prefix}: is damaged: its checksum does not match")
    return inputs.parse_json(line, error_prefix, Event)

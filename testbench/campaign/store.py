"""The folder of a campaign's results. Only whole files have their names; everything else can be lost at any moment.

    store.json                schema and a random name, by which a worker knows that it sees the same folder
    points/ab/cdef...h5       a finished point, by its address; whole because it is renamed into place
    states/HASH.h5            state files that points start from
    plans/NAME.json           plans that were run here
    results/NAME.nc, .csv     their results, made anew from the points at the end of each run
    journal/HOST-PID.jsonl    who began and finished what, when
    claims/ADDRESS            locked by the process that is at work on the point
    tmp/                      files that are being written
    lock                      locked by the one campaign that may be at work here

Locks are those of the operating system (flock): a process that is killed has none. A claim is what makes a point run
once, even if a worker of a campaign that was killed is still at it: the next one waits, then finds the point there.
Source  docs/campaigns.md
"""

import contextlib
import fcntl
import json
import os
import socket
import time
import uuid
from datetime import UTC, datetime
from pathlib import Path

from testbench.errors import FileError
from testbench.storage.files import explain

SCHEMA = "gyrostore/1"
LOCK_PATIENCE_S = 0.5
FOLDERS = ("points", "states", "plans", "results", "journal", "claims", "tmp")


class Store:
    """A store that exists. `Store.at` opens one, or makes it."""

    def __init__(self, path, name):
        self.path, self.name = Path(path), name

    @classmethod
    def at(cls, path, create=False):
        """The store in a folder; an empty or missing folder becomes one with `create`."""
        path = Path(path).resolve()
        head = path / "store.json"
        try:
            if not head.exists():
                cls._begin(path, head, create)
            if create:
                for folder in FOLDERS:
                    (path / folder).mkdir(exist_ok=True)
            data = json.loads(head.read_text())
        except OSError as problem:
            raise explain(path, problem) from None
        except ValueError:
            raise FileError(f"{head}: is damaged") from None
        if data.get("schema") != SCHEMA:
            raise FileError(f"{head}: schema {data.get('schema')!r}; this version reads {SCHEMA}")
        return cls(path, data["name"])

    @staticmethod
    def _begin(path, head, create):
        """Make store.json; of two that do so at once the first one counts."""
        strange = path.is_dir() and any(not p.name.startswith(head.name) for p in path.iterdir())
        if strange or (path.exists() and not path.is_dir()):
            raise FileError(f"{path}: is not empty and no store of campaigns; choose another folder")
        if not create:
            raise FileError(f"{path}: is no store of campaigns; gyro campaign run makes one")
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

    def point(self, address):
        """Path of a point."""
        return self.path / "points" / address[:2] / f"{address[2:]}.h5"

    def has(self, address):
        """True if the point is finished."""
        return self.point(address).exists()

    def addresses(self):
        """Addresses of all finished points, sorted."""
        return sorted(f"{p.parent.name}{p.stem}" for p in (self.path / "points").glob("??/*.h5"))

    def publish(self, address, data):
        """Write a point beside and rename it; nothing is left if the disk is full."""
        path = self.point(address)
        part = self.path / "tmp" / f"{address[:16]}.{uuid.uuid4().hex[:8]}.part"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with open(part, "wb", buffering=0) as file:
                left = memoryview(data)
                while left:
                    left = left[file.write(left) :]
                os.fsync(file.fileno())
            os.replace(part, path)
        except OSError as problem:
            raise explain(path, problem) from None
        finally:
            with contextlib.suppress(OSError):
                part.unlink()

    @contextlib.contextmanager
    def claim(self, address):
        """Keep every other process from this point; waits while another one has it."""
        path = self.path / "claims" / address
        try:
            file = open(path, "a")
        except OSError as problem:
            raise explain(path, problem) from None
        with file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
            # whoever waited for this file sees the point, and needs no claim
            if self.has(address):
                with contextlib.suppress(OSError):
                    path.unlink()

    def journal(self, event, **what):
        """Append a line to this process's journal; one write, so that a line is whole or absent."""
        head = {"t": round(time.time(), 6), "event": event, "pid": os.getpid()}
        path = self.path / "journal" / f"{socket.gethostname()}-{os.getpid()}.jsonl"
        try:
            with open(path, "ab", buffering=0) as file:
                file.write((json.dumps(head | what) + "\n").encode())
        except OSError as problem:
            raise explain(path, problem) from None

    def events(self):
        """All whole lines of all journals, by time."""
        out = []
        for path in (self.path / "journal").glob("*.jsonl"):
            for line in path.read_text().splitlines():
                with contextlib.suppress(ValueError):  # a line that a full disk cut
                    out.append(json.loads(line))
        return sorted(out, key=lambda event: event["t"])

    # ---- one campaign at a time --------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def locked(self):
        """Be the one campaign at work here, or FileError that says who is."""
        path = self.path / "lock"
        try:
            file = open(path, "a+")
        except OSError as problem:
            raise explain(path, problem) from None
        with file:
            self._take(file)
            since = datetime.now(UTC).isoformat(timespec="seconds")
            try:
                file.truncate(0)
                file.write(f"process {os.getpid()} on {socket.gethostname()} since {since}")
                file.flush()
            except OSError as problem:
                raise explain(path, problem) from None
            (self.path / "tmp").mkdir(exist_ok=True)  # copies without empty folders lack it
            for part in (self.path / "tmp").iterdir():
                with contextlib.suppress(OSError):
                    part.unlink()
            yield

    def _take(self, file):
        """The lock; `busy` may hold it for a moment, so it is tried for a while."""
        until = time.monotonic() + LOCK_PATIENCE_S
        while True:
            try:
                return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > until:
                    raise FileError(f"{self.path}: another campaign is at work here: {self.owner()}") from None
                time.sleep(0.05)
            except OSError as problem:
                raise explain(file.name, problem) from None

    def owner(self):
        """Text in the lock: who is, or was last, at work here."""
        with contextlib.suppress(OSError):
            return (self.path / "lock").read_text() or "unknown"
        return "unknown"

    def busy(self):
        """True while a campaign is at work here."""
        try:
            with open(self.path / "lock") as file:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False

"""One process at a time: a lock of the operating system (flock) on a file, which says who has it.

A process that is killed has no lock. A FIFO or a device in the place of the file is refused and not waited for.
"""

import contextlib
import fcntl
import os
import socket
import stat
import time
from datetime import UTC, datetime

from testbench.errors import FileError
from testbench.storage import inputs
from testbench.storage.files import explain

PATIENCE_S = 0.5
MOST_OWNER_BYTES = 200


def regular(path, flags=os.O_RDWR | os.O_CREAT):
    """Descriptor of a regular file, which is made if `flags` say so; FileError for anything else."""
    try:
        handle = os.open(path, flags | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
    except OSError as problem:
        raise explain(path, problem) from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise FileError(f"{path}: is no regular file")
    return handle


@contextlib.contextmanager
def alone(path, refusal):
    """Hold the lock; FileError `REFUSAL: OWNER` if another process has it."""
    with open(regular(path), "r+") as file:
        _take(file, path, refusal)
        try:
            file.truncate(0)
            since = datetime.now(UTC).isoformat(timespec="seconds")
            file.write(f"process {os.getpid()} on {socket.gethostname()} since {since}")
            file.flush()
        except OSError as problem:
            raise explain(path, problem) from None
        yield


def _take(file, path, refusal):
    """`busy` may hold the lock for a moment, so it is tried for a while."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > until:
                raise FileError(f"{refusal}: {owner(path)}") from None
            time.sleep(0.05)
        except OSError as problem:
            raise explain(path, problem) from None


def owner(path):
    """Text in the lock: who has it, or had it last."""
    try:
        with inputs.opened(path) as file:
            text = file.read(MOST_OWNER_BYTES).decode(errors="replace")
    except FileError:
        return "unknown"
    return "".join(c for c in text if c.isprintable()) or "unknown"


def busy(path):
    """True while a process has the lock."""
    try:
        with open(regular(path, os.O_RDONLY)) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except (OSError, FileError):
        return False
    return False

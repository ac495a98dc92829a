"""Files and folders that other processes and other users reach: locks, and links that are not followed.

A lock is one of the operating system (flock) on a file that says who has it; a killed process has none. A file system
without locks is taken as it is. A symbolic link in a path is followed only if it belongs to this user or to root.
"""

import contextlib
import errno
import fcntl
import os
import socket
import stat
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)
PATIENCE_S = 1.0  # whoever waits longer says for whom
MOST_OWNER_BYTES = 200
ANONYMOUS_OWNER, MOST_TRIES = "an unknown process", 20


class LockedError(OSError):
    """Another process has the lock; the text says which."""


def foreign_link(path):
    """The first symbolic link on the way to `path`, itself included, of a user who is neither this one nor root."""
    path = Path(os.path.abspath(path))
    for path_prefix in (*reversed(path.parents), path):
        with contextlib.suppress(OSError):
            prefix_status = os.lstat(path_prefix)
            if stat.S_ISLNK(prefix_status.st_mode) and prefix_status.st_uid not in (0, os.geteuid()):
                return path_prefix
    return None


def open_regular(path, flags=os.O_RDWR | os.O_CREAT):
    """Descriptor of a regular file, made if `flags` say so; OSError for a link, a FIFO, a device or a folder."""
    handle = os.open(path, flags | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW, 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    return handle


def try_lock(path):
    """Locked open file, made if need be, that says who has it; `LockedError` if another process has it."""
    tries = 0
    while True:
        file = open(open_regular(path), "r+")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # whoever had the lock may have removed the file
            if os.path.samestat(os.fstat(file.fileno()), os.stat(path, follow_symlinks=False)):
                break
        except BlockingIOError:
            file.close()
            owner, tries = lock_owner(path), tries + 1
            # a moment ago it was taken, and the text follows, or it is being removed
            if owner != ANONYMOUS_OWNER or tries > MOST_TRIES:
                raise LockedError(errno.EWOULDBLOCK, owner, str(path)) from None
            time.sleep(0.005)
            continue
        except FileNotFoundError:
            pass
        except OSError as problem:
            if problem.errno in NO_LOCKS:
                break
            file.close()
            raise
        file.close()
    since = datetime.now(UTC).isoformat(timespec="seconds")
    with contextlib.suppress(OSError):  # a full disk has no room for the text; the lock holds without
        os.ftruncate(file.fileno(), 0)
        os.write(file.fileno(), f"process {os.getpid()} on {socket.gethostname()} since {since}".encode())
    return file


def wait_for_lock(path, what):
    """As `try_lock`, but waits; after PATIENCE_S one line says for whom, and what that process does."""
    until = time.monotonic() + PATIENCE_S
    pause, notice_printed = 0.001, False
    while True:
        try:
            return try_lock(path)
        except LockedError as problem:
            if time.monotonic() > until and not notice_printed:
                print(f"gyro: waits for {problem.strerror}, which {what}", file=sys.stderr, flush=True)
                notice_printed = True
        time.sleep(pause)
        pause = min(2 * pause, 0.1)


def lock_owner(path):
    """Text in a lock: who has it, or had it last."""
    try:
        with open(open_regular(path, os.O_RDONLY), "rb") as file:
            text = file.read(MOST_OWNER_BYTES).decode(errors="replace")
    except OSError:
        text = ""
    return "".join(c for c in text if c.isprintable()) or ANONYMOUS_OWNER


def is_locked(path):
    """True while a process has the lock."""
    try:
        with open(open_regular(path, os.O_RDONLY)) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    return False

"""Output files that are whole or absent: written as PATH.part, renamed when complete, removed when anything fails.

PATH.part is locked while it is written (flock, which a killed process does not hold): of two processes that write one
file the second is refused. A file system without locks is taken as it is.
A seal is the file's own SHA-256 behind its end: damage is found before a library reads it, which with HDF5 may take
for ever on a damaged heap. `GuardedFile` is for HDF5 too, which leaves a file open for good when a write fails during
close: it remembers the first failure, swallows what the library still writes, and lets the owner raise afterwards.
"""

import contextlib
import errno
import hashlib
import io
import os
from pathlib import Path

from testbench.errors import FileError

try:
    import fcntl
except ImportError:  # no POSIX, no locks
    fcntl = None

NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)


def explain(path, problem):
    """`FileError` for an operating-system error on `path`."""
    return FileError(f"{path}: cannot be written: {problem.strerror or problem}")


def part_of(path):
    """Name under which `path` is written."""
    path = Path(path)
    return path.with_name(path.name + ".part")


def lock(path):
    """Open file, locked by this process and made if need be; None if another one holds it.

    Who holds the lock may remove the file; then it is made anew.
    """
    while True:
        file = open(path, "a+b")
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
                return file
        except BlockingIOError:
            file.close()
            return None
        except FileNotFoundError:
            pass
        except OSError as problem:
            if problem.errno in NO_LOCKS:
                return file
            file.close()
            raise
        file.close()


def lock_part(path):
    """The locked PATH.part; FileError if another process writes the file."""
    if Path(path).is_char_device() or Path(path).is_block_device():
        raise FileError(f"{path}: is a device; it is not replaced")
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        clear(path)
        file = lock(part_of(path))
    except OSError as problem:
        raise explain(path, problem) from None
    if file is None:
        raise FileError(f"{path}: another process writes this file")
    return file


def publish(path):
    """Give the finished PATH.part its name."""
    part = part_of(path)
    with open(part, "rb") as file:
        os.fsync(file.fileno())
    os.replace(part, path)


SEAL = b"\nftr-gyro sha256 %s\n"
SEAL_BYTES = len(SEAL % bytes(64))


def seal(path):
    """Append the SHA-256 of a finished file; HDF5 ignores what follows its end."""
    with open(path, "rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    with open(path, "ab", buffering=0) as file:
        if file.write(SEAL % digest.encode()) != SEAL_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def seal_holds(path):
    """True if the file is as it was sealed, False if it was damaged since, None if there is no seal."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        left = os.fstat(file.fileno()).st_size - SEAL_BYTES
        if left < 0:
            return None
        file.seek(left)
        found = file.read()
        if not found.startswith(SEAL[:-3]) or not found.endswith(b"\n"):
            return None
        file.seek(0)
        while left:
            block = file.read(min(left, 1 << 20))
            if not block:
                return False
            digest.update(block)
            left -= len(block)
    return found == SEAL % digest.hexdigest().encode()


def clear(path):
    """Remove what is no regular file under the name PATH.part: to open a FIFO would wait for a reader."""
    if part_of(path).exists() and not part_of(path).is_file():
        discard(path)


def discard(path):
    """Remove PATH.part if there is one."""
    with contextlib.suppress(OSError):
        part_of(path).unlink()


@contextlib.contextmanager
def replacing(path):
    """Yield the name to write to; the file takes its place when the block ends well, and vanishes when it does not."""
    path = Path(path)
    with lock_part(path):
        try:
            yield part_of(path)
            publish(path)
        except OSError as problem:
            raise explain(path, problem) from None
        finally:
            discard(path)


def write_bytes(path, data):
    """Write a whole file, or nothing."""
    with replacing(path) as part:
        part.write_bytes(data)


def write_text(path, text):
    """Write a whole UTF-8 file, or nothing."""
    write_bytes(path, text.encode())


class GuardedFile(io.RawIOBase):
    """Unbuffered read-write file for h5py; after the first failed write it only pretends, and keeps `problem`."""

    def __init__(self, path):
        super().__init__()
        self._file = open(path, "w+b", buffering=0)
        self.problem = None

    def readable(self):
        return True

    def writable(self):
        return True

    def seekable(self):
        return True

    def readinto(self, buffer):
        return self._attempt(lambda: self._file.readinto(buffer), 0)

    def write(self, data):
        view = memoryview(data).cast("B")

        def all_of_it():
            done = 0
            while done < len(view):
                done += self._file.write(view[done:])

        self._attempt(all_of_it, None)
        return len(view)

    def seek(self, offset, whence=io.SEEK_SET):
        return self._file.seek(offset, whence)

    def tell(self):
        return self._file.tell()

    def truncate(self, size=None):
        self._attempt(lambda: self._file.truncate(size), None)
        return size if size is not None else self._file.tell()

    def flush(self):
        if not self.closed:
            self._attempt(self._file.flush, None)

    def close(self):
        if not self.closed:
            super().close()
            try:
                self._file.close()
            except OSError as problem:
                self.problem = self.problem or problem

    def _attempt(self, action, otherwise):
        if self.problem is not None:
            return otherwise
        try:
            return action()
        except OSError as problem:
            self.problem = problem
            return otherwise

"""Files and folders that are whole or absent: made in a place of their own, then renamed; a failure leaves nothing.

    PATH.part/lock    says which process writes PATH; a second one is refused (flock: a killed process holds no lock)
    PATH.part/new     what takes the place of PATH: by a rename, or for a folder by an exchange of both

PATH.part is on the volume of PATH. This process makes it for its user alone, so no link of anybody else is in it.
What is written in `atomic_outputs` is renamed by a process of its own, which outlives a kill of this one: the old set
stands, or the new one. A file system that cannot exchange (NFS) has the old folder renamed away first, in the same
way. A file system without locks is taken as it is.
A seal is the file's own SHA-256 behind its end: damage is found before a library reads it, which with HDF5 may take
for ever on a damaged heap. `GuardedFile` is for HDF5 too, which leaves a file open for good when a write fails during
close: it remembers the first failure, swallows what the library still writes, and lets the owner raise afterwards.
"""

import contextlib
import contextvars
import ctypes
import errno
import hashlib
import io
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

from fpga_model import shared_files
from testbench.errors import FileError
from testbench.interrupts import defer_interrupts

PATIENCE_S = 0.5  # `shared_files.is_locked` has a lock for a moment
AT_FDCWD, RENAME_EXCHANGE = -100, 2
NO_EXCHANGE = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP)
QUIET = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
# what is written in `atomic_outputs`, in order
_set = contextvars.ContextVar("stagings", default=None)
RENAME = "import os, sys\nfor k in range(1, len(sys.argv), 2): os.replace(sys.argv[k], sys.argv[k + 1])"


def explain(path, problem):
    """`FileError` for an operating-system error on `path`."""
    return FileError(f"{path}: cannot be written: {problem.strerror or problem}")


# ---- locks and folders that are this user's --------------------------------------------------------------------------


@contextlib.contextmanager
def hold_lock(path, refusal):
    """Hold the lock at `path`; FileError `REFUSAL: OWNER` if another process has it."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            file = shared_files.try_lock(path)
            break
        except shared_files.LockedError as other:
            if time.monotonic() > until:
                raise FileError(f"{refusal}: {other.strerror}") from None
        except OSError as problem:
            raise explain(path, problem) from None
        time.sleep(0.05)
    with file:
        yield


def refuse_foreign_links(path):
    """FileError if a link of another user is on the way to `path`: it may lead to any file of this user."""
    if link := shared_files.foreign_link(path):
        raise FileError(f"{path}: leads through {link}, a link of another user; name a folder that belongs to you")


def make_private_folder(path):
    """Make a folder that nobody else can write; FileError if a link or another user's folder has its name."""
    refuse_foreign_links(path.parent)
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        path.mkdir(mode=0o700)
    folder_stat = path.lstat()
    if not stat.S_ISDIR(folder_stat.st_mode):
        raise FileError(f"{path}: is not a folder; remove it")
    if folder_stat.st_uid != os.geteuid():
        raise FileError(
            f"{path}: belongs to another user (uid {folder_stat.st_uid}); name a folder that belongs to you"
        )
    if folder_stat.st_mode & 0o077:
        path.chmod(0o700)


# ---- from a place of its own to its name -----------------------------------------------------------------------------


class Staging:
    """PATH.part of this process until `close`; FileError if another process has it, or PATH cannot be written.

    path  the file or folder that is written
    new   where it is made: absent at first, in a folder that only this user can enter
    """

    def __init__(self, path):
        display_path, path = path, Path(os.path.abspath(path))
        if path.is_char_device() or path.is_block_device():
            raise FileError(f"{display_path}: is a device; it is not replaced")
        if path.is_symlink() and path.is_dir():
            refuse_foreign_links(path)
            path = path.resolve()
        self.path, self._folder = path, path.with_name(path.name + ".part")
        self.new, self.replaced = self._folder / "new", self._folder / "replaced"
        try:
            self._lock = self._acquire_lock(display_path)
            self._clear()
        except OSError as problem:
            raise explain(display_path, problem) from None

    def _acquire_lock(self, display_path):
        while True:
            with contextlib.suppress(FileNotFoundError):
                if not stat.S_ISDIR(self._folder.lstat().st_mode):  # a link, or what version 0.1.0 left
                    self._folder.unlink()
            make_private_folder(self._folder)
            try:
                return shared_files.try_lock(self._folder / "lock")
            except shared_files.LockedError as other:
                raise FileError(f"{display_path}: another process is writing it: {other.strerror}") from None
            except FileNotFoundError:  # removed by a process that has just ended
                continue

    def _clear(self):
        for item in self._folder.iterdir():
            if item.is_dir() and not item.is_symlink():
                shutil.rmtree(item)
            elif item.name != "lock":
                item.unlink()

    def finish(self):
        """Give what was made its name: now, or with all else of `atomic_outputs`."""
        if (joined := _set.get()) is None:
            publish(self)
            self.close()
        else:
            joined.append(self)

    def close(self):
        """Remove PATH.part and let others in."""
        with contextlib.suppress(OSError):
            self._clear()
            (self._folder / "lock").unlink()
            self._folder.rmdir()
        self._lock.close()


def publish(*stagings):
    """Rename or exchange, so that all of what stands is old, or all of it is new, whenever this process is killed."""
    renames = []
    for staging in stagings:
        new, path, folder = staging.new, staging.path, staging.new.is_dir()
        if path.exists() and path.is_dir() != folder:
            number = errno.ENOTDIR if folder else errno.EISDIR
            raise OSError(number, os.strerror(number), str(path))
        if folder and path.exists():
            if len(stagings) == 1 and _exchange(new, path):
                return
            renames += [path, staging.replaced]
        elif not folder:
            with open(new, "rb") as file:
                os.fsync(file.fileno())
        renames += [new, path]
    if len(renames) > 2:
        command = [sys.executable, "-I", "-S", "-c", RENAME, *map(os.fspath, renames)]
        with defer_interrupts(), contextlib.suppress(OSError):
            if subprocess.Popen(command, start_new_session=True, **QUIET).wait() == 0:
                return
    # one file alone, and what is left by a process that was killed itself
    for staging in stagings:
        if staging.new.exists():
            if staging.new.is_dir() and staging.path.exists() and not staging.replaced.exists():
                os.rename(staging.path, staging.replaced)
            os.replace(staging.new, staging.path)


def _exchange(new, path):
    """Exchange two folders in one system call; False where the file system cannot."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    if rename(AT_FDCWD, os.fsencode(new), AT_FDCWD, os.fsencode(path), RENAME_EXCHANGE) == 0:
        return True
    if ctypes.get_errno() in NO_EXCHANGE:
        return False
    raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(path))


@contextlib.contextmanager
def atomic_outputs():
    """Files and folders that are written in the block take their places at its end, all of them or none."""
    if _set.get() is not None:
        yield
        return
    stagings = []
    token = _set.set(stagings)
    try:
        yield
        publish(*stagings)
    except OSError as problem:
        raise explain(problem.filename or "output", problem) from None
    finally:
        _set.reset(token)
        for staging in stagings:
            staging.close()


@contextlib.contextmanager
def replace_file(path):
    """Yield the name to write to; the file takes its place when the block ends well, and vanishes when it does not.

    FileError if another process writes it.
    """
    staging = Staging(path)
    try:
        yield staging.new
        staging.finish()
    except OSError as problem:
        staging.close()
        raise explain(path, problem) from None
    except BaseException:
        staging.close()
        raise


@contextlib.contextmanager
def replace_folder(path, mark=None, keep=False):
    """As `replace_file`, of a new folder, which takes the place of `path` as a whole.

    keep  what else is in the folder stays
    mark  otherwise: file of a folder that may be replaced; any other that is not empty is refused. None: all are
    """
    path = Path(path)
    with replace_file(path) as new:
        if path.is_dir() and any(path.iterdir()):
            if not keep and (mark is None or not (path / mark).is_file()):
                why = f" and has no {mark}" if mark else ""
                raise FileError(f"{path}: is not empty{why}; it is not replaced: name another folder")
        if path.is_dir() and Path.cwd().is_relative_to(path.resolve()):
            raise FileError(
                f"{path}: is the working directory or contains it, and cannot be replaced; name another folder"
            )
        new.mkdir()
        token = _set.set(None)
        try:
            yield new
        finally:
            _set.reset(token)
        if keep and path.is_dir():
            _carry(path, new)


def _carry(old, new):
    """Link what is only in the old folder into the new one."""
    for item in old.iterdir():
        new_item = new / item.name
        if item.is_dir() and not item.is_symlink():
            new_item.mkdir(exist_ok=True)
            _carry(item, new_item)
        elif not os.path.lexists(new_item):
            try:
                os.link(item, new_item, follow_symlinks=False)
            except OSError:  # a file system without links
                shutil.copy2(item, new_item, follow_symlinks=False)


def write_bytes(path, data):
    """Write a whole file, or nothing."""
    with replace_file(path) as part:
        part.write_bytes(data)


def write_text(path, text):
    """Write a whole UTF-8 file, or nothing."""
    write_bytes(path, text.encode())


# ---- seals -----------------------------------------------------------------------------------------------------------

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
        remaining_bytes = os.fstat(file.fileno()).st_size - SEAL_BYTES
        if remaining_bytes < 0:
            return None
        file.seek(remaining_bytes)
        seal_line = file.read()
        if not seal_line.startswith(SEAL[:-3]) or not seal_line.endswith(b"\n"):
            return None
        file.seek(0)
        while remaining_bytes:
            block = file.read(min(remaining_bytes, 1 << 20))
            if not block:
                return False
            digest.update(block)
            remaining_bytes -= len(block)
    return seal_line == SEAL % digest.hexdigest().encode()


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
            written_bytes = 0
            while written_bytes < len(view):
                written_bytes += self._file.write(view[written_bytes:])

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

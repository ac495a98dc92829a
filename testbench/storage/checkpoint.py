"""What an unfinished run keeps in its folder, so that it can be interrupted at any moment and continued.

    run.partial/config.toml     the configuration, from the first moment on
    run.partial/rows.bin        rows of the record so far (`spool`)
    run.partial/checkpoint.h5   state, hash, sums and positions at one tick; whole or absent
    run.partial/window.bin      registers of the waveform window, once it is complete
    run.partial/lock            locked by the one process at work here (flock: a killed process holds no lock)

A checkpoint is written beside the one before it and renamed. What rows.bin holds beyond it is cut off when the run
continues, and simulated again to the same bytes. All of it is removed when the run's files are written. Where the file
system has no locks, rows of a second writer are found by their hashes.
Source  docs/record.md
"""

import contextlib
import hashlib
import shutil
from pathlib import Path

import numpy as np

from fpga_model import shared_files
from testbench.arguments import name_of_file
from testbench.errors import FileError
from testbench.storage import spool
from testbench.storage.files import explain, make_private_folder, write_bytes, write_text
from testbench.storage.inputs import open_input

FOLDER = "run.partial"
FORMAT = "run-1"


class Partial:
    """The files of an unfinished run in `directory`."""

    def __init__(self, directory):
        self._lock = None
        self.folder = Path(name_of_file("directory", directory)) / FOLDER
        self.config = self.folder / "config.toml"
        self.rows = self.folder / "rows.bin"
        self.window = self.folder / "window.bin"
        self.checkpoint = self.folder / "checkpoint.h5"

    def __enter__(self):
        self.hold()
        return self

    def __exit__(self, kind, value, traceback):
        self.release()

    def __del__(self):
        self.release()

    def hold(self):
        """Be the one process at work in this folder until `clear`, or the end; FileError if another one is."""
        if self._lock is not None:
            return
        try:
            make_private_folder(self.folder)
            self._lock = shared_files.try_lock(self.folder / "lock")
        except FileNotFoundError:  # removed by a run that has just ended
            self.hold()
        except shared_files.LockedError as other:
            raise FileError(f"{self.folder.parent}: another run is using this folder: {other.strerror}") from None
        except OSError as problem:
            raise explain(self.folder, problem) from None

    def start_new_run(self, config_toml):
        """Start anew; FileError if an unfinished run lies here."""
        self.hold()
        self.refuse_unfinished()
        self.discard()
        write_text(self.config, config_toml)

    def refuse_unfinished(self):
        """FileError if an unfinished run lies here."""
        if self.resumable():
            raise FileError(
                f"{self.folder.parent}: holds an unfinished run; --resume-run {self.folder.parent} continues it, "
                "--discard starts a new run"
            )

    def discard(self):
        """Remove what an unfinished run keeps here."""
        for path in (self.checkpoint, self.rows, self.window, self.config):
            spool.remove(path)

    def resumable(self):
        """True if there is something to continue."""
        return self.checkpoint.is_file()

    def save(self, layout, parts, meta):
        """Write a checkpoint: {part: {name: number or array}}."""
        from testbench.storage.state_file import save_state

        values = {f"{part}.{name}": value for part, items in parts.items() for name, value in items.items()}
        save_state(self.checkpoint, values, f"{FORMAT} {layout}", meta)

    def load(self, *layouts):
        """(parts, meta) of the checkpoint."""
        from testbench.storage.state_file import load_state

        self.check()
        values, meta = load_state(self.checkpoint, *(f"{FORMAT} {layout}" for layout in layouts))
        parts = {}
        for dotted_name, value in values.items():
            part, _, name = dotted_name.partition(".")
            parts.setdefault(part, {})[name] = value
        return parts, meta

    def check(self):
        """FileError if there is nothing to continue."""
        if not self.resumable():
            raise FileError(f"{self.folder.parent}: holds no interrupted run with a checkpoint; start the run again")

    def keep_window(self, rows):
        """Keep the registers of the window, once; returns their SHA-256."""
        data = rows.astype("<i8").tobytes()
        if not self.window.exists():
            write_bytes(self.window, data)
        return hashlib.sha256(data).hexdigest()

    def load_window(self, columns, digest):
        """The registers that `keep_window` kept, by their SHA-256; None if it kept none ("")."""
        if not digest:
            return None
        with open_input(self.window) as file:  # a window of 10 ms is larger than what users may hand over
            data = file.read()
        if hashlib.sha256(data).hexdigest() != digest:
            raise FileError(f"{self.window}: differs from what was written; start the run again with --discard")
        return np.frombuffer(data, "<i8").reshape(-1, columns)

    def clear(self):
        """Remove everything, and let others in."""
        self.discard()
        with contextlib.suppress(OSError):
            for part in self.folder.glob("*.part"):  # of a process that was killed while it wrote
                shutil.rmtree(part)
            (self.folder / "lock").unlink()
            self.folder.rmdir()
        self.release()

    def release(self):
        """Let others in; what is here stays."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None


def open_partial(directory):
    """The interrupted run of a folder, held by this process."""
    partial = Partial(directory)
    partial.check()
    partial.hold()
    partial.check()  # the process that was at work here may have ended it
    return partial

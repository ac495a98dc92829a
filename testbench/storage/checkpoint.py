"""What an unfinished run keeps in its folder, so that it can be interrupted at any moment and continued.

    run.partial/config.toml     the configuration, from the first moment on
    run.partial/rows.bin        rows of the record so far (`spool`)
    run.partial/checkpoint.h5   state, hash, sums and positions at one tick; whole or absent
    run.partial/window.bin      registers of the waveform window, once it is complete

A checkpoint is written beside the one before it and renamed. What rows.bin holds beyond it is cut off when the run
continues, and simulated again to the same bytes. All of it is removed when the run's files are written.
Source  docs/record.md
"""

import contextlib
from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.storage import spool
from testbench.storage.files import discard, explain, write_bytes, write_text

FOLDER = "run.partial"
FORMAT = "run-1"


class Partial:
    """The files of an unfinished run in `directory`."""

    def __init__(self, directory):
        self.folder = Path(directory) / FOLDER
        self.config = self.folder / "config.toml"
        self.rows = self.folder / "rows.bin"
        self.window = self.folder / "window.bin"
        self.checkpoint = self.folder / "checkpoint.h5"

    def begin(self, config_toml):
        """Start anew; what another run left here is gone."""
        self.clear()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise explain(self.folder, problem) from None
        write_text(self.config, config_toml)

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
        for place, value in values.items():
            part, _, name = place.partition(".")
            parts.setdefault(part, {})[name] = value
        return parts, meta

    def check(self):
        """FileError if there is nothing to continue."""
        if not self.resumable():
            raise FileError(f"{self.folder.parent}: holds no interrupted run with a checkpoint; start it again")

    def keep_window(self, rows):
        """Keep the registers of the window, once."""
        if not self.window.exists():
            write_bytes(self.window, rows.astype("<i8").tobytes())

    def load_window(self, columns):
        """The registers that `keep_window` kept, or None."""
        if not self.window.exists():
            return None
        return np.fromfile(self.window, "<i8").reshape(-1, columns)

    def clear(self):
        """Remove everything."""
        for path in (self.checkpoint, self.rows, self.window, self.config):
            discard(path)
            spool.remove(path)
        with contextlib.suppress(OSError):
            self.folder.rmdir()


def stored_config(directory):
    """Path of the configuration of an interrupted run."""
    partial = Partial(directory)
    partial.check()
    return partial.config

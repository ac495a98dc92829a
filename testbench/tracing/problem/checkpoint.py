"""Predictions and stages that are done, kept under the hash of what they were made from: a killed trace goes on.

    STORE/ab/ab12...npz   arrays of one point (no pickle)       STORE/ab/ab12...json   result of a stage
Everything else of a trace follows from these by deterministic algebra, so the same result comes out. A damaged file
is not believed: it is computed again.
"""

import hashlib
import json
import os
import tempfile
from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.storage.inputs import read_bytes, read_json
from testbench.storage.npz_input import read_npz


def digest(*parts):
    """SHA-256 over JSON-able parts and arrays; floats by their bits."""
    h = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            h.update(f"{part.dtype.str}{part.shape}".encode())
            h.update(np.ascontiguousarray(part).tobytes())
        else:
            h.update(json.dumps(part, sort_keys=True, default=float).encode())
        h.update(b"\0")
    return h.hexdigest()


class Store:
    """A folder of finished work, or nothing at all (path None)."""

    def __init__(self, path=None):
        self.path = None if path is None else Path(path)
        if self.path is not None:
            try:
                self.path.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise FileError(f"{path}: no folder for checkpoints: {problem.strerror}") from None

    def _file(self, key, ending):
        return self.path / key[:2] / (key + ending)

    def _write(self, key, ending, write):
        target = self._file(key, ending)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, part = tempfile.mkstemp(dir=target.parent, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    write(file)
                os.replace(part, target)
            except BaseException:
                os.unlink(part)
                raise
        except OSError as problem:
            raise FileError(f"{target}: cannot be written: {problem.strerror}") from None

    def load_arrays(self, key):
        """Arrays of a point; None if they are not there or damaged."""
        if self.path is None:
            return None
        path = self._file(key, ".npz")
        try:
            data = read_npz(read_bytes(path), path)
            return str(data["failed"]) if "failed" in data else [data[f"a{i}"] for i in range(len(data))]
        except (FileError, KeyError):
            return None

    def save_arrays(self, key, arrays):
        """Keep the arrays of a point, or the reason (str) why it failed."""
        if self.path is not None:
            named = (
                {"failed": np.array(arrays)} if isinstance(arrays, str) else {f"a{i}": a for i, a in enumerate(arrays)}
            )
            self._write(key, ".npz", lambda file: np.savez(file, **named))

    def stage(self, key, compute):
        """Result of `compute()`, JSON-able, from the store if it is there."""
        if self.path is None:
            return compute()
        try:
            return read_json(self._file(key, ".json"), object)
        except FileError:
            pass
        text = json.dumps(compute())
        self._write(key, ".json", lambda file: file.write(text.encode()))
        return json.loads(text)

"""Predictions and stages that are done, kept under the hash of what they were made from: a killed trace goes on.

    STORE/CODE/ab/ab12...npz   arrays of one point (no pickle)       STORE/CODE/ab/ab12...json   result of a stage
CODE is the hash of our sources and of the libraries' versions: what another version left is computed again. Everything
else of a trace follows from these by deterministic algebra, so the same result comes out. Each file is sealed with its
own SHA-256; a damaged one is not believed: it is computed again.
"""

import functools
import hashlib
import io
import json
import os
import tempfile
import zipfile
from importlib import metadata
from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.storage import sources
from testbench.storage.files import SEAL, SEAL_BYTES

COMPUTES = ("testbench.measured.openers", "testbench.tracing.trace")
LIBRARIES = ("numba", "numpy", "scipy")


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


@functools.cache
def code_sha256():
    """Hash of everything that computes: our sources that a trace reaches, and the versions of the libraries below."""
    return digest(sources.code_sha256(*COMPUTES), [metadata.version(name) for name in LIBRARIES])


class Store:
    """A folder of finished work, or nothing at all (path None)."""

    def __init__(self, path=None):
        self.path = None if path is None else Path(path) / code_sha256()[:16]
        if self.path is not None:
            try:
                self.path.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise FileError(f"{path}: no folder for checkpoints: {problem.strerror}") from None

    def _file(self, key, ending):
        return self.path / key[:2] / (key + ending)

    def _read(self, key, ending):
        """Contents of a file whose seal holds, else None."""
        try:
            whole = self._file(key, ending).read_bytes()
        except OSError:
            return None
        data = whole[:-SEAL_BYTES]
        return data if whole[-SEAL_BYTES:] == SEAL % hashlib.sha256(data).hexdigest().encode() else None

    def _write(self, key, ending, data):
        target = self._file(key, ending)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, part = tempfile.mkstemp(dir=target.parent, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(data + SEAL % hashlib.sha256(data).hexdigest().encode())
                os.replace(part, target)
            except BaseException:
                os.unlink(part)
                raise
        except OSError as problem:
            raise FileError(f"{target}: cannot be written: {problem.strerror}") from None

    def load_arrays(self, key):
        """Arrays of a point; None if they are not there or damaged."""
        whole = None if self.path is None else self._read(key, ".npz")
        if whole is None:
            return None
        try:
            with np.load(io.BytesIO(whole), allow_pickle=False) as data:
                if "failed" in data:
                    return str(data["failed"])
                return [data[f"a{i}"] for i in range(len(data.files))]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def save_arrays(self, key, arrays):
        """Keep the arrays of a point, or the reason (str) why it failed."""
        if self.path is not None:
            named = (
                {"failed": np.array(arrays)} if isinstance(arrays, str) else {f"a{i}": a for i, a in enumerate(arrays)}
            )
            packed = io.BytesIO()
            np.savez(packed, **named)
            self._write(key, ".npz", packed.getvalue())

    def stage(self, key, compute):
        """Result of `compute()`, JSON-able, from the store if it is there."""
        if self.path is None:
            return compute()
        if (known := self._read(key, ".json")) is not None:
            return json.loads(known)
        text = json.dumps(compute())
        self._write(key, ".json", text.encode())
        return json.loads(text)

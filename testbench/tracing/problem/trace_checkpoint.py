"""Predictions and stages that are done, kept under the hash of what they were made from: a killed trace goes on.

    STORE/CODE/ab/ab12...npz   arrays of one point (no pickle)       STORE/CODE/ab/ab12...json   result of a stage
CODE is the hash of our sources and of the libraries' versions: what another version left is computed again. Everything
else of a trace follows from these by deterministic algebra, so the same result comes out. A file ends with the SHA-256
of its key and contents. One that is damaged, or is another key's, is not believed: it is computed again.
"""

import functools
import hashlib
import io
import json
import os
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np

from testbench.errors import FileError
from testbench.storage import inputs, sources
from testbench.storage.files import SEAL, SEAL_BYTES, refuse_foreign_links

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
                raise FileError(f"{path}: the folder for checkpoints cannot be created: {problem.strerror}") from None

    def _entry_path(self, key, ending):
        return self.path / key[:2] / (key + ending)

    def _write(self, key, ending, data):
        target = self._entry_path(key, ending)
        refuse_foreign_links(target.parent)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, part = tempfile.mkstemp(dir=target.parent, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(data + _seal(key, data))
                os.replace(part, target)
            except BaseException:
                os.unlink(part)
                raise
        except OSError as problem:
            raise FileError(f"{target}: cannot be written: {problem.strerror}") from None

    def _read(self, key, ending):
        """Bytes that were written under this key; FileError if there are none, or others."""
        path = self._entry_path(key, ending)
        data = inputs.read_bytes(path)
        body, seal = data[:-SEAL_BYTES], data[-SEAL_BYTES:]
        if seal != _seal(key, body):
            raise FileError(f"{path}: damaged, or written for other data")
        return body

    def load_arrays(self, key):
        """Arrays of a point; None if they are not there or damaged."""
        if self.path is None:
            return None
        try:
            body = self._read(key, ".npz")
        except FileError:
            return None
        with np.load(io.BytesIO(body), allow_pickle=False) as data:
            if "failed" in data:
                return str(data["failed"])
            return [data[f"a{i}"] for i in range(len(data.files))]

    def save_arrays(self, key, arrays):
        """Keep the arrays of a point, or the reason (str) why it failed."""
        if self.path is not None:
            arrays_by_name = (
                {"failed": np.array(arrays)} if isinstance(arrays, str) else {f"a{i}": a for i, a in enumerate(arrays)}
            )
            buffer = io.BytesIO()
            np.savez(buffer, **arrays_by_name)
            self._write(key, ".npz", buffer.getvalue())

    def load_or_compute(self, key, compute):
        """Result of `compute()`, JSON-able, from the store if it is there."""
        if self.path is None:
            return compute()
        try:
            return json.loads(self._read(key, ".json"))
        except FileError:
            pass
        text = json.dumps(compute())
        self._write(key, ".json", text.encode())
        return json.loads(text)


def _seal(key, data):
    """Of the contents and their key: a file that was copied from another key is not believed."""
    return SEAL % hashlib.sha256(key.encode() + b"\0" + data).hexdigest().encode()

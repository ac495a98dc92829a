"""A shared library (or a Python file) that is the plant: found, hashed, loaded, asked for its version and its keys.

    .so, .dll, .dylib   exports the functions of gyro_plant.h
    .py                 is executed: KEYS (text), create(configuration, file) -> array, and objects of numba.cfunc named
                        reset and step; the array's memory is the plant, and all of its state

What was hashed is what runs: its bytes are loaded from a private copy, whatever becomes of the file meanwhile.
Source  docs/plant_port.md, analog_frontend/port/gyro_plant.h
"""

import ctypes
import functools
import hashlib
import tempfile
import weakref
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analog_frontend.port import foreign
from testbench.errors import FileError
from testbench.storage.inputs import read_bytes

POINTER, INTEGER, STATUS, NUMBER, TEXT = (
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_int32,
    ctypes.c_double,
    ctypes.c_char_p,
)
FUNCTIONS = {
    "abi": (STATUS,),
    "keys": (TEXT,),
    "create": (POINTER, TEXT, TEXT, TEXT, INTEGER),
    "destroy": (None, POINTER),
    "reset": (STATUS, POINTER, INTEGER, INTEGER, INTEGER, NUMBER, POINTER),
    "step": (STATUS, POINTER, POINTER, NUMBER, NUMBER, POINTER, POINTER),
    "error": (TEXT, POINTER),
}
OPTIONAL = {"state_size": (INTEGER, POINTER), "save": (STATUS, POINTER, POINTER), "load": (STATUS, POINTER, POINTER)}
ERROR_BYTES, MOST_STATE_BYTES = 1000, 1 << 28


class Library(NamedTuple):
    """What a file offers; `functions` by their names without gyro_plant_, those of a Python file are its own."""

    path: str
    sha256: str
    keys: frozenset
    functions: dict


def _text(value):
    return value.decode("utf-8", "replace") if value else ""


def open_library(path):
    """`Library` of a file; FileError with one line if it is none."""
    return _load_library(str(path), read_bytes(path))


@functools.cache
def _load_library(path, data):
    """`Library` of these bytes, once in a process."""
    contents = _load_python(path, data) if path.endswith(".py") else _load_native(path, data)
    return Library(path, hashlib.sha256(data).hexdigest(), *contents)


def _load_native(path, data):
    """(keys, functions) of a shared library."""
    with tempfile.TemporaryDirectory(prefix="gyro-plant-") as folder:
        copy = Path(folder) / Path(path).name
        copy.write_bytes(data)
        try:
            loaded = ctypes.CDLL(str(copy))
        except OSError as problem:
            reason = str(problem).replace(f"{copy}: ", "")
            raise FileError(f"{path}: cannot be loaded as a shared library: {reason}") from None
    functions = {}
    for name, (result, *arguments) in (FUNCTIONS | OPTIONAL).items():
        try:
            functions[name] = getattr(loaded, f"gyro_plant_{name}")
        except AttributeError:
            if name in FUNCTIONS:
                raise FileError(f"{path}: exports no gyro_plant_{name}; gyro_plant.h lists what is needed") from None
            continue
        functions[name].restype, functions[name].argtypes = result, arguments
        if name == "abi" and (abi := functions[name]()) != foreign.ABI:
            raise FileError(
                f"{path}: gyro_plant_abi is {abi}, expected {foreign.ABI}: compile it with the current header"
            )
    if OPTIONAL.keys() & functions and (missing := OPTIONAL.keys() - functions):
        raise FileError(f"{path}: exports no gyro_plant_{min(missing)}; state_size, save and load belong together")
    return frozenset(_text(functions["keys"]()).split()), functions


def _load_python(path, data):
    """(keys, functions) of a Python file; its cfuncs are kept, because their code is freed with them."""
    namespace = {"__name__": "gyro_plant", "__file__": path}
    try:
        exec(compile(data, path, "exec"), namespace)
    except Exception as problem:
        raise FileError(f"{path}: {type(problem).__name__}: {problem}") from None
    for name in ("KEYS", "create", "reset", "step"):
        if name not in namespace:
            raise FileError(f"{path}: defines no {name}; expected KEYS, create, reset and step")
    calls = {}
    for name in ("reset", "step"):
        if not isinstance(address := getattr(namespace[name], "address", None), int):
            raise FileError(f"{path}: {name} is not a numba.cfunc")
        calls[name] = ctypes.CFUNCTYPE(*FUNCTIONS[name])(address)
    return frozenset(str(namespace["KEYS"]).split()), {"create": namespace["create"], "file": namespace, **calls}


class Instance:
    """A plant of a library; FileError with the library's own line if it cannot be made.

    configuration, file_text  the two texts of gyro_plant_create
    """

    def __init__(self, library, configuration, file_text):
        self.library, self._functions, self._array = library, library.functions, None
        if library.path.endswith(".py"):
            try:
                self._array = np.ascontiguousarray(self._functions["create"](configuration, file_text))
            except Exception as problem:
                self.fail(f"create: {type(problem).__name__}: {problem}")
            self.address = self._array.ctypes.data
            return
        line = ctypes.create_string_buffer(ERROR_BYTES)
        self.address = self._functions["create"](configuration.encode(), file_text.encode(), line, ERROR_BYTES)
        if not self.address:
            self.fail(f"gyro_plant_create: {_text(line.value) or 'the library gave no reason'}")
        weakref.finalize(self, self._functions["destroy"], self.address)

    def fail(self, text):
        """FileError about this library."""
        raise FileError(f"{self.library.path}: {text}")

    @property
    def step(self):
        """Address of the function."""
        return ctypes.cast(self._functions["step"], POINTER).value

    def call(self, name, *arguments):
        """A function that returns a status; FileError with the library's line for any but 0."""
        if status := self._functions[name](self.address, *arguments):
            self.fail(f"gyro_plant_{name}: {self.line(status)}")

    def line(self, status):
        """What the library says of its last failure."""
        text = _text(self._functions["error"](self.address)) if "error" in self._functions else ""
        return text or f"returned {status}"

    @property
    def saves(self):
        """True if its state can be kept."""
        return self._array is not None or "save" in self._functions

    def state(self):
        """Its state as bytes, an array of uint8."""
        if self._array is not None:
            return np.frombuffer(self._array.tobytes(), np.uint8)
        size = self._functions["state_size"](self.address)
        if not 0 <= size <= MOST_STATE_BYTES:
            self.fail(f"gyro_plant_state_size is {size}, outside 0 .. {MOST_STATE_BYTES} bytes")
        out = np.zeros(size, np.uint8)
        self.call("save", out.ctypes.data)
        return out

    def set_state(self, state):
        """Continue from what `state` gave."""
        if self._array is not None:
            self._array.reshape(-1).view(np.uint8)[:] = state
        else:
            state_bytes = np.ascontiguousarray(state, np.uint8)
            self.call("load", state_bytes.ctypes.data)

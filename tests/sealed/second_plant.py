"""The second plant as a library: compiled from tests/sealed/plant, one file for each state of its sources.

`Driver` feeds it without a firmware, for tests of the plant itself.
Source    docs/sealed.md
"""

import ctypes
import hashlib
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from testbench.errors import FileError

ROOT = Path(__file__).resolve().parents[2]
SOURCES = Path(__file__).resolve().parent / "plant"
HEADER = ROOT / "analog_frontend" / "port" / "gyro_plant.h"
FLAGS = ("-O3", "-march=native", "-std=c99", "-D_GNU_SOURCE", "-shared", "-fPIC")
TICKS, EDGES, CHANNELS = 128, 1024, 5  # of gyro_plant.h
WORD, POINTER, NUMBER = ctypes.c_int64, ctypes.c_void_p, ctypes.c_double


def sha256():
    """Hash of the plant's sources and of the flags; the port's version is in its first call."""
    digest = hashlib.sha256(repr(FLAGS).encode())
    for path in sorted(SOURCES.iterdir()):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def compiled(folder=ROOT / "build" / "sealed"):
    """Path of the library, compiled where it is not yet there; FileError with the compiler's first line."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"second_plant_{sha256()[:16]}.so"
    if not path.exists():
        with tempfile.NamedTemporaryFile(dir=folder, suffix=".so", delete=False) as part:
            command = ["cc", *FLAGS, f"-I{HEADER.parent}", str(SOURCES / "plant.c"), "-o", part.name, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise FileError(f"{SOURCES}: the compiler refuses: {done.stderr.strip().splitlines()[0]}")
        os.replace(part.name, path)
    return path


class Pins(ctypes.Structure):
    """gyro_pins."""

    _fields_ = (
        *((name, WORD) for name in ("tick", "ticks", "drive_clock", "sense_clock", "quadrature_code", "edge_count")),
        ("drive_code", WORD * TICKS),
        ("sense_code", WORD * TICKS),
        ("edge", WORD * 2 * EDGES),
    )


class Adc(ctypes.Structure):
    """gyro_adc."""

    _fields_ = (("code", WORD * CHANNELS), ("drdy", WORD * 2))


class Driver:
    """A second plant from power-on with codes 0, without a firmware. ValueError with its own line if it refuses."""

    def __init__(self, configuration, own="", seed=1, temp_degc=25.0):
        self.library, self.pins, self.adc, self.motion = ctypes.CDLL(str(compiled())), Pins(), Adc(), (NUMBER * 4)()
        create, reset, self._step = (getattr(self.library, f"gyro_plant_{n}") for n in ("create", "reset", "step"))
        create.restype, error = POINTER, ctypes.create_string_buffer(300)
        create.argtypes = ctypes.c_char_p, ctypes.c_char_p, ctypes.c_char_p, WORD
        reset.argtypes = POINTER, WORD, WORD, WORD, NUMBER, POINTER
        self._step.argtypes = POINTER, POINTER, NUMBER, NUMBER, POINTER, POINTER
        self.temp_degc, self.tick = temp_degc, 0
        self.plant = create(configuration.encode(), own.encode(), error, len(error))
        if not self.plant:
            raise ValueError(error.value.decode())
        reset(self.plant, seed, 0, 0, temp_degc, ctypes.byref(self.adc))

    def frame(self, drive_code, sense_code, clocks, quadrature_code, edges, rate_rad_s):
        """(codes, x vx y vy) after 125 ticks; clocks: of both DACs, edges (n, 2): as of `top.advance_ticks`."""
        self.pins.tick, self.pins.ticks, self.pins.edge_count = self.tick, len(drive_code), len(edges)
        self.pins.drive_clock, self.pins.sense_clock = clocks
        self.pins.quadrature_code = quadrature_code
        self.pins.drive_code[: len(drive_code)] = [int(v) for v in drive_code]
        self.pins.sense_code[: len(sense_code)] = [int(v) for v in sense_code]
        for k, (clock, pin) in enumerate(edges):
            self.pins.edge[k][0], self.pins.edge[k][1] = int(clock), int(pin)
        to = (ctypes.byref(v) for v in (self.adc, self.motion))
        if self._step(self.plant, ctypes.byref(self.pins), rate_rad_s, self.temp_degc, *to):
            raise ValueError("the plant has failed")
        self.tick += len(drive_code)
        return np.array(self.adc.code[:]), np.array(self.motion[:])

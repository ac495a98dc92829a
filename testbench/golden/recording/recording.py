"""Recordings of closed loops: what the firmware was given, in integers, with the parameters that it had.

    RECORDINGS/NAME.npz   params       raw parameters of `fpga_model.top`, with their names
                          adc          one row per conversion: clock, status, eight codes
                          host         one row per event: clock, 1 for a reset, address, data
                          sar          samples of both SAR converters per tick, as the errors of a prediction
                          windows      first clock and length of what is worth every clock, and what it shows
                          closed       SHA-256 of all registers at the frame starts of the closed loop

The prediction of a sample is that of a sine at the drive frequency from the two before it: the errors are the noise,
and pack into a byte. All is exact; nothing in a replay depends on floating point. `closed` tells whether today's
firmware still does what the recorded one did: if not, its codes are no longer the plant's answer.
Source  docs/golden.md (recordings)
"""

import hashlib
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model import top
from fpga_model.block import fill_shape, flattened_parameters, parameter_defaults, port_name, raws, required_parameters
from fpga_model.design_record import DEFAULT
from fpga_model.digital_sid import SAMPLE
from fpga_model.fixed import formats
from testbench.errors import FileError
from testbench.flatten import format_leaves, leaves
from testbench.golden.recording.replay_recording import Stimulus
from testbench.storage.files import write_bytes
from testbench.storage.inputs import read_bytes
from testbench.storage.npz_input import read_npz

FOLDER = Path(__file__).parent / "recordings"
SCHEMA = "gyro-recording/1.0"
# 2 cos(2 pi 11002.3 Hz / 1 MHz), the pole pair of the prediction: part of the format, whatever the plant does
PREDICTOR_SHIFT = 14
PREDICTOR = 32690
ADC_COLUMNS = 10
# What a file holds: its shape (None: any length), and NumPy's letters of its types
KEYS = {
    "schema": ((), "U"), "param_names": ((None,), "U"), "params": ((None,), "i"), "frames": ((), "i"),
    "row_every": ((), "i"), "adc": ((ADC_COLUMNS, None), "i"), "host": ((None, 4), "i"), "sar": ((2, None), "i"),
    "windows": ((None, 2), "i"), "shows": ((None,), "U"), "closed": ((), "U"),
}  # fmt: skip


class Window(NamedTuple):
    """Clocks whose rows are exported one by one, and what they show."""

    first: int
    count: int
    shows: str


class Recording(NamedTuple):
    """A recording; `row_every` frames have one row at their first clock in the bundle."""

    name: str
    params: top.Params
    frames: int
    row_every: int
    stimulus: Stimulus
    windows: tuple
    closed: str


def params_from(path, names, raw, design=DEFAULT):
    """Params of the whole design from their names, dotted or flat, and raw integers; FileError for other names.

    What came later than the file has its default.
    """
    raw_by_name = dict(zip(map(port_name, names), raw))
    required_names = [name for name, _ in required_parameters(top.PARAMS_FMT, raw_by_name)]
    if list(map(port_name, names)) != required_names or len(raw) != len(required_names):
        strange = sorted(raw_by_name.keys() ^ set(required_names)) or required_names[:1]
        raise FileError(f"{path}: parameters are not those of this firmware ({strange[0]}); record again")
    values = iter(raws(top.PARAMS_FMT, raw_by_name))
    return fill_shape(top.PARAMS_FMT, lambda _: int(next(values)))._replace(design=design)


def param_names():
    """Dotted names of the parameters, in order."""
    return [name for name, _ in format_leaves(top.PARAMS_FMT)]


def _extrapolate_sample(a, b):
    return ((PREDICTOR * b) >> PREDICTOR_SHIFT) - a


def packed_samples(sar):
    """Errors of the prediction, int32 (ticks, 2)."""
    rows = np.asarray(sar, np.int64)
    before = np.vstack([np.zeros((2, 2), np.int64), rows])
    return (rows - _extrapolate_sample(before[:-2], before[1:-1])[: len(rows)]).astype(np.int32)


def unpacked_samples(errors):
    """Samples from the errors of their prediction; the inverse of `packed_samples`."""
    out = np.zeros((len(errors), 2), np.int64)
    for column in range(2):
        a = b = 0
        samples = []
        for error in errors[:, column].tolist():
            a, b = b, error + _extrapolate_sample(a, b)
            samples.append(b)
        out[:, column] = samples
    return out


def save(recording, folder=FOLDER):
    """Write a recording beside its place and rename it."""
    r = recording
    text, parameter_entries = io.BytesIO(), flattened_parameters(r.params, top.PARAMS_FMT)
    np.savez_compressed(
        text,
        schema=np.array(SCHEMA),
        param_names=np.array([name for name, _, _ in parameter_entries]),
        params=np.array([value for _, value, _ in parameter_entries], np.int64),
        frames=np.array(r.frames),
        row_every=np.array(r.row_every),
        adc=np.ascontiguousarray(np.diff(r.stimulus.adc, axis=0, prepend=0).T),
        host=r.stimulus.host,
        sar=np.ascontiguousarray(packed_samples(r.stimulus.sar).T.astype(np.int32)),
        windows=np.array([w[:2] for w in r.windows], np.int64).reshape(-1, 2),
        shows=np.array([w.shows for w in r.windows], "U128"),
        closed=np.array(r.closed),
    )
    write_bytes(Path(folder) / f"{r.name}.npz", text.getvalue())


def load(name, folder=FOLDER):
    """Read a recording; raises FileError if it is damaged or of another design."""
    path = Path(folder) / f"{name}.npz"
    data = read_npz(read_bytes(path), path)
    for key, (shape, kind) in KEYS.items():
        if key not in data:
            raise FileError(f"{path}: {key} is missing")
        have = data[key]
        fits = have.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, have.shape))
        if not fits or have.dtype.kind != kind or (key == "sar" and have.dtype.itemsize > 4):
            raise FileError(f"{path}: {key} is {have.dtype} {have.shape}, expected shape {shape} of kind {kind}")
    if str(data["schema"]) != SCHEMA:
        raise FileError(f"{path}: schema is {str(data['schema'])!r}, not {SCHEMA!r}")
    params = params_from(path, data["param_names"].tolist(), data["params"].tolist())
    adc = np.cumsum(data["adc"].T.astype(np.int64), axis=0).reshape(-1, ADC_COLUMNS)
    stimulus = Stimulus(
        np.ascontiguousarray(adc),
        np.ascontiguousarray(data["host"].astype(np.int64).reshape(-1, 4)),
        unpacked_samples(data["sar"].T),
    )
    windows = tuple(Window(int(a), int(n), str(what)) for (a, n), what in zip(data["windows"], data["shows"]))
    recording = Recording(
        name, params, int(data["frames"]), int(data["row_every"]), stimulus, windows,
        str(data["closed"]),
    )  # fmt: skip
    check(path, recording)
    return recording


def check(path, r):
    """Raise FileError if anything of a recording is outside its limits."""

    def expect(ok, what):
        if not ok:
            raise FileError(f"{path}: {what}")

    d = r.params.design
    end = r.frames * d.frame_clocks
    expect(r.frames >= 1 and r.row_every >= 1, f"frames = {r.frames}, row_every = {r.row_every}: at least 1 each")
    for name, rows in (("adc", r.stimulus.adc), ("host", r.stimulus.host)):
        clocks = rows[:, 0]
        expect((np.diff(clocks) > 0).all(), f"{name}: the clocks do not strictly increase")
        expect(not len(clocks) or (clocks[0] >= 0 and clocks[-1] < end), f"{name}: a clock is outside 0 .. {end - 1}")
    status, codes, host = r.stimulus.adc[:, 1], r.stimulus.adc[:, 2:], r.stimulus.host
    expect(((status >= 0) & (status < 1 << 24)).all(), "adc: a status word is outside 24 bits")
    expect(((codes >= -(1 << 23)) & (codes < 1 << 23)).all(), "adc: a code is outside 24 bits")
    expect(((host[:, 1] >= 0) & (host[:, 1] <= 1)).all(), "host: an event is neither a write nor a reset")
    expect(((host[:, 2] >= 0) & (host[:, 2] < 1 << 8)).all(), "host: an address is outside 8 bits")
    expect(((host[:, 3] >= 0) & (host[:, 3] < 1 << 48)).all(), "host: data outside 48 bits")
    sar = r.stimulus.sar
    expect(len(sar) in (0, end // d.tick_clocks), f"sar: {len(sar)} samples, expected {end // d.tick_clocks} or none")
    expect(((sar >= SAMPLE.lo) & (sar <= SAMPLE.hi)).all(), f"sar: a sample is outside {SAMPLE.lo} .. {SAMPLE.hi}")
    for window in r.windows:
        inside = window.first >= 0 and window.count >= 1 and window.first + window.count <= end
        expect(inside, f"window {window.shows}: clocks {window.first} + {window.count} are outside 0 .. {end - 1}")
    for (name, value), (_, fmt) in zip(leaves(r.params), format_leaves(formats(top.Params, d))):
        expect(fmt.holds(value), f"parameter {name}: {value} is outside its format {fmt}")


def sha256(recording):
    """Hash of everything that a replay reads, whatever the file around it."""
    digest = hashlib.sha256()
    r = recording
    shape = formats(top.Params, r.params.design)
    parameter_entries, added = flattened_parameters(r.params, shape), parameter_defaults(shape)
    digest.update("".join(name for name, _, _ in parameter_entries if name in added).encode())
    for values in (
        np.array([value for _, value, _ in parameter_entries], np.int64),
        np.array([r.frames], np.int64),
        *r.stimulus,
        *([] if r.params.design == DEFAULT else [np.array(r.params.design, np.int64)]),
    ):
        rows = np.ascontiguousarray(values, "<i8")
        digest.update(f"{rows.shape}".encode())
        digest.update(rows.tobytes())
    return digest.hexdigest()

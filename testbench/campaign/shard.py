"""The file of one finished point: named variables in HDF5 that xarray opens, made of identity and results alone.

    /          schema
    /identity  canonical JSON, see `points`
    /NAME      numbers (float64, nan where there is none), texts, arrays on dimension scales tau_s and time_N (s)

Made in memory and sealed with its own SHA-256 (`files`): on the disk it is whole or absent, and damage is found.
Source  docs/campaigns.md
"""

import hashlib
import io

import h5py
import numpy as np

from testbench.campaign.plan.measure import FRAME_S, Variable
from testbench.errors import FileError
from testbench.storage.files import SEAL, SEAL_BYTES

TEXT = h5py.string_dtype()
UNITS = (
    ("_lsb_per_dps", "LSB/(deg/s)"),
    ("_lsb", "LSB"),
    ("_hz", "Hz"),
    ("_deg", "deg"),
    ("_m", "m"),
    ("_s", "s"),
    ("_v", "V"),
)


def unit_of(name):
    """Unit of a number by the ending of its name, such as phase_deg.xe1."""
    stem = name.split(".")[0]
    return next((unit for ending, unit in UNITS if stem.endswith(ending)), "")


def variables_of(numbers):
    """{name: Variable} of the numbers that an engine gives."""
    out = {}
    for name, value in numbers.items():
        attrs = {"units": unit_of(name)} if unit_of(name) else {}
        if not isinstance(value, str):
            value = float("nan") if value is None else float(value)
        out[name] = Variable((), value, attrs)
    return out


def write_variables(file, variables, scales):
    """Write variables into an open HDF5 file; `scales` are one-dimensional variables by the name of their dimension."""
    for name, (dims, data, attrs) in {**scales, **variables}.items():
        text = isinstance(data, str) or (isinstance(data, np.ndarray) and data.dtype.kind in "OU")
        dataset = file.create_dataset(name, data=data, dtype=TEXT if text else None)
        for key, value in attrs.items():
            dataset.attrs[key] = value
        if name in scales:
            dataset.make_scale(name)
            continue
        for axis, dim in enumerate(dims):
            dataset.dims[axis].attach_scale(file[dim])


def scales_of(variables, tau_s):
    """Dimension scales that these variables need: tau_s, and time_N counted from the first frame of the scenario."""
    lengths = {dim: np.shape(v.data)[k] for v in variables.values() for k, dim in enumerate(v.dims)}
    out = {}
    for dim in sorted(lengths):
        if dim == "tau_s":
            out[dim] = Variable((dim,), np.array(tau_s, float), {"units": "s"})
        elif dim.startswith("time_"):
            step = int(dim.removeprefix("time_"))
            attrs = {"units": "s", "long_name": "time from the beginning of the scenario"}
            out[dim] = Variable((dim,), np.arange(lengths[dim]) * step * FRAME_S, attrs)
    return out


def encode(identity, variables, tau_s=()):
    """Bytes of the file."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["schema"] = "gyropoint/1"
        file.create_dataset("identity", data=identity, dtype=TEXT)
        write_variables(file, variables, scales_of(variables, tau_s))
    data = buffer.getvalue()
    return data + SEAL % hashlib.sha256(data).hexdigest().encode()


def decode(data, path):
    """(identity, {name: Variable}) of the bytes of a file; FileError if they were damaged."""
    body, seal = data[:-SEAL_BYTES], data[-SEAL_BYTES:]
    if seal != SEAL % hashlib.sha256(body).hexdigest().encode():
        raise FileError(f"{path}: is damaged; delete it and run the campaign again")
    with h5py.File(io.BytesIO(body), "r") as file:
        variables = {}
        for name, dataset in file.items():
            if name == "identity" or dataset.is_scale:
                continue
            value = dataset[()]
            value = value.decode() if isinstance(value, bytes) else value
            attrs = {k: v for k, v in dataset.attrs.items() if k != "DIMENSION_LIST"}
            dims = tuple(dim[0].name.removeprefix("/") for dim in dataset.dims)
            variables[name] = Variable(dims, value, attrs)
        return file["identity"][()].decode(), variables

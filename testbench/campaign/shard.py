"""The file of one finished point: named variables in HDF5 that xarray opens, made of identity and results alone.

    /          schema
    /identity  canonical JSON, see `points`
    /NAME      numbers (float64, nan where there is none), texts, arrays on dimension scales tau_s and time_N (s)

Made in memory and sealed with its own SHA-256 (`files`): on the disk it is whole or absent, and damage is found.
Source  docs/campaigns.md
"""

import hashlib
import io
import re

import h5py
import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.campaign.plan.measure import STEP, Variable
from testbench.errors import FileError
from testbench.interrupts import defer_interrupts
from testbench.storage import inputs
from testbench.storage.files import SEAL, SEAL_BYTES

TEXT = h5py.string_dtype()
DIMENSION = re.compile(r"tau_s|time_[1-9]\d{0,5}")
STORED_AS = (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT)
UNITS = (
    ("_lsb_per_dps", "LSB/(deg/s)"),
    ("_lsb", "LSB"),
    ("_hz", "Hz"),
    ("_deg", "deg"),
    ("_m", "m"),
    ("_s", "s"),
    ("_v", "V"),
)


def unit_from_name(name):
    """Unit of a number by the ending of its name, such as phase_deg.xe1."""
    stem = name.split(".")[0]
    return next((unit for ending, unit in UNITS if stem.endswith(ending)), "")


def variables_from_numbers(numbers):
    """{name: Variable} of the numbers that an engine gives."""
    out = {}
    for name, value in numbers.items():
        attrs = {"units": unit_from_name(name)} if unit_from_name(name) else {}
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


def dimension_scales(variables, tau_s):
    """Dimension scales that these variables need: tau_s, and time_N counted from the first frame of the scenario."""
    lengths = {dim: np.shape(v.data)[k] for v in variables.values() for k, dim in enumerate(v.dims)}
    steps_s = {dim: v.attrs[STEP] for v in variables.values() for dim in v.dims if STEP in v.attrs}
    out = {}
    for dim in sorted(lengths):
        if dim == "tau_s":
            out[dim] = Variable((dim,), np.array(tau_s, float), {"units": "s"})
        elif dim.startswith("time_"):
            # points of earlier versions have no step: they are of the default design
            step_s = steps_s.get(dim, int(dim.removeprefix("time_")) / DEFAULT.frame_hz)
            attrs = {"units": "s", "long_name": "time from the beginning of the scenario"}
            out[dim] = Variable((dim,), np.arange(lengths[dim]) * step_s, attrs)
    return out


def encode(identity, variables, tau_s=()):
    """Bytes of the file."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["schema"] = "gyropoint/1"
        file.create_dataset("identity", data=identity, dtype=TEXT)
        write_variables(file, variables, dimension_scales(variables, tau_s))
    data = buffer.getvalue()
    return data + SEAL % hashlib.sha256(data).hexdigest().encode()


@defer_interrupts()  # h5py forgets objects in callbacks, in which Python ignores a Ctrl-C
def decode(data, path):
    """(identity, {name: Variable}) of the bytes of a file; FileError if they were damaged, or never were a point."""
    body, seal = data[:-SEAL_BYTES], data[-SEAL_BYTES:]
    if seal != SEAL % hashlib.sha256(body).hexdigest().encode():
        raise FileError(f"{path}: is damaged: its SHA-256 does not match")
    with inputs.explain_damage(path, "point"), h5py.File(io.BytesIO(body), "r") as file:
        datasets = _datasets(file, path, len(body))
        variables = {
            name: _variable(dataset, f"{path}: /{name}")
            for name, dataset in datasets.items()
            if name != "identity" and not dataset.is_scale
        }
        return file["identity"][()].decode(), variables


def _datasets(file, path, size):
    """{name: dataset} of an open point; FileError for what `encode` never makes, before any of it is followed."""
    out, total = {}, 0
    for name in file:
        item = out[name] = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
        if not isinstance(item, h5py.Dataset):
            raise FileError(f"{path}: /{name}: is not a dataset, or only a link to one")
        created = item.id.get_create_plist()
        if created.get_layout() not in STORED_AS or created.get_external_count() or item.ndim > 1:
            raise FileError(f"{path}: /{name}: has another storage layout than the data of a point")
        if item.dtype.kind not in "iufb" and not (item.ndim == 0 and h5py.check_string_dtype(item.dtype)):
            raise FileError(
                f"{path}: /{name}: {item.dtype} of shape {item.shape} is not a number, a row of numbers or a text"
            )
        total += item.nbytes
    if total > size:
        raise FileError(f"{path}: {total} bytes of data do not fit a file of {size} bytes")
    return out


def _variable(dataset, error_prefix):
    value = dataset[()]
    value = value.decode() if isinstance(value, bytes) else value
    dataset_attrs = dataset.attrs
    names = [name for name in dataset_attrs if name != "DIMENSION_LIST"]
    if any(dataset_attrs.get_id(name).shape for name in names):
        raise FileError(f"{error_prefix}: an attribute is neither a number nor a text")
    dims = tuple(dim[0].name.removeprefix("/") for dim in dataset.dims) if dataset.ndim else ()
    if not all(DIMENSION.fullmatch(dim) for dim in dims):
        raise FileError(f"{error_prefix}: {dims} are not the dimensions of a point")
    return Variable(dims, value, {name: dataset_attrs[name] for name in names})

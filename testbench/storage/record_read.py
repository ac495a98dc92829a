"""Reading a record: schema, units, lengths, rates and hashes are checked; no code that could execute what it reads.

Source  docs/record.md
"""

from typing import Annotated

import h5py
import numpy as np
from pydantic import Field

from testbench.errors import FileError
from testbench.storage.hdf5_input import open_hdf5
from testbench.storage.inputs import parse_json
from testbench.storage.record import (
    KINDS,
    SCHEMA,
    STREAM_KEYS,
    Column,
    Record,
    RecordError,
    TableColumn,
    axis_name,
    column_digest,
    content_digest,
    describe_stream,
    described_tables,
    is_valid_unit,
    nominal_clock_hz,
    plain_attribute,
)

HIDDEN = {"units", "DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates"}
DAMAGED = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, ArithmeticError, MemoryError)
# An attribute: text or number that HDF5 and NumPy can hold, too
Value = str | Annotated[int, Field(ge=-(1 << 63), lt=1 << 63)] | float


def read_record(path):
    """Checked `Record`; raises RecordError with one finding `Rnn path expected, found` per thing that is wrong."""
    with open_hdf5(path) as file:
        findings = []
        try:
            record = _read(file, findings)
        except (FileError, *DAMAGED) as problem:
            if not findings:
                findings.append(f"R01 / expected a complete record, found damage: {' '.join(str(problem).split())}")
    if findings:
        raise RecordError(path, findings)
    return record


def text_attribute(value):
    """A text attribute; ValueError if it is a number."""
    value = plain_attribute(value)
    if not isinstance(value, str):
        raise ValueError(f"expected a text, found {value}")
    return value


def _read(file, findings):
    schema = file.attrs.get("schema", "nothing")
    if schema != SCHEMA:
        findings.append(f"R01 / expected schema {SCHEMA}, found {schema}")
        return None
    for path, key in (
        *(("/", key) for key in ("provenance", "config_toml", "versions", "attributes", "content_sha256")),
        *(("clock", key) for key in ("f_xtal_nominal_Hz", "ppm")),
        *(("integrity", key) for key in ("path", "sha256")),
    ):
        if path not in file or key not in (file[path] if path == "integrity" else file[path].attrs):
            findings.append(f"R02 {path} expected {key}, found nothing")
    if findings:
        return None
    digest_by_path = dict(zip(*(file["integrity"][key].asstr()[:].tolist() for key in ("path", "sha256"))))
    record = Record(
        config_toml=text_attribute(file.attrs["config_toml"]),
        provenance=text_attribute(file.attrs["provenance"]),
        clock_ppm=float(file["clock"].attrs["ppm"]),
        attrs=parse_json(file.attrs["attributes"], "attributes", dict[str, Value]),
        versions=parse_json(file.attrs["versions"], "versions", dict[str, str]),
        content_sha256=text_attribute(file.attrs["content_sha256"]),
    )
    record.clock_hz = nominal_clock_hz(float(file["clock"].attrs["f_xtal_nominal_Hz"]), findings)
    column_paths = []
    file.visititems(lambda name, item: column_paths.append(f"/{name}") if isinstance(item, h5py.Dataset) else None)
    for path in column_paths:
        if not path.startswith("/integrity/"):
            _read_column(file, path, record, digest_by_path, findings)
    for path in sorted(set(digest_by_path) - set(column_paths)):
        findings.append(f"R02 {path} expected a column, found nothing")
    if not findings:
        streams = {
            name: describe_stream(column, digest_by_path[f"/streams/{name}"], len(column.data))
            for name, column in record.streams.items()
        }
        content = content_digest(
            streams,
            described_tables(record.tables),
            record.config_toml,
            record.provenance,
            record.clock_ppm,
            record.attrs,
            record.clock_hz,
        )
        if content != record.content_sha256:
            findings.append(f"R15 / expected content_sha256 {record.content_sha256}, found {content}")
    return record


def _read_column(file, path, record, digest_by_path, findings):
    dataset = file[path]
    group, _, name = path[1:].rpartition("/")
    is_axis = group == "streams" and dataset.is_scale
    if name == "row" and group != "streams":
        return
    text = h5py.check_string_dtype(dataset.dtype) is not None
    allowed = group != "streams" if text else dataset.dtype.kind in KINDS
    if not allowed or dataset.ndim != 1:
        findings.append(f"R04 {path} expected a column of numbers, found {dataset.dtype} of {dataset.ndim} dimensions")
        return
    if not text and dataset.dtype.byteorder == ">":
        findings.append(f"R20 {path} expected little-endian numbers, found {dataset.dtype}")
        return
    unit = dataset.attrs.get("unit")
    if not is_valid_unit(unit) and not (unit == "" and group != "streams"):
        findings.append(f"R03 {path} expected a unit, found {unit!r}")
        return
    data = np.array(dataset.asstr()[:].tolist(), str) if text else dataset[:]
    digest = column_digest(data)
    if digest_by_path.get(path) != digest:
        findings.append(f"R15 {path} expected sha256 {digest_by_path.get(path, 'none')}, found {digest}")
    elif is_axis:
        return
    elif group != "streams":
        record.tables.setdefault(group, {})[name] = TableColumn(data, unit)
    else:
        attrs = {key: plain_attribute(dataset.attrs[key]) for key in dataset.attrs if key not in HIDDEN}
        missing = [key for key in STREAM_KEYS if key not in attrs]
        num, den, edge0 = (attrs.get(key) for key in STREAM_KEYS[1:])
        if missing or not all(isinstance(value, int) for value in (num, den, edge0)) or num < 1 or den < 1:
            findings.append(
                f"R08 {path} expected {', '.join(STREAM_KEYS[1:])}: a ratio of the clock, found {num}/{den}"
            )
            return
        axis = f"streams/{axis_name(num, den, edge0, record.clock_hz)}"
        if axis not in file or len(file[axis]) != len(data):
            findings.append(f"R05 {path} expected {axis} of {len(data)} rows, found another length")
            return
        column_attrs = {key: value for key, value in attrs.items() if key not in STREAM_KEYS}
        record.streams[name] = Column(data, unit, num, den, edge0, column_attrs, record.clock_hz)

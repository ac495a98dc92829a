"""Records: named columns with units, exact rates, the configuration, the versions and a content hash, in HDF5.

    /            schema, record_id, created_utc, provenance, config_toml, versions, content_sha256
    /clock       f_xtal_nominal_Hz, ppm
    /streams     one column per signal: unit, fs_num / fs_den (rate per clock edge), edge0 (clock edge of row 0)
    /TABLE       small tables: registers, segments, stimulus/rate, ...
    /integrity   path, sha256 of every column

Every stream hangs on a dimension scale (clock edges, with the factor to seconds): xarray reads a group as it is.
Writing streams into PATH.part and renames it at the end; reading checks schema, units, lengths, rates and hashes, and
holds no code that could execute what it reads.
Source  docs/record.md
"""

import hashlib
import json
import math
import platform
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import h5py
import numpy as np

from testbench.errors import FileError
from testbench.interrupts import defer_interrupts
from testbench.storage.files import GuardedFile, Staging, explain, seal
from testbench.version import VERSION

SCHEMA = "gyrorec/1.0"
CLOCK_HZ = 26_000_000  # of the default design
UNITS = frozenset(
    "1 code word edge tick s ms us ns Hz kHz turn deg rad deg/s rad/s degC K V A F N m um pm N/m ppm "
    "LSB LSB/(deg/s)".split()
)
SCALED_UNIT = re.compile(r"(?:\d+(?:\.\d+)? )?(\S+)/2\^\d+")
KINDS = "iuf"  # NumPy kinds that a column may hold
NO_ATTRS = MappingProxyType({})
CHUNK_BYTES = 1 << 18
STREAM_KEYS = ("unit", "fs_num", "fs_den", "edge0")


class RecordError(FileError):
    """A file that is no valid record: one line; `findings` has one line for each thing that is wrong."""

    def __init__(self, path, findings):
        self.findings = tuple(findings)
        more = f" (and {len(self.findings) - 1} more)" if len(self.findings) > 1 else ""
        super().__init__(f"{path}: {self.findings[0]}{more}")


class Column(NamedTuple):
    """A stream: values at edges edge0 + n * den / num of the master clock."""

    data: np.ndarray
    unit: str
    num: int = 1
    den: int = 1
    edge0: int = 0
    attrs: Mapping = NO_ATTRS
    clock_hz: int = CLOCK_HZ

    @property
    def rate_hz(self):
        """Nominal rate; `num` and `den` are the exact one."""
        return self.clock_hz * self.num / self.den

    @property
    def time_s(self):
        """Nominal time of each row, from power-on."""
        return (self.edge0 + np.arange(len(self.data)) * (self.den / self.num)) / self.clock_hz


class TableColumn(NamedTuple):
    """A column of a table; text columns have unit ""."""

    data: np.ndarray
    unit: str


@dataclass
class Record:
    """What a run leaves behind, in memory."""

    streams: dict = field(default_factory=dict)
    tables: dict = field(default_factory=dict)
    config_toml: str = ""
    provenance: str = "simulated"
    clock_ppm: float = 0.0
    attrs: dict = field(default_factory=dict)
    versions: dict = field(default_factory=dict)
    content_sha256: str = ""
    clock_hz: int = CLOCK_HZ

    def write(self, path, progress=None):
        """Write it; returns its content hash."""
        return write_record(path, self)


def is_valid_unit(unit):
    """True for a unit of the table, or a power-of-two share of one, such as "10 V/2^23"."""
    scaled = SCALED_UNIT.fullmatch(unit) if isinstance(unit, str) else None
    return unit in UNITS or (scaled is not None and scaled[1] in UNITS)


def versions():
    """Versions of everything that a number may depend on."""
    import numba

    return {
        "ftr-gyro": VERSION,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "h5py": h5py.__version__,
        "machine": platform.machine(),
    }


def column_digest(array):
    """SHA-256 of a column: little-endian bytes in row order, or the UTF-8 texts with their lengths."""
    digest = hashlib.sha256()
    _update(digest, array)
    return digest.hexdigest()


def _update(digest, array):
    if array.dtype.kind in "OU":
        for text in array.tolist():
            data = text.encode()
            digest.update(len(data).to_bytes(8, "little") + data)
    else:
        digest.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).data)


def content_digest(streams, tables, config_toml, provenance, clock_ppm, attrs, clock_hz=CLOCK_HZ):
    """Hash of everything that was simulated or measured; not of when, where and by which version."""
    # records had one clock once: theirs is not in their hash
    clock = clock_ppm if clock_hz == CLOCK_HZ else [clock_hz, clock_ppm]
    text = json.dumps([SCHEMA, streams, tables, config_toml, provenance, clock, attrs], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def describe_stream(column, digest, rows):
    """What the content hash says about a stream, apart from its values."""
    dtype = column.data.dtype
    return {
        **{key: plain_attribute(value) for key, value in column.attrs.items()},
        "unit": column.unit,
        "fs_num": int(column.num),
        "fs_den": int(column.den),
        "edge0": int(column.edge0),
        "rows": int(rows),
        "dtype": f"{dtype.kind}{dtype.itemsize}",
        "sha256": digest,
    }


def plain_attribute(value):
    """An attribute as a plain Python value; only texts and numbers are allowed."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bytes):
        value = value.decode()
    if isinstance(value, bool):
        value = int(value)
    if not isinstance(value, (str, int, float)):
        raise ValueError(f"attribute of type {type(value).__name__}")
    return value


def nominal_clock_hz(hz, findings):
    """Nominal frequency (Hz) of a record's master clock; a finding, and that of the default design, for none."""
    if math.isfinite(hz) and hz >= 1 and hz == int(hz):
        return int(hz)
    findings.append(f"R08 /clock expected f_xtal_nominal_Hz in whole hertz, found {hz}")
    return CLOCK_HZ


def axis_name(num, den, edge0, clock_hz=CLOCK_HZ):
    """Name of the dimension of a rate: time_8k, time_1M, or the ratio."""
    hz, remainder = divmod(clock_hz * num, den)
    for unit, suffix in ((10**6, "M"), (10**3, "k"), (1, "")):
        if not remainder and hz % unit == 0:
            name = f"time_{hz // unit}{suffix}"
            break
    else:
        name = f"time_{num}_{den}"
    return name if edge0 == 0 else f"{name}_from_{edge0}"


def _row_clock_edges(num, den, edge0, first, rows):
    """Clock edges of rows first .. first + rows - 1, rounded down where the ratio is not whole."""
    return edge0 + (np.arange(first, first + rows, dtype=np.int64) * den) // num


class RecordWriter:
    """Streams columns into PATH.part and renames it when the block ends well; otherwise nothing is left.

    with RecordWriter(path, config_toml=text) as writer:
        writer.stream("adc_yI", "code", np.int32, num=1, den=3250, edge0=0, bits=24)
        writer.append(adc_yI=block)
        writer.table("segments", {"id": ("1", ids), "kind": ("", kinds)})
    """

    def __init__(
        self,
        path,
        config_toml="",
        provenance="simulated",
        clock_ppm=0.0,
        attrs=None,
        record_id=None,
        created_utc=None,
        clock_hz=CLOCK_HZ,
    ):
        self.path = Path(path)
        self._clock_hz = clock_hz
        self._record_id, self._created_utc = record_id, created_utc
        self._head = (
            config_toml,
            provenance,
            float(clock_ppm),
            {k: plain_attribute(v) for k, v in (attrs or {}).items()},
        )
        self._streams = {}
        self._digests = {}
        self._axes = {}
        self._tables = {}
        self.content_sha256 = ""
        self._staging = Staging(self.path)
        try:
            self._guard = GuardedFile(self._staging.new)
        except OSError as problem:
            self._staging.close()
            raise explain(self.path, problem) from None
        self._file = h5py.File(self._guard, "w")

    def __enter__(self):
        return self

    @defer_interrupts()  # the HDF5 library calls Python to write, and knows no exceptions
    def __exit__(self, kind, value, traceback):
        is_published = False
        try:
            if kind is None:
                self._finish()
            self._file.close()
            self._guard.close()
            self._check()
            if kind is None:
                seal(self._staging.new)
                self._staging.finish()
                is_published = True
        except OSError as problem:
            raise explain(self.path, self._guard.problem or problem) from None
        finally:
            if self._file:
                self._file.close()
            self._guard.close()
            if not is_published:
                self._staging.close()

    def stream(self, name, unit, dtype, num=1, den=1, edge0=0, *, compress=True, **attrs):
        """Declare a stream: numbers of `unit`, num / den rows per clock edge, row 0 at edge `edge0`."""
        if not is_valid_unit(unit):
            raise ValueError(f"stream {name}: unit {unit!r} is not in the table of units")
        if name in self._streams or num < 1 or den < 1:
            raise ValueError(
                f"stream {name}: duplicate stream, or rate {num}/{den} is not a ratio of positive integers"
            )
        axis = axis_name(num, den, edge0, self._clock_hz)
        if axis not in self._axes:
            self._axes[axis] = (num, den, edge0)
        empty = np.empty(0, np.dtype(dtype))
        if empty.dtype.kind not in KINDS:
            raise ValueError(f"stream {name}: {empty.dtype} is not a number type")
        column = Column(empty, unit, num, den, edge0, {key: plain_attribute(value) for key, value in attrs.items()})
        dataset = self._create_dataset(f"streams/{name}", empty.dtype, compress)
        for key, value in {**column.attrs, "unit": unit, "units": unit}.items():
            dataset.attrs[key] = value
        dataset.attrs["fs_num"], dataset.attrs["fs_den"], dataset.attrs["edge0"] = num, den, edge0
        self._streams[name] = column
        self._digests[name] = hashlib.sha256()

    @defer_interrupts()
    def append(self, **blocks):
        """Add rows to declared streams."""
        for name, block in blocks.items():
            self._extend(f"streams/{name}", np.asarray(block, self._streams[name].data.dtype), self._digests[name])

    def table(self, name, columns):
        """Write a small table: column -> (unit, values); text columns have unit ""."""
        columns = {key: TableColumn(_table_array(values), unit) for key, (unit, values) in columns.items()}
        for key, column in columns.items():
            if column.unit != "" and not is_valid_unit(column.unit):
                raise ValueError(f"table {name}: unit {column.unit!r} of {key} is not in the table of units")
        self._rows(name, columns)
        self._tables[name] = columns
        self._check()

    def _rows(self, name, columns):
        rows = {len(column.data) for column in columns.values()}
        if len(rows) != 1:
            raise ValueError(f"table {name}: columns of different lengths {sorted(rows)}")
        group = self._file.create_group(name)
        row = group.create_dataset("row", data=np.arange(rows.pop(), dtype=np.int64))
        row.make_scale("row")
        for key, column in columns.items():
            text = column.data.dtype.kind == "U"
            data = column.data.astype(object) if text else column.data
            dataset = group.create_dataset(key, data=data, dtype=h5py.string_dtype() if text else None)
            dataset.attrs["unit"] = dataset.attrs["units"] = column.unit
            dataset.dims[0].attach_scale(row)

    def _create_dataset(self, path, dtype, compress=True):
        rows = max(1024, CHUNK_BYTES // dtype.itemsize)
        packed = {"compression": 1, "shuffle": True} if compress else {}
        return self._file.create_dataset(
            path, (0,), dtype.newbyteorder("<"), maxshape=(None,), chunks=(rows,), **packed
        )

    def _extend(self, path, block, digest):
        dataset = self._file[path]
        rows = len(dataset)
        dataset.resize(rows + len(block), axis=0)
        dataset[rows:] = block
        _update(digest, block)
        self._check()

    def _check(self):
        if self._guard.problem is not None:
            raise explain(self.path, self._guard.problem)

    def _finish(self):
        digest_by_path = {f"/streams/{name}": digest.hexdigest() for name, digest in self._digests.items()}
        for axis, (num, den, edge0) in self._axes.items():
            names = [name for name, c in self._streams.items() if (c.num, c.den, c.edge0) == (num, den, edge0)]
            rows = {len(self._file[f"streams/{name}"]) for name in names}
            if len(rows) != 1:
                raise ValueError(f"streams {', '.join(names)}: one rate, but different lengths {sorted(rows)}")
            scale = self._create_dataset(f"streams/{axis}", np.dtype(np.int64))
            digest = hashlib.sha256()
            total = rows.pop()
            for first in range(0, total, CHUNK_BYTES):
                count = min(CHUNK_BYTES, total - first)
                self._extend(scale.name, _row_clock_edges(num, den, edge0, first, count), digest)
            digest_by_path[scale.name] = digest.hexdigest()
            scale.attrs["unit"], scale.attrs["units"] = "edge", "s"
            scale.attrs["scale_factor"] = 1.0 / self._clock_hz
            scale.attrs["long_name"] = "time from power-on"
            scale.make_scale(axis)
            for name in names:
                self._file[f"streams/{name}"].dims[0].attach_scale(scale)
        for name, columns in self._tables.items():
            digest_by_path |= {f"/{name}/{key}": column_digest(column.data) for key, column in columns.items()}
        self._head_attrs()
        texts = {"path": sorted(digest_by_path), "sha256": [digest_by_path[path] for path in sorted(digest_by_path)]}
        self._rows("integrity", {key: TableColumn(np.array(values, str), "") for key, values in texts.items()})

    def _head_attrs(self):
        config_toml, provenance, clock_ppm, attrs = self._head
        streams = {
            name: describe_stream(column, self._digests[name].hexdigest(), len(self._file[f"streams/{name}"]))
            for name, column in self._streams.items()
        }
        self.content_sha256 = content_digest(streams, described_tables(self._tables), *self._head, self._clock_hz)
        root = self._file.attrs
        root["schema"] = SCHEMA
        root["record_id"] = self._record_id or str(uuid.uuid4())
        root["created_utc"] = self._created_utc or datetime.now(UTC).isoformat(timespec="seconds")
        root["provenance"] = provenance
        root["config_toml"] = config_toml
        root["versions"] = json.dumps(versions())
        root["attributes"] = json.dumps(attrs)
        root["content_sha256"] = self.content_sha256
        clock = self._file.create_group("clock")
        clock.attrs["f_xtal_nominal_Hz"] = float(self._clock_hz)
        clock.attrs["ppm"] = clock_ppm


def _table_array(values):
    array = np.asarray(values)
    if array.dtype.kind == "b":
        array = array.astype(np.int64)
    if array.ndim != 1 or array.dtype.kind not in "iufU":
        raise ValueError(f"table column of {array.ndim} dimensions and type {array.dtype}")
    return array


def described_tables(tables):
    return {
        f"{name}/{key}": {"unit": column.unit, "rows": len(column.data), "sha256": column_digest(column.data)}
        for name, columns in tables.items()
        for key, column in columns.items()
    }


def write_record(path, record):
    """Write a record that is in memory; returns its content hash."""
    head = record.config_toml, record.provenance, record.clock_ppm, record.attrs
    with RecordWriter(path, *head, clock_hz=record.clock_hz) as writer:
        for name, column in record.streams.items():
            writer.stream(name, column.unit, column.data.dtype, column.num, column.den, column.edge0, **column.attrs)
            writer.append(**{name: column.data})
        for name, columns in record.tables.items():
            writer.table(name, {key: (column.unit, column.data) for key, column in columns.items()})
    return writer.content_sha256

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
from testbench.files import GuardedFile, discard, explain, part_of, publish, seal, seal_holds
from testbench.interrupts import held
from testbench.version import VERSION

SCHEMA = "gyrorec/1.0"
STATE_SCHEMA = "gyrostate/1.0"
CLOCK_HZ = 26_000_000
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
    """A stream: values at clock edges edge0 + n * den / num of the 26 MHz clock."""

    data: np.ndarray
    unit: str
    num: int = 1
    den: int = 1
    edge0: int = 0
    attrs: Mapping = NO_ATTRS

    @property
    def rate_hz(self):
        """Nominal rate; `num` and `den` are the exact one."""
        return CLOCK_HZ * self.num / self.den

    @property
    def time_s(self):
        """Nominal time of each row, from power-on."""
        return (self.edge0 + np.arange(len(self.data)) * (self.den / self.num)) / CLOCK_HZ


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

    def write(self, path, progress=None):
        """Write it; returns its content hash."""
        return write_record(path, self)


def known_unit(unit):
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


def _digest(array):
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


def _content(streams, tables, config_toml, provenance, clock_ppm, attrs):
    """Hash of everything that was simulated or measured; not of when, where and by which version."""
    text = json.dumps([SCHEMA, streams, tables, config_toml, provenance, clock_ppm, attrs], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _described(column, digest, rows):
    """What the content hash says about a stream, apart from its values."""
    dtype = column.data.dtype
    return {
        **{key: _plain(value) for key, value in column.attrs.items()},
        "unit": column.unit,
        "fs_num": int(column.num),
        "fs_den": int(column.den),
        "edge0": int(column.edge0),
        "rows": int(rows),
        "dtype": f"{dtype.kind}{dtype.itemsize}",
        "sha256": digest,
    }


def _plain(value):
    """An attribute as a plain Python value; only texts and numbers are allowed."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bytes):
        value = value.decode()
    if isinstance(value, bool):
        value = int(value)
    if not isinstance(value, (str, int, float)):
        raise ValueError(f"attribute of type {type(value).__name__}")
    return value


def _axis_name(num, den, edge0):
    """Name of the dimension of a rate: time_8k, time_1M, or the ratio."""
    hz, left = divmod(CLOCK_HZ * num, den)
    for unit, suffix in ((10**6, "M"), (10**3, "k"), (1, "")):
        if not left and hz % unit == 0:
            name = f"time_{hz // unit}{suffix}"
            break
    else:
        name = f"time_{num}_{den}"
    return name if edge0 == 0 else f"{name}_from_{edge0}"


def _edges(num, den, edge0, first, rows):
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
    ):
        self.path = Path(path)
        self._record_id, self._created_utc = record_id, created_utc
        self._head = (config_toml, provenance, float(clock_ppm), {k: _plain(v) for k, v in (attrs or {}).items()})
        self._streams = {}
        self._digests = {}
        self._axes = {}
        self._tables = {}
        self.content_sha256 = ""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._guard = GuardedFile(part_of(self.path))
        except OSError as problem:
            raise explain(self.path, problem) from None
        self._file = h5py.File(self._guard, "w")

    def __enter__(self):
        return self

    @held()  # the HDF5 library calls Python to write, and knows no exceptions
    def __exit__(self, kind, value, traceback):
        try:
            if kind is None:
                self._finish()
            self._file.close()
            self._guard.close()
            self._check()
            if kind is None:
                seal(part_of(self.path))
                publish(self.path)
        except OSError as problem:
            raise explain(self.path, self._guard.problem or problem) from None
        finally:
            if self._file:
                self._file.close()
            self._guard.close()
            discard(self.path)

    def stream(self, name, unit, dtype, num=1, den=1, edge0=0, *, compress=True, **attrs):
        """Declare a stream: numbers of `unit`, num / den rows per clock edge, row 0 at edge `edge0`."""
        if not known_unit(unit):
            raise ValueError(f"stream {name}: unit {unit!r} is not in the table of units")
        if name in self._streams or num < 1 or den < 1:
            raise ValueError(f"stream {name}: declared twice, or rate {num}/{den} is not a ratio of positive integers")
        axis = _axis_name(num, den, edge0)
        if axis not in self._axes:
            self._axes[axis] = (num, den, edge0)
        empty = np.empty(0, np.dtype(dtype))
        if empty.dtype.kind not in KINDS:
            raise ValueError(f"stream {name}: {empty.dtype} is not a number type")
        column = Column(empty, unit, num, den, edge0, {key: _plain(value) for key, value in attrs.items()})
        dataset = self._growing(f"streams/{name}", empty.dtype, compress)
        for key, value in {**column.attrs, "unit": unit, "units": unit}.items():
            dataset.attrs[key] = value
        dataset.attrs["fs_num"], dataset.attrs["fs_den"], dataset.attrs["edge0"] = num, den, edge0
        self._streams[name] = column
        self._digests[name] = hashlib.sha256()

    @held()
    def append(self, **blocks):
        """Add rows to declared streams."""
        for name, block in blocks.items():
            self._extend(f"streams/{name}", np.asarray(block, self._streams[name].data.dtype), self._digests[name])

    def table(self, name, columns):
        """Write a small table: column -> (unit, values); text columns have unit ""."""
        columns = {key: TableColumn(_table_array(values), unit) for key, (unit, values) in columns.items()}
        for key, column in columns.items():
            if column.unit != "" and not known_unit(column.unit):
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

    def _growing(self, path, dtype, compress=True):
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
        listed = {f"/streams/{name}": digest.hexdigest() for name, digest in self._digests.items()}
        for axis, (num, den, edge0) in self._axes.items():
            names = [name for name, c in self._streams.items() if (c.num, c.den, c.edge0) == (num, den, edge0)]
            rows = {len(self._file[f"streams/{name}"]) for name in names}
            if len(rows) != 1:
                raise ValueError(f"streams {', '.join(names)}: one rate, but different lengths {sorted(rows)}")
            scale = self._growing(f"streams/{axis}", np.dtype(np.int64))
            digest = hashlib.sha256()
            total = rows.pop()
            for first in range(0, total, CHUNK_BYTES):
                count = min(CHUNK_BYTES, total - first)
                self._extend(scale.name, _edges(num, den, edge0, first, count), digest)
            listed[scale.name] = digest.hexdigest()
            scale.attrs["unit"], scale.attrs["units"] = "edge", "s"
            scale.attrs["scale_factor"] = 1.0 / CLOCK_HZ
            scale.attrs["long_name"] = "time from power-on"
            scale.make_scale(axis)
            for name in names:
                self._file[f"streams/{name}"].dims[0].attach_scale(scale)
        for name, columns in self._tables.items():
            listed |= {f"/{name}/{key}": _digest(column.data) for key, column in columns.items()}
        self._head_attrs()
        texts = {"path": sorted(listed), "sha256": [listed[path] for path in sorted(listed)]}
        self._rows("integrity", {key: TableColumn(np.array(values, str), "") for key, values in texts.items()})

    def _head_attrs(self):
        config_toml, provenance, clock_ppm, attrs = self._head
        streams = {
            name: _described(column, self._digests[name].hexdigest(), len(self._file[f"streams/{name}"]))
            for name, column in self._streams.items()
        }
        self.content_sha256 = _content(streams, _described_tables(self._tables), *self._head)
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
        clock.attrs["f_xtal_nominal_Hz"] = float(CLOCK_HZ)
        clock.attrs["ppm"] = clock_ppm


def _table_array(values):
    array = np.asarray(values)
    if array.dtype.kind == "b":
        array = array.astype(np.int64)
    if array.ndim != 1 or array.dtype.kind not in "iufU":
        raise ValueError(f"table column of {array.ndim} dimensions and type {array.dtype}")
    return array


def _described_tables(tables):
    return {
        f"{name}/{key}": {"unit": column.unit, "rows": len(column.data), "sha256": _digest(column.data)}
        for name, columns in tables.items()
        for key, column in columns.items()
    }


def write_record(path, record):
    """Write a record that is in memory; returns its content hash."""
    with RecordWriter(path, record.config_toml, record.provenance, record.clock_ppm, record.attrs) as writer:
        for name, column in record.streams.items():
            writer.stream(name, column.unit, column.data.dtype, column.num, column.den, column.edge0, **column.attrs)
            writer.append(**{name: column.data})
        for name, columns in record.tables.items():
            writer.table(name, {key: (column.unit, column.data) for key, column in columns.items()})
    return writer.content_sha256


# ---- reading ---------------------------------------------------------------------------------------------------------

DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, OverflowError, MemoryError)


def _open(path):
    path = Path(path)
    try:
        whole = seal_holds(path)
    except OSError as problem:
        raise FileError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    if whole is False:
        raise RecordError(path, ["R15 / expected the file that was written, found damage"])
    try:
        return h5py.File(path, "r")
    except OSError:
        raise RecordError(path, ["R01 / expected an HDF5 file, found something else"]) from None


def read_record(path):
    """Checked `Record`; raises RecordError with one finding `Rnn path expected, found` per thing that is wrong."""
    with _open(path) as file:
        findings = []
        try:
            record = _read(file, findings)
        except DAMAGED as problem:
            if not findings:
                findings.append(f"R01 / expected a complete record, found damage: {' '.join(str(problem).split())}")
    if findings:
        raise RecordError(path, findings)
    return record


def _read(file, findings):
    schema = file.attrs.get("schema", "nothing")
    if schema != SCHEMA:
        findings.append(f"R01 / expected schema {SCHEMA}, found {schema}")
        return None
    for place, key in (
        *(("/", key) for key in ("provenance", "config_toml", "versions", "attributes", "content_sha256")),
        *(("clock", key) for key in ("f_xtal_nominal_Hz", "ppm")),
        *(("integrity", key) for key in ("path", "sha256")),
    ):
        if place not in file or key not in (file[place] if place == "integrity" else file[place].attrs):
            findings.append(f"R02 {place} expected {key}, found nothing")
    if findings:
        return None
    listed = dict(zip(*(file["integrity"][key].asstr()[:].tolist() for key in ("path", "sha256"))))
    record = Record(
        config_toml=_plain(file.attrs["config_toml"]),
        provenance=_plain(file.attrs["provenance"]),
        clock_ppm=float(file["clock"].attrs["ppm"]),
        attrs=json.loads(file.attrs["attributes"]),
        versions=json.loads(file.attrs["versions"]),
        content_sha256=_plain(file.attrs["content_sha256"]),
    )
    if file["clock"].attrs["f_xtal_nominal_Hz"] != CLOCK_HZ:
        findings.append(f"R08 /clock expected f_xtal_nominal_Hz {CLOCK_HZ}")
    found = []
    file.visititems(lambda name, item: found.append(f"/{name}") if isinstance(item, h5py.Dataset) else None)
    for place in found:
        if not place.startswith("/integrity/"):
            _read_column(file, place, record, listed, findings)
    for place in sorted(set(listed) - set(found)):
        findings.append(f"R02 {place} expected a column, found nothing")
    if not findings:
        described = {
            name: _described(column, listed[f"/streams/{name}"], len(column.data))
            for name, column in record.streams.items()
        }
        content = _content(
            described,
            _described_tables(record.tables),
            record.config_toml,
            record.provenance,
            record.clock_ppm,
            record.attrs,
        )
        if content != record.content_sha256:
            findings.append(f"R15 / expected content_sha256 {record.content_sha256}, found {content}")
    return record


def _read_column(file, place, record, listed, findings):
    dataset = file[place]
    group, _, name = place[1:].rpartition("/")
    is_axis = group == "streams" and dataset.is_scale
    if name == "row" and group != "streams":
        return
    text = h5py.check_string_dtype(dataset.dtype) is not None
    allowed = group != "streams" if text else dataset.dtype.kind in KINDS
    if not allowed or dataset.ndim != 1:
        findings.append(f"R04 {place} expected a column of numbers, found {dataset.dtype} of {dataset.ndim} dimensions")
        return
    if not text and dataset.dtype.byteorder == ">":
        findings.append(f"R20 {place} expected little-endian numbers, found {dataset.dtype}")
        return
    unit = dataset.attrs.get("unit")
    if not known_unit(unit) and not (unit == "" and group != "streams"):
        findings.append(f"R03 {place} expected a unit, found {unit!r}")
        return
    data = np.array(dataset.asstr()[:].tolist(), str) if text else dataset[:]
    digest = _digest(data)
    if listed.get(place) != digest:
        findings.append(f"R15 {place} expected sha256 {listed.get(place, 'none')}, found {digest}")
    elif is_axis:
        return
    elif group != "streams":
        record.tables.setdefault(group, {})[name] = TableColumn(data, unit)
    else:
        attrs = {key: _plain(dataset.attrs[key]) for key in dataset.attrs if key not in HIDDEN}
        missing = [key for key in STREAM_KEYS if key not in attrs]
        num, den, edge0 = (attrs.get(key) for key in STREAM_KEYS[1:])
        if missing or not all(isinstance(value, int) for value in (num, den, edge0)) or num < 1 or den < 1:
            findings.append(
                f"R08 {place} expected {', '.join(STREAM_KEYS[1:])}: a ratio of the clock, found {num}/{den}"
            )
            return
        axis = f"streams/{_axis_name(num, den, edge0)}"
        if axis not in file or len(file[axis]) != len(data):
            findings.append(f"R05 {place} expected {axis} of {len(data)} rows, found another length")
            return
        own = {key: value for key, value in attrs.items() if key not in STREAM_KEYS}
        record.streams[name] = Column(data, unit, num, den, edge0, own)


HIDDEN = {"units", "DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates"}


# ---- state files -----------------------------------------------------------------------------------------------------


@held()
def save_state(path, values, source_format, meta=None):
    """Save a simulation's state, whole or not at all.

    values         name -> int, float or array of numbers; restored with the same type, bit for bit
    source_format  text that names the layout of `values`; loading with another one is refused
    meta           texts and numbers to keep along
    """
    arrays = {name: np.asarray(value) for name, value in values.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in KINDS or "/" in name:
            raise ValueError(f"state {name}: {array.dtype} is not a number type, or the name holds a slash")
    meta = {key: _plain(value) for key, value in (meta or {}).items()}
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        guard = GuardedFile(part_of(path))
    except OSError as problem:
        raise explain(path, problem) from None
    try:
        with guard:
            with h5py.File(guard, "w") as file:
                file.attrs["schema"] = STATE_SCHEMA
                file.attrs["source_format"] = source_format
                file.attrs["meta"] = json.dumps(meta)
                file.attrs["versions"] = json.dumps(versions())
                file.attrs["content_sha256"] = _state_digest(arrays, source_format, meta)
                group = file.create_group("state")
                for name, array in arrays.items():
                    group.create_dataset(name, data=array.astype(array.dtype.newbyteorder("<")))
                    group[name].attrs["scalar"] = int(not isinstance(values[name], np.ndarray))
        if guard.problem is not None:
            raise explain(path, guard.problem)
        seal(part_of(path))
        publish(path)
    except OSError as problem:
        raise explain(path, problem) from None
    finally:
        discard(path)


def load_state(path, source_format):
    """(values, meta) of a state file; RecordError if it is damaged or of another layout."""
    with _open(path) as file:
        try:
            if file.attrs.get("schema") != STATE_SCHEMA:
                found = file.attrs.get("schema", "nothing")
                raise RecordError(path, [f"R01 / expected schema {STATE_SCHEMA}, found {found}"])
            saved = _plain(file.attrs["source_format"])
            if saved != source_format:
                finding = f"R11 / expected state layout {source_format}, found {saved}: saved by another version"
                raise RecordError(path, [finding])
            meta = json.loads(file.attrs["meta"])
            arrays = {name: dataset[()] for name, dataset in file["state"].items()}
            scalars = {name for name, dataset in file["state"].items() if dataset.attrs["scalar"]}
            digest = _state_digest({k: np.asarray(v) for k, v in arrays.items()}, saved, meta)
            if digest != _plain(file.attrs["content_sha256"]):
                raise RecordError(path, ["R15 /state expected another content_sha256: the file is damaged"])
        except DAMAGED as problem:
            text = " ".join(str(problem).split())
            raise RecordError(path, [f"R01 / expected a complete state, found damage: {text}"]) from None
    return {name: array.item() if name in scalars else array for name, array in arrays.items()}, meta


def _state_digest(arrays, source_format, meta):
    columns = {k: [a.dtype.kind, a.dtype.itemsize, list(a.shape), _digest(a)] for k, a in arrays.items()}
    text = json.dumps([STATE_SCHEMA, source_format, meta, columns], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()

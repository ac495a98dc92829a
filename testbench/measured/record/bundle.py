"""A measurement record as a folder: record.json, one Parquet file per rate, one CSV file per table.

    record.json            head, what each column is, SHA-256 of every file and column, content hash as in HDF5
    streams_NUM_DEN.parquet   columns of one rate
    TABLE.csv              slow logs; the slash of stimulus/rate is a dot in the file's name

The same `Record` as HDF5 gives, with the same content hash. A file is parsed only if its bytes have
the hash that record.json states, so that no library meets damage; names that leave the folder are refused, and
what unpacks to more than `inputs.expansion` allows.
Source    docs/measured.md
"""

import csv
import hashlib
import io
import json
import re
import uuid
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from testbench.errors import FileError
from testbench.measured.formats.parquet_input import libraries, read_parquet
from testbench.measured.record.schema import SCHEMA
from testbench.storage import inputs
from testbench.storage import record as records
from testbench.storage.files import replacing_folder
from testbench.storage.record import Column, Record, RecordError, TableColumn
from testbench.storage.record_read import DAMAGED, Value

HEAD = "record.json"
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
DTYPES = ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")
MOST_BYTES = 1 << 24  # of record.json


def _sha256(data):
    return hashlib.sha256(data).hexdigest()


def write(path, record):
    """Write a record as a folder, whole or not at all; an older folder of that name is replaced. Its content hash."""
    with replacing_folder(path, HEAD) as new:
        head = _head(record, _streams(new, record), _tables(new, record))
        (new / HEAD).write_bytes(json.dumps(head, indent=1, sort_keys=True).encode())
    return head["content_sha256"]


def _streams(folder, record):
    """Write the Parquet files; {file: {sha256, columns}}."""
    arrow, parquet = libraries()
    rates = {}
    for name, column in record.streams.items():
        rates.setdefault((column.num, column.den, len(column.data)), []).append(name)
    out = {}
    for (num, den, rows), names in rates.items():
        sink = io.BytesIO()
        table = arrow.table({name: _native(record.streams[name].data) for name in names})
        parquet.write_table(table, sink, compression="zstd")
        file = f"streams_{num}_{den}.parquet"
        file = file if file not in out else f"streams_{num}_{den}_{rows}.parquet"
        (folder / file).write_bytes(sink.getvalue())
        out[file] = {"sha256": _sha256(sink.getvalue()), "columns": names}
    return out


def _native(data):
    """The same in one piece and in this machine's byte order: Arrow takes no other."""
    return np.ascontiguousarray(data, data.dtype.newbyteorder("="))


def _tables(folder, record):
    """Write the CSV files; {table: {file, sha256, columns: [{name, unit, dtype}]}}."""
    out = {}
    for name, table in record.tables.items():
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(table)
        # repr of a double gives the same double back
        rows.writerows(
            zip(*([repr(v) if isinstance(v, float) else v for v in c.data.tolist()] for c in table.values()))
        )
        data, file = text.getvalue().encode(), f"{name.replace('/', '.')}.csv"
        (folder / file).write_bytes(data)
        columns = [
            {
                "name": key,
                "unit": column.unit,
                "dtype": "U" if column.data.dtype.kind == "U" else column.data.dtype.str[1:],
            }
            for key, column in table.items()
        ]
        out[name] = {"file": file, "sha256": _sha256(data), "columns": columns}
    return out


def _head(record, files, tables):
    described = {
        name: records.described(column, records.digest_of(column.data), len(column.data))
        for name, column in record.streams.items()
    }
    content = records.content_digest(
        described,
        records.described_tables(record.tables),
        record.config_toml,
        record.provenance,
        record.clock_ppm,
        record.attrs,
        record.clock_hz,
    )
    return {
        "schema": SCHEMA,
        "record_id": str(uuid.uuid4()),
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "provenance": record.provenance,
        "config_toml": record.config_toml,
        "versions": records.versions(),
        "attributes": record.attrs,
        "clock": {"f_xtal_nominal_Hz": float(record.clock_hz), "ppm": record.clock_ppm},
        "content_sha256": content,
        "files": files,
        "streams": described,
        "tables": tables,
    }


# ---- reading ---------------------------------------------------------------------------------------------------------


class _Files(BaseModel):
    sha256: str
    columns: list[str]


class _Table(BaseModel):
    file: str
    sha256: str
    columns: list[dict[str, str]]


class _Clock(BaseModel):
    f_xtal_nominal_Hz: float
    ppm: float


class _Head(BaseModel):
    """record.json; what a stream states besides its keys is an attribute of it."""

    provenance: str
    config_toml: str
    attributes: dict[str, Value]
    clock: _Clock
    content_sha256: str
    files: dict[str, _Files]
    streams: dict[str, dict[str, Value]]
    tables: dict[str, _Table]
    versions: dict[str, str] = {}


def read(path):
    """`Record` of a folder; RecordError with one finding per thing that is wrong."""
    path, findings = Path(path), []
    try:
        record = _read(path, findings)
    except (FileError, RecursionError, csv.Error, *DAMAGED) as problem:
        if isinstance(problem, RecordError):
            raise
        text = f"R01 / expected a complete record, found damage: {' '.join(str(problem).split())}"
        raise RecordError(path, [*findings, text]) from None
    if findings:
        raise RecordError(path, findings)
    return record


def _head_of(path):
    """`_Head` of a folder."""
    try:
        data = inputs.read_json(path / HEAD, limit=MOST_BYTES)
    except FileError as problem:
        raise RecordError(path, [f"R01 / expected JSON in {HEAD}, found {problem}"]) from None
    if data.get("schema") != SCHEMA:
        raise RecordError(path, [f"R01 / expected schema {SCHEMA}, found {str(data.get('schema', 'nothing'))[:40]}"])
    missing = [key for key, field in _Head.model_fields.items() if field.is_required() and key not in data]
    if missing:
        raise RecordError(path, [f"R02 / expected {key}, found nothing" for key in missing])
    return inputs.checked(data, _Head, path / HEAD)


def _read(path, findings):
    head = _head_of(path)
    record = Record(
        config_toml=head.config_toml,
        provenance=head.provenance,
        clock_ppm=head.clock.ppm,
        attrs=head.attributes,
        versions=head.versions,
        content_sha256=head.content_sha256,
        clock_hz=records.clock_of(head.clock.f_xtal_nominal_Hz, findings),
    )
    _read_streams(path, head, record, findings)
    _read_tables(path, head, record, findings)
    if not findings:
        have = _head(record, {}, {})["content_sha256"]
        if have != record.content_sha256:
            findings.append(f"R15 / expected content_sha256 {record.content_sha256}, found {have}")
    return record


def _bytes(path, file, digest, limit, findings):
    """Bytes of a file of the bundle, or None with a finding."""
    if not NAME.fullmatch(file):
        findings.append(f"R01 /{file} expected the name of a file in the folder, found another")
        return None
    try:
        data = inputs.read_bytes(path / file, limit)
    except FileError as problem:
        findings.append(f"R02 /{file} expected a file, found none: {problem}")
        return None
    if _sha256(data) != digest:
        findings.append(f"R15 /{file} expected sha256 {digest}, found {_sha256(data)}")
        return None
    return data


def _read_streams(path, head, record, findings):
    for file, item in head.files.items():
        data = _bytes(path, file, item.sha256, None, findings)
        if data is None:
            continue
        found = read_parquet(data, path / file, item.columns)
        for name in item.columns:
            if name not in found or name not in head.streams:
                findings.append(f"R02 /streams/{name} expected a column of numbers, found nothing")
            elif found[name].dtype.kind not in records.KINDS:
                findings.append(f"R04 /streams/{name} expected a column of numbers, found {found[name].dtype}")
            else:
                _stream(name, found[name], dict(head.streams[name]), record, findings)
    for name in sorted(set(head.streams) - set(record.streams)):
        if not findings:
            findings.append(f"R02 /streams/{name} expected a column, found nothing")


def _stream(name, array, stated, record, findings):
    unit, num, den, edge0 = (stated.pop(key, None) for key in records.STREAM_KEYS)
    rows, _, digest = (stated.pop(key, None) for key in ("rows", "dtype", "sha256"))
    if not records.known_unit(unit):
        findings.append(f"R03 /streams/{name} expected a unit, found {unit!r}")
    elif not all(isinstance(v, int) for v in (num, den, edge0)) or num < 1 or den < 1:
        findings.append(f"R08 /streams/{name} expected fs_num, fs_den, edge0: a ratio of the clock, found {num}/{den}")
    elif rows != len(array):
        findings.append(f"R05 /streams/{name} expected {rows} rows, found {len(array)}")
    elif digest != records.digest_of(array):
        findings.append(f"R15 /streams/{name} expected sha256 {digest}, found {records.digest_of(array)}")
    else:
        attrs = {key: records.plain(value) for key, value in stated.items()}
        record.streams[name] = Column(array, unit, num, den, edge0, attrs, record.clock_hz)


def _read_tables(path, head, record, findings):
    for name, item in head.tables.items():
        data = _bytes(path, item.file, item.sha256, inputs.MOST_TABLE_BYTES, findings)
        if data is None:
            continue
        rows = list(csv.reader(io.StringIO(data.decode())))
        columns = item.columns
        if (
            not rows
            or rows[0] != [stated["name"] for stated in columns]
            or any(len(row) != len(columns) for row in rows)
        ):
            findings.append(f"R02 /{name} expected the columns of {HEAD}, found others")
            continue
        table = record.tables.setdefault(name, {})
        for k, stated in enumerate(columns):
            texts = [row[k] for row in rows[1:]]
            key, unit, dtype = stated["name"], stated["unit"], stated["dtype"]
            if unit != "" and not records.known_unit(unit):
                findings.append(f"R03 /{name}/{key} expected a unit, found {unit!r}")
            elif dtype == "U":
                table[key] = TableColumn(np.array(texts, str), unit)
            elif dtype in DTYPES:
                kind = float if dtype[0] == "f" else int
                table[key] = TableColumn(np.array([kind(text) for text in texts], np.dtype(dtype)), unit)
            else:
                findings.append(f"R20 /{name}/{key} expected one of {', '.join(DTYPES)} or U, found {dtype}")

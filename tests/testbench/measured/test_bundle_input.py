"""Bundles of others: what a small file unpacks to is known before, and a head of another form is one line."""

import hashlib
import io
import json
import resource

import numpy as np
import pyarrow.parquet
import pytest

from testbench.errors import FileError
from testbench.measured.record import bundle
from testbench.storage.record import RecordError


def resealed(folder, name, data):
    """Put other bytes under a name of a bundle, with their hash."""
    (folder / name).write_bytes(data)
    head = json.loads((folder / "record.json").read_text())
    owners = [*head["files"].items(), *((table["file"], table) for table in head["tables"].values())]
    next(item for file, item in owners if file == name)["sha256"] = hashlib.sha256(data).hexdigest()
    (folder / "record.json").write_text(json.dumps(head))


def parquet_bytes(columns):
    sink = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(columns), sink, compression="zstd")
    return sink.getvalue()


def test_a_small_parquet_file_of_gigabytes_is_refused_before_it_is_unpacked(small, tmp_path):
    bundle.write(tmp_path / "a", small)
    rows = 1 << 24
    data = parquet_bytes({name: np.zeros(rows, np.int64) for name in ("adc_xI", "adc_xQ", "adc_yI")})
    assert 1000 * len(data) < 3 * 8 * rows
    resealed(tmp_path / "a", "streams_1_3250.parquet", data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RecordError, match="402653184 bytes unpacked are more than the limit"):
        bundle.read(tmp_path / "a")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_columns_that_are_no_plain_numbers_are_refused(small, tmp_path):
    bundle.write(tmp_path / "a", small)
    for values in (["x"] * 3, [[1.0]] * 3, [{"a": 1}] * 3, [b"x"] * 3):
        resealed(tmp_path / "a", "streams_1_3250.parquet", parquet_bytes({"adc_xI": values}))
        with pytest.raises(RecordError, match="R02 /streams/adc_xI expected a column of numbers"):
            bundle.read(tmp_path / "a")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda head: head.update(attributes=[]), "attributes: Input should be a valid dictionary"),
        (lambda head: head["attributes"].update(lab=[10]), "attributes.lab"),
        (lambda head: head.update(streams={"adc_xI": 3}), "streams.adc_xI"),
        (lambda head: head["clock"].update(ppm="x"), "clock.ppm"),
        (lambda head: head.update(tables={"a": {}}), "tables.a.file"),
    ],
)
def test_a_head_of_another_form_is_one_line(small, tmp_path, change, said):
    bundle.write(tmp_path / "a", small)
    head = json.loads((tmp_path / "a" / "record.json").read_text())
    change(head)
    (tmp_path / "a" / "record.json").write_text(json.dumps(head))
    with pytest.raises(FileError, match=said) as caught:
        bundle.read(tmp_path / "a")
    assert len(str(caught.value).splitlines()) == 1

"""A record that another program has written from docs/record.md is accepted, and the page's hashes are ours."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from testbench.measured.importing import firmware_words
from testbench.measured.record import load_record, schema
from testbench.storage import record as records
from testbench.storage.files import SEAL, seal, seal_holds
from testbench.storage.record import RecordError
from tests.testbench.measured.importing import independent_writer as other

PAGE = (Path(__file__).resolve().parents[4] / "docs" / "record.md").read_text()
CONTENT = next(line.strip() for line in PAGE.splitlines() if line.startswith('    ["gyrorec/1.0"'))


def vector(begin):
    """SHA-256 of a row of the page's test vectors."""
    (found,) = re.findall(rf"^\| {re.escape(begin)}.* \| `([0-9a-f]{{64}})` \|$", PAGE, re.M)
    return found


@pytest.mark.parametrize(
    "digest", [records.column_digest, lambda a: other.column_hash(a.tolist() if a.dtype.kind == "U" else a)]
)
def test_the_hashes_of_columns_are_those_of_the_page(digest):
    assert digest(np.array([1, -2, 3], np.int32)) == vector("int32 1, -2, 3")
    assert digest(np.array([0.1, -0.0])) == vector("double 0.1, -0.0")
    assert digest(np.array(["fit", "", "Ω"])) == vector("texts")


def test_the_hashes_of_content_and_roles_are_those_of_the_page():
    name, streams, tables, toml, provenance, ppm, head = json.loads(CONTENT)
    assert name == records.SCHEMA
    for digest in (records.content_digest, other.content_hash):
        assert digest(streams, tables, toml, provenance, ppm, head) == vector("content")
    row = ("a.0", 0, 32500, "a", "fit")
    assert other.roles_hash([row]) == schema.json_sha256([list(row)]) == vector("roles")


def test_the_other_writers_numbers_are_the_pages():
    rng = np.random.default_rng(1)
    bits = rng.integers(0, 1 << 64, 2000, np.uint64).view(float)
    some = [0.0, -0.0, 1e16, 1.5e16, 1e15, 0.0001, 0.00012, 1e-5, 5e-07, 123456.789, *bits[np.isfinite(bits)]]
    for x in some:
        assert other.json_text(x) == json.dumps(float(x))
    assert other.json_text('Ω"\\\n\x07😀') == json.dumps('Ω"\\\n\x07😀')


def test_the_seal_is_that_of_the_page(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    seal(tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == b"abc" + SEAL % vector("seal").encode()
    assert len(SEAL % vector("seal").encode()) == 82
    assert r"the 82 bytes `\nftr-gyro sha256 HASH\n`" in PAGE
    assert seal_holds(tmp_path / "a")


def test_the_page_lists_map_tables_and_columns():
    assert f"\n    {schema.regmap_sha256()}\n" in PAGE
    assert f"`{schema.regmap_sha256(1)}`" in PAGE
    for name, columns in schema.TABLES.items():
        listed = ", ".join(f"`{key}` {unit}".strip() for key, unit in columns.items())
        assert f"| `{name}` | {listed} |" in PAGE
    for key in schema.ROOT_KEYS:
        assert f"`{key}`" in PAGE


def contents(small):
    """What the writer is given: codes, words of the log and conditions of a small record; nothing derived."""
    streams = {
        name: (
            "code",
            425,
            {"bits": 24, "twos_comp": 1, "tap": "adc"} | {k: float(c.attrs[k]) for k in ("lsb_V", "lsb_V_unc")},
            c.data,
        )
        for name, c in ((name, small.streams[name]) for name in schema.ADC)
    }
    tables = {
        name: {key: (c.unit, c.data.tolist() if c.unit == "" else c.data) for key, c in table.items()}
        for name, table in small.tables.items()
        if name in schema.TABLES
    }
    head = {key: small.attrs[key] for key in schema.ROOT_KEYS if key != "roles_sha256"}
    return head, small.config_toml, streams, tables


def test_a_record_of_another_writer_is_accepted_and_its_words_follow(small, tmp_path):
    other.write(tmp_path / "theirs.h5", *contents(small))
    loaded = load_record.load(tmp_path / "theirs.h5")
    assert loaded.findings == []
    found, why = firmware_words.complete_record(loaded.record)
    assert why == ""
    assert np.array_equal(found.streams["amplitude_word"].data, small.streams["amplitude_word"].data)


def test_one_wrong_byte_of_another_writer_is_refused(small, tmp_path):
    head, toml, streams, tables = contents(small)
    other.write(tmp_path / "theirs.h5", head, toml, streams, tables)
    import h5py

    with h5py.File(tmp_path / "theirs.h5", "a") as file:
        file["streams/adc_yQ"][17] += 1
    with pytest.raises(RecordError, match="R15 /streams/adc_yQ"):
        load_record.load(tmp_path / "theirs.h5")

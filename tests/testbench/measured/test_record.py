"""Records: every rule refuses what it is for, damage never loads and never crashes."""

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from fpga_model.rates import FRAME_CYCLES
from testbench.errors import FileError
from testbench.measured.record import checks, firmware_residual, load_record, record_tables, schema
from testbench.storage import record as records
from testbench.storage.record import Column, RecordError, TableColumn, write_record

OF_VERSION_1 = "44d4403050ffa92ad81704f9c1a722fcec11d7ab4db9a35e899e6930f0fc851f"  # regmap_sha256 of older records


def same(a, b):
    assert list(a.streams) == list(b.streams) or set(a.streams) == set(b.streams)
    for name, column in a.streams.items():
        other = b.streams[name]
        assert column[1:5] == other[1:5]
        assert dict(column.attrs) == dict(other.attrs)
        assert np.array_equal(column.data, other.data)
        assert column.data.dtype == other.data.dtype
    assert set(a.tables) == set(b.tables)
    for name, table in a.tables.items():
        for key, column in table.items():
            assert column.unit == b.tables[name][key].unit
            assert column.data.tolist() == b.tables[name][key].data.tolist(), (name, key)
    assert (a.attrs, a.provenance, a.config_toml) == (b.attrs, b.provenance, b.config_toml)


def test_what_goes_in_comes_out(small, tmp_path):
    digest = write_record(tmp_path / "a.h5", small)
    loaded = load_record.load(tmp_path / "a.h5", replay=False)
    same(small, loaded.record)
    assert loaded.findings == []
    assert loaded.record.content_sha256 == digest


def test_a_clean_record_has_no_findings(small):
    assert checks.check(small) == []


def test_a_record_of_the_board_holds_nothing_of_its_truth(small):
    assert not any("truth" in name for name in (*small.streams, *small.tables, *small.attrs))


# ---- rules -----------------------------------------------------------------------------------------------------------


def column(record, table, key, row, value):
    """A table with one value changed."""
    old = record.tables[table][key]
    data = old.data.astype(object) if old.data.dtype.kind == "U" else old.data.copy()
    data[row] = value
    record.tables[table][key] = TableColumn(data.astype(str) if old.data.dtype.kind == "U" else data, old.unit)


def roles(record):
    record.attrs["roles_sha256"] = schema.roles_sha256(record.tables["segments"])


def stream(record, name, **changes):
    record.streams[name] = record.streams[name]._replace(**changes)


def codes(record, name, rows, value):
    data = record.streams[name].data.copy()
    data[rows] = value
    stream(record, name, data=data)


def dropped(record, row):
    """One row is missing in every stream, and nobody says so."""
    for name, c in record.streams.items():
        data = np.concatenate([np.delete(c.data, row), c.data[-1:]])
        stream(record, name, data=data)


def fit_rows(record):
    table = record.tables["segments"]
    k = table["role"].data.tolist().index("fit")
    return slice(*(int(table[key].data[k]) // FRAME_CYCLES for key in ("edge_a", "edge_b")))


def swapped_edges(record):
    edges = record.tables["stimulus/rate"]["edge"].data[::-1].copy()
    record.tables["stimulus/rate"]["edge"] = TableColumn(edges, "edge")


def edge_before(record):
    edges = record.tables["stimulus/rate"]["edge"].data.copy()
    edges[1] = edges[0] - 1
    record.tables["stimulus/rate"]["edge"] = TableColumn(edges, "edge")


def same_group(record):
    table = record.tables["segments"]
    k = table["role"].data.tolist().index("validate")
    column(record, "segments", "repeat_group", k, "a")
    roles(record)


def alone(record):
    groups = np.array([f"g{k}" for k in range(len(record.tables["segments"]["id"].data))])
    record.tables["segments"]["repeat_group"] = TableColumn(groups, "")
    roles(record)


def overlap(record):
    column(record, "segments", "edge_a", 1, 0)
    roles(record)


def dangling(record):
    column(record, "segments", "edge_b", -1, 10**12)
    roles(record)


def second_column(record, table, key):
    """A counter in seconds of its own clock."""
    old = record.tables[table][key]
    record.tables[table][key] = TableColumn(old.data / 26e6, "s")


def nan_rate(record):
    column(record, "stimulus/rate", "rate", 0, np.nan)


COUNTER = "counter/Vxm_vs_sgnsin"
SPOILT = {
    "R02 stream": (lambda r: r.streams.pop("adc_xQ"), "R02 /streams/adc_xQ expected a stream"),
    "R02 table": (lambda r: r.tables.pop("segments"), "R02 /segments expected a table"),
    "R02 column": (lambda r: r.tables["segments"].pop("role"), "R02 /segments/role expected a column"),
    "R02 attribute": (lambda r: r.attrs.pop("lab"), "R02 / expected lab"),
    "R02 other name": (
        lambda r: r.streams.__setitem__("adc_zI", r.streams["adc_xI"]),
        "R02 /streams/adc_zI expected a stream of the schema",
    ),
    "R03": (lambda r: stream(r, "adc_xI", unit="V"), "R03 /streams/adc_xI expected unit code, found V"),
    "R03 table": (
        lambda r: r.tables["stimulus/rate"].__setitem__("rate", TableColumn(np.zeros(4), "rad/s")),
        "R03 /stimulus/rate/rate expected unit deg/s, found rad/s",
    ),
    "R04 range": (lambda r: codes(r, "adc_yI", 7, 1 << 23), "R04 /streams/adc_yI expected codes within -8388608"),
    "R04 bits": (
        lambda r: stream(r, "dac_ftr", attrs={**r.streams["dac_ftr"].attrs, "bits": 16}),
        "R04 /streams/dac_ftr expected bits = 20",
    ),
    "R05": (lambda r: stream(r, "adc_xQ", data=r.streams["adc_xQ"].data[:-1]), "R05 /streams/adc_xQ expected"),
    "R06 by one": (edge_before, "R06 /stimulus/rate/edge expected rising edges"),
    "R06": (swapped_edges, "R06 /stimulus/rate/edge expected rising edges"),
    "R07": (lambda r: dropped(r, 5000), "R07 /streams/nco_pword expected phase steps equal to the frequency word"),
    "R08": (lambda r: stream(r, "adc_xI", den=3251), "R08 /streams/adc_xI expected rate 1/3250"),
    "R08 clock": (
        lambda r: setattr(r, "clock_hz", 24_000_000),
        "R08 /clock expected f_xtal_nominal_Hz 26000000, found 24000000",
    ),
    "R08 edge": (lambda r: stream(r, "adc_xQ", edge0=1), "R08 /streams/adc_xQ expected edge0"),
    "R09": (nan_rate, "R09 /stimulus/rate/rate expected finite numbers"),
    "R10 stuck": (lambda r: codes(r, "adc_yQ", fit_rows(r), 3), "R10 /streams/adc_yQ expected codes that change"),
    "R10 saturated": (
        lambda r: codes(r, "adc_yQ", slice(fit_rows(r).start, fit_rows(r).start + 9), (1 << 23) - 1),
        "R10 /streams/adc_yQ expected at most 0.1 % of the codes at the rails",
    ),
    "R11 bitstream": (lambda r: r.attrs.update(bitstream_sha256="0" * 64), "R11 / expected bitstream_sha256"),
    "R11 register": (lambda r: column(r, "registers", "addr", 0, 0x3F), "R11 /registers expected a writable"),
    "R11 configuration": (lambda r: setattr(r, "config_toml", "[firmware]\nagc = 1\n"), "R11 / expected a config"),
    "R12 overlap": (overlap, "R12 /segments"),
    "R12 dangling": (dangling, "R12 /segments/b.1 expected edges within"),
    "R13": (same_group, "R13 /segments/a expected one role"),
    "R15 roles": (lambda r: column(r, "segments", "role", 2, "validate"), "R15 /segments expected the roles"),
    "R17": (lambda r: r.attrs.update(nuisances="plant.fx_hz,plant.qx"), "R17 /priors/plant.qx expected a prior"),
    "R18": (lambda r: second_column(r, COUNTER, "edge"), f"R18 /{COUNTER}/edge expected unit edge, found s"),
    "R18 outside": (lambda r: column(r, COUNTER, "edge", -1, 10**13), f"R18 /{COUNTER}/edge expected edges within"),
    "R19 counter": (lambda r: column(r, COUNTER, "unc", 0, 0.0), f"R19 /{COUNTER}/unc expected uncertainties"),
    "R19 prior": (lambda r: column(r, "priors", "sd", 0, 0.0), "R19 /priors/plant.fx_hz expected sd above 0"),
    "R19 gain": (
        lambda r: stream(r, "adc_xI", attrs={**r.streams["adc_xI"].attrs, "lsb_V_unc": 0.0}),
        "R19 /streams/adc_xI expected lsb_V_unc above 0",
    ),
    "R20": (
        lambda r: stream(r, "adc_xI", data=r.streams["adc_xI"].data.astype(float)),
        "R20 /streams/adc_xI expected integer codes",
    ),
}


@pytest.mark.parametrize("case", SPOILT)
def test_every_rule_refuses_what_it_is_for(own, case):
    spoil, line = SPOILT[case]
    spoil(own)
    findings = [str(f) for f in checks.check(own) if f.level == schema.REFUSED]
    assert any(text.startswith(line) for text in findings), findings
    assert all("\n" not in text for text in findings)


def test_another_register_map_is_a_downgrade_and_r0_is_skipped_by_name(own, tmp_path):
    own.attrs["regmap_sha256"] = "0" * 64
    own.tables["registers"]["name"] = TableColumn(
        np.array([f"their_{k}" for k in range(len(own.tables["registers"]["name"].data))]), ""
    )
    write_record(tmp_path / "a.h5", own)
    loaded = load_record.load(tmp_path / "a.h5")
    (finding,) = loaded.findings
    assert (finding.rule, finding.level) == ("R11", schema.DOWNGRADED)
    assert "R0 and R2 are skipped" in finding.text
    assert loaded.residual.verdict.startswith("R0 not decidable: skipped, regmap_sha256 0000000000000000 is not")
    assert not loaded.is_blocked


def test_a_record_of_the_first_version_of_the_map_is_replayed(own, tmp_path):
    own.attrs["regmap_sha256"] = OF_VERSION_1
    write_record(tmp_path / "a.h5", own)
    loaded = load_record.load(tmp_path / "a.h5")
    assert not loaded.findings
    assert "R0 is 0 LSB" in loaded.residual.verdict


def test_a_missing_repeat_is_a_downgrade(own):
    alone(own)
    (finding,) = checks.check(own)
    assert (finding.rule, finding.level) == ("R14", schema.DOWNGRADED)
    assert "ranked, not confirmed" in finding.text


def void(record, row):
    """The recorder lost a row."""
    for name, c in record.streams.items():
        codes(record, name, slice(row, row + 1), 0)
        assert c.data is not record.streams[name].data


def declared(record, row):
    """And says so."""
    values = {"edge_a": row * FRAME_CYCLES, "edge_b": (row + 1) * FRAME_CYCLES, "streams": "all", "reason": "overrun"}
    gaps = record.tables["gaps"]
    for key, value in values.items():
        old = gaps[key].data.tolist()
        gaps[key] = TableColumn(np.array([*old[:1], value, *old[1:]]), gaps[key].unit)


def test_a_declared_gap_is_none_of_rule_7(own):
    void(own, 5000)
    assert [f.rule for f in checks.check(own)] == ["R07"]
    declared(own, 5000)
    assert checks.check(own) == []


def test_codes_that_nobody_recorded_leave_the_firmware_undecided(own):
    void(own, 5000)
    declared(own, 5000)
    residual = firmware_residual.residual(own)
    assert not residual.decidable
    assert residual.verdict == "R0 not decidable: codes of frame 5000 are lost in a gap"


# ---- damage ----------------------------------------------------------------------------------------------------------


def cut(record, rows=120):
    """A small record of the same shape: the first frames alone."""
    for name, c in list(record.streams.items()):
        stream(record, name, data=c.data[:rows])
    edge = rows * FRAME_CYCLES
    for table in record.tables.values():
        key = "edge_b" if "edge_b" in table else "edge"
        if key in table:
            keep = table[key].data < edge if key == "edge" else table[key].data <= edge
            for name, c in table.items():
                table[name] = TableColumn(c.data[keep], c.unit)
    roles(record)
    return record


def loaded_or_refused(path, want):
    """1 if refused with clean lines; 0 if it loads and is what was written."""
    try:
        have, lines = load_record.load(path, replay=False).record, ()
    except RecordError as problem:
        have, lines = None, problem.findings
    except FileError as problem:
        have, lines = None, (str(problem),)
    if have is not None:
        same(want, have)
        return 0
    assert lines
    assert all("\n" not in line for line in lines)
    return 1


def damaged(rng, k, clean):
    data = bytearray(clean)
    if k % 4 == 0:
        return data[: rng.integers(len(data))]
    for place in rng.integers(0, len(data), 1 + 40 * (k % 2)):
        data[place] ^= int(rng.integers(1, 256))
    return data


@pytest.mark.parametrize("count", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_damaged_files_give_refusals(own, tmp_path, count):
    small = cut(own)
    rng = np.random.default_rng(11)
    h5 = tmp_path / "a.h5"
    write_record(h5, small)
    clean = h5.read_bytes()
    refused = 0
    for k in range(count):
        h5.write_bytes(damaged(rng, k, clean))
        refused += loaded_or_refused(h5, small)
    h5.write_bytes(clean)
    assert loaded_or_refused(h5, small) == 0, "and undamaged it loads"
    assert refused >= 0.98 * count  # a byte may mark the seal


def test_nothing_here_can_execute_what_it_reads():
    for module in (record_tables, load_record, checks):
        source = Path(module.__file__).read_text()
        assert not any(word in source for word in ("import pickle", "allow_pickle", "eval(", "exec("))


def test_tables_hold_every_number_of_the_record(own, tmp_path):
    values = np.resize(np.array([0.1, 1 / 3, 5e-324, -0.0]), len(own.tables["stimulus/rate"]["rate"].data))
    own.tables["stimulus/rate"]["rate"] = TableColumn(values, "deg/s")
    record_tables.write(tmp_path / "a", own)
    columns = {}
    for path in (tmp_path / "a").glob("streams_*.parquet"):
        columns |= pyarrow.parquet.read_table(path).to_pydict()
    assert columns == {name: column.data.tolist() for name, column in own.streams.items()}
    with open(tmp_path / "a" / "stimulus.rate.csv", newline="") as file:
        have = np.array([float(row["rate"]) for row in csv.DictReader(file)])
    assert have.tobytes() == values.tobytes()
    for name, table in own.tables.items():
        head = (tmp_path / "a" / f"{name.replace('/', '.')}.csv").read_text().splitlines()[0]
        assert head == ",".join(table)


def test_a_folder_with_files_is_not_replaced(small, tmp_path):
    (tmp_path / "thesis.txt").write_text("years")
    with pytest.raises(FileError, match="is not empty"):
        record_tables.write(tmp_path, small)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_an_empty_stream_is_refused(own):
    for name in list(own.streams):
        stream(own, name, data=own.streams[name].data[:0])
    assert any(f.rule in ("R05", "R12") for f in checks.check(own))


def test_the_column_type_of_records_is_the_one_of_runs(small):
    assert isinstance(small.streams["adc_xI"], Column)
    assert isinstance(small, records.Record)

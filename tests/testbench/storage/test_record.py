"""Records: what goes in comes out and xarray reads it; whatever is damaged is refused; nothing half-written stays."""

import errno
import hashlib
import os
import stat
import subprocess
import sys
import textwrap
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from testbench.errors import FileError
from testbench.storage import files, record, record_read, state_file
from testbench.storage.record import Column, Record, RecordError, RecordWriter, TableColumn

ROOT = Path(__file__).resolve().parents[3]


def sample(rows=3000, seed=1):
    rng = np.random.default_rng(seed)
    streams = {
        "adc_yI": Column(rng.integers(-(1 << 23), 1 << 23, rows).astype(np.int32), "code", 1, 3250, 26, {"bits": 24}),
        "adc_yQ": Column(rng.integers(-(1 << 23), 1 << 23, rows).astype(np.int32), "code", 1, 3250, 26, {"tap": "adc"}),
        "dac_drv": Column(rng.integers(-335, 335, 4 * rows).astype(np.int16), "code", 1, 26),
        "nco_fword": Column(rng.integers(0, 1 << 48, rows), "word", 1, 3250),
        "x_amplitude": Column(rng.normal(5, 1e-4, rows), "um", 1, 3250),
    }
    tables = {
        "registers": {
            "name": TableColumn(np.array(["control", "phase °"]), ""),
            "raw": TableColumn(np.array([1, 1 << 47]), "word"),
        },
        "stimulus/rate": {
            "t_s": TableColumn(np.array([0.0, 1.0]), "s"),
            "rate": TableColumn(np.array([0.0, 100.0]), "deg/s"),
        },
    }
    return Record(streams, tables, config_toml="[noise]\nseed = 1\n", attrs={"lab": "bench 2"}, clock_ppm=1.5)


@pytest.fixture
def path(tmp_path):
    record.write_record(tmp_path / "run.h5", sample())
    return tmp_path / "run.h5"


def same(a, b):
    return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def test_what_goes_in_comes_out(path):
    want, have = sample(), record_read.read_record(path)
    assert set(have.streams) == set(want.streams)
    for name, column in want.streams.items():
        got = have.streams[name]
        assert same(got.data, column.data)
        assert got[1:] == (*column[1:5], dict(column.attrs), record.CLOCK_HZ)
    for name, columns in want.tables.items():
        for key, column in columns.items():
            got = have.tables[name][key]
            assert got.unit == column.unit
            assert got.data.tolist() == column.data.tolist()
    assert (have.config_toml, have.attrs, have.clock_ppm) == (want.config_toml, want.attrs, want.clock_ppm)
    assert have.versions["numpy"] == np.__version__
    assert os.listdir(path.parent) == ["run.h5"]


def test_xarray_reads_every_group_with_units_and_seconds(path):
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        streams = tree["streams"].dataset
        want = sample().streams
        for name, column in want.items():
            assert streams[name].attrs["units"] == column.unit
            assert np.array_equal(streams[name].values, column.data)
            time_s = streams[name][streams[name].dims[0]]
            assert time_s.attrs["units"] == "s"
            assert np.allclose(time_s.values, column.time_s, rtol=1e-15, atol=0)
        assert streams.adc_yI.dims == ("time_8k_from_26",)
        assert streams.dac_drv.dims == ("time_1M",)
        assert tree["registers"]["name"].values.tolist() == ["control", "phase °"]
        assert tree["stimulus/rate"]["rate"].attrs["units"] == "deg/s"
        assert tree.attrs["config_toml"] == sample().config_toml


def test_a_record_of_another_clock_has_its_seconds(tmp_path):
    """Rows of 8 kHz from 24 MHz: the same numbers at 3000 clocks a row, and in seconds."""
    rows = np.arange(40, dtype=np.int32)
    record.write_record(tmp_path / "a.h5", Record({"a": Column(rows, "code", 1, 3000)}, clock_hz=24_000_000))
    have = record_read.read_record(tmp_path / "a.h5")
    column = have.streams["a"]
    assert (have.clock_hz, column.clock_hz, column.rate_hz) == (24_000_000, 24_000_000, 8000.0)
    assert column.time_s == pytest.approx(rows / 8000, rel=1e-15)
    with xr.open_dataset(tmp_path / "a.h5", group="streams", engine="h5netcdf") as streams:
        assert streams["a"].dims == ("time_8k",)
        assert np.allclose(streams["time_8k"].values, rows / 8000, rtol=1e-15, atol=0)


@settings(max_examples=30)
@given(st.lists(st.integers(0, 2000), min_size=1, max_size=6))
def test_how_it_is_cut_into_blocks_does_not_matter(tmp_path_factory, cuts):
    folder = tmp_path_factory.mktemp("blocks")
    values = np.arange(sum(cuts), dtype=np.int32) * 7919 % 100003
    with RecordWriter(folder / "a.h5") as writer:
        writer.stream("a", "code", np.int32, den=26)
        first = 0
        for cut in cuts:
            writer.append(a=values[first : first + cut])
            first += cut
    whole = Record({"a": Column(values, "code", 1, 26)})
    assert record.write_record(folder / "b.h5", whole) == writer.content_sha256
    assert record_read.read_record(folder / "a.h5").content_sha256 == writer.content_sha256


def test_the_content_hash_is_of_the_content_alone(tmp_path):
    first = record.write_record(tmp_path / "a.h5", sample())
    assert record.write_record(tmp_path / "b.h5", sample()) == first
    ids = [h5py.File(tmp_path / name, "r").attrs["record_id"] for name in ("a.h5", "b.h5")]
    assert ids[0] != ids[1]
    changes = [
        lambda r: r.streams["adc_yI"].data.__setitem__(5, 0),
        lambda r: r.streams.update(adc_yI=r.streams["adc_yI"]._replace(unit="V")),
        lambda r: r.streams.update(nco_fword=r.streams["nco_fword"]._replace(edge0=52)),
        lambda r: r.streams.update(dac_drv=r.streams["dac_drv"]._replace(den=13)),
        lambda r: r.streams.update(dac_drv=r.streams["dac_drv"]._replace(attrs={"bits": 16})),
        lambda r: r.tables["registers"]["raw"].data.__setitem__(0, 0),
        lambda r: setattr(r, "config_toml", ""),
        lambda r: setattr(r, "clock_ppm", 0.0),
        lambda r: setattr(r, "clock_hz", 24_000_000),
        lambda r: setattr(r, "provenance", "measured"),
        lambda r: r.attrs.update(lab="bench 3"),
    ]
    hashes = {first}
    for change in changes:
        changed = sample()
        change(changed)
        hashes.add(record.write_record(tmp_path / "c.h5", changed))
    assert len(hashes) == 1 + len(changes)


def test_a_column_hash_is_sha256_of_little_endian_bytes(path):
    with h5py.File(path, "r") as file:
        listed = dict(zip(file["integrity/path"].asstr()[:], file["integrity/sha256"].asstr()[:]))
    plain = sample().streams["dac_drv"].data.astype("<i2").tobytes()
    assert listed["/streams/dac_drv"] == hashlib.sha256(plain).hexdigest()


def test_texts_cannot_move_between_rows_unseen(tmp_path):
    hashes = set()
    for texts in (["ab", "c"], ["a", "bc"], ["", "abc"]):
        tables = {"t": {"a": TableColumn(np.array(texts), "")}}
        hashes.add(record.write_record(tmp_path / "a.h5", Record(tables=tables)))
    assert len(hashes) == 3


@pytest.mark.parametrize("unit", ["V", "10 V/2^23", "turn/2^48", "5.5 V/2^16"])
def test_shares_of_a_unit_are_units(tmp_path, unit):
    record.write_record(tmp_path / "a.h5", Record({"a": Column(np.zeros(3), unit)}))
    assert record_read.read_record(tmp_path / "a.h5").streams["a"].unit == unit


@pytest.mark.parametrize("unit", ["", "furlong", "furlong/2^3", "V/2^", "ten V/2^3", "V/3^2", None])
def test_other_units_are_not(unit):
    assert not record.is_valid_unit(unit)


def test_a_file_that_takes_a_few_bytes_at_a_time_is_written_whole(tmp_path):
    class Slow:
        """A file that writes at most 1000 bytes in one call."""

        def __init__(self, file):
            self.file = file

        def write(self, data):
            return self.file.write(data[:1000])

        def __getattr__(self, name):
            return getattr(self.file, name)

    data = np.random.default_rng(0).bytes(12_345)
    with files.GuardedFile(tmp_path / "a") as guard:
        guard._file = Slow(guard._file)
        assert guard.write(data) == len(data)
    assert (tmp_path / "a").read_bytes() == data


def test_a_seal_finds_every_damage(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(bytes(range(200)))
    assert files.seal_holds(path) is None
    files.seal(path)
    whole = path.read_bytes()
    assert whole[:200] == bytes(range(200))
    assert files.seal_holds(path) is True
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 1
        path.write_bytes(damaged)
        in_its_text = 200 <= place < len(whole) - 65 or place == len(whole) - 1
        assert files.seal_holds(path) is (None if in_its_text else False)
    path.write_bytes(whole[:-1])
    assert files.seal_holds(path) is None
    path.write_bytes(whole[-10:])
    assert files.seal_holds(path) is None


def test_rates_and_times_are_exact():
    column = Column(np.zeros(4), "V", 2, 3250, 26)
    assert column.rate_hz == 16000
    assert column.time_s.tolist() == [(26 + 1625 * n) / 26e6 for n in range(4)]


# ---- refusals --------------------------------------------------------------------------------------------------------


def delete(place, key=None):
    def edit(file):
        if key is None:
            del file[place]
        else:
            del file[place].attrs[key]

    return edit


def set_attr(place, key, value):
    return lambda file: file[place].attrs.__setitem__(key, value)


def replaced(place, **kwargs):
    def edit(file):
        attrs = {k: v for k, v in file[place].attrs.items() if k not in ("DIMENSION_LIST", "REFERENCE_LIST")}
        del file[place]
        file.create_dataset(place, **kwargs)
        for key, value in attrs.items():
            file[place].attrs[key] = value

    return edit


def poke(place, row, value):
    return lambda file: file[place].__setitem__(row, value)


EDITS = [
    (set_attr("/", "schema", "gyrorec/2.0"), "R01 / expected schema gyrorec/1.0, found gyrorec/2.0"),
    (delete("/", "schema"), "R01 / expected schema gyrorec/1.0, found nothing"),
    (delete("/", "config_toml"), "R02 / expected config_toml, found nothing"),
    (delete("clock"), "R02 clock expected f_xtal_nominal_Hz, found nothing"),
    (delete("integrity/sha256"), "R02 integrity expected sha256, found nothing"),
    (delete("streams/adc_yI"), "R02 /streams/adc_yI expected a column, found nothing"),
    (set_attr("streams/adc_yI", "unit", "furlong"), "R03 /streams/adc_yI expected a unit, found 'furlong'"),
    (delete("streams/adc_yI", "unit"), "R03 /streams/adc_yI expected a unit, found None"),
    (set_attr("streams/adc_yI", "unit", "V"), "R15 / expected content_sha256"),
    (replaced("streams/adc_yI", data=np.zeros((2, 2))), "R04 /streams/adc_yI expected a column of numbers"),
    (replaced("streams/adc_yI", data=["a"], dtype=h5py.string_dtype()), "R04 /streams/adc_yI expected a column"),
    (replaced("streams/adc_yI", data=np.zeros(3, ">i4")), "R20 /streams/adc_yI expected little-endian"),
    (replaced("streams/adc_yI", data=np.zeros(3, "<i4")), "R15 /streams/adc_yI expected sha256"),
    (set_attr("streams/adc_yI", "fs_den", 0), "R08 /streams/adc_yI expected fs_num, fs_den, edge0"),
    (set_attr("streams/adc_yI", "fs_den", 3250.0), "R08 /streams/adc_yI expected fs_num, fs_den, edge0"),
    (set_attr("streams/adc_yI", "fs_den", 3251), "R05 /streams/adc_yI expected streams/time_1_3251_from_26"),
    (set_attr("clock", "f_xtal_nominal_Hz", 26e6 + 0.5), "R08 /clock expected f_xtal_nominal_Hz in whole hertz, found"),
    (
        set_attr("clock", "f_xtal_nominal_Hz", 52e6),
        "R05 /streams/adc_yI expected streams/time_16k_from_26 of 3000 rows",
    ),
    (set_attr("clock", "ppm", 2.0), "R15 / expected content_sha256"),
    (set_attr("/", "config_toml", ""), "R15 / expected content_sha256"),
    (set_attr("/", "attributes", "{"), "R01 / expected a complete record, found damage"),
    (poke("streams/adc_yI", 7, 1), "R15 /streams/adc_yI expected sha256"),
    (poke("streams/time_1M", 7, 1), "R15 /streams/time_1M expected sha256"),
    (poke("registers/raw", 0, 9), "R15 /registers/raw expected sha256"),
    (poke("registers/name", 0, "x"), "R15 /registers/name expected sha256"),
    (lambda file: file.create_dataset("streams/more", data=[1]), "R03 /streams/more expected a unit"),
]


@pytest.mark.parametrize(("edit", "line"), EDITS, ids=[line[:50] for _, line in EDITS])
def test_an_edited_record_is_refused(path, edit, line):
    with h5py.File(path, "r+") as file:
        edit(file)
    files.seal(path)  # a file without a seal is first read by a process of its own, which test_hdf5_input.py tests
    with pytest.raises(RecordError) as caught:
        record_read.read_record(path)
    assert caught.value.findings[0].startswith(line)
    assert str(caught.value).startswith(f"{path}: {line}"[: len(str(path)) + 40])
    assert "\n" not in str(caught.value)


def test_all_findings_are_kept_and_counted(path):
    with h5py.File(path, "r+") as file:
        poke("streams/adc_yI", 7, 1)(file)
        poke("streams/adc_yQ", 7, 1)(file)
    with pytest.raises(RecordError, match=r"R15 /streams/adc_yI .* \(and 1 more\)$") as caught:
        record_read.read_record(path)
    assert len(caught.value.findings) == 2


def test_files_that_are_no_records_are_refused(tmp_path):
    with pytest.raises(FileError, match="cannot be read: No such file"):
        record_read.read_record(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(RecordError, match="R01 / expected an HDF5 file"):
        record_read.read_record(tmp_path / "text.h5")


def read_or_line(path):
    try:
        return record_read.read_record(path)
    except FileError as problem:
        return str(problem)


@pytest.mark.parametrize("count", [40, pytest.param(200, marks=pytest.mark.slow)])
def test_damaged_files_are_refused_or_unharmed(tmp_path, count):
    path = tmp_path / "run.h5"
    record.write_record(path, sample(rows=200))
    clean, want = path.read_bytes(), record_read.read_record(path)
    rng = np.random.default_rng(7)
    refused = 0
    for k in range(count):
        data = bytearray(clean)
        if k % 4 == 0:
            data = data[: rng.integers(len(data))]
        else:
            for place in rng.integers(0, len(data), 1 + 40 * (k % 2)):
                data[place] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        have = read_or_line(path)
        if isinstance(have, str):
            assert "\n" not in have
            refused += 1
        else:
            assert have.content_sha256 == want.content_sha256
            assert all(same(have.streams[name].data, want.streams[name].data) for name in want.streams)
    assert refused >= 0.975 * count, "only damage to the few bytes that mark the seal goes unseen, and harms nothing"


def test_nothing_here_can_execute_what_it_reads():
    for module in ("record", "files", "state_file", "checkpoint"):
        source = (ROOT / "testbench" / "storage" / f"{module}.py").read_text()
        assert not any(word in source for word in ("import pickle", "allow_pickle=True", "eval(", "exec("))


# ---- misuse ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("use", "words"),
    [
        (lambda w: w.stream("a", "furlong", np.int32), "unit 'furlong'"),
        (lambda w: w.stream("a", "V", object), "is not a number type"),
        (lambda w: w.stream("a", "V", float, den=0), "not a ratio"),
        (lambda w: w.stream("a", "V", float, note=["list"]), "attribute of type list"),
        (lambda w: [w.stream("a", "V", float), w.stream("a", "V", float)], "duplicate stream"),
        (lambda w: [w.stream("a", "V", float), w.stream("b", "V", float), w.append(a=[1.0])], "different lengths"),
        (lambda w: w.table("t", {"a": ("V", [1.0]), "b": ("V", [1.0, 2.0])}), "different lengths"),
        (lambda w: w.table("t", {"a": ("furlong", [1.0])}), "unit 'furlong'"),
        (lambda w: w.table("t", {"a": ("V", [[1.0]])}), "2 dimensions"),
    ],
)
def test_misuse_is_refused_and_leaves_nothing(tmp_path, use, words):
    with pytest.raises(ValueError, match=words), RecordWriter(tmp_path / "run.h5") as writer:
        use(writer)
    assert os.listdir(tmp_path) == []


# ---- whole or absent -------------------------------------------------------------------------------------------------


def write_noise(path, blocks=20):
    rng = np.random.default_rng(1)
    with RecordWriter(path) as writer:
        writer.stream("a", "code", np.int64)
        for _ in range(blocks):
            writer.append(a=rng.integers(-(1 << 62), 1 << 62, 20000))


@pytest.mark.parametrize("room", [0, 1000, 100_000, 2_000_000])
def test_a_full_disk_is_one_line_and_leaves_the_old_file(tmp_path, monkeypatch, room):
    path = tmp_path / "run.h5"
    path.write_text("the old one")

    class Full:
        """A file on a disk with `room` bytes left."""

        def __init__(self, file):
            self.file, self.left = file, room

        def write(self, data):
            self.left -= len(data)
            if self.left < 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            return self.file.write(data)

        def __getattr__(self, name):
            return getattr(self.file, name)

    plain = files.GuardedFile.__init__

    def limited(self, where):
        plain(self, where)
        self._file = Full(self._file)

    monkeypatch.setattr(files.GuardedFile, "__init__", limited)
    with pytest.raises(FileError) as caught:
        write_noise(path)
    assert str(caught.value) == f"{path}: cannot be written: No space left on device"
    assert os.listdir(tmp_path) == ["run.h5"]
    assert path.read_text() == "the old one"
    with pytest.raises(FileError, match="No space left on device"):
        state_file.save_state(path, {"a": np.zeros(300_000)}, "layout")
    assert path.read_text() == "the old one"


def test_a_real_limit_on_file_size_is_one_line_and_leaves_nothing(tmp_path):
    script = f"""
        import resource, sys
        sys.path.insert(0, {str(ROOT)!r})
        from tests.testbench.storage.test_record import write_noise
        from testbench.errors import FileError
        resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))
        try:
            write_noise({str(tmp_path / "run.h5")!r})
        except FileError as problem:
            print(problem)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout == f"{tmp_path / 'run.h5'}: cannot be written: File too large\n"
    assert done.stderr == ""
    assert os.listdir(tmp_path) == []


def test_an_unwritable_place_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    for path, why in ((tmp_path / "file" / "run.h5", "Not a directory"), (tmp_path, "Is a directory")):
        with pytest.raises(FileError, match=f"cannot be written: {why}|cannot be written: File exists"):
            write_noise(path, 1)


@pytest.mark.parametrize("problem", [RuntimeError("stop"), KeyboardInterrupt()])
def test_an_interrupted_run_leaves_nothing(tmp_path, problem):
    def begin_and_fail():
        with RecordWriter(tmp_path / "run.h5") as writer:
            writer.stream("a", "code", np.int64)
            writer.append(a=[1, 2, 3])
            raise problem

    with pytest.raises(type(problem)):
        begin_and_fail()
    assert os.listdir(tmp_path) == []


def test_a_text_file_is_whole_or_absent(tmp_path):
    path = tmp_path / "sub" / "a.txt"
    files.write_text(path, "one")

    def begin_and_fail():
        with files.replace_file(path) as part:
            part.write_text("two")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        begin_and_fail()
    assert (path.read_text(), os.listdir(path.parent)) == ("one", ["a.txt"])


def test_a_device_is_not_replaced(tmp_path):
    try:
        os.mknod(tmp_path / "null", stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("only root makes a device")
    with pytest.raises(FileError, match="is a device; it is not replaced"):
        files.write_text(tmp_path / "null", "one")
    assert stat.S_ISCHR(os.stat(tmp_path / "null").st_mode)

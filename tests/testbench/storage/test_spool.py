"""Rows on their way to the disk: the same bytes however they come, exact sums, cut where a checkpoint says."""

import errno
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbench.engines import engine
from testbench.errors import FileError
from testbench.storage import record_read, spool
from testbench.storage.code_hash import BLOCK_TICKS
from testbench.storage.spool import FIELDS, Recording, Spool

ROOT = Path(__file__).resolve().parents[3]
TRUTHS = len(engine.TRUTH_COLUMNS)


def rows(count, seed=1):
    """Frames with every register anywhere in its format, and truth."""
    rng = np.random.default_rng(seed)
    frames = [rng.integers(fmt.lo, fmt.hi, count, np.int64, endpoint=True) for _, _, fmt in engine.FRAME_COLUMNS]
    return np.stack(frames, axis=1), rng.normal(size=(count, TRUTHS))


def filled(frames, truth, cuts=(), first_frame=40, **kwargs):
    made = Spool(**kwargs)
    for begin, end in zip([0, *cuts], [*cuts, len(frames)]):
        if end > begin:
            made.add(first_frame + begin, frames[begin:end], truth[begin:end])
    return made


def test_columns_come_out_as_they_went_in():
    frames, truth = rows(300)
    streams = Recording(filled(frames, truth), "", 0.0).streams
    assert list(streams) == list(FIELDS)
    for k, (name, lsb, fmt) in enumerate(engine.FRAME_COLUMNS):
        column = streams[name]
        assert np.array_equal(column.data, frames[:, k])
        assert column.attrs == {"lsb": lsb.format(dds_bits=48), "format": str(fmt)}
        assert (column.num, column.den, column.edge0) == (1, 3250, 40 * 3250)
        assert column.data.dtype == (np.int64 if name == "frequency_word" else np.int32)
    for k, (name, unit) in enumerate(engine.TRUTH_COLUMNS):
        assert np.array_equal(streams[f"truth_{name}"].data, truth[:, k])
        assert streams[f"truth_{name}"].unit == unit


@settings(max_examples=25)
@given(st.lists(st.integers(0, 20_000), max_size=6), st.sampled_from([1, 7, 80, 8000]))
def test_how_rows_come_does_not_matter(tmp_path_factory, cuts, decimate):
    frames, truth = rows(20_000)
    path = tmp_path_factory.mktemp("spool") / "rows.bin"
    made = filled(frames, truth, sorted(cuts), decimate=decimate, path=path)
    made.flush()
    want = filled(frames, truth, decimate=decimate)
    assert path.read_bytes() == b"".join(block.tobytes() for block in want.row_blocks())
    assert made.rows == want.rows == 20_000 // decimate


@pytest.mark.parametrize("decimate", [2, 80, 8000])
def test_rows_of_several_frames(decimate):
    frames, truth = rows(24_001)
    kept = 24_001 // decimate
    streams = Recording(filled(frames, truth, decimate=decimate), "", 0.0).streams
    for k, (name, _, _) in enumerate(engine.FRAME_COLUMNS):
        groups = [[int(v) for v in part] for part in frames[: kept * decimate, k].reshape(kept, decimate)]
        column = streams.get(f"{name}_sum", streams.get(name))
        if name == "flags":
            want = [int(np.bitwise_or.reduce(group)) for group in groups]
        elif name == "lock":
            want = [int(np.bitwise_and.reduce(group)) for group in groups]
        elif name in ("state", "drive_dac_code", "sense_dac_code"):
            want = [group[0] for group in groups]
        else:
            want = [sum(group) for group in groups]
            assert name not in streams, "a sum is not a code"
        assert column.data.tolist() == want, name
        assert (column.den, column.edge0, column.attrs["frames"]) == (3250 * decimate, 40 * 3250, decimate)
    assert np.array_equal(streams["truth_x"].data, truth[: kept * decimate : decimate, 0])


def test_no_sum_can_overflow():
    """The widest word, summed over the longest group that the configuration allows."""
    widest = max(fmt.hi for _, _, fmt in engine.FRAME_COLUMNS)
    lowest = min(fmt.lo for _, _, fmt in engine.FRAME_COLUMNS)
    assert max(widest, -lowest) * 8000 < 2**63


def test_chosen_columns_in_the_order_of_the_engine():
    frames, truth = rows(100)
    streams = Recording(filled(frames, truth, columns=["truth_rate", "rate_word"]), "", 0.0).streams
    assert list(streams) == ["rate_word", "truth_rate"]


def test_a_spool_is_cut_to_its_checkpoint_and_continues(tmp_path):
    frames, truth = rows(30_000)
    for decimate in (1, 7000):
        path = tmp_path / f"{decimate}.bin"
        whole = filled(frames, truth, path=path, decimate=decimate)
        whole.flush()
        want = path.read_bytes()
        first = filled(frames[:10_000], truth[:10_000], path=path, decimate=decimate)
        values = first.dump()
        first.add(10_040, frames[10_000:25_000] + 1, truth[10_000:25_000])
        first.flush()
        with open(path, "ab") as file:
            file.write(b"half a row")
        second = Spool(path=path, decimate=decimate, rows=values["rows"])
        second.restore(values)
        second.add(10_040, frames[10_000:], truth[10_000:])
        second.flush()
        assert path.read_bytes() == want
        assert (second.rows, second.first_frame) == (whole.rows, 40)


def test_a_spool_that_lost_rows_is_refused(tmp_path):
    path = tmp_path / "rows.bin"
    filled(*rows(10), path=path).flush()
    size = filled(*rows(10)).dtype.itemsize
    with pytest.raises(FileError, match=rf"rows\.bin: has {10 * size} bytes, its checkpoint states {11 * size}"):
        Spool(path=path, rows=11)
    with pytest.raises(FileError, match=r"none\.bin: cannot be written: No such file"):
        Spool(path=tmp_path / "none.bin", rows=1)


class Disk:
    """A file that takes `room` bytes of each write, or none."""

    def __init__(self, path, mode, buffering, room):
        self.file, self.room = open(path, mode, buffering=buffering), room

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()

    def seek(self, *where):
        self.file.seek(*where)

    def write(self, data):
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.file.write(data[: self.room])


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    made = filled(*rows(10), path=tmp_path / "rows.bin")
    monkeypatch.setattr(spool, "open", lambda *args, buffering: Disk(*args, buffering, 0), raising=False)
    with pytest.raises(FileError, match=r"rows\.bin: cannot be written: No space left on device"):
        made.flush()


def test_rows_that_another_run_took_or_gave_are_missed(tmp_path):
    path = tmp_path / "rows.bin"
    made = filled(*rows(100), path=path)
    made.flush()
    filled(*rows(10), path=path).flush()
    with pytest.raises(FileError, match=r"rows\.bin: has 1240 bytes, but 12400 were written; another run"):
        list(made.row_blocks())
    path.unlink()
    made.add(140, *rows(5))
    with pytest.raises(FileError, match=r"rows\.bin: cannot be written: No such file"):
        made.flush()


def test_a_disk_that_takes_part_of_a_write_gets_the_rest(tmp_path, monkeypatch):
    frames, truth = rows(500)
    path = tmp_path / "rows.bin"
    made = filled(frames, truth, path=path)
    monkeypatch.setattr(spool, "open", lambda *args, buffering: Disk(*args, buffering, 1000), raising=False)
    made.flush()
    assert path.read_bytes() == next(filled(frames, truth).row_blocks()).tobytes()


def test_the_record_is_that_of_the_columns(tmp_path, monkeypatch):
    frames, truth = rows(3000)
    monkeypatch.setattr(spool, "READ_ROWS", 777)
    recording = Recording(filled(frames, truth), "[noise]\nseed = 1\n", 1.5)
    recording.tables["segments"] = {"name": ("", np.array(["scenario"])), "edge": ("edge", np.array([40 * 3250]))}
    recording.write(tmp_path / "run.h5")
    have = record_read.read_record(tmp_path / "run.h5")
    for name, column in recording.streams.items():
        assert np.array_equal(have.streams[name].data, column.data)
        assert have.streams[name].attrs == column.attrs
    assert have.tables["segments"]["edge"].data.tolist() == [40 * 3250]
    assert (have.config_toml, have.clock_ppm) == ("[noise]\nseed = 1\n", 1.5)


def test_the_same_rows_make_the_same_file(tmp_path):
    frames, truth = rows(3000)
    head = {"record_id": "one", "created_utc": "now"}
    for name, cuts in (("a.h5", []), ("b.h5", [5, 1200])):
        Recording(filled(frames, truth, cuts), "", 0.0, **head).write(tmp_path / name)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_sizes_on_the_pages():
    frames = 7200 * 8000
    page = " ".join((ROOT / "docs" / "record.md").read_text().split())
    row, summed = Spool().dtype.itemsize, Spool(decimate=80).dtype.itemsize
    one = frames * Spool(["rate_word"]).dtype.itemsize / 1e6
    assert f"A row of all columns takes {row} bytes before compression" in page
    assert f"so two hours of them are {frames * row / 1e9:.1f} GB" in page
    assert f"Two hours of all columns at 100 Hz (n = 80) are {frames / 80 * summed / 1e6:.0f} MB" in page
    assert f"Two hours of `rate_word` alone are {one:.0f} MB" in page
    assert f"# {one:.0f} MB before compression" in (ROOT / "docs" / "tutorials" / "first_run.md").read_text()
    for rule, names in (
        ("first", "`state`, DAC codes of drive and sense, truth"),
        ("any", "`flags`"),
        ("all", "`lock`"),
    ):
        assert f"| {rule} | {names} |" in page
    assert f"blocks of {BLOCK_TICKS} ticks" in page


def test_no_rows_are_a_record_too(tmp_path):
    Recording(Spool(), "", 0.0).write(tmp_path / "run.h5")
    assert len(record_read.read_record(tmp_path / "run.h5").streams["rate_word"].data) == 0

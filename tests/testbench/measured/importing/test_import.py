"""Files of a laboratory as records: the board's own words follow from four columns; what cannot follow is told."""

import itertools
import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from fpga_model.rates import FRAME_CYCLES
from testbench.errors import ConfigError, FileError
from testbench.measured.closed_loop import loop_noise, loop_record, loop_runs
from testbench.measured.importing import assemble, dwells
from testbench.measured.importing.record_map import Dwells
from testbench.measured.record import checks, load_record, schema
from testbench.measured.record.sessions import sessions
from testbench.measured.residual import features, residuals
from testbench.storage.record import write_record
from tests.testbench.command import gyro

ADC = tuple(schema.ADC)
MAP = """
[time]
column = "t"
[set]
"plant.fx_hz" = 11002.5
[profile]
rate_dps = 100.0
[dwells]
settle_s = 0.1
longest_s = 0.1
[columns]
"""
DWELL = '[[segment]]\nid = "a"\nfrom_s = 1.175\nto_s = 1.225\n'
PRIOR = '[[prior]]\nparam = "plant.fx_hz"\nmean = 11002.3\nsd = 1.0\nunit = "Hz"\n'
NAMES = {"adc_xI": "drive i", "adc_xQ": "drive q", "adc_yI": "rate", "adc_yQ": "quad"}


def columns(unit="code", **more):
    keys = "".join(f", {key} = {value!r}" for key, value in more.items())
    return "".join(f'{stream} = {{ column = "{name}", unit = "{unit}"{keys} }}\n' for stream, name in NAMES.items())


@pytest.fixture(scope="module")
def board(small):
    """{stream: rows} of the first power-on of the small record."""
    one = sessions(small)[0]
    return {name: c.data[one.rows] for name, c in small.streams.items()}


def made(board, first=0, **values):
    """Columns of a file: time stamps and the four channels, from a row on."""
    rows = len(board["adc_xI"])
    out = {"t": np.arange(rows) * 125e-6} | {NAMES[name]: board[name].astype(float) for name in ADC}
    return {key: np.asarray(v, float)[first:] for key, v in (out | values).items()}


def csv(path, table):
    np.savetxt(path, np.stack(list(table.values()), 1), "%.17g", ",", header=",".join(table), comments="")
    return path


def imported(tmp_path, table, text=""):
    (tmp_path / "map.toml").write_text(text or MAP + columns())
    return assemble.import_files([csv(tmp_path / "data.csv", table)], tmp_path / "map.toml")


def same_words(found, board):
    assert found.lacking == ""
    rows = len(found.record.streams["adc_xI"].data)
    assert rows <= len(board["adc_xI"])
    for name in found.record.streams.keys() & board.keys():
        a, b = found.record.streams[name].data, board[name][:rows]
        assert np.array_equal(a[1:], b[1:]), name  # DAC codes of frame 0 are what the chips hold at power-on
    assert not [f for f in checks.check(found.record) if f.level != schema.DOWNGRADED]


def test_five_columns_become_a_record_with_the_boards_own_words(board, tmp_path):
    found = imported(tmp_path, made(board))
    same_words(found, board)
    assert {"amplitude_word", "nco_fword", "ftr_acc", "dac_ftr", "state"} <= found.record.streams.keys()
    assert found.record.streams["rate_word"].attrs["tap"] == "replayed"
    lock = int(np.argmax(board["state"] == 12))
    text = " ".join(found.lines)
    assert f"locked from {lock / 8000:.4g} s on" in text
    assert "power-on: frame 0 is row 1, the last in which no channel has a conversion" in text
    assert json.loads(found.record.attrs[assemble.IMPORT_ATTRIBUTE]) == list(found.lines)
    s = found.record.tables["segments"]
    assert s["kind"].data.tolist() == ["startup", "warmup"]  # too short for a dwell
    assert s["edge_b"].data.tolist() == [FRAME_CYCLES * lock, FRAME_CYCLES * len(board["state"])]
    assert (s["rate_set"].data[1], s["a_set"].data[1], s["temp_set"].data[1]) == (100.0, 5.0, 25.0)


def test_the_command_writes_what_the_check_accepts(board, tmp_path):
    (tmp_path / "map.toml").write_text(MAP + columns())
    csv(tmp_path / "data.csv", made(board))
    done = gyro("measured", "import", "data.csv", "--map", "map.toml", "-o", "bench.h5", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "assumed: every recorded conversion was good (adc_ok)" in done.stdout
    loaded = load_record.load(tmp_path / "bench.h5")
    assert loaded.residual.verdict.startswith("R0 is 0 LSB")


@pytest.mark.parametrize("kind", ["npz", "parquet", "mat"])
def test_every_kind_of_file_gives_the_record_of_the_csv(board, tmp_path, kind):
    table = {key.replace(" ", "_"): v for key, v in made(board).items()}
    text = (MAP + columns()).replace("drive i", "drive_i").replace("drive q", "drive_q")
    path = tmp_path / f"data.{kind}"
    if kind == "npz":
        np.savez(path, **table)
    elif kind == "mat":
        scipy.io.savemat(path, table)
    else:
        pq.write_table(pa.table(table), path)
    (tmp_path / "map.toml").write_text(text)
    same_words(assemble.import_files([path], tmp_path / "map.toml"), board)


def test_volts_with_their_lsb_are_the_codes_again(board, tmp_path):
    """With nine digits of the largest channel the error is a hundredth of a code."""
    lsb = 4.8e-7
    table = made(board, **{NAMES[name]: np.round(board[name] * lsb * 1e3, 6) for name in ADC})
    found = imported(tmp_path, table, MAP + columns("mV", lsb_V=lsb, lsb_V_unc=1e-9))
    same_words(found, board) if not checks.check(found.record) else None
    assert found.lacking == ""
    assert np.array_equal(found.record.streams["rate_word"].data, board["rate_word"])
    assert found.record.streams["adc_xI"].attrs["lsb_V"] == lsb


@pytest.mark.parametrize("share", [1.001, 1.0], ids=["another LSB", "few digits"])
def test_volts_that_are_no_codes_are_told_and_no_word_is_made_of_them(board, tmp_path, share):
    lsb = 4.76837158203125e-07
    values = {NAMES[name]: np.round(board[name] * lsb, 12 if share > 1 else 6) for name in ADC}
    found = imported(tmp_path, made(board, **values), MAP + columns("V", lsb_V=lsb * share))
    assert found.lacking.endswith("its volts do not correspond to integer codes of the converter")
    text = " ".join(found.lines)
    step = 10 * lsb if share > 1 else 4e-6  # the converter's codes step by ten: 4.8 uV, or 4 and 5 of whole uV
    assert f"smallest step {step:.4g}" in text
    assert "R0 is not decidable; tracing needs nco_fword, amplitude_word, rate_word, quadrature_code" in text
    assert set(found.record.streams) == set(ADC)
    assert not [f for f in checks.check(found.record) if f.level == schema.REFUSED]


def scrambled(board, rng):
    """The same power-on by a logger that began before it, with a clock of its own and repeated rows."""
    table = made(board)
    rows = len(table["t"])
    early = {key: np.concatenate([np.zeros(40), v]) for key, v in table.items()}
    early["t"] = 1e4 + (np.arange(rows + 40) * 125e-3 * (1 + 3e-5) + rng.uniform(-0.02, 0.02, rows + 40))
    again = np.sort(np.concatenate([np.arange(rows + 40), rng.integers(50, rows, 30)]))
    return {key: v[again] for key, v in early.items()}


def test_the_time_line_is_found(board, tmp_path):
    text = MAP.replace('column = "t"', 'column = "t"\nunit = "ms"') + columns()
    found = imported(tmp_path, scrambled(board, np.random.default_rng(3)), text)
    same_words(found, board)
    assert len(found.record.streams["adc_xI"].data) == len(board["adc_xI"])
    lines = " ".join(found.lines)
    (ppm,) = re.findall(r", ([-+.\d]+) ppm", lines)
    assert float(ppm) == pytest.approx(30, abs=0.5)  # a jitter of 0.02 ms in 10 000 rows
    assert "left out: 30 repeated rows" in lines
    assert "frame 0 is row 41" in lines


def test_a_first_row_with_codes_is_frame_1_by_its_stamp(board, tmp_path):
    for power_on in (0.0, 125e-6):
        text = MAP.replace('column = "t"', f'column = "t"\npower_on = {power_on}') + columns()
        same_words(imported(tmp_path, made(board, first=1), text), board)


def test_behind_a_lost_row_nothing_is_used(board, tmp_path):
    table = {key: np.delete(v, 9500) for key, v in made(board).items()}
    found = imported(tmp_path, table)
    assert any("left out: all rows from frame 9500 on" in line for line in found.lines)
    assert len(found.record.streams["adc_xI"].data) == 9500
    same_words(found, board)


LATE = {
    "no stamp": ("", 5, "no row without a conversion, and no time stamp of the power-on"),
    "stamp": ("power_on = 0.0", 5, "the first row is frame 5 by its time stamp: 4 conversions are missing"),
}


@pytest.mark.parametrize("case", LATE)
def test_a_late_start_is_told_and_goes_on(board, tmp_path, case):
    line, first, wanted = LATE[case]
    text = MAP.replace('column = "t"', f'column = "t"\n{line}') + columns() + PRIOR
    found = imported(tmp_path, made(board, first), text)
    assert wanted in found.lacking
    assert set(found.record.streams) == set(ADC)
    write_record(tmp_path / "late.h5", found.record)
    loaded = load_record.load(tmp_path / "late.h5")
    assert "R0 not decidable: frame 0 is not a power-on" in loaded.residual.verdict
    done = gyro("measured", "trace", tmp_path / "late.h5")
    assert done.returncode == 2
    assert "the observable f_word is computed from it" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_decimated_file_is_told_and_goes_on(board, tmp_path):
    table = {key: v[: len(v) // 8 * 8].reshape(-1, 8).mean(1) for key, v in made(board).items()}
    found = imported(tmp_path, table)
    assert "a row covers 8 frames: no word can be replayed" in found.lacking
    write_record(tmp_path / "slow.h5", found.record)
    assert not load_record.load(tmp_path / "slow.h5").is_blocked


@pytest.mark.parametrize("first", [0, 1])
def test_recorded_words_are_kept_and_compared(board, tmp_path, first):
    words = {"f": board["nco_fword"] * (26e6 / 2**48), "a": board["amplitude_word"] * (10 / 2**23)}
    table = made(board, first, **words)
    more = 'nco_fword = { column = "f", unit = "Hz" }\namplitude_word = { column = "a", unit = "V" }\n'
    text = MAP.replace('column = "t"', 'column = "t"\npower_on = 0.0') + columns() + more
    found = imported(tmp_path, table, text)
    same_words(found, board)
    assert found.record.streams["nco_fword"].attrs["tap"] == "internal"
    write_record(tmp_path / "a.h5", found.record)
    assert load_record.load(tmp_path / "a.h5").residual.first is None


def test_another_firmware_is_imported_with_its_words_and_r1_works(board, tmp_path):
    names = ("nco_fword", "nco_pword", "amplitude_word", "rate_word", "quadrature_code")
    table = made(board) | {name: board[name].astype(float) for name in names}
    text = 'regmap_sha256 = "' + "1" * 64 + '"\n' + MAP + columns()
    text += "".join(f'{name} = {{ column = "{name}", unit = "1" }}\n' for name in names)
    found = imported(tmp_path, table, text)
    assert "another firmware" in found.lacking
    write_record(tmp_path / "a.h5", found.record)
    loaded = load_record.load(tmp_path / "a.h5")
    assert "R0 not decidable: skipped, regmap_sha256 1111111111111111" in loaded.residual.verdict
    done = gyro("measured", "trace", tmp_path / "a.h5")
    assert done.returncode == 2
    assert "regmap_sha256 belongs to another firmware" in done.stderr


def test_two_files_of_one_condition_are_repeats(board, tmp_path):
    twice = "[[power_on]]\n[[power_on]]\n[power_on.profile]\nrate_dps = 100.0\n"
    (tmp_path / "map.toml").write_text(MAP + columns() + twice + DWELL)
    paths = [csv(tmp_path / f"{k}.csv", made(board)) for k in range(2)]
    found = assemble.import_files(paths, tmp_path / "map.toml")
    s = found.record.tables["segments"]
    assert s["repeat_group"].data[s["kind"].data == "dwell"].tolist() == ["a", "a"]
    assert found.record.tables["power_on"]["edge"].data.tolist() == [0, FRAME_CYCLES * len(board["adc_xI"])]
    assert checks.check(found.record) == []


def test_dwells_begin_at_steps_of_a_settled_board_and_behind_a_settling_elsewhere():
    fixed = dwells.track(0.0)
    tracks = dwells.Tracks(
        dwells.track([(0, 0.0), (4, 50.0), (8, -50.0)]), fixed, dwells.track([(0, 5.0), (12, 5.5)]), fixed
    )
    locked = np.arange(8000 * 20) >= 8000
    parts = dwells.find_segments(tracks, locked, Dwells(settle_s=2.0, longest_s=3.0, held_out=[2]))
    assert all(a.end == b.first for a, b in itertools.pairwise(parts))
    assert (parts[0].first, parts[-1].end) == (0, 8000 * 20)
    # behind lock 3 s .. 4 s is shorter than the others and no dwell
    found = [(p.first / 8000, p.end / 8000, p.role) for p in parts if p.kind == "dwell"]
    assert found == [(4.0, 7.0, "fit"), (8.0, 11.0, "validate"), (14.0, 17.0, "fit")]


def test_lines_between_points_are_steps_of_eight_milliseconds_with_the_mean_of_each():
    t = dwells.track([(0, 10.0), (1, 10.0), (1.08, 20.0), (1.08, -5.0)], linear=True)
    assert t.frames == (0, *range(8000, 8640, 64), 8640)
    assert t.values[1:-1] == pytest.approx([10.5 + k for k in range(10)])
    values = [t.value_at(frame) for frame in (7999, 8639, 8640, 10**6)]
    assert values == [10.0, pytest.approx(19.5), -5.0, -5.0]


def test_times_of_a_late_file_count_from_power_on_where_that_is_known():
    t = dwells.track([(0, 0.0), (1, 5.0), (3, 7.0)]).shift_origin(2 * 8000)
    assert t == dwells.Track((0, 8000), (5.0, 7.0))
    assert dwells.track(3.0).shift_origin(100) == dwells.Track((0,), (3.0,))


def determined(frames):
    """True if the draws of the noise determine a dwell of so many frames by itself; ConfigError if not."""
    size = 8 * (len(features.bins(frames, loop_runs.FIRST_BIN)) - 1)
    rows = np.random.default_rng(1).normal(size=(loop_noise.NOISE_DRAWS, size))
    return loop_noise.compute_noise_gain({"a": (rows, np.zeros(size))}) > 0


def test_a_dwell_alone_is_as_long_as_the_draws_of_the_noise_determine():
    fixed = dwells.track(0.0)
    parts = dwells.find_segments(dwells.Tracks(fixed, fixed, fixed, fixed), np.ones(80_000, bool), Dwells())
    (dwell,) = (p for p in parts if p.kind == "dwell")
    assert dwell.end - dwell.first == dwells.SINGLE_DWELL_FRAMES
    assert determined(dwells.SINGLE_DWELL_FRAMES)
    with pytest.raises(ConfigError, match="more draws or fewer bins"):
        determined(2 * dwells.SINGLE_DWELL_FRAMES)


def test_a_dwell_ends_where_the_lock_is_lost():
    fixed = dwells.track(0.0)
    locked = np.arange(8000 * 20) >= 8000
    locked[8000 * 9 : 8000 * 10] = False
    parts = dwells.find_segments(dwells.Tracks(fixed, fixed, fixed, fixed), locked, Dwells(settle_s=2.0, longest_s=5.0))
    assert [(p.first / 8000, p.end / 8000) for p in parts if p.kind == "dwell"] == [(3.0, 8.0), (12.0, 17.0)]


WRONG = {
    "unknown key": (MAP + columns() + "[dwell]\n", "dwell: Extra inputs are not permitted"),
    "no stream": (MAP + columns() + 'adc_z = { column = "t" }\n', "columns.adc_z: is not a stream"),
    "missing": (MAP + columns().replace("adc_yQ", "adc_ok"), "columns.adc_yQ is missing"),
    "unit": (MAP + columns("furlong"), "columns.adc_xI.unit: Input should be"),
    "hertz": (MAP + columns("Hz"), "columns.adc_xI: unit 'Hz' is valid only for nco_fword"),
    "setting": (MAP.replace("plant.fx_hz", "plant.fx") + columns(), "[set]"),
    "write": (MAP + columns() + "[[write]]\nat_s = 1.0\n", "write[0]: expected name with raw, or a_um, or detune_deg"),
    "files": (MAP + columns() + "[[power_on]]\n[[power_on]]\n", "2 [[power_on]] for 1 files"),
    "segment": (
        MAP + columns() + '[[segment]]\nid = "a"\nfrom_s = 2.0\nto_s = 1.0\n',
        "segment a: from_s = 2 s is not before",
    ),
    "beyond": (
        MAP + columns() + '[[segment]]\nid = "a"\nfrom_s = 2.0\nto_s = 100.0\n',
        "segment a: 2 .. 100 s is outside the file, which covers 0 .. 1.22513 s",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_map_is_one_line(board, tmp_path, case):
    text, wanted = WRONG[case]
    with pytest.raises(ConfigError) as caught:
        imported(tmp_path, made(board), text)
    assert wanted in str(caught.value)
    assert "\n" not in str(caught.value)


BROKEN = {
    "no column": (lambda t: t | {"t2": t.pop("t")}, "no column 't'"),
    "another rate": (lambda t: t | {"t": t["t"] * 0.8}, "rows are 100 us apart, expected a multiple of 125 us"),
    "time goes back": (
        lambda t: t | {"t": np.where(np.arange(len(t["t"])) == 70, 0.0, t["t"])},
        "row 71: time goes back",
    ),
    "beyond the converter": (lambda t: t | {"rate": t["rate"] + 2.0**23}, "is code 8388608 of adc_yI, outside"),
    "two codes at one time": (
        lambda t: t | {"t": np.where(np.arange(len(t["t"])) == 5000, t["t"][4999], t["t"])},
        "row 5001: two rows have the same time",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_one_line(board, tmp_path, case):
    spoil, wanted = BROKEN[case]
    with pytest.raises(FileError) as caught:
        imported(tmp_path, spoil(made(board)))
    assert wanted in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_wrong_register_does_not_lock_and_is_told(board, tmp_path):
    """Another amplitude than the board's: the replayed loops see an error that never vanishes."""
    text = MAP.replace("[set]\n", '[set]\n"firmware.amplitude_um" = 2.0\n') + columns()
    found = imported(tmp_path, made(board), text)
    assert "the replayed firmware does not lock" in found.lacking


def test_r1_of_an_imported_record_has_the_words_to_the_clock(board, tmp_path):
    (tmp_path / "map.toml").write_text(MAP + columns() + DWELL)
    paths = [csv(tmp_path / f"{k}.csv", made(board)) for k in range(2)]
    assert residuals.study_residuals(assemble.import_files(paths, tmp_path / "map.toml").record, "R1").exact_words


def test_a_late_start_with_its_words_can_be_traced(board, tmp_path, monkeypatch):
    """R0 is not decidable, the features of a dwell are those of the whole power-on."""
    names = ("nco_fword", "amplitude_word", "rate_word", "quadrature_code")
    table = made(board, **{name: board[name].astype(float) for name in names})
    parts = '[[segment]]\nid = "s"\nfrom_s = {:.6f}\nto_s = {:.6f}\nkind = "settle"\nrole = "none"\n' + DWELL
    text = MAP + columns() + "".join(f'{n} = {{ column = "{n}", unit = "1" }}\n' for n in names)
    monkeypatch.setattr(loop_record, "LEAST_SETTLE_S", 0.02)
    whole = imported(tmp_path, table, text + parts.format(1.15, 1.175))
    late = text + parts.format(0.15, 0.175).replace("1.175", "0.175").replace("1.225", "0.225")
    cut = imported(tmp_path, {key: v[8000:] for key, v in table.items()}, late)
    assert whole.lacking == ""
    assert "no word can be replayed" in cut.lacking
    assert cut.lines[-1] == "R0 is not decidable; tracing is possible"
    a, b = (loop_record.measured_features(found.record, "a", {}).values["a"] for found in (whole, cut))
    assert np.array_equal(a, b)

"""Recordings: what is stored comes back, damage is refused with one line, they are closed loops of this firmware."""

import hashlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import fault_monitor, sequencer, top
from fpga_model.digital_sid import SAMPLE
from fpga_model.rates import FRAME_CYCLES
from testbench.errors import FileError
from testbench.flatten import names
from testbench.golden.bundles import design_bundle as golden
from testbench.golden.recording import make_recordings, recording, replay_recording

CLOSED = (*(pytest.param(case, marks=pytest.mark.slow) for case in ("story", "power_on")), "story_digital")
ALL_STATES = set(range(len(sequencer.STATES)))


@pytest.fixture(scope="module")
def seen():
    """{case: (recording, {register: column at the frame starts})}, computed when asked for."""
    found = {}

    def get(case):
        if case not in found:
            r = recording.load(case)
            rows = replay_recording.run(r.params, r.stimulus, r.frames, np.arange(r.frames) * FRAME_CYCLES)
            found[case] = r, dict(zip(names(top.State()), rows.registers.T)), rows
        return found[case]

    return get


samples = st.lists(st.tuples(*[st.integers(SAMPLE.lo, SAMPLE.hi)] * 2), max_size=50)


@given(samples)
def test_samples_are_packed_without_loss(rows):
    sar = np.array(rows, np.int64).reshape(-1, 2)
    assert np.array_equal(recording.unpacked_samples(recording.packed_samples(sar)), sar)


def test_prediction_is_that_of_the_nominal_frequency():
    assert round(2 * np.cos(2 * np.pi * 11002.3e-6) * 2**recording.PREDICTOR_SHIFT) == recording.PREDICTOR


def test_prediction_errors_of_the_recorded_samples_fit_a_byte():
    errors = recording.packed_samples(recording.load("story_digital").stimulus.sar)
    assert np.mean(np.abs(errors) < 128) > 0.99


@pytest.mark.parametrize("case", golden.CASES)
def test_what_is_saved_is_loaded(case, tmp_path):
    r = recording.load(case)
    recording.save(r, tmp_path)
    again = recording.load(case, tmp_path)
    assert recording.sha256(again) == recording.sha256(r)
    assert again.windows == r.windows
    assert again.params == r.params
    assert (again.frames, again.row_every, again.closed) == (r.frames, r.row_every, r.closed)


@pytest.mark.parametrize("case", CLOSED)
def test_firmware_still_does_what_it_did_in_the_closed_loop(seen, case):
    r, _, rows = seen(case)
    found = hashlib.sha256(rows.registers.astype("<i8").tobytes()).hexdigest()
    assert found == r.closed, (
        f"{case}: the firmware has changed: python -m testbench.golden.recording.make_recordings {case} reset registers"
    )
    assert make_recordings.is_current(r)


@pytest.mark.parametrize("case", make_recordings.OF_STORY)
def test_a_case_is_made_of_the_story_that_is_stored(case):
    kept, again = recording.load(case), make_recordings.OF_STORY[case](recording.load("story"))
    text = f"{case} is of another story: python -m testbench.golden.recording.make_recordings {case}"
    assert recording.sha256(again) == recording.sha256(kept), text
    assert make_recordings.find_windows(again) == kept.windows, text


@pytest.mark.parametrize("case", make_recordings.OF_STORY)
def test_a_case_is_not_made_of_an_old_story(monkeypatch, case):
    old = recording.load("story")._replace(closed="0" * 64)
    monkeypatch.setattr(make_recordings.recording, "load", lambda name: old)
    with pytest.raises(FileError, match="record story first"):
        make_recordings.make(case)


def test_the_story_is_recorded_before_reset_whatever_the_order(monkeypatch):
    made = []
    r = recording.load("reset")
    monkeypatch.setattr(make_recordings, "make", lambda name, progress: made.append(name) or r)
    monkeypatch.setattr(recording, "save", lambda r: None)
    make_recordings.main(["reset", "story"])
    assert made == ["story", "reset"]


def test_closed_loop_gives_the_recorded_inputs_again():
    frames = 8
    again = make_recordings.record_closed_loop("story", make_recordings.CASES["story"]._replace(frames=frames))
    kept = recording.load("story").stimulus
    end = frames * FRAME_CYCLES
    assert np.array_equal(again.stimulus.adc, kept.adc[kept.adc[:, 0] < end])
    assert np.array_equal(again.stimulus.host, kept.host[kept.host[:, 0] < end])
    assert len(again.stimulus.adc) == frames


def test_cases_cover_the_life_of_the_firmware(seen):
    states, flags = set(), 0
    for case in ("story", "reset"):
        _, column, _ = seen(case)
        states |= set(column["control.sequencer.state"].tolist())
        flags |= int(np.bitwise_or.reduce(column["control.sequencer.faults.flags"]))
    assert states == ALL_STATES
    assert flags == fault_monitor.ALL


def test_story_locks_saturates_fails_and_is_safe_again(seen):
    r, column, _ = seen("story")
    state, flags = column["control.sequencer.state"], column["control.sequencer.faults.flags"]
    latch, word = column["control.sequencer.faults.latch"], column["control.rate_loop.loop.y"]
    lock = int(np.flatnonzero(state == sequencer.LOCKED)[0])
    at = dict(make_recordings.RATES)
    assert lock < min(k for k in at if k)
    # rate steps of +-300 deg/s: a third of the force, with the right signs
    full = r.params.control.rate_loop.loop.hi
    assert 0.2 * full < word[599] < 0.4 * full
    assert -0.4 * full < word[659] < -0.2 * full
    # 1500 deg/s is beyond full scale: the word sits at its limit, is flagged, and leaves it again
    assert (word[736:745] == full).all()
    assert flags[745] & fault_monitor.RATE_SATURATED
    assert (np.abs(word[800:815]) < full).all()
    for frame, flag in ((826, "OVER_RANGE"), (844, "STALE"), (872, "STUCK"), (900, "STALE")):
        assert flags[frame] & getattr(fault_monitor, flag), flag
    # silence of the ADC: safe state with the drive off, then a new start
    safe = np.flatnonzero(state == sequencer.STANDBY)
    assert safe[-1] > 900
    assert state[safe[-1] + 1] == sequencer.KICK
    assert sequencer.OPEN in state[980:]
    assert state[-1] == sequencer.IDLE
    # the host clears the latch
    assert latch[881] == 0 < latch[875]
    assert (np.diff(latch.astype(int)) < 0).sum() >= 3


@pytest.mark.parametrize("case", CLOSED[1:])
def test_digital_story_and_power_on_reach_lock(seen, case):
    r, column, _ = seen(case)
    assert sequencer.LOCKED in column["control.sequencer.state"]
    assert r.params.digital == (case == "story_digital")


def test_power_on_is_of_the_default_firmware():
    assert recording.load("power_on").params == make_recordings.build.firmware(make_recordings.config.Config())


def test_reset_case_loses_lock_and_fails_a_search_and_writes_everything(seen):
    r, column, _ = seen("reset")
    assert max(column["control.sequencer.attempts"]) == 1
    host = r.stimulus.host
    assert (host[:, 1] == 1).sum() == len(make_recordings.RESETS)
    written = set(host[host[:, 1] == 0, 2].tolist())
    assert set(range(1, 18)) - {6, 7} <= written
    assert any(address > 0x4C for address in written)


def test_reset_case_locks_with_fixed_words_that_change_and_holds_every_loop(seen):
    _, column, _ = seen("reset")
    state, control = column["control.sequencer.state"], column["control.sequencer.control"]
    fixed = control & make_recordings.FIXES == make_recordings.FIXES
    for places in (state == sequencer.OPEN, state == sequencer.LOCKED):
        for name in ("rate_fixed", "quadrature_fixed"):
            assert len(set(column[f"registers.{name}"][fixed & places].tolist())) >= 4, name
    assert len(set(column["registers.amplitude_fixed"][state == sequencer.OPEN].tolist())) >= 4
    held = control & make_recordings.HOLDS == make_recordings.HOLDS
    assert (held & (state >= sequencer.BALANCE)).sum() >= 2


@pytest.mark.parametrize("case", [*CLOSED, *make_recordings.OF_STORY])
def test_windows_show_every_change_of_state(seen, case):
    r, column, _ = seen(case)
    shown = " ".join(w.shows for w in r.windows)
    state = column["control.sequencer.state"]
    for frame in np.flatnonzero(np.diff(state)):
        a, b = (sequencer.STATES[int(state[k])] for k in (frame, frame + 1))
        assert f"{a} to {b}" in shown, (case, frame)


# ---- damage ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def damaged(tmp_path):
    """Function that stores a copy of `reset` with some arrays changed."""

    def make(**changed):
        with np.load(recording.FOLDER / "reset.npz") as file:
            data = {key: file[key] for key in file.files} | changed
        np.savez(tmp_path / "reset.npz", **{k: v for k, v in data.items() if v is not None})
        return tmp_path

    return make


def stored(key):
    with np.load(recording.FOLDER / "reset.npz") as file:
        return file[key].copy()


def test_absent_truncated_and_foreign_files_are_refused(tmp_path):
    with pytest.raises(FileError, match=r"cannot be read|is not a readable|object"):
        recording.load("reset", tmp_path)
    whole = (recording.FOLDER / "reset.npz").read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 30):
        (tmp_path / "reset.npz").write_bytes(whole[:size])
        with pytest.raises(FileError, match=r"cannot be read|is not a readable|object"):
            recording.load("reset", tmp_path)


def test_objects_in_a_file_are_refused(damaged):
    with pytest.raises(FileError, match=r"cannot be read|is not a readable|object"):
        recording.load("reset", damaged(closed=np.array([{}], object)))


@pytest.mark.parametrize(
    ("key", "change", "text"),
    [
        ("schema", lambda v: np.array("gyro-recording/2.0"), "schema is 'gyro-recording/2.0'"),
        ("host", lambda v: None, "host is missing"),
        ("param_names", lambda v: np.array([*v[:-1], "other"]), "record again"),
        ("params", lambda v: v[:-1], "record again"),
        ("params", lambda v: np.where(np.arange(len(v)) == 1, 2, v), "parameter quadrature_fast: 2"),
        ("frames", lambda v: np.array(0), "frames = 0"),
        ("frames", lambda v: np.array(20), "a clock is outside 0 .. 64999"),
        ("host", lambda v: v[::-1], "host: the clocks do not strictly increase"),
        ("host", lambda v: v + [0, 2, 0, 0], "neither a write nor a reset"),
        ("host", lambda v: v + [0, 0, 256, 0], "an address is outside 8 bits"),
        ("host", lambda v: v + [0, 0, 0, 1 << 48], "data outside 48 bits"),
        ("adc", lambda v: -v, "adc: the clocks do not strictly increase"),
        ("sar", lambda v: np.zeros((2, 5), np.int32), "5 samples"),
        ("windows", lambda v: v + [10**9, 0], "are outside 0 .."),
    ],
)
def test_contents_outside_their_limits_are_refused(damaged, key, change, text):
    with pytest.raises(FileError, match=text.replace("(", r"\(")):
        recording.load("reset", damaged(**{key: change(stored(key))}))

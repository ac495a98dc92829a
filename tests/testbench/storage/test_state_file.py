"""State files: numbers come back bit for bit; another layout, damage and what is no number are refused."""

import json
import os

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from testbench.storage import record, state_file
from testbench.storage.record import RecordError

numbers = st.one_of(
    st.integers(-(1 << 63), (1 << 63) - 1),
    st.floats(),
    hnp.arrays(st.sampled_from([np.int64, np.float64]), hnp.array_shapes(max_dims=2, max_side=5)),
)


def bits(value):
    array = np.asarray(value)
    return type(value), array.dtype.str, array.shape, array.tobytes()


@given(st.dictionaries(st.sampled_from(["dds.phase", "plant.z", "delay.taps.0", "frame", "seed"]), numbers, min_size=1))
def test_a_state_comes_back_bit_for_bit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("state") / "state.h5"
    state_file.save_state(path, values, "layout 1", {"edge": 26, "note": "text"})
    back, meta = state_file.load_state(path, "layout 1")
    assert {name: bits(value) for name, value in back.items()} == {name: bits(value) for name, value in values.items()}
    assert meta == {"edge": 26, "note": "text"}


def test_a_state_of_another_layout_or_damaged_is_refused(tmp_path):
    state, path = tmp_path / "state.h5", tmp_path / "run.h5"
    record.write_record(path, record.Record({"a": record.Column(np.zeros(3), "code")}))
    state_file.save_state(state, {"a": 1, "b": np.arange(3.0)}, "layout 1")
    with pytest.raises(RecordError, match="R11 / expected state layout layout 2, found layout 1"):
        state_file.load_state(state, "layout 2")
    with pytest.raises(RecordError, match=r"R01 / expected schema gyrostate/1\.0, found gyrorec/1\.0"):
        state_file.load_state(path, "layout 1")
    for edit in (
        lambda file: file["state/b"].__setitem__(0, 5.0),
        lambda file: file.attrs.__setitem__("meta", json.dumps({"edge": 1})),
        lambda file: file.__delitem__("state/a"),
    ):
        state_file.save_state(state, {"a": 1, "b": np.arange(3.0)}, "layout 1")
        with h5py.File(state, "r+") as file:
            edit(file)
        with pytest.raises(RecordError, match="R15 /state"):
            state_file.load_state(state, "layout 1")
    for place in ("meta", "source_format", "content_sha256"):
        state_file.save_state(state, {"a": 1}, "layout 1")
        with h5py.File(state, "r+") as file:
            del file.attrs[place]
        with pytest.raises(RecordError, match="R01 / expected a complete state"):
            state_file.load_state(state, "layout 1")


@pytest.mark.parametrize(
    ("values", "words"),
    [({"a": "text"}, "not a number type"), ({"a/b": 1}, "slash"), ({"a": None}, "not a number type")],
)
def test_a_state_holds_numbers_only(tmp_path, values, words):
    with pytest.raises(ValueError, match=words):
        state_file.save_state(tmp_path / "state.h5", values, "layout")
    assert os.listdir(tmp_path) == []

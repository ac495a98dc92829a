"""What is left of rows that are gone: the means and the start-up, as from all rows at once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpga_model import sequencer
from testbench.run import run_statistics
from testbench.run.run_statistics import RunStatistics, StartUp
from testbench.run.simulation import FRAME, TRUTH

LSB_HZ = 26e6 / 2**48


def rows(count, lock_at=None, seed=1):
    rng = np.random.default_rng(seed)
    frames = rng.integers(0, 1 << 20, (count, len(FRAME)))
    frames[:, FRAME["frequency_word"]] += 119_110_000_000
    frames[:, FRAME["flags"]] = 1 << rng.integers(0, 3, count)
    frames[:, FRAME["state"]] = 3
    if lock_at is not None:
        frames[lock_at:, FRAME["state"]] = sequencer.LOCKED
    return frames, rng.normal(0, 5e-6, (count, len(TRUTH)))


def fed(sink, frames, truth, cuts, first_frame=0, restart=()):
    """The sink after all rows in pieces; a new one takes over before the pieces in `restart`."""
    for k, (begin, end) in enumerate(zip([0, *cuts], [*cuts, len(frames)])):
        if k in restart:
            values, sink = sink.dump(), type(sink)(*([LSB_HZ] if isinstance(sink, RunStatistics) else []))
            sink.restore(values)
            sink.active = True
        if end > begin:
            sink.add(first_frame + begin, frames[begin:end], truth[begin:end])
    return sink


@settings(max_examples=20)
@given(st.lists(st.integers(1, 4999), max_size=4).map(sorted), st.sets(st.integers(0, 4)))
def test_means_of_pieces_are_those_of_the_whole(cuts, restart):
    frames, truth = rows(5000)
    sums = RunStatistics(LSB_HZ)
    sums.active = True
    sums = fed(sums, frames, truth, cuts, restart=restart)
    for name in run_statistics.SUMMED:
        assert sums.mean(name) == sum(frames[:, FRAME[name]].tolist()) / 5000
    assert sums.flags == 0b111
    assert sums.temp_degc == truth[-1, TRUTH["temperature"]]
    ratio = 11000.0 / (frames[:, FRAME["frequency_word"]] * LSB_HZ)
    amplitude = np.sqrt(truth[:, TRUTH["x"]] ** 2 + (truth[:, TRUTH["vx"]] * ratio) ** 2)
    assert sums.amplitude_m == pytest.approx(np.mean(amplitude), rel=1e-12)


def test_only_the_scenario_counts():
    frames, truth = rows(100)
    sums = RunStatistics(LSB_HZ)
    sums.add(0, frames, truth)
    assert sums.rows == 0


@settings(max_examples=20)
@given(
    st.one_of(st.none(), st.integers(0, 19_999)),
    st.lists(st.integers(1, 19_999), max_size=4).map(sorted),
    st.sets(st.integers(0, 4)),
)
def test_the_start_up_ends_half_a_second_after_lock(lock_at, cuts, restart):
    frames, truth = rows(20_000, lock_at)
    seen = fed(StartUp(), frames, truth, cuts, first_frame=16, restart=restart)
    columns = seen.columns()
    kept = 20_000 if lock_at is None else min(20_000, lock_at + 4000)
    assert seen.lock_s == (None if lock_at is None else (16 + lock_at) / 8000)
    assert np.array_equal(columns["time_s"], (16 + np.arange(kept)) / 8000)
    for name in ("frequency_word", "phase", "state"):
        assert np.array_equal(columns[name], frames[:kept, FRAME[name]])
    for name in ("x", "vx"):
        assert np.array_equal(columns[name], truth[:kept, TRUTH[name]])


def test_a_start_up_without_lock_is_kept_for_ten_seconds():
    frames, truth = rows(30_000)
    seen = StartUp()
    for k in range(4):
        seen.add(30_000 * k, frames, truth)
    assert len(seen.columns()["x"]) == 80_000

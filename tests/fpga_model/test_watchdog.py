"""The watchdog: every register at every clock, and the time after which frames count as missing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import watchdog
from fpga_model.design_record import DEFAULT
from fpga_model.rates import FRAME_TICKS
from tests import naive
from tests.fpga_model.records import assert_rows, rows

tick_runs = st.lists(st.tuples(st.sampled_from([0, 1, 1]), st.sampled_from([0] * 30 + [1])), max_size=40)


def run(p, inputs, s=None):
    return rows(lambda s, *i: watchdog.step(p, s, *i), s or watchdog.State(), inputs)


@given(st.integers(0, 12), tick_runs)
def test_step_is_the_documented_equation(limit, inputs):
    p = watchdog.Params(limit)
    assert_rows(run(p, inputs), naive.watchdog(limit, inputs), watchdog.STATE_FMT)


def test_age_saturates_and_stale_stays():
    inputs = [(1, 0)] * 1100
    found = run(watchdog.design(), inputs)
    assert_rows(found[-3:], naive.watchdog(300, inputs)[-3:], watchdog.STATE_FMT)
    assert found[-1] == (1023, 1)


def test_two_frames_may_be_late_but_not_missing():
    p = watchdog.design()
    assert p.limit == 300 > 2 * FRAME_TICKS, "one lost frame must not be stale"
    found = run(p, [(1, 0)] * 301)
    assert [r.stale for r in found[-2:]] == [0, 1], "stale rises at the tick after the limit"
    assert run(p, [(1, 1)], found[-1])[-1] == (0, 0), "a frame wins over a tick, and one is enough"


@pytest.mark.parametrize(("frame_ticks", "limit"), [(100, 240), (125, 300), (250, 600), (426, 1022)])
def test_the_limit_is_the_same_count_of_frames_in_every_design(frame_ticks, limit):
    assert watchdog.design(DEFAULT._replace(frame_ticks=frame_ticks)).limit == limit


@pytest.mark.parametrize(("frame_ticks", "limit_frames"), [(125, 1.99), (125, 8.184), (125, -1), (427, 2.4)])
def test_design_refuses(frame_ticks, limit_frames):
    with pytest.raises(ValueError, match=rf"gap of .* frames of {frame_ticks} ticks is outside .* 1022 ticks"):
        watchdog.design(DEFAULT._replace(frame_ticks=frame_ticks), limit_frames)

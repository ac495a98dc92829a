"""Pipeline delay: every tap at every depth, the latency, and the limits of the depth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import delay
from fpga_model.jit import kernel
from testbench.flatten import names, store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows


@kernel
def trace(p, s, xs):
    """Registers before each edge, and after the last one; the output pin at each edge."""
    rows = np.empty((len(xs) + 1, delay.MAX_DEPTH), np.int64)
    pins = np.empty(len(xs), np.int64)
    for n in range(len(xs)):
        store(rows[n], s)
        pins[n] = delay.out(p, s, int(xs[n]))
        s = delay.step(p, s, int(xs[n]))
    store(rows[len(xs)], s)
    return rows, pins


@given(
    st.integers(0, delay.MAX_DEPTH),
    st.lists(
        st.one_of(st.sampled_from([delay.X.lo, -1, 1, delay.X.hi]), st.integers(delay.X.lo, delay.X.hi)), max_size=25
    ),
)
def test_step_and_out_are_the_documented_equation(depth, xs):
    p = delay.design(depth)
    rows, pins = trace(p, delay.State(), np.array(xs, np.int64))
    assert_same_rows(delay.State(), rows, naive.delay(depth, xs))
    assert pins.tolist() == ([0] * depth + xs)[: len(xs)]
    assert_in_formats(delay.STATE_FMT, rows)


@pytest.mark.parametrize("depth", range(delay.MAX_DEPTH + 1))
def test_latency_is_the_depth(depth):
    p = delay.design(depth)
    _, pins = trace(p, delay.State(), np.array([1] + [0] * 12, np.int64))
    assert np.flatnonzero(pins).tolist() == [delay.latency(p)] == [depth]


@pytest.mark.parametrize("depth", [-1, 9, 16, 0.5, float("nan")])
def test_a_wrong_depth_is_refused(depth):
    with pytest.raises(ValueError, match="depth_clocks"):
        delay.design(depth)


def test_formats_follow_the_word():
    assert set(delay.state_fmt(delay.PARAMS_FMT.depth).taps) == {delay.PARAMS_FMT.depth}
    assert len(names(delay.State())) == delay.MAX_DEPTH

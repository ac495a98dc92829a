"""The integer square root: every register at every clock, and the edges of all 65536 roots."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import isqrt
from fpga_model.jit import kernel
from tests import naive

TOP = 2**32 - 1
# numba does not know the defaults of a NamedTuple, so the reset state is made outside the kernels
RESET = isqrt.State()


@kernel
def trace(s, start, u):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(start) + 1, 7), np.int64)
    for n in range(len(start) + 1):
        for k, value in enumerate(s):
            rows[n, k] = value
        if n < len(start):
            s = isqrt.step(s, int(start[n]), int(u[n]))
    return rows


@kernel
def root(s, u):
    """State when done, and the clocks it took."""
    s = isqrt.step(s, 1, u)
    clocks = 1
    while not s.done and clocks < 100:
        s = isqrt.step(s, 0, 0)
        clocks += 1
    return s, clocks


@kernel
def wrong_edges(s, first, last, by):
    """The roots r with a wrong answer at r*r - 1, r*r or r*r + 2*r (one below the next square), or a late one."""
    wrong = 0
    for r in range(first, last, by):
        for u, expected in ((r * r - 1, r - 1), (r * r, r), (r * r + 2 * r, r)):
            if u >= 0:
                s, clocks = root(s, u)
                good = s.y == expected and s.root == expected and s.remainder == u - expected * expected
                wrong += 0 if good and clocks == isqrt.LATENCY else 1
    return wrong


def test_edges_of_all_65536_roots():
    assert wrong_edges(RESET, 0, 65536, 257 if numba.config.DISABLE_JIT else 1) == 0


def test_largest_radicand():
    s, _ = root(RESET, TOP)
    assert (s.y, s.remainder) == (65535, 131070)


value = st.one_of(
    st.sampled_from([0, 1, 2, 3, 4, 2**30 - 1, 2**30, 2**31, TOP - 1, TOP]),
    st.integers(0, 65535).map(lambda r: r * r),
    st.integers(0, TOP),
)


@given(st.lists(st.tuples(value, st.sampled_from([1, 2, 9, 15, 16, 17, 18, 21])), min_size=1, max_size=6), value)
def test_step_is_the_documented_equation(runs, idle):
    """Each run is one start and some clocks, possibly too few; the input carries something else in between."""
    inputs = [(1, u) if k == 0 else (0, idle) for u, clocks in runs for k in range(clocks)]
    rows = trace(RESET, *np.array(inputs, dtype=np.int64).T.copy())
    assert [tuple(row) for row in rows.tolist()] == naive.isqrt(inputs)
    for fmt, lowest, highest in zip(isqrt.STATE_FMT, rows.min(axis=0), rows.max(axis=0), strict=True):
        assert fmt.lo <= lowest <= highest <= fmt.hi


@pytest.mark.parametrize("u", [1, TOP])
def test_done_rises_latency_clocks_after_start_for_one_clock(u):
    start = np.zeros(50, dtype=np.int64)
    start[5] = 1
    rows = trace(RESET, start, start * u)
    assert np.flatnonzero(rows[:, 5]).tolist() == [5 + isqrt.LATENCY]
    assert (np.flatnonzero(np.diff(rows[:, 6])) + 1).tolist() == [5 + isqrt.LATENCY]
    assert isqrt.LATENCY <= 18


def test_header_states_formats_and_latency():
    text = " ".join(isqrt.__doc__.split())
    for names, fmt in {
        "u, radicand": isqrt.STATE_FMT.radicand, "root, y": isqrt.STATE_FMT.root, "i": isqrt.STATE_FMT.i,
        "remainder": isqrt.STATE_FMT.remainder, "busy, done": isqrt.STATE_FMT.busy,
    }.items():  # fmt: skip
        assert f"{names} {fmt}" in text
    assert isqrt.STATE_FMT.root == isqrt.STATE_FMT.y
    assert f"Latency {isqrt.LATENCY} clocks" in text
    assert sum(fmt.width for fmt in isqrt.STATE_FMT) == 87

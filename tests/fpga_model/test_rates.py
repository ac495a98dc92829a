"""Clock enables: positions in time over two seconds' worth of wraps, slots, and the enables decoded from them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import rates
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel
from testbench.flatten import store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows


@kernel
def trace(s, go):
    """Registers before each edge, and after the last one; the three decoded enables at each edge."""
    rows = np.empty((len(go) + 1, 3), np.int64)
    enables = np.empty((len(go), 3), np.int64)
    for n in range(len(go)):
        store(rows[n], s)
        enables[n, 0], enables[n, 1], enables[n, 2] = rates.ce_1m(s), rates.ce_8k(s), rates.tick_enable(s, 2)
        s = rates.step(DEFAULT, s, int(go[n]))
    store(rows[len(go)], s)
    return rows, enables


def run(goes):
    return trace(rates.State(), np.array(goes, np.int64))


@pytest.mark.parametrize(
    ("khz", "tick_clocks", "master_hz", "ticks"),
    [
        (500, 26, 26_000_000, 2),
        (1000, 26, 26_000_000, 1),
        (500, 26, 52_000_000, 4),
        (1000, 26, 52_000_000, 2),
        (500, 20, 52_000_000, 8),  # 650 kHz would be too fast
        (500, 16, 200_000_000, 32),
        (500, 27, 26_000_000, 2),
    ],
)
def test_v_q_is_sent_in_the_last_of_the_fewest_ticks_that_are_not_too_fast(khz, tick_clocks, master_hz, ticks):
    d = DEFAULT._replace(tick_clocks=tick_clocks, master_hz=master_hz)
    found = [rates.quadrature_due(d, tick, int(khz == 1000)) for tick in range(250)]
    assert found == [int((tick + 1) % ticks == 0) for tick in range(250)]
    assert master_hz / tick_clocks / ticks <= 1e3 * khz < 2 * master_hz / tick_clocks / ticks or ticks == 1


def test_constants_are_the_board():
    assert (rates.MASTER_HZ, rates.TICK_HZ, rates.FRAME_HZ) == (26_000_000, 1_000_000, 8_000)
    assert (rates.TICK_CYCLES, rates.FRAME_TICKS, rates.FRAME_CYCLES) == (26, 125, 3250)


@given(st.lists(st.sampled_from([0] * 30 + [1]), max_size=300))
def test_step_is_the_documented_equation(goes):
    rows, _ = run(goes)
    assert_same_rows(rates.State(), rows, naive.rates(goes))
    assert_in_formats(rates.STATE_FMT, rows)


def test_three_frames_without_and_with_go():
    goes = [1 if n in (5, 900, 930, 2000, 9000, 9061) else 0 for n in range(3 * 3250 + 7)]
    rows, enables = run(goes)
    assert_same_rows(rates.State(), rows, naive.rates(goes))
    edges = np.arange(len(goes))
    assert (enables[:, 0] == (edges % 26 == 0)).all()
    assert (enables[:, 1] == (edges % 3250 == 0)).all()
    assert (enables[:, 2] == (edges % 26 == 2)).all()
    assert rows[:, 2].max() == rates.SLOTS


def test_every_slot_is_seen_once_after_a_go():
    rows, _ = run([1] + [0] * 80)
    assert rows[0, 2] == 0
    assert rows[rates.LATENCY : rates.LATENCY + rates.SLOTS, 2].tolist() == list(range(1, rates.SLOTS + 1))
    assert not rows[rates.LATENCY + rates.SLOTS :, 2].any()


@pytest.mark.parametrize("gap", [1, 2, 59, 60, 61, 62])
def test_a_second_go_restarts_the_slots(gap):
    rows, _ = run([1] + [0] * (gap - 1) + [1] + [0] * 70)
    assert rows[gap + 1, 2] == 1

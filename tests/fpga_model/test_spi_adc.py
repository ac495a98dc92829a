"""SPI master of the ADC: every register, the frame on the pins, DRDY, status check, and data sheet timing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import spi_adc
from fpga_model.jit import kernel
from testbench.flatten import names, store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows

NAMES = names(spi_adc.State())
TC_NS = 1e9 / 26e6


@kernel
def trace(s, drdy, dout):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(drdy) + 1, 20), np.int64)
    for n in range(len(drdy)):
        store(rows[n], s)
        s = spi_adc.step(s, int(drdy[n]), int(dout[n]))
    store(rows[len(drdy)], s)
    return rows


def run(drdy, dout):
    return trace(spi_adc.State(), np.array(drdy, np.int64), np.array(dout, np.int64))


def column(rows, name):
    return rows[:, NAMES.index(name)]


def one_frame(bits, after=200):
    """Rows of a read of 216 bits; DRDY falls at edge 10."""
    drdy = [1] * 10 + [0] * 20 + [1] * (spi_adc.FRAME_CYCLES + after)
    dout = [0] * len(drdy)
    # a bit is on the pin from the clock in which SCLK is high
    for k, bit in enumerate(bits):
        dout[10 + 4 + 2 * k] = bit
    return run(drdy, dout)


def frame_bits(status, codes):
    return [int(c) for c in f"{status:024b}" + "".join(f"{code % 2**24:024b}" for code in codes)]


@st.composite
def drdy_levels(draw):
    """Falls at random, also while a frame is read and in its tail."""
    gaps = draw(st.lists(st.sampled_from([1, 2, 3, 100, 431, 432, 433, 484, 485, 486, 487, 700]), max_size=5))
    levels = [draw(st.integers(0, 1))]
    for gap in gaps:
        levels += [1 - levels[-1]] * gap
    return levels + [1] * draw(st.integers(0, 500))


@given(drdy_levels(), st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.5, 0.9]))
def test_step_is_the_documented_equation(drdy, seed, ones):
    dout = (np.random.default_rng(seed).random(len(drdy)) < ones).astype(int).tolist()
    rows = run(drdy, dout)
    assert_same_rows(spi_adc.State(), rows, naive.spi_adc(drdy, dout))
    assert_in_formats(spi_adc.STATE_FMT, rows)


def test_three_frames_in_a_row_every_register():
    rng = np.random.default_rng(1298)
    drdy = ([1] * 600 + [0] * 200) * 3
    dout = rng.integers(0, 2, len(drdy)).tolist()
    # the second frame begins with a good status
    for k, bit in enumerate([1, 1, 0, 0]):
        dout[1400 + 4 + 2 * k] = bit
    rows = run(drdy, dout)
    assert_same_rows(spi_adc.State(), rows, naive.spi_adc(drdy, dout))
    assert np.flatnonzero(column(rows, "valid")).tolist() == [600 + 800 * k + spi_adc.READ_CYCLES for k in range(2)]
    assert column(rows, "ok")[1400 + spi_adc.READ_CYCLES] == 1


@given(
    st.lists(
        st.one_of(st.sampled_from([-(1 << 23), -1, 0, 1, (1 << 23) - 1]), st.integers(-(1 << 23), (1 << 23) - 1)),
        min_size=8,
        max_size=8,
    )
)
def test_words_arrive_in_order_and_sign_extended(codes):
    rows = one_frame(frame_bits(0xC00000, codes))
    assert np.flatnonzero(column(rows, "valid")).tolist() == [10 + spi_adc.READ_CYCLES]
    at = 10 + spi_adc.READ_CYCLES
    assert [column(rows, f"channels.{k}")[at] for k in range(8)] == codes
    assert column(rows, "status")[at] == 0xC00000


@pytest.mark.parametrize("head", range(16))
def test_ok_only_with_the_right_head(head):
    rows = one_frame(frame_bits(head << 20 | 0x0ABCD, [1] * 8))
    assert column(rows, "ok")[10 + spi_adc.READ_CYCLES] == (head == 0b1100)
    assert column(rows, "valid")[10 + spi_adc.READ_CYCLES] == 1, "valid tells that a frame ended, ok whether to use it"


def test_frame_on_the_pins_and_data_sheet_timing():
    """SCLK 216 pulses of 13 MHz; CS leads by more than 6 ns, trails by four periods of a 514 ns clock or more."""
    rows = one_frame([1] * 216)
    cs, sclk = column(rows, "cs_n"), column(rows, "sclk")
    rises, falls = np.flatnonzero(np.diff(sclk) == 1) + 1, np.flatnonzero(np.diff(sclk) == -1) + 1
    assert len(rises) == len(falls) == 216
    assert set(np.diff(rises)) == set(np.diff(falls)) == {2}
    assert (falls - rises == 1).all()
    down, up = np.flatnonzero(np.diff(cs))[:2] + 1
    assert down == 10 + 3
    assert (rises[0] - down) * TC_NS >= 6
    assert 4 * 514 <= (up - falls[-1]) * TC_NS <= 4 * 514 + TC_NS
    assert 2 * TC_NS >= 50, "SCLK period"
    # DOUT is valid 17 ns after the rise and is taken one clock after it
    assert TC_NS >= 17
    # CS may fall again two periods after it rose, and the next conversion is 3250 clocks away (812 at 32 kSPS)
    assert (812 - (up - down)) * TC_NS >= 2 * 514


def test_a_second_fall_while_busy_is_ignored_and_the_next_is_not():
    busy = spi_adc.FRAME_CYCLES + spi_adc.TAIL_CYCLES
    # the edge that raises CS is the last one that cannot start a frame
    for gap, frames in ((busy, 1), (busy + 1, 2)):
        drdy = [1] * 3 + [0] * (gap - 5) + [1] * 5 + [0] * (busy + 5)
        rows = run(drdy, [0] * len(drdy))
        assert (np.diff(column(rows, "cs_n")) == -1).sum() == frames


def test_low_drdy_at_reset_is_no_fall():
    rows = run([0] * 50, [0] * 50)
    assert (column(rows, "cs_n") == 1).all()


def test_a_fall_needs_two_registers_before_it_acts():
    rows = run([1] * 5 + [0] * 5, [0] * 10)
    busy = column(rows, "busy")
    assert np.flatnonzero(busy).tolist() == [8, 9, 10]
    assert column(rows, "meta")[6] == 0
    assert column(rows, "sync")[6] == 1

"""SPI master of the ADC: every register, the frame on the pins, DRDY, status check, and data sheet timing."""

from typing import get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import spi_adc
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from fpga_model.jit import kernel
from testbench.flatten import names, store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows

NAMES = names(spi_adc.State())
TC_NS = 1e9 / 26e6
READ = 435
BUSY = 432 + 54
READOUTS = [  # divider, bits of a word, channels, clocks of the tail
    (2, 24, 8, 54),
    (4, 24, 8, 107),
    (8, 24, 8, 411),
    (2, 16, 5, 1),
    (4, 19, 6, 54),
    (8, 17, 7, 96),
]


def design(divider, word_bits, channels, tail):
    return DEFAULT._replace(adc_divider=divider, adc_word_bits=word_bits, adc_channels=channels, adc_tail_clocks=tail)


@kernel
def trace(d, s, drdy, dout):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(drdy) + 1, 20), np.int64)
    for n in range(len(drdy)):
        store(rows[n], s)
        s = spi_adc.step(d, s, int(drdy[n]), int(dout[n]))
    store(rows[len(drdy)], s)
    return rows


def run(drdy, dout, d=DEFAULT):
    return trace(d, spi_adc.State(), np.array(drdy, np.int64), np.array(dout, np.int64))


def column(rows, name):
    return rows[:, NAMES.index(name)]


def one_frame(bits, after=200):
    """Rows of a read of 216 bits; DRDY falls at edge 10."""
    drdy = [1] * 10 + [0] * 20 + [1] * (432 + after)
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


@given(drdy_levels(), st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.5, 0.9]), st.sampled_from(READOUTS))
def test_step_is_the_documented_equation(drdy, seed, ones, readout):
    d = design(*readout)
    dout = (np.random.default_rng(seed).random(len(drdy)) < ones).astype(int).tolist()
    rows = run(drdy, dout, d)
    assert_same_rows(spi_adc.State(), rows, naive.spi_adc(drdy, dout, *readout))
    assert_in_formats(formats(spi_adc.State, d), rows)


@pytest.mark.parametrize("readout", READOUTS[1:])
def test_a_readout_of_other_numbers(readout):
    """Two frames in a row: every register; words left justified, channels beyond those sent 0, valid when it is due."""
    divider, word_bits, channels, tail = readout
    rng, d = np.random.default_rng(word_bits), design(*readout)
    read = 3 + divider * (1 + channels) * word_bits
    period = read + tail + 1
    drdy = ([1] * 5 + [0] * (period - 5)) * 2 + [1] * period
    words = rng.integers(0, 2**word_bits, (2, 1 + channels))
    words[:, 0] |= 0b1100 << (word_bits - 4)
    words[:, 0] &= ~(0b0011 << (word_bits - 4))
    dout = [0] * len(drdy)
    for frame, row in enumerate(words):
        line = "".join(f"{word:0{word_bits}b}" for word in row)
        for k, bit in enumerate(line):
            at = 5 + frame * period + 3 + divider * (k + 1)
            # on the line from the rise of SCLK to its next one, as the converter does
            dout[at - divider // 2 : at + divider // 2] = [int(bit)] * divider
    rows = run(drdy, dout, d)
    assert_same_rows(spi_adc.State(), rows, naive.spi_adc(drdy, dout, *readout))
    valid = np.flatnonzero(column(rows, "valid"))
    assert valid.tolist() == [5 + read, 5 + read + period]
    for at, row in zip(valid, words):
        codes = [int(word) << (24 - word_bits) for word in row[1:]]
        wanted = [code - 2**24 if code >= 2**23 else code for code in codes] + [0] * (8 - channels)
        assert [column(rows, f"channels.{k}")[at] for k in range(8)] == wanted
        assert column(rows, "ok")[at] == 1
    sclk = column(rows, "sclk")
    rises, falls = np.flatnonzero(np.diff(sclk) == 1) + 1, np.flatnonzero(np.diff(sclk) == -1) + 1
    assert (falls - rises == divider // 2).all()
    assert np.flatnonzero(np.diff(column(rows, "cs_n")) == 1)[0] + 1 - falls[(1 + channels) * word_bits - 1] == tail


def test_tail_of_the_part_and_width_of_the_count():
    """Four periods of 514 ns in whole clocks: 53.5, 82.2 and 106.9; the count holds bits, half periods and tail."""
    assert [spi_adc.tail_clocks(hz) for hz in (26_000_000, 40_000_000, 52_000_000)] == [54, 83, 107]
    count = get_type_hints(spi_adc.State)["count"]
    for divider, word_bits, channels, tail in READOUTS:
        most = max(divider // 2 * word_bits, tail) - 1
        assert (
            most.bit_length()
            <= count.for_design(design(divider, word_bits, channels, tail)).width
            <= most.bit_length() + 1
        )


def test_three_frames_in_a_row_every_register():
    rng = np.random.default_rng(1298)
    drdy = ([1] * 600 + [0] * 200) * 3
    dout = rng.integers(0, 2, len(drdy)).tolist()
    # the second frame begins with a good status
    for k, bit in enumerate([1, 1, 0, 0]):
        dout[1400 + 4 + 2 * k] = bit
    rows = run(drdy, dout)
    assert_same_rows(spi_adc.State(), rows, naive.spi_adc(drdy, dout))
    assert np.flatnonzero(column(rows, "valid")).tolist() == [600 + 800 * k + READ for k in range(2)]
    assert column(rows, "ok")[1400 + READ] == 1


@given(
    st.lists(
        st.one_of(st.sampled_from([-(1 << 23), -1, 0, 1, (1 << 23) - 1]), st.integers(-(1 << 23), (1 << 23) - 1)),
        min_size=8,
        max_size=8,
    )
)
def test_words_arrive_in_order_and_sign_extended(codes):
    rows = one_frame(frame_bits(0xC00000, codes))
    assert np.flatnonzero(column(rows, "valid")).tolist() == [10 + READ]
    at = 10 + READ
    assert [column(rows, f"channels.{k}")[at] for k in range(8)] == codes
    assert column(rows, "status")[at] == 0xC00000


@pytest.mark.parametrize("head", range(16))
def test_ok_only_with_the_right_head(head):
    rows = one_frame(frame_bits(head << 20 | 0x0ABCD, [1] * 8))
    assert column(rows, "ok")[10 + READ] == (head == 0b1100)
    assert column(rows, "valid")[10 + READ] == 1, "valid tells that a frame ended, ok whether to use it"


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
    # the edge that raises CS is the last one that cannot start a frame
    for gap, frames in ((BUSY, 1), (BUSY + 1, 2)):
        drdy = [1] * 3 + [0] * (gap - 5) + [1] * 5 + [0] * (BUSY + 5)
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

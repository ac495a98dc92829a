"""Digital side of the ADC: every register, frames, DRDY, conversions during a read, round trip to the master."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.parts import adc_serial
from fpga_model import spi_adc
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel
from testbench.flatten import names, store
from tests import naive
from tests.rows import assert_same_rows

NAMES = names(adc_serial.State())
MASTER = names(spi_adc.State())
CODE = st.one_of(st.sampled_from([-(1 << 23), -1, 0, 1, (1 << 23) - 1]), st.integers(-(1 << 23), (1 << 23) - 1))
CODES = st.lists(CODE, min_size=8, max_size=8)
GOOD = adc_serial.status_word()


@kernel
def eight(x):
    """A row of eight codes as the tuple that the chip takes."""
    return (int(x[0]), int(x[1]), int(x[2]), int(x[3]), int(x[4]), int(x[5]), int(x[6]), int(x[7]))


@kernel
def trace(word_bits, s, pins, codes):
    """What the chip holds after each clock; pins: cs_n, sclk, loaded, status."""
    rows = np.empty((len(pins), 26), np.int64)
    for n in range(len(pins)):
        x = pins[n]
        s = adc_serial.step(word_bits, s, int(x[0]), int(x[1]), int(x[2]), int(x[3]), eight(codes[n]))
        store(rows[n], s)
    return rows


@kernel
def linked(d, chip, master, loaded, status, codes):
    """Chip and SPI master: the master's registers before each edge, and the chip's pins DRDY_N and DOUT."""
    rows = np.empty((len(loaded), 20), np.int64)
    pins = np.empty((len(loaded), 2), np.int64)
    for n in range(len(loaded)):
        store(rows[n], master)
        pins[n, 0], pins[n, 1] = chip.drdy_n, adc_serial.dout(chip)
        master = spi_adc.step(d, master, chip.drdy_n, adc_serial.dout(chip))
        chip = adc_serial.step(
            d.adc_word_bits, chip, master.cs_n, master.sclk, int(loaded[n]), int(status[n]), eight(codes[n])
        )
    return rows, pins


def run(inputs, word_bits=24):
    pins = np.array([x[:4] for x in inputs], np.int64).reshape(-1, 4)
    return trace(word_bits, adc_serial.State(), pins, np.array([x[4] for x in inputs], np.int64).reshape(-1, 8))


def column(rows, name, of=NAMES):
    return rows[:, of.index(name)]


def read(bits, load_at=(), codes=(), idle=3):
    """Pins of one read of `bits` bits, with conversions that end at the given clocks."""
    levels = [(1, 0)] * idle + [(0, 0)] + [(0, 1), (0, 0)] * bits + [(0, 0), (1, 0)]
    inputs = [(cs, sclk, 0, 0, [0] * 8) for cs, sclk in levels]
    for clock, code in zip(load_at, codes):
        inputs[clock] = (*inputs[clock][:2], 1, GOOD, code)
    return inputs


@given(
    st.lists(
        st.tuples(st.integers(0, 1), st.integers(0, 1), st.sampled_from([0, 0, 0, 1]), st.just(GOOD), CODES),
        max_size=25,
    )
)
def test_any_levels_on_the_pins(inputs):
    assert_same_rows(adc_serial.State(), run(inputs), naive.adc_chip(inputs))


@given(
    st.lists(st.tuples(st.sampled_from([0, 1, 24, 25, 48, 215, 216, 217]), st.integers(0, 40), CODES), max_size=3),
    st.integers(16, 24),
)
def test_reads_of_any_length_with_conversions_inside(reads, word_bits):
    inputs = []
    for bits, clock, codes in reads:
        part = read(bits)
        inputs += read(bits, [min(clock, len(part) - 1)], [codes])
    assert_same_rows(adc_serial.State(), run(inputs, word_bits), naive.adc_chip(inputs, word_bits))


def shifted_out(rows):
    """DOUT in every clock in which SCLK has risen, as text."""
    sclk = column(rows, "sclk")
    return "".join(str(x) for x in column(rows, "out")[np.flatnonzero(np.diff(sclk, prepend=0) == 1)])


@given(CODES, CODES, st.integers(5, 400))
def test_a_conversion_during_a_read_does_not_disturb_it(first, second, clock):
    """The second result is read in full by the next frame."""
    inputs = read(216, [0, clock], [first, second]) + read(216)
    text = shifted_out(run(inputs))
    for frame, codes in ((text[:216], first), (text[216:], second)):
        assert frame == f"{GOOD:024b}" + "".join(f"{code % 2**24:024b}" for code in codes)


def test_dout_changes_only_when_sclk_or_cs_does():
    rng = np.random.default_rng(5)
    inputs = read(216, [0], [rng.integers(-(1 << 23), 1 << 23, 8).tolist()])
    rows = run(inputs)
    changed = np.flatnonzero(np.diff(column(rows, "out"))) + 1
    rises = np.flatnonzero(np.diff(column(rows, "sclk")) == 1) + 1
    assert len(changed) > 50
    assert set(changed) <= {*rises.tolist(), len(rows) - 1}


def test_zeros_after_the_frame():
    rows = run(read(240, [0], [[-1] * 8]))
    text = shifted_out(rows)
    assert text == f"{GOOD:024b}" + "1" * 192 + "0" * 24


def test_drdy_falls_with_the_result_and_rises_with_the_first_sclk_fall():
    rows = run(read(216, [1], [[0] * 8]))
    drdy = column(rows, "drdy_n")
    first_fall = np.flatnonzero(np.diff(column(rows, "sclk")) == -1)[0] + 1
    assert np.flatnonzero(drdy == 0).tolist() == list(range(1, first_fall))


def test_drdy_of_unread_results_is_high_for_a_moment_so_that_it_falls_again():
    loads = [(1, 0, int(n in (2, 20, 22, 40)), GOOD, [n] * 8) for n in range(60)]
    rows = run(loads)
    drdy = column(rows, "drdy_n")
    low = [n for n in range(60) if drdy[n] == 0]
    assert low == [*range(2, 20), *range(20 + adc_serial.PULSE, 40), *range(40 + adc_serial.PULSE, 60)]
    assert column(rows, "result.1")[22] == 22, "a result during the pulse is kept"


OTHERS = [  # divider, bits of a word, channels; clocks of the read
    (2, 24, 8, 435),
    (4, 24, 8, 867),
    (8, 24, 8, 1731),
    (2, 16, 5, 195),
    (4, 19, 6, 535),
]


@pytest.mark.parametrize(("period", "readout"), [(813, OTHERS[0]), *((3250, readout) for readout in OTHERS)], ids=str)
def test_round_trip_to_the_master(period, readout):
    """Random words, negative codes and both ends; valid when the last bit has come, once per conversion."""
    divider, word_bits, channels, read = readout
    d = DEFAULT._replace(adc_divider=divider, adc_word_bits=word_bits, adc_channels=channels)
    rng = np.random.default_rng(period)
    frames = 12
    words = rng.integers(-(1 << 23), 1 << 23, (frames, 8))
    words[0], words[1], words[2] = -(1 << 23), (1 << 23) - 1, [-1, 0, 1, -2, 2, -(1 << 22), 1 << 22, -1]
    n = np.arange(frames * period)
    loaded = (n % period == 7).astype(np.int64)
    # codes are on the bus only in the clock of `loaded`
    codes = np.where(loaded[:, None] == 1, words[n // period], 0x555555)
    status = np.where(loaded == 1, adc_serial.status_word(0x5A, 0xA5, 0x9), 0)
    rows, pins = linked(d, adc_serial.State(), spi_adc.State(), loaded, status, codes)
    valid = np.flatnonzero(column(rows, "valid", MASTER))
    # drdy_n is low in the row after the clock of `loaded`
    assert valid.tolist() == [7 + 1 + k * period + read for k in range(frames)]
    got = np.stack([column(rows, f"channels.{k}", MASTER)[valid] for k in range(8)], axis=1)
    step = 2 ** (24 - word_bits)
    assert (got == np.where(np.arange(8) < channels, words // step * step, 0)).all()
    assert (column(rows, "ok", MASTER)[valid] == 1).all()
    assert (column(rows, "status", MASTER)[valid] == 0xC5AA59 // step * step).all()
    assert (np.diff(pins[:, 0]) == -1).sum() == frames


@pytest.mark.parametrize("bit", range(24))
def test_a_wrong_bit_in_the_status_head_is_seen_and_a_lead_off_bit_is_no_fault(bit):
    loaded = np.zeros(900, np.int64)
    loaded[3] = 1
    status = np.full(900, GOOD ^ 1 << bit)
    rows, _ = linked(DEFAULT, adc_serial.State(), spi_adc.State(), loaded, status, np.full((900, 8), -5))
    (valid,) = np.flatnonzero(column(rows, "valid", MASTER))
    assert column(rows, "ok", MASTER)[valid] == (bit < 20)


def test_a_conversion_that_ends_while_the_frame_is_read_does_not_mix():
    """An ADC clock that runs too fast: each frame that is read belongs to one conversion."""
    period = 471
    n = np.arange(period * 20)
    loaded = (n % period == 0).astype(np.int64)
    codes = np.repeat((n // period)[:, None], 8, axis=1)
    rows, _ = linked(DEFAULT, adc_serial.State(), spi_adc.State(), loaded, np.full(len(n), GOOD), codes)
    valid = np.flatnonzero(column(rows, "valid", MASTER))
    assert len(valid) > 8
    for at in valid:
        assert len({int(column(rows, f"channels.{k}", MASTER)[at]) for k in range(8)}) == 1


def test_status_word():
    assert adc_serial.status_word() == 0xC00000
    assert adc_serial.status_word(0xFF, 0, 0) == 0xCFF000
    assert adc_serial.status_word(0, 0xFF, 0) == 0xC00FF0
    assert adc_serial.status_word(0, 0, 0xF) == 0xC0000F
    for wrong in ({"lead_off_p": 256}, {"lead_off_n": -1}, {"gpio": 16}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            adc_serial.status_word(**wrong)

"""Digital side of the DACs: every register, wrong frames, power-on, and codes through the SPI master to the output."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.parts import dac_serial
from fpga_model import spi_dac
from fpga_model.jit import kernel
from testbench.flatten import store
from tests import naive
from tests.rows import assert_same_rows

PARTS = {
    "DAC8811": (dac_serial.DAC8811, spi_dac.DAC8811),
    "AD5791": (dac_serial.AD5791, spi_dac.AD5791),
    "DAC82002": (dac_serial.DAC82002, spi_dac.DAC82002),
}
# The same parts once more, as the data sheets' words
SHEETS = {
    "DAC8811": {
        "bits": 16, "exact": False, "ldac": False, "data": 16, "offset": -32768, "signed": False,
        "header": "", "control": None, "start": -32768,
    },
    "AD5791": {
        "bits": 24, "exact": True, "ldac": True, "data": 20, "offset": 0, "signed": True,
        "header": "0001", "control": "0010", "start": -(2**19),
    },
    "DAC82002": {
        "bits": 24, "exact": True, "ldac": False, "data": 16, "offset": 0, "signed": False,
        "header": "00001000", "control": None, "start": 0,
    },
}  # fmt: skip
RANGE = {"DAC8811": (-32768, 32767), "AD5791": (-(2**19), 2**19 - 1), "DAC82002": (0, 65535)}
by_name = pytest.mark.parametrize("name", PARTS)
SHIFT, COUNT, SYNC_N, LDAC_N, STAGED, LATCH, CODE, ENABLED, UPDATED = range(9)


@kernel
def trace(p, s, pins):
    """What the chip holds after each clock."""
    rows = np.empty((len(pins), 9), np.int64)
    for n in range(len(pins)):
        x = pins[n]
        s = dac_serial.step(p, s, int(x[0]), int(x[1]), int(x[2]), int(x[3]))
        store(rows[n], s)
    return rows


@kernel
def linked(p, s, q, c, load, code, init):
    """SPI master and chip: what the chip holds after each edge."""
    rows = np.empty((len(load), 9), np.int64)
    for n in range(len(load)):
        s = spi_dac.step(p, s, int(load[n]), spi_dac.frame(p, int(code[n]), int(init[n])))
        c = dac_serial.step(q, c, s.sync_n, s.sclk_en, spi_dac.sdin(p, s), s.ldac_n)
        store(rows[n], c)
    return rows


def bits_on_pins(word, bits, gap=2, ldac=False):
    """Pins of one frame of `bits` bits, with gaps in the clock that a chip must not mind."""
    pins = [(0, 0, 1, 1)]
    for k in reversed(range(bits)):
        pins += [(0, 1, word >> k & 1, 1)]
        pins += [(0, 0, 0, 1)] if k % 7 == 3 else []
    pins += [(1, 0, 0, 1)] * gap
    return pins + ([(1, 0, 0, 0), (1, 0, 0, 1)] if ldac else [])


def run(name, pins):
    p = PARTS[name][0]
    return trace(p, dac_serial.reset(p), np.array(pins, np.int64).reshape(-1, 4))


@st.composite
def frames(draw, name):
    """Frames of right and wrong length and address, with stray pin changes between and inside them."""
    bits = SHEETS[name]["bits"]
    headers = [SHEETS[name]["header"], SHEETS[name]["control"] or "", "0000", "1001", "0011"]
    pins = []
    for _ in range(draw(st.integers(0, 4))):
        length = draw(st.sampled_from([bits, bits, bits, bits - 1, bits + 1, bits + 8, 1, 0]))
        text = draw(st.sampled_from(headers))
        word = int((text + "1" * length)[:length] or "0", 2) & draw(st.integers(0, 2**length - 1) | st.just(-1))
        if draw(st.booleans()):
            word |= int((text + "0" * length)[:length] or "0", 2)
        pins += bits_on_pins(word, length, draw(st.integers(1, 3)), draw(st.booleans()))
        pins += draw(st.lists(st.tuples(*[st.integers(0, 1)] * 4), max_size=4))
    return pins


@given(st.data(), st.sampled_from(list(PARTS)))
def test_step_is_the_documented_equation(data, name):
    pins = data.draw(frames(name))
    assert_same_rows(dac_serial.State(), run(name, pins), naive.dac_chip(SHEETS[name], pins))


@given(st.sampled_from(list(PARTS)), st.lists(st.tuples(*[st.integers(0, 1)] * 4), max_size=60))
def test_any_levels_on_the_pins(name, pins):
    assert_same_rows(dac_serial.State(), run(name, pins), naive.dac_chip(SHEETS[name], pins))


@by_name
def test_codes_through_the_master_arrive_at_latch_cycles(name):
    """Random codes and both ends of the range, a frame per least period; the output changes exactly when it should."""
    q, p = PARTS[name]
    rng = np.random.default_rng(8811)
    lo, hi = RANGE[name]
    codes = [lo, hi, 0, lo + 1, hi - 1, -1 if lo else 1, 1, *rng.integers(lo, hi + 1, 200).tolist()]
    period = spi_dac.period_cycles(p)
    latch = spi_dac.latch_cycles(p, period)
    load = np.zeros(len(codes) * period, np.int64)
    load[::period] = 1
    code = np.repeat(codes, period)
    # another word on the bus outside the load edge must not matter
    code[load == 0] ^= 1
    enabled = dac_serial.reset(q)._replace(enabled=1, code=q.power_on_code)
    rows = linked(p, spi_dac.State(), q, enabled, load, code, np.zeros_like(load))
    # row n is after edge n: the load edge is k*period, and the output changes `latch` edges later
    updates = np.flatnonzero(rows[:, UPDATED])
    assert updates.tolist() == [k * period + latch for k in range(len(codes)) if k * period + latch < len(load)]
    assert len(updates) == len(codes)
    assert rows[updates, CODE].tolist() == codes
    held = np.repeat([q.power_on_code, *codes], np.diff([0, *updates, len(load)]))
    assert (rows[:, CODE] == held).all(), "nothing but an update changes the output"


def test_sense_dac_stays_at_0_v_until_its_control_word():
    q, p = PARTS["AD5791"]
    load = np.zeros(26 * 5, np.int64)
    load[::26] = 1
    code = np.full(26 * 5, 1000)
    init = np.repeat([0, 0, 1, 0, 0], 26)
    rows = linked(p, spi_dac.State(), q, dac_serial.reset(q), load, code, init)
    on = 2 * 26 + p.bits
    assert not rows[:on, CODE].any()
    assert rows[on, UPDATED]
    assert (rows[on:, CODE] == 1000).all(), "the data register was written behind the clamp"


def test_control_word_before_the_first_data_word_puts_negative_full_scale_out():
    q, p = PARTS["AD5791"]
    load = np.zeros(26 * 3, np.int64)
    load[::26] = 1
    init = np.repeat([1, 0, 0], 26)
    rows = linked(p, spi_dac.State(), q, dac_serial.reset(q), load, np.zeros(26 * 3, np.int64), init)
    first_data = 26 + spi_dac.latch_cycles(p, 26)
    assert (rows[p.bits : first_data, CODE] == -(1 << 19)).all()
    assert not rows[first_data:, CODE].any()


def test_clamp_comes_back_when_the_control_word_asks_for_it():
    word = PARTS["AD5791"][1].control
    on = bits_on_pins(0x100123, 24, ldac=True) + bits_on_pins(word, 24)
    for bit in (2, 3):
        rows = run("AD5791", on + bits_on_pins(word | 1 << bit, 24) + bits_on_pins(word, 24))
        codes = rows[np.flatnonzero(rows[:, UPDATED]), CODE].tolist()
        assert codes == [0, 0x123, 0, 0x123]


@by_name
def test_power_on(name):
    q, _ = PARTS[name]
    s = dac_serial.reset(q)
    assert s.code == {"DAC8811": -32768, "AD5791": 0, "DAC82002": 0}[name]
    assert (s.sync_n, s.ldac_n, s.updated) == (1, 1, 0)


@pytest.mark.parametrize("name", ["AD5791", "DAC82002"])
@pytest.mark.parametrize("length", [0, 1, 16, 23, 25, 32, 48, 24 + 32, 24 + 64])
def test_a_wrong_bit_count_changes_nothing_in_the_24_bit_parts(name, length):
    good = int((SHEETS[name]["header"] + "10" * 12)[:24], 2)
    # the last 24 bits are a good word, so that only the count can tell
    rows = run(name, bits_on_pins(good, length, ldac=True))
    q = dac_serial.reset(PARTS[name][0])
    assert (rows[:, STAGED] == q.staged).all()
    assert (rows[:, CODE] == q.code).all()


def test_drive_dac_takes_the_last_16_bits():
    rows = run("DAC8811", bits_on_pins(0xABC1234, 28))
    assert rows[-1, CODE] == 0x1234 - 0x8000
    # and with fewer, those that were there before move up
    rows = run("DAC8811", bits_on_pins(0xFFFF, 16) + bits_on_pins(0, 4))
    assert rows[-1, CODE] == 0xFFF0 - 0x8000


def test_ldac_held_low_makes_the_sense_dac_transparent():
    pins = [(s, e, d, 0) for s, e, d, _ in bits_on_pins(PARTS["AD5791"][1].control, 24) + bits_on_pins(0x17FFFF, 24)]
    rows = run("AD5791", pins)
    assert rows[-1, CODE] == 0x7FFFF
    updates = np.flatnonzero(rows[:, UPDATED])
    assert len(updates) == 3, "LDAC falls, control word, data word"
    assert rows[updates[-1], SYNC_N] == 1
    assert rows[updates[-1] - 1, SYNC_N] == 0


@by_name
def test_bits_while_sync_is_high_are_not_seen(name):
    rows = run(name, [(1, 1, k & 1, 1) for k in range(40)])
    assert not rows[:, [SHIFT, COUNT, UPDATED]].any()

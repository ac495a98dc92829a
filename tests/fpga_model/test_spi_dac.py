"""SPI master of the DACs: every register, the frames' bits, the latch instant, and the data sheets' pin timing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import spi_dac
from fpga_model.jit import kernel
from testbench.flatten import store
from tests import naive
from tests.fpga_model import spi_timing
from tests.rows import assert_in_formats, assert_same_rows

PARTS = {"DAC8811": spi_dac.DAC8811, "AD5791": spi_dac.AD5791, "DAC82002": spi_dac.DAC82002}
ALL = PARTS | {"divided": spi_dac.DIVIDED, "strobed": spi_dac.STROBED}
by_part = pytest.mark.parametrize("p", PARTS.values(), ids=PARTS)
by_all = pytest.mark.parametrize("p", ALL.values(), ids=ALL)
SHIFT, LEFT, LEAD, SYNC_N, SCLK_EN, LDAC_N, LDAC_WAIT = range(7)


@kernel
def trace(p, s, load, word):
    """Registers before each edge, and after the last one; the data pin beside them."""
    rows = np.empty((len(load) + 1, 7), np.int64)
    data = np.empty(len(load) + 1, np.int64)
    for n in range(len(load)):
        store(rows[n], s)
        data[n] = spi_dac.sdin(p, s)
        s = spi_dac.step(p, s, int(load[n]), int(word[n]))
    store(rows[len(load)], s)
    data[len(load)] = spi_dac.sdin(p, s)
    return rows, data


def run(p, inputs):
    load, word = np.array(inputs, np.int64).reshape(-1, 2).T.copy()
    return trace(p, spi_dac.State(), load, word)


def words(p):
    top = (1 << p.bits) - 1
    return st.one_of(st.sampled_from([0, 1, top >> 1, (top >> 1) + 1, top]), st.integers(0, top))


@st.composite
def loads(draw, p, longest):
    """A frame every so many clocks, also too early, with another word on the bus in between."""
    inputs = []
    for _ in range(draw(st.integers(0, 4))):
        inputs.append((1, draw(words(p))))
        inputs += [(0, draw(words(p)))] * draw(st.integers(0, longest))
    return inputs


@given(st.data(), st.sampled_from(list(ALL)))
def test_step_is_the_documented_equation(data, name):
    p = ALL[name]
    inputs = data.draw(loads(p, 4 * p.bits))
    rows, pins = run(p, inputs)
    assert_same_rows(spi_dac.State(), rows, naive.spi_dac(p.bits, p.lead, p.ldac, inputs, p.gap, p.strobe))
    assert_in_formats(spi_dac.STATE_FMT, rows)
    assert pins.tolist() == [row[SHIFT] >> (p.bits - 1) for row in rows]


@given(*(st.integers(0, n) for n in (3, 1, 3, 1)), st.integers(1, 24), st.integers(0, 2**24 - 1))
def test_any_frame_shape(lead, ldac, gap, strobe, bits, word):
    p = spi_dac.DAC8811._replace(bits=bits, lead=lead, ldac=ldac, gap=gap, strobe=strobe)
    inputs = [(1, word % 2**bits), *[(0, 0)] * (bits * (gap + 1) + 8)]
    rows, _ = run(p, inputs)
    assert_same_rows(spi_dac.State(), rows, naive.spi_dac(bits, lead, ldac, inputs, gap, strobe))


@by_all
def test_one_frame_on_the_pins(p):
    word = 0xA5C30F & ((1 << p.bits) - 1)
    rows, data = run(p, [(0, 0)] * 3 + [(1, word)] + [(0, 0)] * 40)
    low = np.flatnonzero(rows[:, SYNC_N] == 0)
    clocked = np.flatnonzero(rows[:, SCLK_EN])
    divider, end = p.gap + 1, 4 + p.lead + p.bits * (p.gap + 1)
    assert low.tolist() == list(range(4, end)), "SYNC falls with the load edge, and rises behind whole bits"
    assert clocked.tolist() == list(range(4 + p.lead, end, divider)), "one bit per period of SCLK"
    assert int("".join(map(str, data[clocked])), 2) == word, "MSB first"
    pulse = np.flatnonzero(rows[:, LDAC_N] == 0)
    assert pulse.tolist() == ([low[-1] + 2] if p.ldac else [4] if p.strobe else [])
    latch_row = pulse[0] if p.ldac else low[-1] + 1
    assert spi_dac.latch_cycles(p, 50) == (50 if p.strobe else latch_row - 4)


def test_latch_cycles_of_the_board():
    assert [spi_dac.latch_cycles(p, 26) for p in PARTS.values()] == [17, 25, 24]
    assert (spi_dac.PRODUCT_TICK, spi_dac.CODE_TICK, spi_dac.LOAD_TICK) == (0, 1, 2)


@by_all
def test_least_period_is_the_shortest_that_keeps_every_latch_edge(p):
    """SYNC rises, and LDAC where there is one falls, once per frame; one clock less and that edge is lost."""

    def latch_edges(period):
        rows, _ = run(p, ([(1, 1)] + [(0, 0)] * (period - 1)) * 4 + [(0, 0)] * 30)
        pin = rows[:, LDAC_N] if p.ldac else 1 - rows[:, SYNC_N]
        return int((np.diff(pin) == -1).sum())  # with strobe LDAC falls with each load: what counts is SYNC

    assert latch_edges(spi_dac.period_cycles(p)) == 4
    assert latch_edges(spi_dac.period_cycles(p) - 1) == 1


@pytest.mark.parametrize("code", [-32768, -32767, -1, 0, 1, 32767])
def test_drive_word_is_offset_binary(code):
    assert spi_dac.frame(spi_dac.DAC8811, code, 0) == code + 32768
    assert spi_dac.frame(spi_dac.DAC8811, code, 1) == code + 32768, "it has no control register"


@pytest.mark.parametrize("code", [-(1 << 19), -1, 0, 1, (1 << 19) - 1])
def test_sense_word_is_write_address_001_and_twos_complement(code):
    word = spi_dac.frame(spi_dac.AD5791, code, 0)
    assert f"{word:024b}"[:4] == "0001"
    assert word & 0xFFFFF == code % (1 << 20)


def test_sense_control_word():
    """Write, address 010; LIN COMP 1100, SDODIS 0, BIN/2sC 0, DACTRI 0, OPGND 0, RBUF 1, reserved 0."""
    word = spi_dac.frame(spi_dac.AD5791, 12345, 1)
    assert f"{word:024b}" == "0010" + "0000000000" + "1100" + "0" + "0" + "0" + "0" + "1" + "0"


@pytest.mark.parametrize("code", [-16, -1, 0, 1, 15])
def test_code_between_command_and_tail(code):
    """Command 10, the code in offset binary, a tail of one bit that is 0."""
    assert f"{spi_dac.frame(spi_dac.STROBED, code, 0):08b}" == f"10{code + 16:05b}0"


@pytest.mark.parametrize("code", [0, 1, 32767, 32768, 65535])
def test_quadrature_word_writes_register_8_in_straight_binary(code):
    assert spi_dac.frame(spi_dac.DAC82002, code, 0) == 0x080000 | code


def limits_kept(p, period):
    return {name: ok for name, _, _, ok in spi_timing.timing_report(p, period)}


def test_pin_timing_of_the_default_board_is_within_the_data_sheets():
    for p, period in (
        (spi_dac.DAC8811, spi_timing.DRIVE_PERIOD_CYCLES),
        (spi_dac.AD5791, spi_timing.SENSE_PERIOD_CYCLES),
        (spi_dac.DAC82002, spi_timing.QUADRATURE_PERIOD_CYCLES),
    ):
        assert all(limits_kept(p, period).values()), spi_timing.timing_report(p, period)


def test_quadrature_dac_at_1_mhz_breaks_its_sync_high_time_and_nothing_else():
    report = spi_timing.timing_report(spi_dac.DAC82002, 26)
    assert [(name, limit) for name, _, limit, ok in report if not ok] == [("SYNC high", 160)]
    actual = {name: ns for name, ns, _, _ in report}
    assert actual["SYNC high"] == pytest.approx(2 / 26e6 * 1e9)
    assert actual["update to update"] == 1000


@by_part
def test_report_agrees_with_the_pins(p):
    """The intervals of the report, measured on the trace of two frames."""
    period = 52
    rows, _ = run(p, ([(1, 0x555555 >> (24 - p.bits))] + [(0, 0)] * (period - 1)) * 2)
    tc = 1e9 / 26e6
    sync, ldac = rows[:, SYNC_N], rows[:, LDAC_N]
    falls = np.flatnonzero((sync[1:] == 0) & (sync[:-1] == 1)) + 1
    rises = np.flatnonzero((sync[1:] == 1) & (sync[:-1] == 0)) + 1
    clocked = np.flatnonzero(rows[:, SCLK_EN])
    sampled = clocked + 0.5
    measured = {
        "SCLK period": tc * np.diff(clocked).min(),
        "SYNC high": tc * (falls[1] - rises[0]),
        "update to update": tc * (rises[1] - rises[0]),
        "SDIN setup": tc / 2,
        "SDIN hold": tc / 2,
        "SCLK high": tc / 2,
        "SCLK low": tc / 2,
    }
    for chip_select in ("CS", "SYNC"):
        measured[f"{chip_select} fall to first SCLK edge"] = tc * (sampled[0] - falls[0])
        measured[f"last SCLK edge to {chip_select} rise"] = tc * (rises[0] - sampled[sampled < rises[0]][-1])
    if p.ldac:
        drop = np.flatnonzero((ldac[1:] == 0) & (ldac[:-1] == 1))[0] + 1
        measured["SYNC rise to LDAC fall"] = tc * (drop - rises[0])
        measured["LDAC low"] = tc * (np.flatnonzero(ldac[drop:])[0])
    for name, actual, limit, ok in spi_timing.timing_report(p, period):
        assert actual == pytest.approx(measured[name]), name
        assert ok == (actual >= limit)


@by_part
def test_frames_may_not_overlap(p):
    spi_timing.timing_report(p, spi_dac.period_cycles(p))
    with pytest.raises(ValueError, match="period_clocks"):
        spi_timing.timing_report(p, spi_dac.period_cycles(p) - 1)

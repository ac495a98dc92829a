"""Sine: every register, the error bound on every cell of the phase, symmetry, and spurs against the derived bound."""

import math
from fractions import Fraction
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import sine
from fpga_model.design_record import DEFAULT
from fpga_model.jit import DISABLED, kernel
from testbench.flatten import store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows

TURN = 1 << 48
CELL_BITS = 22
CELLS = 1 << CELL_BITS
WAVE = naive.quarter_sine(10)
sweep = pytest.mark.skipif(DISABLED, reason="millions of clocks are for the compiled kernel")


@kernel
def trace(s, phases):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(phases) + 1, 8), np.int64)
    for n in range(len(phases)):
        store(rows[n], s)
        s = sine.step(DEFAULT, sine.ROM, s, int(phases[n]))
    store(rows[len(phases)], s)
    return rows


@kernel
def tone(s, word, start, count):
    """`count` outputs of a phase that advances by `word` from `start`."""
    y = np.empty(count, np.int64)
    phase = start
    for n in range(count + sine.LATENCY):
        if n >= sine.LATENCY:
            y[n - sine.LATENCY] = s.y
        s = sine.step(DEFAULT, sine.ROM, s, phase)
        phase = (phase + word) & ((1 << 48) - 1)
    return y


@pytest.fixture(scope="module")
def every_cell():
    """y of every cell of the cut phase, in order."""
    return tone(sine.State(), TURN >> CELL_BITS, 0x2ABCDEF, CELLS)


corners = [
    (base + d) % TURN
    for base in (*(k * TURN // 8 for k in range(8)), TURN // 4096, TURN // 2 - TURN // 4096)
    for d in (-(1 << 26), -1, 0, 1, 1 << 26, 1 << 36)
]
phases = st.one_of(st.sampled_from(corners), st.integers(0, TURN - 1))


@given(st.lists(phases, max_size=20))
def test_step_is_the_documented_equation(inputs):
    rows = trace(sine.State(), np.array(inputs, np.int64))
    assert_same_rows(sine.State(), rows, naive.sine_rows(inputs, WAVE, 2**17 - 1))
    assert_in_formats(sine.STATE_FMT, rows)


@kernel
def closed(phases):
    y = np.empty(len(phases), np.int64)
    for n in range(len(phases)):
        y[n] = sine.phase_sine(DEFAULT, sine.ROM, int(phases[n]))
    return y


@given(st.lists(phases, min_size=4, max_size=20))
def test_closed_form_is_the_pipeline(inputs):
    rows = trace(sine.State(), np.array(inputs, np.int64))
    y = list(sine.State._fields).index("y")
    assert rows[sine.LATENCY :, y].tolist() == closed(np.array(inputs, np.int64))[: len(rows) - sine.LATENCY].tolist()


def test_every_table_row():
    """Both ends of each of the 1024 steps, in all four quadrants."""
    step = TURN // 4096
    inputs = [k * step + d for k in range(4096) for d in (0, step - 1)]
    rows = trace(sine.State(), np.array(inputs, np.int64))
    assert_same_rows(sine.State(), rows, naive.sine_rows(inputs, WAVE, 2**17 - 1))


def test_tables_are_the_sine_to_all_their_bits():
    with mpmath.workprec(200):
        full = 2**17 - 1
        exact = [full * mpmath.sin(mpmath.pi / 2 * k / 1024) for k in range(1025)]
        assert list(sine.tables()[0]) == [int(mpmath.nint(x * 64)) for x in exact[:-1]]
        assert list(sine.tables()[1]) == [int(mpmath.nint((b - a) * 32)) for a, b in pairwise(exact)]
    assert sine.ROM.tolist() == [b * 2**13 + s for b, s in zip(*sine.tables())]


def test_latency_from_phase_to_y():
    inputs = np.zeros(12, np.int64)
    inputs[4] = TURN // 4
    y = trace(sine.State(), inputs)[:, -1]
    assert np.flatnonzero(y > 1000).tolist() == [4 + sine.LATENCY]
    assert y[4 + sine.LATENCY] == 2**17 - 1


def test_bound_is_the_sum_of_its_derived_parts():
    """Chord of a sine over a step h: h**2/8; tables and output: half an LSB of each."""
    step = math.pi / 2 / 1024
    total = (2**17 - 1) * step**2 / 8 + 2**-7 + 2**-6 + 0.5
    assert float(sine.MAX_ERROR_LSB) == pytest.approx(total, rel=1e-6)
    assert total < sine.MAX_ERROR_LSB < Fraction("0.563")


@sweep
def test_error_on_every_cell_is_within_the_bound(every_cell):
    middle = (np.arange(CELLS) + 0.5) / CELLS
    error = every_cell - (2**17 - 1) * np.sin(2 * np.pi * middle)
    worst = np.argmax(np.abs(error))
    # double precision is good to 1e-9 LSB here; the worst cells are judged again with 40 digits
    assert abs(error[worst]) <= float(sine.MAX_ERROR_LSB) + 1e-9
    assert abs(error[worst]) > 0.5, "rounding alone reaches half an LSB, so the comparison is real"
    with mpmath.workdps(40):
        for k in np.argsort(-np.abs(error))[:50].tolist():
            exact = (2**17 - 1) * mpmath.sin(2 * mpmath.pi * (mpmath.mpf(k) + 0.5) / CELLS)
            assert (
                abs(int(every_cell[k]) - exact)
                <= mpmath.mpf(sine.MAX_ERROR_LSB.numerator) / sine.MAX_ERROR_LSB.denominator
            )
    # rounding is uniform over an LSB; the systematic rest adds at most its bound
    assert np.sqrt(np.mean(error**2)) <= math.sqrt(1 / 12) + float(sine.MAX_ERROR_LSB - sine.ROUNDING_LSB)


@sweep
def test_symmetry_of_every_cell(every_cell):
    half, quarter = CELLS // 2, CELLS // 4
    assert (every_cell[half:] == -every_cell[:half]).all()
    assert (every_cell[:half] == every_cell[:half][::-1]).all(), "so the mean phase is exactly the middle of the cell"
    assert every_cell.max() == 2**17 - 1 == -every_cell.min()
    assert every_cell[quarter] == every_cell[quarter - 1] == 2**17 - 1


@given(st.integers(0, TURN - 1))
def test_sine_of_half_a_turn_more_is_minus_sine(phase):
    y = trace(sine.State(), np.array([phase, (phase + TURN // 2) % TURN, 0, 0], np.int64))[:, -1]
    assert y[3] == -y[4]


SPUR_BOUND = 4 / math.pi * float(sine.MAX_ERROR_LSB + sine.PHASE_CUT_LSB) / (2**17 - 1)


def sideband_lsb():
    """The chord error repeats 4096 times a turn: half its first Fourier line, h**2/8 * 4/pi**2, on either side."""
    return (2**17 - 1) * (math.pi / 2 / 1024) ** 2 / 8 * 4 / math.pi**2 / 2


def rounding_line_lsb(count):
    """Standard deviation of one line of uniform rounding errors, mean square 1/12, over the count/4 odd lines."""
    return math.sqrt(2 / (3 * count))


def test_spur_bound_in_decibels():
    """No line of an error that stays within E is higher than 4/pi E, the fundamental of a square wave."""
    assert 20 * math.log10(SPUR_BOUND) == pytest.approx(-103.8, abs=0.1)


@sweep
@pytest.mark.parametrize("odd", [1, 3, 443, 65_537, 131_071, 99_991])
def test_spurs_of_whole_periods(odd):
    """2**18 outputs are a whole number of periods, so a line is one bin and the FFT needs no window."""
    count = 1 << 18
    y = tone(sine.State(), odd * (TURN // count), 12345, count)
    lines = np.abs(np.fft.rfft(y)) * 2 / count
    assert lines.argmax() == odd
    # sine table and rounding scale the carrier by less than the bound
    assert abs(lines[odd] - (2**17 - 1)) <= (2**17 - 1) * SPUR_BOUND
    lines[odd] = 0
    assert lines.max() <= (2**17 - 1) * SPUR_BOUND
    assert lines.max() <= sideband_lsb() + 6 * rounding_line_lsb(count), "what the tables and rounding should leave"
    assert lines[0::2].max() < 1e-6, "a sine that is odd about 0 and even about a quarter turn has odd lines only"


@sweep
@pytest.mark.parametrize("hz", [10_930, 11_002.3, 3_249_999.7, 9_876_543.21])
def test_spurs_of_any_frequency(hz):
    """A Kaiser window with side lobes below -140 dB shows the spurs that cutting the phase makes."""
    count = 1 << 18
    word = round(hz * TURN / 26e6) | 1
    window = np.kaiser(count, 20)
    lines = np.abs(np.fft.rfft(tone(sine.State(), word, 0, count) * window)) * 2 / window.sum()
    carrier = round(hz / 26e6 * count)
    lines[max(carrier - 12, 0) : carrier + 13] = 0
    assert lines.max() <= (2**17 - 1) * SPUR_BOUND

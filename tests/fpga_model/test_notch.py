"""The notch: every register at every clock, its gain against the ideal filter, and what `design` refuses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import freqz, iirnotch

from fpga_model import block, control, notch, top
from fpga_model.fixed import half_up
from fpga_model.rates import FRAME_HZ
from testbench.config import Config, changed
from testbench.run import build
from tests import naive
from tests.fpga_model.records import assert_rows, rows

CORNERS = [notch.WORD.lo, notch.WORD.lo + 1, -1, 0, 1, notch.WORD.hi - 1, notch.WORD.hi]
words = st.one_of(st.sampled_from(CORNERS), st.integers(notch.WORD.lo, notch.WORD.hi))
inputs = st.lists(st.tuples(st.sampled_from([0, 1, 1]), words), max_size=60)
coefs = st.integers(notch.COEF.lo, notch.COEF.hi)


def run(p, given, s=None):
    return rows(lambda s, *i: notch.step(p, s, *i), s or notch.State(), given)


@pytest.mark.parametrize("p", notch.BLOCK.cases.values(), ids=notch.BLOCK.cases)
@given(given=inputs)
def test_step_is_the_documented_equation(p, given):
    assert_rows(run(p, given), naive.notch(*p, given), notch.STATE_FMT)


@given(coefs, coefs, inputs)
def test_any_coefficients(g, c, given):
    assert_rows(run(notch.Params(g, c), given), naive.notch(g, c, given), notch.STATE_FMT)


@given(st.integers(notch.Y_LO, notch.Y_HI))
def test_out_is_the_rounded_word(y1):
    found = notch.out(notch.State(y1=y1))
    assert found == naive.rounded("half_up", naive.Fraction(y1, 1 << notch.SHIFT))
    assert notch.WORD.holds(found)


@pytest.mark.parametrize(("centre_hz", "width_hz"), [(139.0, 20.0), (25.0, 2.0), (1500.0, 900.0)])
def test_gain_is_that_of_the_filter(centre_hz, width_hz):
    p = notch.design(centre_hz, width_hz)
    g, c = p.g / notch.ONE, p.c / notch.ONE
    tones_hz = np.array([0.01, centre_hz - width_hz / 2, centre_hz, centre_hz + width_hz / 2, 3999.0])
    own = freqz([g, c, g], [1, c, 2 * g - 1], tones_hz, fs=FRAME_HZ)[1]
    wanted = freqz(*iirnotch(centre_hz, centre_hz / width_hz, fs=FRAME_HZ), tones_hz, fs=FRAME_HZ)[1]
    # half an LSB of g and of c move the zero by this much; the gain falls by 2 / width around it
    moved_hz = FRAME_HZ / (2 * math.pi) * 2.0**-notch.COEF.f / math.sin(2 * math.pi * centre_hz / FRAME_HZ)
    assert np.max(np.abs(own - wanted)) < 2 * moved_hz / width_hz + 1e-6
    assert abs(own[0]) == pytest.approx(1, abs=1e-8)


def test_a_tone_at_the_centre_goes_and_a_constant_stays():
    p, count = notch.design(139.0), 8000
    tone = [round(300_000 * math.sin(2 * math.pi * 139.0 * n / FRAME_HZ)) for n in range(count)]
    out = [half_up(row[2], notch.SHIFT) for row in naive.notch(*p, [(1, 100_000 + word) for word in tone])]
    assert max(abs(word - 100_000) for word in out[-800:]) <= 30
    rest = naive.notch(*p, [(1, -77_777)] * 4000)[-1]
    assert half_up(rest[2], notch.SHIFT) == -77_777


def test_a_constant_within_one_lsb_is_kept():
    """The dead band of y, half a step of its format over 1 + c + d, is below a twentieth of a word."""
    p = notch.design(139.0)
    sum_of_feedback = 1 + p.c / notch.ONE + 2 * p.g / notch.ONE - 1
    assert 0.5 / sum_of_feedback / (1 << notch.SHIFT) < 0.05


@pytest.mark.parametrize(
    ("centre_hz", "width_hz", "name"),
    [
        (0.0, 20.0, "notch_hz"),
        (2000.0, 20.0, "notch_hz"),
        (139.0, 139.0, "notch_width_hz"),
        (139.0, 0.0, "notch_width"),
    ],
)
def test_design_refuses(centre_hz, width_hz, name):
    with pytest.raises(ValueError, match=rf"{name}.* Hz is outside 0 \.\. "):
        notch.design(centre_hz, width_hz)


def test_off_it_is_absent():
    """Neither a parameter nor a register; on, four registers behind all others."""
    off, on = (build.firmware(changed(Config(), {"firmware.notch_hz": hz})) for hz in (0.0, 139.0))
    assert off.control.notch is None
    assert block.reset(top.State(), off) == top.State()
    names = [path for path, _ in block.leaves(block.reset(top.State(), on))]
    assert names[:-4] == [path for path, _ in block.leaves(top.State())]
    assert names[-4:] == [f"control.notch.{name}" for name in notch.State._fields]


def test_its_slot_comes_between_the_word_and_the_rate_output():
    assert control.SLOT_PI + 1 < control.SLOT_NOTCH < control.rates.SLOT_ROOT

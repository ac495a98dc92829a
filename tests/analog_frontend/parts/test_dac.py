"""Static DAC: straight line, bow and glitch against their formulas; ideal by default."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.parts import dac

CODES = st.integers(-(1 << 15), (1 << 15) - 1)


@given(CODES)
def test_an_ideal_dac_is_a_straight_line(code):
    p = dac.design(16, 10.0)
    assert dac.volts(p, code) == pytest.approx(code * 10.0 / 32768, rel=1e-15)


@given(CODES)
def test_a_bow_is_zero_at_the_ends_and_largest_in_the_middle(code):
    p, ideal = dac.design(16, 10.0, bow=1e-4), dac.design(16, 10.0)
    assert dac.volts(p, code) - dac.volts(ideal, code) == pytest.approx(1e-3 * (1 - (code / 32768) ** 2), abs=1e-14)


@given(CODES, CODES)
def test_glitches_count_the_segments_crossed(a, b):
    p = dac.design(16, 10.0, glitch_v_s=2e-9, segment_bits=12)
    borders = len([k for k in range(-8, 9) if min(a, b) < k * 4096 <= max(a, b)])
    assert dac.glitch(p, a, b) == pytest.approx(2e-9 * borders * (1 if b >= a else -1), abs=1e-24)
    assert dac.glitch(dac.design(16, 10.0), a, b) == 0.0


@pytest.mark.parametrize(
    ("bits", "span", "bow", "text"),
    [(7, 10.0, 0.0, "bits"), (16, 0.0, 0.0, "span_v"), (16, 30.0, 0.0, "span_v"), (16, 10.0, 0.1, "bow")],
)
def test_what_cannot_be_is_refused(bits, span, bow, text):
    with pytest.raises(ValueError, match=text):
        dac.design(bits, span, bow=bow)

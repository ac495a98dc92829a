"""Static DAC: straight line, bow and glitch against their formulas; ideal by default."""

import math

import numpy as np
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
    ("instant_s", "poles_s"),
    [(0.731e-6, (100e-9, 40e-9, 40e-9)), (0.168e-6, (68e-9, 16e-9, 40e-9)), (0.95e-6, (300e-9, 40e-9, 41e-9))],
)
def test_the_mean_of_an_electrode_stands_at_its_share_between_both_ends(instant_s, poles_s):
    """A staircase of 11 kHz through three poles, by steps of 1 ns; what is left is of second order in the slope."""
    turn, h, taus = 2 * math.pi * 11e3 * 1e-6, 1e-9, np.array(poles_s)
    s, level, ends, means = np.zeros(3), 0.0, [], []
    for tick in range(40):
        rows = []
        for k in range(1000):
            if k == round(instant_s / h):
                level = math.cos(turn * tick)
            rows.append(s[2])
            # each pole follows the middle of what drives it
            for n, tau in enumerate(taus):
                s[n] += (1 - math.exp(-h / tau)) * ((level if n == 0 else s[n - 1]) - s[n])
        ends.append(rows[0])
        means.append(np.mean(rows))
    first, last, mean = np.array(ends[20:-1]), np.array(ends[21:]), np.array(means[20:-1])
    share = dac.end_share(instant_s, poles_s, 1e-6)
    off, straight = (np.max(np.abs(mean - (1 - e) * first - e * last)) for e in (share, 0.5))
    assert off < turn**2 / 4
    assert straight > 5 * off


@pytest.mark.parametrize(
    ("bits", "span", "bow", "text"),
    [(7, 10.0, 0.0, "bits"), (16, 0.0, 0.0, "span_v"), (16, 30.0, 0.0, "span_v"), (16, 10.0, 0.1, "bow")],
)
def test_what_cannot_be_is_refused(bits, span, bow, text):
    with pytest.raises(ValueError, match=text):
        dac.design(bits, span, bow=bow)

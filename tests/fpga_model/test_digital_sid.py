"""The digital demodulator: every register at every clock, its gain in codes per volt, its three poles."""

import cmath
import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import digital_sid
from fpga_model.jit import kernel
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

P = digital_sid.design()
RESET = digital_sid.State()
X_SIN, X_COS, Y_SIN, Y_COS = range(4)

edge = st.tuples(
    st.sampled_from([0, 1]),
    st.sampled_from([0, 0, 0, 1]),
    st.integers(0, 15),
    st.one_of(st.sampled_from([0, 7]), raws(digital_sid.SAMPLE)),
    st.one_of(st.sampled_from([0, 7]), raws(digital_sid.SAMPLE)),
)


@kernel
def frames(p, s, x, y, refs):
    """Codes after each dump; one column of samples and references per frame, and 5 clocks for the poles."""
    codes = np.empty((len(x), 4), np.int64)
    for n in range(len(x)):
        for k in range(x.shape[1]):
            s = digital_sid.step(p, s, 1, 1 if k == 0 else 0, int(refs[n, k]), int(x[n, k]), int(y[n, k]))
            if k == 0:
                for _ in range(5):
                    s = digital_sid.step(p, s, 0, 0, 0, 0, 0)
                for lane in range(4):
                    codes[n, lane] = s.codes[lane]
    return codes


def constant(p, value, count, refs=15, reset=RESET):
    """Codes of `count` frames of one sample value."""
    samples = np.full((count, 125), value, np.int64)
    return frames(p, reset, samples, samples, np.full((count, 125), refs, np.int64))


params = st.builds(
    digital_sid.Params,
    st.one_of(st.just(P.alpha), raws(digital_sid.ALPHA)),
    st.one_of(st.just(P.gain_x), raws(digital_sid.GAIN)),
    st.one_of(st.just(P.gain_y), raws(digital_sid.GAIN)),
    st.integers(0, digital_sid.MAX_DELAY),
    st.sampled_from([0, 1, 2, 5, P.still]),
)


@given(params, st.lists(edge, max_size=60))
def test_step_is_the_documented_equation(p, inputs):
    found = rows(lambda s, *i: digital_sid.step(p, s, *i), RESET, inputs)
    gains = [Fraction(g, 2**17) for g in (p.gain_x, p.gain_x, p.gain_y, p.gain_y)]
    expected = naive.digital_sid(Fraction(p.alpha, 2**20), gains, p.ref_delay, p.still, inputs)
    assert_rows(found, expected, digital_sid.STATE_FMT)


@pytest.mark.parametrize("sample", [digital_sid.SAMPLE.lo, digital_sid.SAMPLE.hi])
def test_a_sum_that_is_never_dumped_saturates(sample):
    inputs = [(1, 0, 5, sample, sample)] * 140 + [(1, 1, 0, 0, 0), (0, 0, 0, 0, 0)]
    p = P._replace(ref_delay=0, gain_x=digital_sid.GAIN.hi, alpha=digital_sid.ALPHA.hi)
    found = rows(lambda s, *i: digital_sid.step(p, s, *i), RESET, inputs)
    gains = [Fraction(g, 2**17) for g in (p.gain_x, p.gain_x, p.gain_y, p.gain_y)]
    assert_rows(found, naive.digital_sid(Fraction(p.alpha, 2**20), gains, 0, p.still, inputs), digital_sid.STATE_FMT)
    assert set(found[140].acc) == {digital_sid.ACC.lo, digital_sid.ACC.hi}


def test_codes_saturate_at_the_ends_of_24_bits():
    assert constant(P, digital_sid.SAMPLE.hi, 200)[-1].tolist() == [2**23 - 1] * 4
    assert constant(P, digital_sid.SAMPLE.lo, 200)[-1].tolist() == [-(2**23)] * 4


def test_latency():
    found = rows(lambda s, *i: digital_sid.step(P, s, *i), RESET, [(1, 1, 0, 0, 0)] + [(0, 0, 0, 0, 0)] * 6)
    assert [s.valid for s in found] == [int(n == digital_sid.LATENCY) for n in range(8)]


@pytest.mark.parametrize("frozen", [(1, 0), (0, 1), (1, 1), (0, 0)])
def test_a_frozen_sample_makes_the_frame_invalid(frozen):
    """`still` ticks after the last change, whichever sample it is, and valid again with the first that moves."""
    p = P._replace(still=300)
    ticks = [(1, int(n % 125 == 0), 0, 0 if frozen[0] else n % 9, 5 if frozen[1] else -(n % 7)) for n in range(1001)]
    ticks = [row for tick in ticks for row in (tick, *[(0, 0, 0, 0, 0)] * 4)]
    found = rows(
        lambda s, *i: digital_sid.step(p, s, *i), RESET, ticks + [(1, 0, 0, 8, 9), (1, 1, 0, 9, 8)] + ticks[1:5]
    )
    said = [s.ok for s in found if s.valid]
    assert said == ([1, 1, 1] + [0] * 6 + [1] if any(frozen) else [1] * 10)


def test_dc_gain_to_1e_5():
    """Full-scale mean of sign x sample: code = mean volts * 2 * PGA / 4 V * 2**23, after the poles have settled."""
    settled = 8000  # one second is 300 time constants
    for p, lane, pga in ((P, X_SIN, 1), (P, Y_COS, 12)):
        largest = 0.9 * 4.0 / (2 * pga)
        sample = round(largest / 5 * 2**17)
        code = constant(p, sample, settled)[-1][lane]
        expected = sample / 2**17 * 5 * 2 * pga / 4 * 2**23
        assert abs(code / expected - 1) < 1e-5


def test_code_per_volt_is_that_of_the_analogue_board():
    """A 1 V sine in phase gives 4/pi * 2**23 / 4: the same code as the switched capacitors and the ADC give."""
    volts, f, count = 1.0, 11002.3, 1600
    n = np.arange(-125, 125 * (count - 1)).reshape(count, 125)
    turns = n * (f / 1e6)
    x = np.round(volts * np.sin(2 * np.pi * turns) / 5 * 2**17).astype(np.int64)
    sin_bit = (turns % 1 < 0.5).astype(np.int64)
    cos_bit = ((turns + 0.25) % 1 < 0.5).astype(np.int64)
    refs = (sin_bit | cos_bit << 1) * 5
    p = P._replace(ref_delay=0)
    codes = frames(p, RESET, x, np.zeros_like(x), refs)[-400:]
    expected = volts * 4 / math.pi / 4 * 2**23
    # 1 us sampling moves a mean edge by less than one part in 11e3 Hz * 1 us / 2 per crossing; they average out
    assert np.mean(codes[:, X_SIN]) == pytest.approx(expected, rel=2e-4)
    assert np.abs(np.mean(codes[:, X_COS])) < 2e-4 * expected


def test_references_are_those_of_the_aperture():
    """With a delay of d ticks the sample that arrives now is weighed with the reference of d ticks ago."""
    for d in range(digital_sid.MAX_DELAY + 1):
        p = P._replace(ref_delay=d)
        inputs = [(1, 0, 15, 0, 0)] + [(1, 0, 0, int(k == d), 0) for k in range(1, 6)]
        # the reference was 1 in tick 0 only, the sample arrives in tick d
        if d == 0:
            inputs[0] = (1, 0, 15, 1, 0)
        last = rows(lambda s, *i, p=p: digital_sid.step(p, s, *i), RESET, inputs)[-1]
        assert last.acc[X_SIN] == 1


def test_three_poles_at_50_hz():
    """From the impulse response: each pole takes what alpha = 1 - exp(-2 pi 50 / 8000) takes, -3 dB at 50 Hz."""
    step = constant(P, 50_000, 800)[:, X_SIN].astype(float)
    impulse = np.diff(step, prepend=0.0)
    n = np.arange(len(impulse))
    response = abs(np.sum(impulse * np.exp(-2j * np.pi * 50 / 8000 * n))) / step[-1]
    p = math.exp(-2 * math.pi * 50 / 8000)
    exact = abs((1 - p) / (1 - p * cmath.exp(-2j * math.pi * 50 / 8000))) ** 3
    # each of 800 differences errs by less than one code of 8e6
    assert response == pytest.approx(exact, abs=800 / step[-1])
    assert 20 * math.log10(exact) == pytest.approx(3 * -3.0103, abs=0.005)


def test_alpha_is_the_exact_map():
    alpha = digital_sid.alpha_of_hz(50, 8000)
    assert abs(alpha - Decimal(-math.expm1(-2 * math.pi * 50 / 8000))) < Decimal("1e-16")
    assert P.alpha == round(alpha * 2**20)
    assert (P.gain_x, P.gain_y) == (round(Fraction(128, 100) * 2**17), round(Fraction(1536, 100) * 2**17))


@pytest.mark.parametrize(
    "wrong",
    [
        {"pole_hz": 0},
        {"pole_hz": 2000},
        {"ref_delay_ticks": 5},
        {"samples_per_dump": 129},
        {"pga_y": 13},
    ],
)
def test_design_refuses(wrong):
    with pytest.raises(ValueError, match=r"pole_hz|ref_delay_ticks|samples_per_dump|gain_y"):
        digital_sid.design(**wrong)

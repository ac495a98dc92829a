"""Every rounding and overflow rule on every value of small formats, the formats' algebra, and values near 2**61."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import fixed
from fpga_model.fixed import Fmt
from fpga_model.rounding_aliases import ALIASES
from tests import naive

RULES = sorted(fixed.ROUNDINGS)

SMALL = [Fmt(s, i, f) for s in (0, 1) for i in range(-1, 4) for f in range(-1, 4) if 1 <= s + i + f <= 4 and i + f >= 0]
FORMATS = st.builds(Fmt, st.integers(0, 1), st.integers(-3, 12), st.integers(3, 12))


# Rounding -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", RULES)
def test_rounding_of_every_value_from_minus_40_to_40(rule):
    func = fixed.ROUNDINGS[rule]
    for n in range(7):
        for raw in range(-40 << n, (40 << n) + 1):
            assert func(raw, n) == naive.rounded(rule, Fraction(raw, 1 << n)), (raw, n)


@pytest.mark.parametrize("rule", RULES)
def test_rounding_near_the_ends_of_int64(rule):
    func = fixed.ROUNDINGS[rule]
    for n in range(63):
        half = (1 << n) >> 1
        for base in (1 << 61, -(1 << 61), (1 << 62) - (1 << n), -(1 << 62) + (1 << n), 0):
            for raw in {base + k + d for k in (0, half, -half) for d in (-2, -1, 0, 1, 2)}:
                if abs(raw) <= 1 << 62:
                    assert func(raw, n) == naive.rounded(rule, Fraction(raw, 1 << n)), (raw, n)


@pytest.mark.parametrize("rule", RULES)
@given(raw=st.integers(-(1 << 62), 1 << 62), n=st.integers(0, 62))
def test_rounding_of_any_value(rule, raw, n):
    assert fixed.ROUNDINGS[rule](raw, n) == naive.rounded(rule, Fraction(raw, 1 << n))


# Aliases of other tools ---------------------------------------------------------------------------------------------


def test_aliases_name_rules_of_ours_and_leave_none_out():
    assert set(ALIASES.values()) == set(fixed.ROUNDINGS)
    assert {key.partition(":")[0] for key in ALIASES} == {
        "apytypes", "cl_fix", "ap_fixed", "fixed_pkg", "fpbinary", "sel", "fxpmath", "numfi", "matlab_fi", "verilog",
        "python",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("tool", "count"),
    [("apytypes", 8), ("cl_fix", 6), ("ap_fixed", 7), ("fixed_pkg", 2), ("fpbinary", 5), ("sel", 6), ("fxpmath", 5),
     ("numfi", 6), ("matlab_fi", 6), ("verilog", 4), ("python", 9)],
)  # fmt: skip
def test_aliases_hold_every_rule_of_a_tool(tool, count):
    assert sum(key.startswith(tool + ":") for key in ALIASES) == count


@pytest.mark.parametrize(
    ("name", "rule"),
    [("matlab_fi:Nearest", "half_up"), ("numfi:Nearest", "half_away"), ("sel:nearest", "half_up"),
     ("fxpmath:trunc", "toward_zero"), ("cl_fix:Trunc_s", "floor"), ("fixed_pkg:fixed_round", "half_even"),
     ("numfi:Convergent", "half_away"), ("sel:convergent", "half_even"), ("matlab_fi:Convergent", "half_even")],
)  # fmt: skip
def test_words_that_mean_different_rules_in_different_tools(name, rule):
    assert ALIASES[name] == rule


# Overflow -----------------------------------------------------------------------------------------------------------


def test_clamp_of_every_value_and_limit_from_minus_40_to_40():
    for lo, hi in itertools.combinations_with_replacement(range(-40, 41, 4), 2):
        for x in range(-40, 41):
            assert fixed.clamp(x, lo, hi) == sorted((lo, x, hi))[1]


def test_wraps_on_every_value_of_small_widths():
    for width in range(7):
        for x in range(-300, 301):
            assert fixed.wrap_unsigned(x, width) == naive.congruent_within(x, 2**width, 0)
            if width:
                assert fixed.wrap(x, width) == naive.congruent_within(x, 2**width, -(2 ** (width - 1)))


@pytest.mark.parametrize("width", [1, 2, 24, 31, 32, 33, 48, 60, 61, 62])
def test_wraps_near_two_to_the_61(width):
    for x in (s * (1 << 61) + d for s in (-1, 1) for d in range(-3, 4)):
        assert fixed.wrap_unsigned(x, width) == naive.congruent_within(x, 2**width, 0)
        assert fixed.wrap(x, width) == naive.congruent_within(x, 2**width, -(2 ** (width - 1)))
        assert fixed.clamp(x, -(1 << 61), 1 << 61) == sorted((-(1 << 61), x, 1 << 61))[1]


# Formats ------------------------------------------------------------------------------------------------------------


def test_small_formats_are_what_the_definition_says():
    for fmt in SMALL:
        values = naive.format_values(*fmt)
        assert len(values) == 1 << fmt.width
        raws = range(fmt.lo, fmt.hi + 1)
        assert [fixed.to_real(raw, fmt) for raw in raws] == values
        assert [fmt.holds(raw) for raw in (fmt.lo - 1, fmt.lo, fmt.hi, fmt.hi + 1)] == [False, True, True, False]
        assert [fixed.quantize(value, fmt) for value in values] == list(raws)


def test_products_sums_and_differences_fit_their_formats():
    values = {fmt: naive.format_values(*fmt) for fmt in SMALL}
    for a, b in itertools.product(SMALL, repeat=2):
        # results are monotone in each operand: the corners give the range, the other pairs the resolution
        corners = itertools.product(values[a][:1] + values[a][-1:], values[b][:1] + values[b][-1:])
        for x, y in itertools.chain(corners, zip(values[a], itertools.cycle(values[b]), strict=False)):
            assert naive.in_format(x * y, *fixed.mul_fmt(a, b)), (x, y, a, b)
            assert naive.in_format(x + y, *fixed.add_fmt(a, b)), (x, y, a, b)
            assert naive.in_format(x - y, *fixed.sub_fmt(a, b)), (x, y, a, b)


def test_every_pair_of_values_of_the_smallest_formats():
    tiny = [fmt for fmt in SMALL if fmt.width <= 3]
    for a, b in itertools.product(tiny, repeat=2):
        for x, y in itertools.product(naive.format_values(*a), naive.format_values(*b)):
            assert naive.in_format(x * y, *fixed.mul_fmt(a, b)), (x, y, a, b)
            assert naive.in_format(x + y, *fixed.add_fmt(a, b)), (x, y, a, b)
            assert naive.in_format(x - y, *fixed.sub_fmt(a, b)), (x, y, a, b)


@given(fmt=FORMATS)
def test_growth_of_a_format_with_itself_has_no_bit_to_spare(fmt):
    lowest, highest = fixed.to_real(fmt.lo, fmt), fixed.to_real(fmt.hi, fmt)

    def narrower(grown):
        return grown.s, grown.i - 1, grown.f

    if fmt.hi > 1 or fmt.s:
        largest = lowest * lowest if fmt.s else highest * highest
        assert not naive.in_format(largest, *narrower(fixed.mul_fmt(fmt, fmt)))
    if fmt.hi > 0 or fmt.s:
        assert not naive.in_format(2 * (lowest if fmt.s else highest), *narrower(fixed.add_fmt(fmt, fmt)))
    if fmt.hi > 1 or (fmt.s and fmt.hi > 0):
        assert not naive.in_format(lowest - highest, *narrower(fixed.sub_fmt(fmt, fmt)))


@given(a=FORMATS, b=FORMATS)
def test_products_of_different_formats_have_no_bit_to_spare(a, b):
    if a.hi > 1 and b.hi > 1:
        corners = [x * y for x in (a.lo, a.hi) for y in (b.lo, b.hi)]
        s, i, f = fixed.mul_fmt(a, b)
        assert not all(naive.in_format(c / Fraction(2) ** f, s, i - 1, f) for c in corners)


def test_short_names_of_formats():
    assert fixed.bits(5) == (0, 5, 0)
    assert fixed.signed_bits(24) == (1, 23, 0)
    assert (fixed.bits(5).width, fixed.signed_bits(24).width) == (5, 24)
    assert (fixed.signed_bits(24).lo, fixed.signed_bits(24).hi) == (-(2**23), 2**23 - 1)
    assert str(Fmt(1, -1, 24)) == "[1,-1,24]"


# Quantize -----------------------------------------------------------------------------------------------------------


@given(fmt=FORMATS, quarter=st.integers(-(1 << 16), 1 << 16))
def test_quantize_is_half_even_inside_and_raises_outside(fmt, quarter):
    value = Fraction(quarter, 4) / Fraction(2) ** fmt.f
    raw = naive.rounded("half_even", Fraction(quarter, 4))
    if naive.in_format(raw / Fraction(2) ** fmt.f, *fmt):
        assert fixed.quantize(value, fmt) == fixed.quantize(float(value), fmt) == raw
    else:
        with pytest.raises(ValueError, match="does not fit"):
            fixed.quantize(value, fmt)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), np.float64("nan")])
def test_quantize_refuses_what_is_not_finite(value):
    with pytest.raises(ValueError, match=r"gain \(1/s\): .* is not a finite number"):
        fixed.quantize(value, Fmt(1, 3, 4), "gain (1/s)")


def test_quantize_names_quantity_value_format_and_limits():
    with pytest.raises(ValueError, match=r"gain \(1/s\): 8 does not fit format \[1,3,4\], which holds -8 \.\. 7\.9375"):
        fixed.quantize(8, Fmt(1, 3, 4), "gain (1/s)")
    with pytest.raises(ValueError, match=r"value: -1 does not fit format \[0,3,0\], which holds 0 \.\. 7"):
        fixed.quantize(-1, Fmt(0, 3, 0))


def test_quantize_rounds_before_it_checks():
    assert fixed.quantize(7.5, Fmt(0, 4, 0)) == 8
    with pytest.raises(ValueError, match="does not fit"):
        fixed.quantize(7.5, Fmt(0, 3, 0))
    assert fixed.quantize(-0.5, Fmt(0, 3, 0)) == 0


def test_quantize_takes_big_integers_and_numpy_scalars():
    assert fixed.quantize(2**61 - 1, fixed.signed_bits(62)) == 2**61 - 1
    assert fixed.quantize(np.int64(-5), fixed.signed_bits(4)) == -5
    assert fixed.quantize(np.float64(0.375), Fmt(1, 0, 3)) == 3

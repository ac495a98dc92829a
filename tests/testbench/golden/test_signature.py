"""Signatures: the polynomial is primitive, every way to compute the remainder gives the same, no two bits cancel."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import pi
from fpga_model.jit import kernel
from testbench.flatten import format_leaves
from testbench.golden.recording import signature

# 2^64 - 1
FACTORS = (3, 5, 17, 257, 641, 65537, 6700417)
WIDTHS = [fmt.width for _, fmt in format_leaves(pi.STATE_FMT)]
append = signature.appender(WIDTHS)


def times(a, b):
    """Product of polynomials over GF(2) modulo the signature's, by the book."""
    out = 0
    while b:
        if b & 1:
            out ^= a
        b >>= 1
        a <<= 1
        if a >> signature.DEGREE:
            a ^= signature.POLYNOMIAL
    return out


def power(n):
    """x^n modulo the polynomial."""
    out, base = 1, 2
    while n:
        if n & 1:
            out = times(out, base)
        base = times(base, base)
        n >>= 1
    return out


def remainder(value):
    """Long division."""
    while value.bit_length() > signature.DEGREE:
        value ^= signature.POLYNOMIAL << (value.bit_length() - signature.DEGREE - 1)
    return value


def test_polynomial_is_primitive():
    order = (1 << signature.DEGREE) - 1
    assert np.prod([int(f) for f in FACTORS], dtype=object) == order
    assert power(order) == 1
    assert all(power(order // factor) != 1 for factor in FACTORS)


@given(st.integers(1, 400), st.data())
def test_chunks_give_the_remainder_of_the_long_division(width, data):
    word = data.draw(st.integers(0, (1 << width) - 1))
    before = data.draw(st.integers(0, signature.MASK))
    assert signature.fold_word(word, width, before) == remainder(before << width | word)


@given(st.lists(st.integers(0, (1 << 70) - 1), max_size=6))
def test_signature_is_the_remainder_of_all_rows_padded_to_words(words):
    stream = 0
    for word in words:
        stream = stream << 128 | word
    assert signature.signature(words, 70) == remainder(stream)


@kernel
def run(buffer, at, rows):
    for n in range(rows.shape[0]):
        append(buffer, at, pi.State(rows[n, 0], rows[n, 1], rows[n, 2]))
        at -= ROW_WORDS
    return at


ROW_WORDS = signature.padded_width(sum(WIDTHS)) // signature.DEGREE
RAWS = st.tuples(*(st.integers(fmt.lo, fmt.hi) for _, fmt in format_leaves(pi.STATE_FMT)))


@given(st.lists(RAWS, min_size=1, max_size=60))
def test_compiled_appender_gives_the_plain_definition(rows):
    table = np.array(rows, np.int64)
    buffer = np.zeros(signature.WORDS + ROW_WORDS * len(rows), np.int64)
    at = run(buffer, ROW_WORDS * len(rows), table)
    words = []
    for row in rows:
        word = 0
        for value, width in zip(row, WIDTHS):
            word = word << width | (value & ((1 << width) - 1))
        words.append(word)
    assert at == 0
    assert signature.remainder_signature(buffer[: signature.WORDS]) == signature.signature(words, sum(WIDTHS))


def test_rows_too_wide_to_be_appended_at_once_are_refused():
    with pytest.raises(ValueError, match="at most 120"):
        signature.appender([63] * 123)


@given(st.data())
def test_two_wrong_bits_of_a_frame_never_cancel(data):
    # x has order 2^64 - 1, and a frame has fewer bits: no power difference is 0 modulo it
    bits = 3250 * 4416
    a = data.draw(st.integers(0, bits - 1))
    b = data.draw(st.integers(0, bits - 1).filter(lambda k: k != a))
    assert power(a) ^ power(b) != 0


@given(st.data())
def test_rows_of_any_layout_in_pairs(data):
    """`rows_signature` against the definition, for widths that no kernel is compiled for, and any number of rows."""
    widths = data.draw(st.lists(st.integers(1, 63), min_size=1, max_size=12))
    count = data.draw(st.integers(1, 9))
    rows = [[data.draw(st.integers(0, (1 << width) - 1)) for width in widths] for _ in range(count)]
    words = []
    for row in rows:
        word = 0
        for value, width in zip(row, widths):
            word = word << width | value
        words.append(word)
    assert signature.rows_signature(np.array(rows, np.int64), widths) == signature.signature(words, sum(widths))


def test_negative_values_enter_by_their_low_bits():
    rows = np.array([[-1, 5], [-7, 0]], np.int64)
    words = [(0x3F << 3) | 5, ((-7 & 0x3F) << 3)]
    assert signature.rows_signature(rows, [6, 3]) == signature.signature(words, 9)

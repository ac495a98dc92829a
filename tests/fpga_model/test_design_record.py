"""The design record: formats of other designs against arithmetic on plain integers, and the defaults of the board."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import dds, design_record, frequency_tracker, rates, references, registers, sine
from fpga_model import top as fpga
from fpga_model.design_record import DEFAULT, Design
from fpga_model.fixed import Fmt, Width, add_fmt, formats, most, mul_fmt, sub_fmt
from testbench.flatten import format_leaves, leaves

DESIGNS = st.tuples(
    st.just(DEFAULT.master_hz),
    st.integers(18, 32),
    st.integers(50, 500),
    st.integers(32, 48),
    st.integers(4, 12),
    st.integers(1, 12),
    st.integers(13, 20),
).map(lambda values: Design(*values))


def test_defaults_are_the_papers_board():
    assert (DEFAULT.tick_hz, DEFAULT.frame_hz, DEFAULT.frame_clocks) == (1e6, 8e3, 3250)
    assert (rates.MASTER_HZ, rates.TICK_CYCLES, rates.FRAME_TICKS) == DEFAULT[:3]
    assert fpga.reset(DEFAULT) == fpga.State()


@given(DESIGNS)
def test_formats_of_a_design(d):
    assert set(formats(dds.State, d)) == {Fmt(0, 0, d.dds_bits)}
    f = formats(sine.State, d)
    assert f.y == Fmt(1, 0, d.sine_bits - 1)
    assert f.base.width == d.sine_bits - 1 + 6
    assert f.slope.width == d.sine_bits - d.sine_address_bits + 5
    assert f.product.width == f.slope.width + d.sine_fraction_bits + 1
    assert formats(rates.State, d).frame.hi >= d.frame_ticks - 1 > formats(rates.State, d).frame.hi // 2
    assert formats(registers.State, d).frequency_fixed.width == d.dds_bits
    assert formats(fpga.State, d).control.frequency_tracker.word.width == d.dds_bits
    for (name, fmt), (_, value) in zip(format_leaves(formats(fpga.State, d)), leaves(fpga.reset(d)), strict=True):
        assert fmt.holds(value), name


@given(DESIGNS)
def test_table_of_a_design_holds_its_formats(d):
    base, slope = sine.tables(d)
    assert len(base) == len(slope) == 1 << d.sine_address_bits
    assert max(base) <= sine.BASE.for_design(d).hi
    assert max(slope) <= sine.SLOPE.for_design(d).hi, "the first row rises most"
    assert base[-1] / 64 + slope[-1] / 32 <= sine.OUT.for_design(d).hi + 1 / 32


@given(DESIGNS, st.integers(0, 2**48 - 1))
def test_sine_of_a_design_is_the_sine(d, turn):
    phase = turn >> (48 - d.dds_bits)
    y = sine.phase_sine(d, sine.table(d), phase)
    exact = (2 ** (d.sine_bits - 1) - 1) * _sin(phase / 2**d.dds_bits)
    rows = 2**d.sine_address_bits
    chord = 2 ** (d.sine_bits - 1) * (1.5708 / rows) ** 2 / 8
    cell = 2 ** (d.sine_bits - 1) * 6.2832 / 2 ** (2 + d.sine_address_bits + d.sine_fraction_bits)
    assert abs(y - exact) <= 0.53 + chord + cell / 2


def _sin(turns):
    import mpmath

    return float(mpmath.sin(2 * mpmath.pi * mpmath.mpf(turns)))


@given(DESIGNS)
def test_frequency_words(d):
    word = dds.word_of_hz(11_000.0, d)
    assert abs(float(dds.hz_of_word(word, d)) - 11_000.0) <= d.master_hz / 2**d.dds_bits / 2
    assert dds.offset_of_deg(90, d) == 1 << (d.dds_bits - 2)
    assert frequency_tracker.reset(d).word == word


def test_widths_keep_their_rule_through_sums():
    a = design_record.width("dds_bits")
    d = DEFAULT._replace(dds_bits=20)
    for found, default, other in ((a + 2, 50, 22), (2 + a, 50, 22), (a - 8, 40, 12), (60 - a, 12, 40), (-a, -48, -20)):
        assert (found, found.for_design(d)) == (default, other)
    assert isinstance(most(a, 30), Width)
    assert (most(a, 30), most(a, 30).for_design(d), most(3, 4)) == (48, 30, 4)
    x = Fmt(0, 0, a)
    assert mul_fmt(x, x).for_design(d) == Fmt(0, 0, 40)
    assert add_fmt(x, Fmt(1, 3, 30)).for_design(d) == Fmt(1, 4, 30)
    assert sub_fmt(x, x).for_design(d) == Fmt(1, 0, 20)
    assert x.for_design(None) == x
    assert type(x.for_design(None).f) is int


def test_frequencies_outside_the_clock_are_refused():
    with pytest.raises(ValueError, match="not from 0 to below 24000000 Hz"):
        dds.word_of_hz(25e6, DEFAULT._replace(master_hz=24_000_000))


def test_references_turn_with_the_phase():
    d = DEFAULT._replace(dds_bits=32)
    assert [references.signs_of(d, k << 30) for k in range(4)] == [3, 1, 0, 2]

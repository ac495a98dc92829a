"""Reference pins: signs at every octant's ends, alignment, the 1 MHz grid, latency, duty."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import references
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel
from testbench.flatten import store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows

TURN = 1 << 48


@kernel
def trace(p, s, drive, sense, enable):
    """Registers before each edge, and after the last one; the pins at each edge."""
    rows = np.empty((len(drive) + 1, 5), np.int64)
    pins = np.empty(len(drive), np.int64)
    for n in range(len(drive)):
        store(rows[n], s)
        pins[n] = references.pins(p, s)
        s = references.step(DEFAULT, p, s, int(drive[n]), int(sense[n]), int(enable[n]))
    store(rows[len(drive)], s)
    return rows, pins


def run(p, drive, sense, enable):
    return trace(p, references.State(), *(np.array(x, np.int64) for x in (drive, sense, enable)))


ENDS = [(TURN * k // 4 + d) % TURN for k in range(4) for d in (-1, 0, 1)]
phase = st.one_of(st.sampled_from(ENDS), st.integers(0, TURN - 1))


@given(
    st.builds(references.Params, st.integers(0, 3), st.integers(0, 1)),
    st.lists(st.tuples(phase, phase, st.sampled_from([0, 0, 1])), max_size=30),
)
def test_step_is_the_documented_equation(p, inputs):
    drive, sense, enable = zip(*inputs) if inputs else ((), (), ())
    rows, pins = run(p, drive, sense, enable)
    exact = [(Fraction(d, TURN), Fraction(s, TURN)) for d, s in zip(drive, sense)]
    assert_same_rows(references.State(), rows, naive.references(p.align, exact, enable))
    assert_in_formats(references.STATE_FMT, rows)
    assert pins.tolist() == rows[:-1, 4 if p.retimed else p.align].tolist()


def test_signs_are_those_of_sine_and_cosine_at_every_quarters_ends():
    p = references.design(retimed=False)
    for raw in ENDS:
        word = run(p, [raw] * 2, [0] * 2, [0] * 2)[1][1]
        turns = raw / TURN
        assert word & 1 == (np.sin(2 * np.pi * (turns + 1e-17)) >= 0 if raw != TURN // 2 else 0)
        assert word >> 1 & 1 == (raw < TURN // 4 or raw >= 3 * TURN // 4)
        assert word >> 2 == 0b11


def test_packing_is_drive_sin_cos_then_sense_sin_cos():
    p = references.design(retimed=False)
    quarter = TURN // 4
    first, second, third, fourth = 0b11, 0b01, 0b00, 0b10
    for d, drive in enumerate((first, second, third, fourth)):
        for s, sense in enumerate((first, second, third, fourth)):
            word = run(p, [d * quarter] * 2, [s * quarter] * 2, [0] * 2)[1][1]
            assert word == drive | sense << 2


@pytest.mark.parametrize("align", range(4))
def test_latency_grows_with_alignment(align):
    p = references.design(align, retimed=False)
    _, pins = run(p, [TURN // 2] * 10 + [0] * 10, [TURN // 2] * 20, [0] * 20)
    assert np.flatnonzero(pins & 1).tolist()[0] - 10 == references.LATENCY + align


@pytest.mark.parametrize("align", range(4))
def test_retimed_pins_change_only_after_a_1_mhz_enable(align):
    p = references.design(align)
    edges = np.arange(26 * 200)
    phases = edges * 119_101_000_000 % TURN
    _, pins = run(p, phases, (phases + TURN // 5) % TURN, edges % 26 == 0)
    changes = np.flatnonzero(np.diff(pins)) + 1
    assert len(changes) > 8
    assert set(changes % 26) == {1}
    # what the pins show is the sign of the phase `align` + 1 edges before the enable
    shown = changes - 1
    assert ((pins[changes] & 1) == (phases[shown - align - 1] < TURN // 2)).all()


def test_each_sign_is_high_for_half_a_turn():
    p = references.design(retimed=False)
    phases = np.arange(4096) * (TURN // 4096)
    _, pins = run(p, phases, phases, np.zeros(4096))
    assert [(pins[1:] >> k & 1).sum() for k in range(4)] == [2048, 2047, 2048, 2047]


def test_design_refuses_what_does_not_exist():
    for wrong in (4, -1, 1.5):
        with pytest.raises(ValueError, match="align_clocks"):
            references.design(wrong)
    with pytest.raises(ValueError, match="retimed"):
        references.design(0, 2)

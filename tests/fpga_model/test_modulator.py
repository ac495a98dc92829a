"""Modulator: every register at every clock, every corner of amplitude x sine, saturation, rounding, delay in frames."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import modulator
from fpga_model.fixed import signed_bits
from fpga_model.jit import kernel
from testbench.flatten import store
from tests import naive
from tests.rows import assert_in_formats, assert_same_rows

A, S = modulator.AMPLITUDE, modulator.SINE


@kernel
def trace(p, s, inputs):
    """Registers before each edge, and after the last one; the output pin at each edge."""
    rows = np.empty((len(inputs) + 1, 4), np.int64)
    pins = np.empty(len(inputs), np.int64)
    for n in range(len(inputs)):
        store(rows[n], s)
        pins[n] = modulator.out(p, s)
        x = inputs[n]
        s = modulator.step(p, s, int(x[0]), int(x[1]), int(x[2]), int(x[3]))
    store(rows[len(inputs)], s)
    return rows, pins


def run(p, inputs):
    return trace(p, modulator.State(), np.array(inputs, np.int64).reshape(-1, 4))


def raws(fmt):
    near = [fmt.lo, fmt.lo + 1, -1, 0, 1, fmt.hi - 1, fmt.hi]
    return st.one_of(st.sampled_from(near), st.integers(fmt.lo, fmt.hi))


designs = st.builds(modulator.design, st.sampled_from([2, 16, 18, 20]), st.integers(0, 2))
edge = st.tuples(st.integers(0, 1), st.integers(0, 1), raws(A), raws(S))


@given(designs, st.lists(edge, max_size=30))
def test_step_is_the_documented_equation(p, inputs):
    rows, pins = run(p, inputs)
    assert_same_rows(modulator.State(), rows, naive.modulator(p.shift, p.lo, p.hi, inputs))
    assert_in_formats(modulator.STATE_FMT, rows)
    assert pins.tolist() == rows[:-1, 1 + p.frames].tolist()


@pytest.mark.parametrize(("code_bits", "shift"), [(16, 25), (20, 21)])
def test_every_corner_of_both_codes(code_bits, shift):
    p = modulator.design(code_bits)
    assert p == modulator.Params(shift, -(1 << (code_bits - 1)), (1 << (code_bits - 1)) - 1, 0)
    amplitudes = [a for base in (A.lo, A.lo // 2, 0, A.hi // 2, A.hi) for a in range(base - 2, base + 3) if A.holds(a)]
    sines = [x for base in (S.lo, S.lo // 2, 0, S.hi // 2, S.hi) for x in range(base - 2, base + 3) if S.holds(x)]
    inputs = [(1, 1, a, x) for a, x in itertools.product(amplitudes, sines)]
    rows, _ = run(p, inputs + [(0, 1, 0, 0)])
    assert_same_rows(modulator.State(), rows, naive.modulator(p.shift, p.lo, p.hi, inputs + [(0, 1, 0, 0)]))
    assert (rows[:, 1].min(), rows[:, 1].max()) == (p.lo, p.hi), "both limits are reached"


@pytest.mark.parametrize("code_bits", [16, 20])
def test_ties_and_saturation_to_the_lsb(code_bits):
    """Products chosen on, just below and just above ties and limits; every one is a real amplitude times a sine."""
    p = modulator.design(code_bits)
    half = 1 << (p.shift - 1)
    tested = 0
    # amplitude -2**k times sine: products that are exact multiples of 2**k
    for target in (p.lo, p.lo + 1, -1, 0, 1, p.hi - 1, p.hi):
        product = target * 2 * half + half
        for k in range(A.f, p.shift - 3, -1):
            if product % (1 << k) == 0 and S.holds(-(product >> k)) and S.holds(-(product >> k) - 1):
                x = -(product >> k)
                break
        else:
            continue
        codes = []
        for sine in (x - 1, x, x + 1):
            rows, _ = run(p, [(1, 0, -(1 << k), sine), (0, 1, 0, 0)])
            codes.append(rows[-1, 1])
        tested += 1
        assert codes[1] == min(target + 1, p.hi), "a tie goes up"
        assert codes[0] >= codes[1] >= codes[2]
    assert tested == (7 if code_bits == 16 else 3), "20-bit ties near full scale are no product of these operands"
    # minimum times minimum is the one product above full scale
    rows, _ = run(p, [(1, 0, A.lo, S.lo), (0, 1, 0, 0)])
    assert rows[1, 0] == 1 << 40
    assert rows[2, 1] == p.hi


def test_latency_and_frames():
    for frames in range(3):
        p = modulator.design(16, frames)
        # product at tick count 0, code at 1, as on the board; the amplitude steps once
        inputs = [(int(n % 26 == 0), int(n % 26 == 1), A.hi if n >= 26 else 0, S.hi) for n in range(26 * 6)]
        _, pins = run(p, inputs)
        assert np.flatnonzero(pins)[0] == 26 + modulator.LATENCY + 26 * frames


@kernel
def closed(p, amplitude, y):
    return modulator.dac_code(p, amplitude, y)


@given(designs, raws(A), raws(S))
def test_closed_form_is_the_pipeline(p, amplitude, y):
    rows, _ = run(p, [(1, 0, amplitude, y), (0, 1, 0, 0)])
    assert rows[-1, list(modulator.State._fields).index("code")] == closed(p, amplitude, y)


def test_codes_are_held_between_enables():
    p = modulator.design(20, 1)
    rows, _ = run(p, [(1, 0, A.hi, S.hi), (0, 1, 0, 0)] + [(0, 0, A.lo, S.hi)] * 20)
    assert (rows[2:] == rows[2]).all()


@pytest.mark.parametrize(("code_bits", "frames"), [(1, 0), (21, 0), (16.5, 0), (16, 3), (16, -1)])
def test_design_refuses_what_does_not_exist(code_bits, frames):
    with pytest.raises(ValueError, match=r"code_bits|frames"):
        modulator.design(code_bits, frames)


def test_code_formats():
    assert signed_bits(20) == modulator.CODE
    assert modulator.PRODUCT.width + 1 <= 63

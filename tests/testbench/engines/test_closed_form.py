"""Closed forms of the blocks that a window works through: every register, against the blocks' own steps."""

import numpy as np
import pytest

from fpga_model import cordic, isqrt, rate_output, rates
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel
from testbench.engines import closed_form_window

COUNT = 20_000


@kernel
def _rotate(d, s, x, y, closed, stepped):
    for n in range(x.shape[0]):
        a = closed_form_window.rotate(d, s, x[n], y[n])
        for k in range(rates.SLOT_CORDIC, rates.SLOT_SEQUENCER):
            s = cordic.step(d, s, 1 if k == rates.SLOT_CORDIC else 0, x[n], y[n])
        _put(closed[n], a)
        _put(stepped[n], s)


@kernel
def _put(row, r):
    row[0], row[1], row[2], row[3] = r.x, r.y, r.angle, r.i
    row[4], row[5], row[6], row[7] = r.busy, r.done, r.magnitude, r.phase


@kernel
def _root(rest, u, closed, stepped):
    for n in range(u.shape[0]):
        s = isqrt.step(rest, 1, u[n])
        a = closed_form_window.root(s)
        for _ in range(rates.SLOT_ROOT + 1, rates.SLOTS + 1):
            s = isqrt.step(s, 0, 0)
        for row, r in ((closed[n], a), (stepped[n], s)):
            row[0], row[1], row[2], row[3] = r.radicand, r.root, r.remainder, r.i
            row[4], row[5], row[6] = r.busy, r.done, r.y


@kernel
def _scale(p, a, words, temperatures, closed, stepped):
    s = a
    for n in range(words.shape[0]):
        a = closed_form_window.scale_rate(p, rate_output.step(p, a, 1, words[n], temperatures[n]))
        s = rate_output.step(p, s, 1, words[n], temperatures[n])
        for _ in range(rates.SLOT_ROOT + 1, rates.SLOTS + 1):
            s = rate_output.step(p, s, 0, 0, 0)
        for row, r in ((closed[n], a), (stepped[n], s)):
            row[0], row[1], row[2], row[3], row[4] = r.stage, r.word, r.t, r.t2, r.bias
            row[5], row[6], row[7], row[8], row[9] = r.scale, r.corrected, r.scaled, r.acc, r.count
            row[10], row[11], row[12] = r.k, r.y, r.valid


def _both(columns):
    return np.zeros((COUNT, columns), np.int64), np.full((COUNT, columns), -1, np.int64)


@pytest.mark.parametrize("d", [DEFAULT, DEFAULT._replace(cordic_iterations=9, cordic_guard_bits=2)])
@pytest.mark.parametrize("size", [3, 400, 1 << 23])
def test_a_vector_is_turned_as_by_the_steps(size, d):
    rng = np.random.default_rng(size)
    x, y = (rng.integers(-size, size, COUNT, endpoint=True).clip(cordic.INPUT_LO, cordic.INPUT_HI) for _ in range(2))
    corners = [(a, b) for a in (0, 1, -1, cordic.INPUT_LO, cordic.INPUT_HI) for b in (0, 1, -1, cordic.INPUT_LO)]
    x[: len(corners)], y[: len(corners)] = np.array(corners).T
    closed, stepped = _both(8)
    _rotate(d, cordic.State(), x, y, closed, stepped)
    np.testing.assert_array_equal(closed, stepped)


def test_a_root_is_that_of_the_steps():
    rng = np.random.default_rng(1)
    roots = rng.integers(0, 1 << 16, COUNT)
    u = roots * roots + rng.integers(-1, 2, COUNT)
    u[: COUNT // 2] = rng.integers(0, 1 << 32, COUNT // 2)
    u[:4] = 0, 1, (1 << 32) - 1, 65535 * 65535
    closed, stepped = _both(7)
    _root(isqrt.State(), u.clip(0, (1 << 32) - 1), closed, stepped)
    np.testing.assert_array_equal(closed, stepped)


def test_an_output_word_is_that_of_the_steps():
    rng = np.random.default_rng(2)
    p = rate_output.design(bias_deg_s=0.3, bias_t1=0.2, bias_t2=-0.1, scale_t1=1e-7, decimation=2)
    closed, stepped = _both(13)
    words, temperatures = (rng.integers(-(1 << 23), 1 << 23, COUNT) for _ in range(2))
    _scale(p, rate_output.State(), words, temperatures, closed, stepped)
    np.testing.assert_array_equal(closed, stepped)

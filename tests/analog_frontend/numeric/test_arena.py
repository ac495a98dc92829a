"""Records of arrays in two flat arrays: what a kernel writes through its view is what Python reads through its own."""

from typing import NamedTuple

import numpy as np

from analog_frontend.numeric import arena
from analog_frontend.numeric.shapes import FLOAT, INTEGER, doubles, int64s
from analog_frontend.numeric.vector import LANES
from fpga_model.jit import hot


class Record(NamedTuple):
    a: doubles(2, 3)
    n: int64s(4)
    b: doubles(9)
    m: int64s(2, 2, 2)


class Other(NamedTuple):
    c: doubles(1)


AT = arena.record_layout(Record, (3, 5))
BEHIND = arena.record_layout(Other, AT.sizes)
opened, opened_behind = AT.opened, BEHIND.opened


@hot
def fill(floats, ints):
    v, o = opened(floats, ints), opened_behind(floats, ints)
    for i in range(2):
        for j in range(3):
            v.a[i, j] = 10.0 * i + j
    row = v.m[1]
    row[0, 1] = -7
    v.n[3] = v.m.shape[2] + len(v.b)
    v.b[8] = v.a[1, 2]
    o.c[0] = 0.5


@hot
def count_up(address, n):
    row = arena_row(address, n)
    for k in range(n):
        row[k] = k - 2


arena_row, doubles_at = arena.int32_at, arena.float64_at


@hot
def halves(address, n):
    row = doubles_at(address, n)
    for k in range(n):
        row[k] = 0.5 * k


def test_views_of_kernel_and_python_are_the_same():
    floats, ints = arena.room(BEHIND.sizes)
    fill(floats, ints)
    v, o = arena.views(Record, AT, floats, ints), arena.views(Other, BEHIND, floats, ints)
    np.testing.assert_array_equal(v.a, [[0, 1, 2], [10, 11, 12]])
    np.testing.assert_array_equal(v.m, [[[0, 0], [0, 0]], [[0, -7], [0, 0]]])
    np.testing.assert_array_equal(v.n, [0, 0, 0, 11])
    np.testing.assert_array_equal(v.b, [0] * 8 + [12])
    assert o.c[0] == 0.5
    assert np.count_nonzero(floats) == 7
    assert np.count_nonzero(ints) == 2


def test_arrays_do_not_touch_and_begin_at_a_register():
    ends = {FLOAT: 3, INTEGER: 5}
    for _, kind, at, shape in AT.rows:
        assert at >= ends[kind]
        assert (at - (3, 5)[kind]) % LANES == 0
        ends[kind] = at + int(np.prod(shape))
    assert AT.sizes[FLOAT] >= ends[FLOAT]
    assert AT.sizes[INTEGER] >= ends[INTEGER]
    floats, _ = arena.room(AT.sizes)
    assert floats.ctypes.data % 64 == 0


def test_a_row_at_an_address():
    row = np.zeros(6, np.int32)
    count_up(row[1:].ctypes.data, 4)
    np.testing.assert_array_equal(row, [0, -2, -1, 0, 1, 0])
    numbers = np.full(3, -1.0)
    halves(numbers.ctypes.data, 2)
    np.testing.assert_array_equal(numbers, [0.0, 0.5, -1.0])

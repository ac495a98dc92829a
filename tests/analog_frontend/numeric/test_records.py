"""A record out of two rows, by its kind."""

from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.records import Kind, split, unpack_record
from fpga_model.jit import hot


class Inner(NamedTuple):
    x: float
    n: int


class Outer(NamedTuple):
    a: int
    pair: tuple
    inner: Inner


RECORD = Outer(3, (1.5, 7), Inner(-2.25, 9))


@hot
def weighed(kind, ints, floats):
    r = unpack_record(kind, ints, floats)
    return r.a * 1000.0 + r.pair[1] * 100.0 + r.inner.n + r.pair[0] * r.inner.x


def test_split_goes_depth_first():
    assert split(RECORD) == ([3, 7, 9], [1.5, -2.25])


def test_a_kind_gives_what_the_record_itself_gives():
    ints, floats = (np.array(part) for part in split(RECORD))
    expected = 3709.0 + 1.5 * -2.25
    assert weighed(RECORD, ints, floats) == expected
    assert weighed(Kind(RECORD), ints, floats) == expected
    assert weighed(Kind(Outer(0, (0.0, 0), Inner(0.0, 0))), ints + 1, floats) == expected + 1101.0


def test_a_record_of_another_shape_is_another_kind():
    ints, floats = np.array([4, 5]), np.array([2.5])

    class Small(NamedTuple):
        a: int
        pair: tuple
        inner: Inner

    assert weighed(Kind(Small(0, (0, 0), Inner(0.0, 0))), np.append(ints, [6, 7]), floats) == 4607.0 + 5 * 2.5

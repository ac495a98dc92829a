"""`_replace` of records in compiled code: what Python's own gives, types included, and unknown fields are refused."""

from typing import NamedTuple

import pytest
from numba.core.errors import TypingError

from fpga_model.jit import DISABLED, kernel


class Inner(NamedTuple):
    count: int = 1
    flag: int = 2


class Outer(NamedTuple):
    inner: Inner = Inner()
    level: float = 0.5
    pair: tuple = (1, 2)


@kernel
def replaced(s, n):
    for k in range(n):
        s = s._replace(level=s.level + 1.0)
        s = s._replace(pair=(s.pair[1], k), inner=s.inner._replace(flag=0))
    return s


@kernel
def unknown(s):
    return s._replace(missing=1)


def test_compiled_and_python_give_the_same_record():
    found = replaced(Outer(), 3)
    assert found == getattr(replaced, "py_func", replaced)(Outer(), 3) == Outer(Inner(1, 0), 3.5, (1, 2))
    assert isinstance(found.inner, Inner)


@pytest.mark.skipif(DISABLED, reason="Python's own method says it in other words")
def test_a_field_that_is_not_there_is_refused():
    with pytest.raises(TypingError, match="_replace"):
        unknown(Outer())

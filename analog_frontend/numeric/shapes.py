"""Records of arrays whose fields say by their type what the array holds, and its shape.

class Record(NamedTuple):
    z: doubles(16, 8)
    switch: int64s(8, 4)

zeros(Record, name=value, ...)     the record with arrays of zeros, and what is given for other fields
"""

from math import prod
from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.vector import aligned_zeros

FLOAT, INTEGER = 0, 1


class Shaped(NamedTuple):
    """Type of such a field: FLOAT or INTEGER, and the shape."""

    kind: int
    shape: tuple


def doubles(*shape):
    """An array of doubles."""
    return Shaped(FLOAT, shape)


def int64s(*shape):
    """An array of int64."""
    return Shaped(INTEGER, shape)


def zeros(record, **given):
    """`record` with arrays of zeros; `given` are its other fields."""
    return record(**{name: given.get(name, _zeros(hint)) for name, hint in record.__annotations__.items()})


def _zeros(hint):
    if not isinstance(hint, Shaped):
        return None
    flat = aligned_zeros(prod(hint.shape))
    return (flat if hint.kind == FLOAT else flat.view(np.int64)).reshape(hint.shape)

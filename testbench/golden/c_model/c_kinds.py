"""What a value of a kernel is in C: a number, a record, an array, or something that is known when the C is written.

    NUMBER              int64_t
    Record              struct of the fields of a NamedTuple, depth first; what is known is no member
    Array(of, n)        n values of one kind
    StaticValue(value)  a design record, a table, None: no argument and no member is made of it

A number is passed by value; a record or an array by a pointer to const.
"""

import keyword
from typing import NamedTuple

import numpy as np

from fpga_model.design_record import Design
from fpga_model.fixed import Fmt

# of C99 and of C++, so that a header suits both; `result` is what a function that returns a record writes into
RESERVED = set(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool catch "
    "class delete explicit export false friend mutable namespace new operator private protected public template this "
    "throw true try typename using virtual result main".split()
)


class Number(NamedTuple):
    """int64_t."""

    c_name: str = "int64_t"


NUMBER = Number()


class StaticValue:
    """A value that is known when the C is written; two are one kind if they are one object."""

    def __init__(self, value):
        self.value = value

    def __eq__(self, other):
        return isinstance(other, StaticValue) and self.value is other.value

    def __hash__(self):
        return id(self.value)


class Array(NamedTuple):
    """`count` values of the kind `of`."""

    of: object
    count: int

    @property
    def c_name(self):
        return self.of.c_name


class Record(NamedTuple):
    """Fields of a NamedTuple: (name, kind), with those that are known."""

    type: type
    fields: tuple

    @property
    def c_name(self):
        return f"{prefix(self.type.__module__)}_{self.type.__name__}"

    @property
    def members(self):
        """(name, kind) of what the struct holds."""
        return [(name, kind) for name, kind in self.fields if not isinstance(kind, StaticValue)]

    def field_kind(self, name):
        return dict(self.fields)[name]


def prefix(module):
    """Prefix of the C names of a module."""
    return f"gyro_{module.rpartition('.')[2]}"


def c_name(name):
    """A local name or a field that is no word of C."""
    return f"{name}_" if name in RESERVED or keyword.iskeyword(name) else name


def aggregate(kind):
    return isinstance(kind, (Record, Array))


def infer_kind(example):
    """Kind of a value, or of a shape of formats."""
    if isinstance(example, (int, np.integer, Fmt)):
        return NUMBER
    if example is None or isinstance(example, (Design, np.ndarray)):
        return StaticValue(example)
    if hasattr(example, "_fields"):
        return Record(type(example), tuple((name, infer_kind(item)) for name, item in zip(example._fields, example)))
    items = {infer_kind(item) for item in example}
    if len(items) != 1:
        raise TypeError(f"tuple of {len(items)} kinds, expected 1: {example!r}")
    return Array(items.pop(), len(example))


def number_count(kind):
    """Numbers that a kind holds."""
    if isinstance(kind, Array):
        return kind.count * number_count(kind.of)
    if isinstance(kind, Record):
        return sum(number_count(item) for _, item in kind.members)
    return 1

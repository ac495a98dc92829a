"""Records of arrays that stand in two flat arrays, one of doubles and one of int64.

    AT = record_layout(Record, first)        where each array of a record of shapes.py stands, aligned to eight
    v = AT.opened(floats, integers)          the record, its arrays views of the two

    int32_at(address, n), int64_at, float64_at              n numbers of somebody else's, at the address of the first

A kernel that takes a record of eighty arrays spends more time on its arguments than on its work. Every place and shape
is a constant, so indices cost nothing.
"""

import ctypes
from math import prod
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from analog_frontend.numeric.shapes import FLOAT, INTEGER
from analog_frontend.numeric.vector import LANES, aligned_zeros
from fpga_model.jit import DISABLED

ITEM_BYTES = 8


class RecordLayout(NamedTuple):
    """Where the arrays of a record stand."""

    rows: tuple  # (name, kind, place, shape)
    sizes: tuple  # doubles and integers up to the end
    opened: object  # function of both arrays that returns the record


def _round_up_to_lanes(size):
    return -(-size // LANES) * LANES


def record_layout(record, first=(0, 0)):
    """Places of the arrays of `record`, behind `first` (doubles, integers)."""
    sizes, rows = list(first), []
    for name, (kind, shape) in record.__annotations__.items():
        rows.append((name, kind, sizes[kind], shape))
        sizes[kind] += _round_up_to_lanes(prod(shape))
    return RecordLayout(tuple(rows), tuple(sizes), _python_opener(record, rows) if DISABLED else _native(record, rows))


def room(sizes):
    """(doubles, integers) of zeros, as large as `sizes`."""
    return aligned_zeros(sizes[FLOAT]), aligned_zeros(sizes[INTEGER]).view(np.int64)


def views(record, at, floats, integers):
    """The record for Python."""
    return _python_opener(record, at.rows)(floats, integers)


def _python_opener(record, rows):
    def open_views(floats, integers):
        arrays = (floats, integers)
        return record(*(arrays[kind][at : at + prod(shape)].reshape(shape) for _, kind, at, shape in rows))

    return open_views


def _native(record, rows):
    items = (types.float64, types.int64)
    record_type = types.NamedTuple([types.Array(items[kind], len(shape), "C") for _, kind, _, shape in rows], record)
    word = ir.IntType(64)

    def number(value):
        return ir.Constant(word, value)

    def view(context, builder, kind, base, array_offset, shape):
        array = make_array(kind)(context, builder)
        strides = [prod(shape[k + 1 :]) * ITEM_BYTES for k in range(len(shape))]
        populate_array(
            array,
            data=builder.gep(base.data, [number(array_offset)]),
            shape=[number(n) for n in shape],
            strides=[number(n) for n in strides],
            itemsize=number(ITEM_BYTES),
            meminfo=None,
        )
        return array._getvalue()

    @intrinsic
    def open_views(typingctx, floats, integers):
        def codegen(context, builder, signature, args):
            bases = [make_array(t)(context, builder, a) for t, a in zip(signature.args, args)]
            arrays = [
                view(context, builder, record_type.types[k], bases[kind], array_offset, shape)
                for k, (_, kind, array_offset, shape) in enumerate(rows)
            ]
            return context.make_tuple(builder, record_type, arrays)

        return record_type(floats, integers), codegen

    return open_views


def _array_view_function(kind, python, native):
    """Function of an address and a number: that many numbers that stand there."""
    if DISABLED:
        return lambda address, n: np.frombuffer((python * n).from_address(address), native)
    array_type = types.Array(kind, 1, "C")

    @intrinsic
    def row_at(typingctx, address, n):
        def codegen(context, builder, signature, args):
            array = make_array(array_type)(context, builder)
            size = ir.Constant(ir.IntType(64), np.dtype(native).itemsize)
            data = builder.inttoptr(args[0], array.data.type)
            populate_array(array, data=data, shape=[args[1]], strides=[size], itemsize=size, meminfo=None)
            return array._getvalue()

        return array_type(types.int64, types.int64), codegen

    return row_at


int32_at = _array_view_function(types.int32, ctypes.c_int32, np.int32)
int64_at = _array_view_function(types.int64, ctypes.c_int64, np.int64)
float64_at = _array_view_function(types.float64, ctypes.c_double, np.float64)

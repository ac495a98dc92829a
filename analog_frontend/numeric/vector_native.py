"""The operations of `vector` for compiled code: types of Numba, and what LLVM is told for each operation.

Source    docs/decisions/0007-frame-engine.md
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.extending import intrinsic, overload

LANES, FIVE = 8, 5


class Vector(types.Type):
    """Numba's type of `lane_count` numbers in one register."""

    def __init__(self, name, number, lane_count):
        self.lanes = lane_count
        self.native = ir.VectorType(number, lane_count)
        super().__init__(name=f"{name}{lane_count}")


@register_default(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.native)


VECTOR, QUAD = Vector("vector", ir.DoubleType(), LANES), Vector("vector", ir.DoubleType(), 4)
INTEGERS = Vector("integers", ir.IntType(64), LANES)
_INT32 = ir.IntType(32)


def _shuffle_lanes(builder, x, y, source_lanes):
    return builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(_INT32, len(source_lanes)), list(source_lanes)))


def _pointer(context, builder, signature, args, native, offset=0):
    array = context.make_array(signature.args[0])(context, builder, args[0])
    index = context.cast(builder, args[1], signature.args[1], types.intp)
    item_pointer = builder.gep(array.data, [builder.add(index, offset) if offset else index])
    return builder.bitcast(item_pointer, native.as_pointer())


def _map_registers(context, builder, result, apply, *args):
    """`apply` of registers, or of each of tuples of them."""
    if not isinstance(result, types.BaseTuple):
        return apply(*args)
    items = [apply(*(builder.extract_value(a, k) for a in args)) for k in range(len(result))]
    return context.make_tuple(builder, result, items)


def _loader(kind):
    @intrinsic
    def load(typingctx, a, i):
        def codegen(context, builder, signature, args):
            # aligned as a number only: the caller's row may start anywhere
            return builder.load(_pointer(context, builder, signature, args, kind.native), align=8)

        return kind(a, i), codegen

    return load


@intrinsic
def store(typingctx, a, i, v):
    def codegen(context, builder, signature, args):
        builder.store(args[2], _pointer(context, builder, signature, args, v.native), align=8)
        return context.get_dummy_value()

    return types.void(a, i, v), codegen


def _splatter(kind, number):
    @intrinsic
    def splat(typingctx, x):
        def codegen(context, builder, signature, args):
            empty = ir.Constant(kind.native, ir.Undefined)
            first = builder.insert_element(empty, args[0], ir.Constant(_INT32, 0))
            return _shuffle_lanes(builder, first, empty, [0] * kind.lanes)

        return kind(number), codegen

    return splat


@intrinsic
def store_rows(typingctx, a, i, step, values):
    def codegen(context, builder, signature, args):
        step = context.cast(builder, args[2], signature.args[2], types.intp)
        for k, kind in enumerate(values):
            offset = builder.mul(step, ir.Constant(step.type, k))
            pointer = _pointer(context, builder, signature, args, kind.native, offset)
            builder.store(builder.extract_value(args[3], k), pointer, align=8)
        return context.get_dummy_value()

    return types.void(a, i, step, values), codegen


@intrinsic
def rows4(typingctx, a, i, count):
    if not isinstance(count, types.IntegerLiteral):
        return None
    rows = types.UniTuple(QUAD, count.literal_value)

    def codegen(context, builder, signature, args):
        pointers = (
            _pointer(context, builder, signature, args, QUAD.native, ir.Constant(ir.IntType(64), QUAD.lanes * k))
            for k in range(len(rows))
        )
        return context.make_tuple(builder, rows, [builder.load(pointer, align=8) for pointer in pointers])

    return rows(a, i, count), codegen


def _gather_codegen(argument_order):
    """Four lanes from scalars: lane k is argument `argument_order[k]`."""

    def codegen(context, builder, signature, args):
        v = ir.Constant(QUAD.native, ir.Undefined)
        for k, number in enumerate(argument_order):
            v = builder.insert_element(v, args[number], ir.Constant(_INT32, k))
        return v

    return codegen


@intrinsic
def four(typingctx, a, b, c, d):
    return QUAD(types.float64, types.float64, types.float64, types.float64), _gather_codegen((0, 1, 2, 3))


@intrinsic
def pair(typingctx, a, b):
    return QUAD(types.float64, types.float64), _gather_codegen((0, 0, 1, 1))


@intrinsic
def lane(typingctx, v, k):
    def codegen(context, builder, signature, args):
        return builder.extract_element(args[0], builder.trunc(args[1], _INT32))

    return types.float64(v, types.int64), codegen


@intrinsic
def ceiling(typingctx, v):
    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(v.native, [v.native])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.ceil.v{v.lanes}f64"), args)

    return v(v), codegen


@intrinsic
def join_lanes(typingctx, a, b):
    result = types.UniTuple(VECTOR, len(a)) if isinstance(a, types.BaseTuple) else VECTOR

    def codegen(context, builder, signature, args):
        return _map_registers(context, builder, result, lambda x, y: _shuffle_lanes(builder, x, y, range(8)), *args)

    return result(a, b), codegen


def _half(first):
    @intrinsic
    def half(typingctx, v):
        def codegen(context, builder, signature, args):
            return _shuffle_lanes(builder, args[0], args[0], range(first, first + 4))

        return QUAD(VECTOR), codegen

    return half


@intrinsic
def turned4(typingctx, v):
    def codegen(context, builder, signature, args):
        swapped = _shuffle_lanes(builder, args[0], args[0], (1, 0, 3, 2))
        return builder.fmul(swapped, ir.Constant(QUAD.native, [-1.0, 1.0, -1.0, 1.0]))

    return QUAD(QUAD), codegen


@intrinsic
def select_lanes(typingctx, a, b, x, y):
    def codegen(context, builder, signature, args):
        test = builder.fcmp_ordered("<=", args[0], args[1])
        return _map_registers(context, builder, x, lambda u, v: builder.select(test, u, v), *args[2:])

    return x(a, a, x, x), codegen


@intrinsic
def larger(typingctx, a, b):
    def codegen(context, builder, signature, args):
        top, b = args
        zero = ir.Constant(VECTOR.native, [0.0] * LANES)
        magnitude = builder.select(builder.fcmp_ordered("<", b, zero), builder.fsub(zero, b), b)
        return builder.select(builder.fcmp_ordered(">", magnitude, top), magnitude, top)

    return VECTOR(VECTOR, VECTOR), codegen


@intrinsic
def store_fives(typingctx, a, i, v):
    def codegen(context, builder, signature, args):
        for first in range(0, FIVE * LANES, LANES):
            pointer = _pointer(context, builder, signature, args, VECTOR.native, ir.Constant(ir.IntType(64), first))
            source_lanes = [(first + k) // FIVE for k in range(LANES)]
            builder.store(_shuffle_lanes(builder, args[2], args[2], source_lanes), pointer, align=8)
        return context.get_dummy_value()

    return types.void(a, types.int64, v), codegen


@intrinsic
def totals4(typingctx, a, b, c, d):
    def codegen(context, builder, signature, args):
        def add_pairs(x, y, low, high):
            return builder.fadd(_shuffle_lanes(builder, x, y, low), _shuffle_lanes(builder, x, y, high))

        a, b, c, d = (add_pairs(v, v, (0, 1, 2, 3), (4, 5, 6, 7)) for v in args)
        a, c = add_pairs(a, b, (0, 4, 2, 6), (1, 5, 3, 7)), add_pairs(c, d, (0, 4, 2, 6), (1, 5, 3, 7))
        return add_pairs(a, c, (0, 1, 4, 5), (2, 3, 6, 7))

    return QUAD(VECTOR, VECTOR, VECTOR, VECTOR), codegen


@intrinsic
def clamp_lanes(typingctx, v, lo, hi):
    def codegen(context, builder, signature, args):
        v, lo, hi = args
        v = builder.select(builder.fcmp_ordered("<", v, lo), lo, v)
        return builder.select(builder.fcmp_ordered(">", v, hi), hi, v)

    return VECTOR(VECTOR, VECTOR, VECTOR), codegen


load, load4, integers = _loader(VECTOR), _loader(QUAD), _loader(INTEGERS)
store4 = store
splat, splat4 = _splatter(VECTOR, types.float64), _splatter(QUAD, types.float64)
low, high = _half(0), _half(4)


# ---- + - * / and the operations on bits ------------------------------------------------------------------------------

_splat_integer = _splatter(INTEGERS, types.int64)


@intrinsic
def _as_doubles(typingctx, v):
    return VECTOR(INTEGERS), lambda context, builder, signature, args: builder.sitofp(args[0], VECTOR.native)


def _operation(name):
    @intrinsic
    def apply(typingctx, a, b):
        return a(a, b), lambda context, builder, signature, args: getattr(builder, name)(*args)

    return apply


def _overload_vector_operator(symbol, name):
    apply = _operation(name)

    @overload(symbol)
    def _vector_implementation(a, b):
        if a in (VECTOR, QUAD) and a == b:
            return lambda a, b: apply(a, b)
        if a in (VECTOR, QUAD) and isinstance(b, types.Float):
            spread = splat if a == VECTOR else splat4
            return lambda a, b: apply(a, spread(b))
        if b in (VECTOR, QUAD) and isinstance(a, types.Float):
            spread = splat if b == VECTOR else splat4
            return lambda a, b: apply(spread(a), b)
        if a == VECTOR and b == INTEGERS:
            return lambda a, b: apply(a, _as_doubles(b))
        return None


def _overload_integer_operator(symbol, name):
    apply = _operation(name)

    @overload(symbol)
    def _integer_implementation(a, b):
        if a == INTEGERS and b == INTEGERS:
            return lambda a, b: apply(a, b)
        if a == INTEGERS and isinstance(b, types.Integer):
            return lambda a, b: apply(a, _splat_integer(b))
        if b == INTEGERS and isinstance(a, types.Integer):
            return lambda a, b: apply(_splat_integer(a), b)
        if symbol is operator.mul and a == INTEGERS and isinstance(b, types.Float):
            return lambda a, b: _as_doubles(a) * b
        return None


_FLOATS = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv"}
_INTEGERS = {operator.add: "add", operator.sub: "sub", operator.mul: "mul"}
_INTEGERS |= {operator.and_: "and_", operator.xor: "xor", operator.rshift: "ashr"}
for _symbol, _name in _FLOATS.items():
    _overload_vector_operator(_symbol, _name)
for _symbol, _name in _INTEGERS.items():
    _overload_integer_operator(_symbol, _name)

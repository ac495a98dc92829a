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
    """Numba's type of `lanes` doubles in one register."""

    def __init__(self, lanes):
        self.lanes = lanes
        self.native = ir.VectorType(ir.DoubleType(), lanes)
        super().__init__(name=f"vector{lanes}")


@register_default(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.native)


VECTOR, QUAD = Vector(LANES), Vector(4)
_INT32 = ir.IntType(32)


def _pointer(context, builder, signature, args, native):
    array = context.make_array(signature.args[0])(context, builder, args[0])
    index = context.cast(builder, args[1], signature.args[1], types.intp)
    return builder.bitcast(builder.gep(array.data, [index]), native.as_pointer())


def _loader(kind):
    @intrinsic
    def load(typingctx, a, i):
        def codegen(context, builder, signature, args):
            # aligned as a double only: the caller's row may start anywhere
            return builder.load(_pointer(context, builder, signature, args, kind.native), align=8)

        return kind(a, i), codegen

    return load


def _storer(kind):
    @intrinsic
    def store(typingctx, a, i, v):
        def codegen(context, builder, signature, args):
            builder.store(args[2], _pointer(context, builder, signature, args, kind.native), align=8)
            return context.get_dummy_value()

        return types.void(a, i, kind), codegen

    return store


def _splatter(kind):
    @intrinsic
    def splat(typingctx, x):
        def codegen(context, builder, signature, args):
            empty = ir.Constant(kind.native, ir.Undefined)
            first = builder.insert_element(empty, args[0], ir.Constant(_INT32, 0))
            mask = ir.Constant(ir.VectorType(_INT32, kind.lanes), [0] * kind.lanes)
            return builder.shuffle_vector(first, empty, mask)

        return kind(types.float64), codegen

    return splat


def _gathered(places):
    """Four lanes from scalars: lane k is argument `places[k]`."""

    def codegen(context, builder, signature, args):
        v = ir.Constant(QUAD.native, ir.Undefined)
        for k, place in enumerate(places):
            v = builder.insert_element(v, args[place], ir.Constant(_INT32, k))
        return v

    return codegen


@intrinsic
def _four_native(typingctx, a, b, c, d):
    return QUAD(types.float64, types.float64, types.float64, types.float64), _gathered((0, 1, 2, 3))


@intrinsic
def _pair_native(typingctx, a, b):
    return QUAD(types.float64, types.float64), _gathered((0, 0, 1, 1))


@intrinsic
def _lane_native(typingctx, v, k):
    def codegen(context, builder, signature, args):
        return builder.extract_element(args[0], builder.trunc(args[1], _INT32))

    return types.float64(v, types.int64), codegen


@intrinsic
def _ceiling_native(typingctx, v):
    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(v.native, [v.native])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.ceil.v{v.lanes}f64"), args)

    return v(v), codegen


def _shuffler(kind, source, places):
    def codegen(context, builder, signature, args):
        return builder.shuffle_vector(args[0], args[-1], ir.Constant(ir.VectorType(_INT32, len(places)), places))

    return lambda count: (kind(*[source] * count), codegen)


@intrinsic
def _joined_native(typingctx, a, b):
    return _shuffler(VECTOR, QUAD, list(range(8)))(2)


@intrinsic
def _low_native(typingctx, v):
    return _shuffler(QUAD, VECTOR, [0, 1, 2, 3])(1)


@intrinsic
def _high_native(typingctx, v):
    return _shuffler(QUAD, VECTOR, [4, 5, 6, 7])(1)


@intrinsic
def _turned_native(typingctx, v):
    def codegen(context, builder, signature, args):
        places = ir.Constant(ir.VectorType(_INT32, 4), [1, 0, 3, 2])
        swapped = builder.shuffle_vector(args[0], args[0], places)
        return builder.fmul(swapped, ir.Constant(QUAD.native, [-1.0, 1.0, -1.0, 1.0]))

    return QUAD(QUAD), codegen


@intrinsic
def _chosen_native(typingctx, a, b, x, y):
    def codegen(context, builder, signature, args):
        return builder.select(builder.fcmp_ordered("<=", args[0], args[1]), args[2], args[3])

    return x(a, a, x, x), codegen


def _operation(name):
    @intrinsic
    def apply(typingctx, a, b):
        return a(a, b), lambda context, builder, signature, args: getattr(builder, name)(*args)

    return apply


def _overloaded(symbol, name):
    apply = _operation(name)

    @overload(symbol)
    def _typed(a, b):
        if isinstance(a, Vector) and a == b:
            return lambda a, b: apply(a, b)
        if isinstance(a, Vector) and isinstance(b, types.Float):
            spread = _SPLATS[a.lanes]
            return lambda a, b: apply(a, spread(b))
        if isinstance(b, Vector) and isinstance(a, types.Float):
            spread = _SPLATS[b.lanes]
            return lambda a, b: apply(spread(a), b)
        if a == VECTOR and b == INTEGERS:
            return lambda a, b: apply(a, _as_doubles(b))
        return None


class Integers(types.Type):
    """Numba's type of eight int64 in one register."""

    native = ir.VectorType(ir.IntType(64), LANES)

    def __init__(self):
        super().__init__(name="integers8")


@register_default(Integers)
class _IntegersModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.native)


INTEGERS = Integers()


@intrinsic
def _integers_native(typingctx, a, i):
    def codegen(context, builder, signature, args):
        return builder.load(_pointer(context, builder, signature, args, INTEGERS.native), align=8)

    return INTEGERS(a, i), codegen


@intrinsic
def _splat_integer(typingctx, x):
    def codegen(context, builder, signature, args):
        empty = ir.Constant(INTEGERS.native, ir.Undefined)
        first = builder.insert_element(empty, args[0], ir.Constant(_INT32, 0))
        return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES))

    return INTEGERS(types.int64), codegen


@intrinsic
def _as_doubles(typingctx, v):
    return VECTOR(INTEGERS), lambda context, builder, signature, args: builder.sitofp(args[0], VECTOR.native)


@intrinsic
def _larger_native(typingctx, a, b):
    def codegen(context, builder, signature, args):
        top, b = args
        zero = ir.Constant(VECTOR.native, [0.0] * LANES)
        magnitude = builder.select(builder.fcmp_ordered("<", b, zero), builder.fsub(zero, b), b)
        return builder.select(builder.fcmp_ordered(">", magnitude, top), magnitude, top)

    return VECTOR(VECTOR, VECTOR), codegen


@intrinsic
def _store_fives_native(typingctx, a, i, v):
    def codegen(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        for first in range(0, FIVE * LANES, LANES):
            places = ir.Constant(ir.VectorType(_INT32, LANES), [(first + k) // FIVE for k in range(LANES)])
            at = builder.add(args[1], ir.Constant(args[1].type, first))
            pointer = builder.bitcast(builder.gep(array.data, [at]), VECTOR.native.as_pointer())
            builder.store(builder.shuffle_vector(args[2], args[2], places), pointer, align=8)
        return context.get_dummy_value()

    return types.void(a, types.int64, v), codegen


@intrinsic
def _totals_native(typingctx, a, b, c, d):
    def codegen(context, builder, signature, args):
        def shuffled(x, y, *places):
            return builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(_INT32, 4), list(places)))

        def added(x, y, low, high):
            return builder.fadd(shuffled(x, y, *low), shuffled(x, y, *high))

        a, b, c, d = (added(v, v, (0, 1, 2, 3), (4, 5, 6, 7)) for v in args)
        a, c = added(a, b, (0, 4, 2, 6), (1, 5, 3, 7)), added(c, d, (0, 4, 2, 6), (1, 5, 3, 7))
        return added(a, c, (0, 1, 4, 5), (2, 3, 6, 7))

    return QUAD(VECTOR, VECTOR, VECTOR, VECTOR), codegen


@intrinsic
def _clamped_native(typingctx, v, lo, hi):
    def codegen(context, builder, signature, args):
        v, lo, hi = args
        v = builder.select(builder.fcmp_ordered("<", v, lo), lo, v)
        return builder.select(builder.fcmp_ordered(">", v, hi), hi, v)

    return VECTOR(VECTOR, VECTOR, VECTOR), codegen


def _overloaded_integers(symbol, name):
    @intrinsic
    def apply(typingctx, a, b):
        return INTEGERS(INTEGERS, INTEGERS), lambda context, builder, signature, args: getattr(builder, name)(*args)

    @overload(symbol)
    def _typed(a, b):
        if a == INTEGERS and b == INTEGERS:
            return lambda a, b: apply(a, b)
        if a == INTEGERS and isinstance(b, types.Integer):
            return lambda a, b: apply(a, _splat_integer(b))
        if b == INTEGERS and isinstance(a, types.Integer):
            return lambda a, b: apply(_splat_integer(a), b)
        if symbol is operator.mul and a == INTEGERS and isinstance(b, types.Float):
            return lambda a, b: _as_doubles(a) * b
        return None


_SPLATS = {kind.lanes: _splatter(kind) for kind in (VECTOR, QUAD)}
for _symbol, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _overloaded(_symbol, _name)
for _symbol, _name in (
    (operator.add, "add"),
    (operator.sub, "sub"),
    (operator.mul, "mul"),
    (operator.and_, "and_"),
    (operator.xor, "xor"),
    (operator.rshift, "ashr"),
):
    _overloaded_integers(_symbol, _name)

load, store, splat = _loader(VECTOR), _storer(VECTOR), _SPLATS[LANES]
load4, store4, splat4 = _loader(QUAD), _storer(QUAD), _SPLATS[4]
four, pair, lane = _four_native, _pair_native, _lane_native
ceiling, chosen, turned4 = _ceiling_native, _chosen_native, _turned_native
joined, low, high = _joined_native, _low_native, _high_native
totals4 = _totals_native
integers, larger, clamped = _integers_native, _larger_native, _clamped_native
store_fives = _store_fives_native

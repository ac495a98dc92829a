"""Eight (or four) doubles side by side, for ticks of a block or for gyroscopes: one operation per lane, nothing else.

    load(a, i) = a[i : i + 8]     store(a, i, v)     splat(x) = x in every lane
    a + b   a - b   a * b   lane by lane; a number stands for itself in every lane
    integers(a, i)   eight int64 of an array, with + - * & ^ >>; times a double they become doubles
    larger(a, b)     the larger of a and the magnitude of b
    store_quads(a, i, step, v0, v1, v2, v3)   lane k of all four at a[i + k step : i + k step + 4]
    four(a, b, c, d)   pair(a, b) = a, a, b, b   splat4, load4, store4   lane(v, k) = v[k], k a constant    four lanes

LLVM maps a vector to whatever the CPU has (512, 256 or 128 bit) and never fuses, reorders or rounds differently: a lane
is bit for bit the scalar operation. Writing the lanes out keeps the speed of a loop from hanging on its vectoriser.
`load` and `store` check no bounds; the caller's arrays have room. Without compiler the lanes are NumPy arrays.
Source    docs/decisions/0007-frame-engine.md
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.datamodel import models, register_default
from numba.extending import intrinsic, overload

from fpga_model.jit import DISABLED

LANES = 8


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

    return types.float64(QUAD, types.int64), codegen


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
def _store_quads_native(typingctx, a, i, step, v0, v1, v2, v3):
    def codegen(context, builder, signature, args):
        def mixed(x, y, places):
            return builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(_INT32, len(places)), places))

        low = [0, 8, 1, 9, 2, 10, 3, 11]
        high = [place + 4 for place in low]
        halves = [(mixed(args[3], args[4], p), mixed(args[5], args[6], p)) for p in (low, high)]
        array = context.make_array(signature.args[0])(context, builder, args[0])
        at = args[1]
        for lane_ in range(LANES):
            x, y = halves[lane_ // 4]
            k = 2 * (lane_ % 4)
            quad = mixed(x, y, [k, k + 1, k + 8, k + 9])
            pointer = builder.bitcast(builder.gep(array.data, [at]), QUAD.native.as_pointer())
            builder.store(quad, pointer, align=8)
            at = builder.add(at, args[2])
        return context.get_dummy_value()

    return types.void(a, types.int64, types.int64, v0, v1, v2, v3), codegen


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
for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
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

if DISABLED:

    def load(a, i):
        """a[i : i + 8]."""
        return np.array(a[i : i + LANES])

    def store(a, i, v):
        """a[i : i + 8] = v."""
        a[i : i + LANES] = v

    def splat(x):
        """x in every lane."""
        return np.full(LANES, x)

    def load4(a, i):
        """a[i : i + 4]."""
        return np.array(a[i : i + 4])

    def store4(a, i, v):
        """a[i : i + 4] = v."""
        a[i : i + 4] = v

    def splat4(x):
        """x in four lanes."""
        return np.full(4, x)

    def four(a, b, c, d):
        """Four lanes."""
        return np.array((a, b, c, d))

    def pair(a, b):
        """a in the first two lanes, b in the others."""
        return np.array((a, a, b, b))

    def lane(v, k):
        """Lane k."""
        return float(v[k])

    def integers(a, i):
        """a[i : i + 8] of an int64 array."""
        return np.array(a[i : i + LANES])

    def larger(a, b):
        """The larger of `a` and the magnitude of `b`."""
        return np.fmax(a, np.abs(b))

    def store_quads(a, i, step, v0, v1, v2, v3):
        """Lane k of all four at a[i + k step : i + k step + 4]."""
        for k in range(LANES):
            a[i + k * step : i + k * step + 4] = (v0[k], v1[k], v2[k], v3[k])

else:
    load, store, splat = _loader(VECTOR), _storer(VECTOR), _SPLATS[LANES]
    load4, store4, splat4 = _loader(QUAD), _storer(QUAD), _SPLATS[4]
    four, pair, lane = _four_native, _pair_native, _lane_native
    integers, larger, store_quads = _integers_native, _larger_native, _store_quads_native


def aligned(size):
    """Zeros that start at a multiple of 64 bytes: a register of eight lanes then never straddles two cache lines."""
    whole = np.zeros(size + LANES)
    first = -(whole.ctypes.data // 8) % LANES
    return whole[first : first + size]

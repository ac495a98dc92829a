"""A nested record of numbers from two rows: the integers from one, the floats from the other, depth first.

    unpack_record(kind, ints, floats)   a record of that Kind, or of the type of a record; only what is used is read

For kernels that hold many records of one kind in arrays; `split` makes the rows. A Kind stands for the type alone: it
costs nothing as an argument, where a record of two hundred numbers would be copied at every call.
"""

from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.extending import NativeValue, intrinsic, models, register_model, typeof_impl, unbox

from fpga_model.jit import DISABLED


class Kind:
    """The type of a record, for `unpack_record`."""

    def __init__(self, record):
        self.record = record


class KindType(types.Type):
    """Numba's type of a Kind."""

    def __init__(self, record):
        self.record = record
        super().__init__(name=f"kind({record})")


@typeof_impl.register(Kind)
def _typeof_kind(kind, context):
    return KindType(typeof(kind.record))


@register_model(KindType)
class _KindModel(models.OpaqueModel):
    pass


@unbox(KindType)
def _unbox_kind(kind, item, c):
    return NativeValue(c.context.get_dummy_value())


def split(record):
    """(integers, floats) of a record, depth first; a part that is None has neither."""
    ints, floats = [], []

    def walk(node):
        if isinstance(node, tuple):
            for item in node:
                walk(item)
        elif isinstance(node, float):
            floats.append(node)
        elif node is not None:
            ints.append(int(node))

    walk(record)
    return ints, floats


def _unpack_python(kind, ints, floats):
    ints, floats = iter(ints), iter(floats)

    def build(node):
        if isinstance(node, tuple):
            items = [build(item) for item in node]
            return type(node)(*items) if hasattr(node, "_fields") else tuple(items)
        if node is None:
            return None
        return float(next(floats)) if isinstance(node, float) else int(next(ints))

    return build(kind.record if isinstance(kind, Kind) else kind)


@intrinsic
def _unpack_native(typingctx, kind, ints, floats):
    record = kind.record if isinstance(kind, KindType) else kind

    def codegen(context, builder, signature, args):
        arrays = [context.make_array(signature.args[k])(context, builder, args[k]) for k in (1, 2)]
        read_positions = [0, 0]

        def get(which, kind):
            array_type = signature.args[1 + which]
            read_position = context.get_constant(types.intp, read_positions[which])
            pointer = cgutils.get_item_pointer(context, builder, array_type, arrays[which], [read_position])
            read_positions[which] += 1
            value = context.unpack_value(builder, array_type.dtype, pointer)
            return context.cast(builder, value, array_type.dtype, kind)

        def build(kind):
            if isinstance(kind, types.BaseTuple):
                record_struct = ir.Constant(context.get_value_type(kind), ir.Undefined)
                for k, item in enumerate(kind.types):
                    record_struct = builder.insert_value(record_struct, build(item), k)
                return record_struct
            if isinstance(kind, types.NoneType):
                return context.get_dummy_value()
            return get(1 if isinstance(kind, types.Float) else 0, kind)

        return build(record)

    return record(kind, ints, floats), codegen


unpack_record = _unpack_python if DISABLED else _unpack_native

"""Nested state records as rows of int64: what traces, saved states and golden vectors are made of.

A row is the record depth first, tuples of registers in place. `store` runs inside kernels at the speed of the stores;
`names`, `widths` and `rebuild` walk the same order in Python, from the record and its formats alone.
"""

from fpga_model.block import fill_shape, leaves
from fpga_model.jit import DISABLED

format_leaves = leaves  # of a tree of formats, where a `Fmt` is a leaf


def names(record):
    """Dotted register names in row order."""
    return [name for name, _ in leaves(record)]


def rebuild(template, row):
    """Record of the same shape as `template` from a row of integers; the inverse of `store`."""
    values = iter(row)
    return fill_shape(template, lambda _: int(next(values)))


def _store_python(row, record):
    for k, (_, value) in enumerate(leaves(record)):
        row[k] = value


if DISABLED:
    store = _store_python
else:
    from numba import types
    from numba.core import cgutils
    from numba.extending import intrinsic, register_jitable

    @intrinsic
    def _store_native(typingctx, row, record):
        def codegen(context, builder, signature, args):
            array = context.make_array(signature.args[0])(context, builder, args[0])
            position = 0

            def store_leaves(kind, value):
                nonlocal position
                if isinstance(kind, types.NoneType):
                    return
                if isinstance(kind, types.BaseTuple):
                    for k, item in enumerate(kind.types):
                        store_leaves(item, builder.extract_value(value, k))
                    return
                pointer = cgutils.get_item_pointer(
                    context, builder, signature.args[0], array, [context.get_constant(types.intp, position)]
                )
                wide = context.cast(builder, value, kind, types.int64)
                context.pack_value(builder, types.int64, wide, pointer)
                position += 1

            store_leaves(signature.args[1], args[1])
            return context.get_dummy_value()

        return types.void(row, record), codegen

    @register_jitable
    def store(row, record):
        """Write every register of `record` into `row` (int64, at least as long), depth first."""
        _store_native(row, record)

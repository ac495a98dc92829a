"""`record._replace(field=value, ...)` in compiled code: a record with some of its fields changed, as in Python.

Numba knows the constructors of NamedTuples but not this method of theirs; machine code is that of the constructor.
"""

from inspect import Parameter, Signature

from numba.core import types
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, signature
from numba.extending import lower_builtin

KEY = "namedtuple._replace"


class _Replace(AbstractTemplate):
    key = KEY

    def generic(self, args, kws):
        if args or not set(kws) <= set(self.this.fields):
            return None
        replacement_types = [kws.get(name, types.none) for name in self.this.fields]
        field_types = [old if new is types.none else new for old, new in zip(self.this.types, replacement_types)]
        names = [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=None) for name in self.this.fields]
        changed = types.BaseTuple.from_types(field_types, self.this.instance_class)
        return signature(changed, *replacement_types, recvr=self.this).replace(pysig=Signature(names))


@infer_getattr
class _Attribute(AttributeTemplate):
    key = types.BaseNamedTuple

    def resolve__replace(self, record):
        return types.BoundFunction(_Replace, record)


@lower_builtin(KEY, types.BaseNamedTuple, types.VarArg(types.Any))
def _lower_replace(context, builder, sig, args):
    record, *replacement_values = args
    items = (
        builder.extract_value(record, k) if kind is types.none else value
        for k, (kind, value) in enumerate(zip(sig.args[1:], replacement_values))
    )
    return context.make_tuple(builder, sig.return_type, items)

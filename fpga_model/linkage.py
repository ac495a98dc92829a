"""How compiled functions come together: parts are included in their callers, units are called by their symbol.

    part   optimised in its caller alone: Numba makes machine code of it, and of every level above it, each time anew
    unit   has machine code of its own in the cache; a caller includes nothing of it and links to its symbol.
           What a cached caller links to is loaded before it (`find_units`)

Source    docs/decisions/0015-compile-units.md
"""

import importlib

import llvmlite.binding as llvm
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _NoEnvironment:
    """A code generator that sets no environment: a part has no symbol in the running engine."""

    def __init__(self, codegen):
        self._codegen = codegen

    def __getattr__(self, name):
        return getattr(self._codegen, name)

    def set_env(self, name, environment):
        """None is needed: only functions with a wrapper for Python read theirs."""


class Part(JITCodeLibrary):
    """The library of a function without machine code of its own."""

    @property
    def codegen(self):
        return _NoEnvironment(self._codegen)

    def _optimize_functions(self, module):
        """Left to the caller, which does it for all parts at once."""
        module.data_layout = self._codegen._data_layout

    def finalize(self):
        self._raise_if_finalized()
        for library in self._linking_libraries:
            self._reload_init.update(library._reload_init)
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name):
        self._ensure_finalized()
        return 0

    def _get_module_for_linking(self):
        """The function and all that it reaches, each once, to be included in a caller."""
        if self._shared_module is None:
            self._shared_module = _linkonce_module(self)
            for library in _reachable_libraries(self)[1:]:
                self._shared_module.link_in(
                    _linkonce_module(library) if isinstance(library, Part) else library._get_module_for_linking(),
                    preserve=True,
                )
        return self._shared_module


def _linkonce_module(part):
    """A copy of a part's own module whose functions may be defined twice and dropped."""
    module = part._final_module.clone()
    for function in module.functions:
        if not function.is_declaration and function.linkage.name == "external":
            function.linkage = "linkonce_odr"
    return module


def _reachable_libraries(part):
    """The libraries that a part reaches, itself first, each once and behind all that use it.

    LLVM's linker takes in what may be dropped only where something that it has already asks for it.
    """
    out, visited_libraries = [], set()

    def visit(library):
        visited_libraries.add(library)
        for other in library._linking_libraries if isinstance(library, Part) else ():
            if other not in visited_libraries:
                visit(other)
        out.append(library)

    visit(part)
    return out[::-1]


class PartCompiler(Compiler):
    """As Numba's, for a `Part`."""

    def __init__(self, typingctx, targetctx, library, *rest):
        library = Part(targetctx.codegen(), "part")
        library.enable_object_caching()
        super().__init__(typingctx, targetctx, library, *rest)


def forget_constants(dispatcher):
    """One compilation for all constants that a function is called with; LLVM sees them where it is included."""
    template = dispatcher.get_call_template

    def get_call_template(args, kws):
        plain = tuple(types.unliteral(a) for a in args)
        return template(plain, {name: types.unliteral(a) for name, a in kws.items()})

    dispatcher.get_call_template = get_call_template


# ---- units -----------------------------------------------------------------------------------------------------------


def make_unit(dispatcher, result):
    """From now on callers of this compiled function link to its symbol instead of including it."""
    library = result.library
    name = dispatcher.py_func.__module__, dispatcher.py_func.__qualname__
    library.unit = (*name, result.fndesc.mangled_name, tuple(result.signature.args))
    library._shared_module = llvm.parse_assembly(str(library._codegen._create_empty_module(library.name)))


def units(library):
    """[(module, function, symbol, arguments)] of the units that a freshly compiled library calls."""
    visited_libraries, ahead, unit_by_symbol = set(), list(library._linking_libraries), {}
    while ahead:
        other = ahead.pop()
        if other not in visited_libraries:
            visited_libraries.add(other)
            if unit := getattr(other, "unit", None):
                unit_by_symbol[unit[:3]] = unit
            ahead.extend(other._linking_libraries if isinstance(other, Part) else ())
    return [unit_by_symbol[key] for key in sorted(unit_by_symbol)]


def find_units(linked_units):
    """Load what a cached function calls; False where a symbol is missing, so that the function is compiled anew."""
    for module, name, symbol, arguments in linked_units:
        try:
            unit = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError):  # of a script, or within a function: nobody else can find it
            return False
        unit.compile(arguments)
        if symbol not in {result.fndesc.mangled_name for result in unit.overloads.values()}:
            return False
    return True


WRAPPER = "_ZN7cpython"  # begins the names of what Python calls: it unpacks records, once a call


class UnitLibrary(JITCodeLibrary):
    """A library that is optimised in one go: what Numba does before serves the pruning of reference counts."""

    def _optimize_functions(self, module):
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self):
        for function in self._final_module.functions:
            if function.name.startswith(WRAPPER) and not function.is_declaration:
                function.add_function_attribute("noinline")
                function.add_function_attribute("optnone")
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)


class UnitCompiler(Compiler):
    """As Numba's, for a `UnitLibrary`."""

    def __init__(self, typingctx, targetctx, library, *rest):
        library = UnitLibrary(targetctx.codegen(), "unit")
        library.enable_object_caching()
        super().__init__(typingctx, targetctx, library, *rest)

"""The one place that configures Numba: `kernel` in general, `hot` for time loops, `inlined` inside them.

Machine code is kept from one process to the next: see `kernel_cache`. What a process has replaced in memory is in the
key of the kernel itself: see `bound`. A kernel that is there is loaded without a lock; a process that finds one being
compiled by another process waits, says for whom, and takes what that one has stored.
Where `fpga_model.COMPILED` is set to False before anything is imported, as by commands that run no kernel, Numba is not
loaded and functions stay Python.
"""

import contextlib
import functools
import gc
from pathlib import Path

import fpga_model
from fpga_model.kernel_cache import (  # noqa: F401  (for those who know of kernels alone)
    DISABLED,
    PACKAGES,
    ROOT,
    cache_folder,
    cache_root,
    is_cached,
    kernel_sources,
)

if fpga_model.COMPILED:
    from numba import njit
    from numba.core.compiler_lock import global_compiler_lock

    from fpga_model import bound, linkage, replacing, shared_files  # noqa: F401  (for what one of them tells Numba)
    from fpga_model.kernel_cache import KernelCache, argument_types

CACHE = cache_folder(Path(__file__).resolve()) is not None


@contextlib.contextmanager
def _pause_garbage_collector():
    """Without the collector, which would look through millions of objects of a compilation that still lives."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _compile_unit(func, buried=False, **options):
    """A function with machine code of its own, from the cache where there is one.

    buried  has no wrapper for Python
    """
    if DISABLED:
        return func
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": buried, **options}
    folder = cache_folder(Path(func.__code__.co_filename).resolve()) if CACHE else None
    if not options.get("_nrt", True):
        options["pipeline_class"] = linkage.UnitCompiler
    dispatcher = njit(**options)(func)
    cache = None if folder is None else KernelCache(dispatcher, folder, linkage.units, linkage.find_units)
    if cache is not None:
        dispatcher._cache = cache
    if buried:
        _bury(dispatcher, _reject_call)
    linkage.forget_constants(dispatcher)
    compile_or_load = dispatcher.compile

    def compile_locked(signature):
        arguments = argument_types(signature)
        # Numba's own lock first: a thread that waits for it must not keep a file from the one that has it
        with global_compiler_lock:
            if arguments in dispatcher.overloads:
                return dispatcher.overloads[arguments].entry_point
            if cache is not None and cache.read(signature):
                entry = compile_or_load(signature)
            else:
                # nothing calls itself, so none waits in a ring
                compiles = f"compiles {func.__module__}.{func.__qualname__}"
                file_lock = shared_files.wait_for_lock(cache.lock, compiles) if cache else contextlib.nullcontext()
                with file_lock, _pause_garbage_collector():
                    if cache is not None:
                        cache.read(signature)
                    entry = compile_or_load(signature)
            linkage.make_unit(dispatcher, dispatcher.overloads[arguments])
            bound.compiled(func)
            return entry

    dispatcher.compile = compile_locked
    return dispatcher


def _bury(dispatcher, called):
    """Only compiled code finds the overloads: a call from Python gets what `called` of the function returns."""

    def add_overload(result):
        dispatcher.overloads[tuple(result.signature.args)] = result

    # an overload that Python's own dispatch does not know of leads to `_compile_for_args`: what it returns is called
    dispatcher.add_overload = add_overload
    dispatcher._compile_for_args = lambda *_, **__: called(dispatcher.py_func)
    linkage.forget_constants(dispatcher)


def kernel(func):
    """Compile in nopython mode: no fastmath, no threads, IEEE doubles and int64 only."""
    return _compile_unit(func)


def hot(func):
    """As `kernel`, for time loops: no reference counting, so that arrays in records cost nothing.

    Such a function cannot allocate and must not return an array; it works in what it is given. It runs without the
    interpreter's lock, so threads that work in arrays of their own run at once.
    """
    return _compile_unit(func, nogil=True, _nrt=False)


def _inline_part(func, called, **options):
    """A function of which compiled code includes the source; `called(func)` is what a call from Python gets."""
    if DISABLED:
        return func
    options = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **options}
    dispatcher = njit(pipeline_class=linkage.PartCompiler, **options)(func)
    _bury(dispatcher, called)
    return dispatcher


def _reject_call(func):
    raise TypeError(f"{func.__module__}.{func.__name__} can only be called by compiled code: wrap it in a kernel")


@functools.cache
def _compile_standalone_unit(func):
    return _compile_unit(func, _nrt=False)


def unit(func):
    """A large part of time loops that is compiled once, however many call it. Only compiled code can call it.

    As `hot`, without a wrapper for Python. Nothing of it is inlined, so it is for what takes a microsecond or more.
    """
    return _compile_unit(func, buried=True, _nrt=False)


def outlined(func):
    """A part of a time loop that stays a function of its own. Only compiled code can call it.

    It has no wrapper for Python: for records of hundreds of fields that takes longer to compile than the body.
    """
    return _inline_part(func, _reject_call)


def inner(func):
    """As `inlined`, but only compiled code can call it; for what takes whole designs as records (see `outlined`)."""
    return _inline_part(func, _reject_call, forceinline=True)


def inlined(func):
    """Inlined by LLVM into its caller: for what runs at every edge of the 26 MHz clock.

    A call from Python compiles it once more, alone.
    """
    return _inline_part(func, _compile_standalone_unit, forceinline=True)

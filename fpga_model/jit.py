"""The one place that configures Numba: `kernel` in general, `hot` for time loops, `inlined` inside them.

Numba's disk cache stamps a function by its own file only, so an edited callee is not seen. The cache folder of a kernel
is therefore named by a hash of every source file that it may be compiled from: see `sources_of`.
`GYRO_CACHE=0` switches it off; `GYRO_CACHE=DIR` moves it.
"""

import functools
import hashlib
import os
import shutil
from pathlib import Path

import numba
from numba import njit

ROOT = Path(__file__).resolve().parent.parent
SHARED = ("fpga_model/**/*.py", "analog_frontend/**/*.py", "testbench/*.py")
ALL = (*SHARED, "testbench/**/*.py")
MIXED = ("bench",)  # its kernels may call those of any folder
KEPT_CACHES = 4
DISABLED = bool(numba.config.DISABLE_JIT)


def sources_of(path):
    """Patterns of the files that a kernel in the file `path` may be compiled from.

    The engines know nothing of the folders under testbench/, and the kernels of such a folder call those of no other:
    an edit in a report leaves the engines compiled. tests/test_architecture.py holds the sources to it.
    """
    parts = path.relative_to(ROOT).parts if path.is_relative_to(ROOT) else ()
    if parts[:1] in (("fpga_model",), ("analog_frontend",)) or (parts[:1] == ("testbench",) and len(parts) == 2):
        return SHARED
    if parts[:1] == ("testbench",) and parts[1] not in MIXED:
        return (*SHARED, f"testbench/{parts[1]}/**/*.py")
    return ALL


@functools.cache
def source_digest(root, patterns):
    """SHA-256 over the path and bytes of every Python source under `root` that a pattern names."""
    digest = hashlib.sha256(f"{numba.__version__} {numba.config.SLP_VECTORIZE}".encode())
    for path in sorted({path for pattern in patterns for path in root.glob(pattern)}):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


@functools.cache
def cache_folder(patterns):
    """The folder that only kernels of these very sources use; None when caching is off or not possible."""
    where = os.environ.get("GYRO_CACHE", "")
    if where == "0" or DISABLED or numba.config.BOUNDSCHECK:
        return None
    home = Path(where or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ftr-gyro"
    if patterns != SHARED:
        home = home / hashlib.sha256(repr(patterns).encode()).hexdigest()[:8]
    folder = home / source_digest(ROOT, patterns)[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for old in sorted(home.glob("?" * 16), key=lambda p: p.stat().st_mtime)[:-KEPT_CACHES]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return None
    return folder


CACHE = cache_folder(SHARED) is not None


def _cached(func):
    """Whether `func` is cached; Numba reads the folder when it decorates."""
    folder = cache_folder(sources_of(Path(func.__code__.co_filename).resolve())) if CACHE else None
    if folder is not None:
        numba.config.CACHE_DIR = str(folder)
    return folder is not None


def kernel(func):
    """Compile in nopython mode: no fastmath, no threads, IEEE doubles and int64 only."""
    return njit(cache=_cached(func), error_model="numpy", no_cfunc_wrapper=True)(func)


def hot(func):
    """As `kernel`, for time loops: no reference counting, so that arrays in records cost nothing.

    Such a function cannot allocate and must not return an array; it works in what it is given. It runs without the
    interpreter's lock, so threads that work in arrays of their own run at once.
    """
    return njit(cache=_cached(func), error_model="numpy", no_cfunc_wrapper=True, nogil=True, _nrt=False)(func)


def _buried(func, **options):
    """A function for compiled callers only: no wrapper for Python, and a Python caller gets an error, not a crash."""
    options = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **options}
    dispatcher = njit(**options)(func)
    if DISABLED:
        return dispatcher

    def refuse(*_, **__):
        raise TypeError(f"{func.__module__}.{func.__name__} can only be called by compiled code: wrap it in a kernel")

    def add_overload(result):
        dispatcher.overloads[tuple(result.signature.args)] = result

    # an overload that Python's own dispatch does not know of leads to `_compile_for_args`, which refuses
    dispatcher.add_overload = add_overload
    dispatcher._compile_for_args = refuse
    return dispatcher


def outlined(func):
    """A part of a time loop that stays a function of its own. Only compiled code can call it.

    It has no wrapper for Python: for records of hundreds of fields that takes longer to compile than the body.
    """
    return _buried(func)


def inner(func):
    """As `inlined`, but only compiled code can call it; for what takes whole designs as records (see `outlined`)."""
    return _buried(func, forceinline=True)


def inlined(func):
    """Inlined by LLVM into its caller: for what runs at every edge of the 26 MHz clock.

    Never cached alone: a callee that comes from the cache is object code, and LLVM cannot inline that (3 times slower).
    """
    return njit(error_model="numpy", no_cfunc_wrapper=True, forceinline=True, _nrt=False)(func)

"""The one place that configures Numba: `kernel` in general, `hot` for time loops, `inlined` inside them.

Numba's disk cache stamps a function by its own file only, so an edited callee is not seen. The cache folder is
therefore named by a hash of every source file of the three packages: an edit anywhere means a new folder.
`GYRO_CACHE=0` switches it off; `GYRO_CACHE=DIR` moves it.
"""

import hashlib
import os
import shutil
from pathlib import Path

import numba
from numba import njit

PACKAGES = ("fpga_model", "analog_frontend", "testbench")
KEPT_CACHES = 4
DISABLED = bool(numba.config.DISABLE_JIT)


def source_digest(root):
    """SHA-256 over the path and bytes of every Python source of the three packages under `root`."""
    digest = hashlib.sha256(f"{numba.__version__} {numba.config.SLP_VECTORIZE}".encode())
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _enable_cache():
    """Point Numba at a folder that only these very sources use; False when caching is off or not possible."""
    where = os.environ.get("GYRO_CACHE", "")
    if where == "0" or DISABLED or numba.config.BOUNDSCHECK:
        return False
    home = Path(where or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ftr-gyro"
    folder = home / source_digest(Path(__file__).resolve().parent.parent)[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for old in sorted(home.iterdir(), key=lambda p: p.stat().st_mtime)[:-KEPT_CACHES]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return False
    numba.config.CACHE_DIR = str(folder)
    return True


CACHE = _enable_cache()


def kernel(func):
    """Compile in nopython mode: no fastmath, no threads, IEEE doubles and int64 only."""
    return njit(cache=CACHE, error_model="numpy", no_cfunc_wrapper=True)(func)


def hot(func):
    """As `kernel`, for time loops: no reference counting, so that arrays in records cost nothing.

    Such a function cannot allocate and must not return an array; it works in what it is given. It runs without the
    interpreter's lock, so threads that work in arrays of their own run at once.
    """
    return njit(cache=CACHE, error_model="numpy", no_cfunc_wrapper=True, nogil=True, _nrt=False)(func)


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

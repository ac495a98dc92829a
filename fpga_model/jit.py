"""The one place that configures Numba: `kernel` in general, `hot` for time loops, `inlined` inside them.

Numba's disk cache stamps a function by its own file only, so an edited callee is not seen. The cache folder of a kernel
is therefore named by a hash over its module and every module that this one imports, directly or not: see `sources_of`.
What a process has replaced in memory is in the key of the kernel itself: see `bound`.
A process that finds a kernel being compiled by another one waits, and takes what that one has stored.
`GYRO_CACHE=0` switches the cache off; `GYRO_CACHE=DIR` moves it. A user without a home that can be written gets a
private folder among the temporary files. Where `fpga_model.COMPILED` is set to False before anything is imported, as by
commands that run no kernel, Numba is not loaded and functions stay Python.
"""

import contextlib
import functools
import gc
import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from pathlib import Path

import fpga_model

try:
    import fcntl
except ImportError:  # no POSIX: two processes on an empty cache compile both
    fcntl = None

if fpga_model.COMPILED:
    # colours of errors that nobody reads took a tenth of a compilation
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    import numba
    from numba import njit
    from numba.core.compiler_lock import global_compiler_lock

    from fpga_model import bound, linkage, replacing  # noqa: F401  (for what it tells Numba)

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("fpga_model", "analog_frontend", "testbench")
IMPORT = re.compile(
    rf"^[ \t]*(?:from[ \t]+((?:{'|'.join(PACKAGES)})[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n(]*)"
    rf"|import[ \t]+((?:{'|'.join(PACKAGES)})[\w.]*))",
    re.MULTILINE,
)
KEPT_CACHES, KEPT_S = 4, 3600.0  # of other versions of the sources; another process may still use a younger one
DISABLED = not fpga_model.COMPILED or bool(numba.config.DISABLE_JIT)


def _file_of(name):
    """Source of a dotted module name, or None if it names something within a module."""
    base = ROOT.joinpath(*name.split("."))
    module, package = base.with_suffix(".py"), base / "__init__.py"
    return module if module.is_file() else package if package.is_file() else None


@functools.cache
def imported(path):
    """Our own source files that the file `path` imports, with the packages above them."""
    found = set()
    for module, names, plain in IMPORT.findall(path.read_text()):
        wanted = [module or plain]
        for name in re.sub(r"#[^\n]*|[()]", "", names).split(","):
            if words := name.split():
                wanted.append(f"{module}.{words[0]}")
        for name in wanted:
            parts = name.split(".")
            found |= {_file_of(".".join(parts[:n])) for n in range(1, len(parts) + 1)}
    return frozenset(found - {None, path})


@functools.cache
def sources_of(path):
    """The file `path` and all of ours that it imports, directly or not: all that its kernels can be compiled from."""
    seen, ahead = set(), [path]
    while ahead:
        file = ahead.pop()
        if file not in seen:
            seen.add(file)
            ahead.extend(imported(file))
    return tuple(sorted(seen))


@functools.cache
def _digest(path):
    return hashlib.sha256(path.read_bytes()).digest()


def source_digest(path):
    """SHA-256 over names and bytes of `sources_of(path)`, and what else machine code depends on."""
    digest = hashlib.sha256(f"{numba.__version__} {numba.config.SLP_VECTORIZE}".encode())
    for file in sources_of(path):
        digest.update(os.path.relpath(file, ROOT).encode() + _digest(file))
    return digest.hexdigest()


def _users_root():
    """The cache folder that the user names or has, if it can be written; None otherwise."""
    named = os.environ.get("GYRO_CACHE") or os.environ.get("XDG_CACHE_HOME")
    try:
        root = Path(named) if named else Path.home() / ".cache"
        root.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: neither HOME nor an entry in passwd
        return None
    return root if os.access(root, os.W_OK | os.X_OK) else None


def _private_root():
    """A folder among the temporary files that only this user can enter; None if somebody else has its name."""
    root = Path(tempfile.gettempdir()) / f"ftr-gyro-{os.getuid()}"
    try:
        with contextlib.suppress(FileExistsError):
            root.mkdir(mode=0o700)
        found = root.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return root if private else None


@functools.cache
def cache_root():
    """Folder that all caches lie in, or None; where the user has none, libraries and children use the private one."""
    root = _users_root()
    if root is not None or not hasattr(os, "getuid"):
        return root
    root = _private_root()
    if root is None:
        print("gyro: no folder for compiled kernels can be written: each process compiles them again", file=sys.stderr)
    else:
        print(f"gyro: no home that can be written: compiled kernels are kept in {root}", file=sys.stderr)
        os.environ["GYRO_CACHE"] = os.environ["XDG_CACHE_HOME"] = str(root)
        os.environ.setdefault("MPLCONFIGDIR", str(root))
    return root


@functools.cache
def cache_folder(path):
    """The folder that only kernels of these very sources use; None when caching is off or not possible."""
    if os.environ.get("GYRO_CACHE") == "0" or DISABLED or numba.config.BOUNDSCHECK or cache_root() is None:
        return None
    name = os.path.relpath(path, ROOT).removesuffix(".py").replace(os.sep, ".").lstrip(".")
    home = cache_root() / "ftr-gyro" / name
    folder = home / source_digest(path)[:16]
    try:
        new = not folder.is_dir()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        if new:
            for old in sorted(home.glob("?" * 16), key=lambda p: p.stat().st_mtime)[:-KEPT_CACHES]:
                if time.time() - old.stat().st_mtime > KEPT_S:
                    shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return None
    return folder


CACHE = cache_folder(Path(__file__).resolve()) is not None


def is_cached(dispatcher):
    """Whether the cache has machine code of a function, made from this copy of its source."""
    return any(Path(dispatcher._cache.cache_path).glob(f"*.{dispatcher.py_func.__name__}-*.nbi"))


@contextlib.contextmanager
def _alone(folder, func):
    """Only one process compiles a function; others wait, and load it. Nothing calls itself, so none waits in a ring."""
    if fcntl is None or folder is None:
        yield
        return
    with open(folder / f"{func.__qualname__}.lock", "a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def _uncollected():
    """Without the collector, which would look through millions of objects of a compilation that still lives."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _unit(func, buried=False, **options):
    """A function with machine code of its own, from the cache where there is one.

    buried  has no wrapper for Python
    """
    if DISABLED:
        return func
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": buried, **options}
    folder = cache_folder(Path(func.__code__.co_filename).resolve()) if CACHE else None
    numba.config.CACHE_DIR = str(folder or "")  # Numba reads it when it decorates
    if not options.get("_nrt", True):
        options["pipeline_class"] = linkage.UnitCompiler
    dispatcher = njit(cache=folder is not None, **options)(func)
    if folder is not None:  # Numba's own folder in it: two copies of the same sources have one each
        folder = Path(dispatcher._cache.cache_path)
        key_of = dispatcher._cache._index_key
        dispatcher._cache._index_key = lambda *wanted: (*key_of(*wanted), bound.digest(func))
    if buried:
        _bury(dispatcher, _refused)
    linkage.forget_constants(dispatcher)
    compile_or_load = dispatcher.compile

    def compile_alone(signature):
        arguments = linkage.arguments_of(signature)
        # Numba's own lock first: a thread that waits for it must not keep a folder from the one that has it
        with global_compiler_lock:
            if arguments in dispatcher.overloads:
                return dispatcher.overloads[arguments].entry_point
            if folder is not None:  # it may have been removed since the function was decorated
                folder.mkdir(parents=True, exist_ok=True)
            with _alone(folder, func), _uncollected():
                if folder is not None:
                    linkage.load_units(folder, dispatcher, arguments)
                loaded = sum(dispatcher.stats.cache_hits.values())
                entry = compile_or_load(signature)
                if folder is not None and loaded == sum(dispatcher.stats.cache_hits.values()):
                    linkage.store_units(folder, dispatcher, arguments)
                linkage.make_unit(dispatcher, dispatcher.overloads[arguments])
                bound.compiled(func)
                return entry

    dispatcher.compile = compile_alone
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
    return _unit(func)


def hot(func):
    """As `kernel`, for time loops: no reference counting, so that arrays in records cost nothing.

    Such a function cannot allocate and must not return an array; it works in what it is given. It runs without the
    interpreter's lock, so threads that work in arrays of their own run at once.
    """
    return _unit(func, nogil=True, _nrt=False)


def _part(func, called, **options):
    """A function of which compiled code includes the source; `called(func)` is what a call from Python gets."""
    if DISABLED:
        return func
    options = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **options}
    dispatcher = njit(pipeline_class=linkage.PartCompiler, **options)(func)
    _bury(dispatcher, called)
    return dispatcher


def _refused(func):
    raise TypeError(f"{func.__module__}.{func.__name__} can only be called by compiled code: wrap it in a kernel")


@functools.cache
def _alone_compiled(func):
    return _unit(func, _nrt=False)


def unit(func):
    """A large part of time loops that is compiled once, however many call it. Only compiled code can call it.

    As `hot`, without a wrapper for Python. Nothing of it is inlined, so it is for what takes a microsecond or more.
    """
    return _unit(func, buried=True, _nrt=False)


def outlined(func):
    """A part of a time loop that stays a function of its own. Only compiled code can call it.

    It has no wrapper for Python: for records of hundreds of fields that takes longer to compile than the body.
    """
    return _part(func, _refused)


def inner(func):
    """As `inlined`, but only compiled code can call it; for what takes whole designs as records (see `outlined`)."""
    return _part(func, _refused, forceinline=True)


def inlined(func):
    """Inlined by LLVM into its caller: for what runs at every edge of the 26 MHz clock.

    A call from Python compiles it once more, alone.
    """
    return _part(func, _alone_compiled, forceinline=True)

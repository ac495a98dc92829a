"""Where machine code is kept: a sealed file for each function and kind of arguments, in a folder of this user alone.

    ROOT/ftr-gyro/MODULE/HASH/FUNCTION-KEY.kernel    HASH   of the sources that a kernel of MODULE can be compiled from
                                                     KEY    of all else that the machine code depends on
A file is its seal, a SHA-256 over what it is for and what it holds, then a pickle. Nothing is unpickled before the seal
holds and the file is known to be writable by this user alone; otherwise the kernel is compiled again, with one line.
Numba's own cache stamps a function by its own file only, so an edited callee is not seen, and trusts what it reads.
`GYRO_CACHE=0` switches the cache off; `GYRO_CACHE=DIR` moves it. A user without a folder of his own gets a private one
among the temporary files.
Source  docs/speed.md, docs/decisions/0015-compile-units.md
"""

import contextlib
import functools
import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
import time
from pathlib import Path

import fpga_model
from fpga_model import shared_files

if fpga_model.COMPILED:
    # colours of errors that nobody reads took a tenth of a compilation
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    import numba
    from numba.core import compiler, serialize, sigutils

    from fpga_model import bound

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("fpga_model", "analog_frontend", "testbench")
IMPORT = re.compile(
    rf"^[ \t]*(?:from[ \t]+((?:{'|'.join(PACKAGES)})[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n(]*)"
    rf"|import[ \t]+((?:{'|'.join(PACKAGES)})[\w.]*))",
    re.MULTILINE,
)
MOST_OLD_CACHES, LEAST_CACHE_AGE_S = (
    4,
    3600.0,
)  # of other versions of the sources; another process may still use a younger one
DISABLED = not fpga_model.COMPILED or bool(numba.config.DISABLE_JIT)
FOLDER, ENDING = "ftr-gyro", ".kernel"
SEAL_BYTES = hashlib.sha256().digest_size
SHARED_WRITE_BITS = stat.S_IWGRP | stat.S_IWOTH


# ---- sources ---------------------------------------------------------------------------------------------------------


def _module_file(name):
    """Source of a dotted module name, or None if it names something within a module."""
    base = ROOT.joinpath(*name.split("."))
    module, package = base.with_suffix(".py"), base / "__init__.py"
    return module if module.is_file() else package if package.is_file() else None


@functools.cache
def direct_imports(path):
    """Our own source files that the file `path` imports, with the packages above them."""
    source_files = set()
    for module, names, plain in IMPORT.findall(path.read_text()):
        module_names = [module or plain]
        for name in re.sub(r"#[^\n]*|[()]", "", names).split(","):
            if words := name.split():
                module_names.append(f"{module}.{words[0]}")
        for name in module_names:
            parts = name.split(".")
            source_files |= {_module_file(".".join(parts[:n])) for n in range(1, len(parts) + 1)}
    return frozenset(source_files - {None, path})


@functools.cache
def kernel_sources(path):
    """The file `path` and all of ours that it imports, directly or not: all that its kernels can be compiled from."""
    source_files, ahead = set(), [path]
    while ahead:
        file = ahead.pop()
        if file not in source_files:
            source_files.add(file)
            ahead.extend(direct_imports(file))
    return tuple(sorted(source_files))


@functools.cache
def _file_digest(path):
    return hashlib.sha256(path.read_bytes()).digest()


def source_digest(path):
    """SHA-256 over names and bytes of `kernel_sources(path)`, and what else machine code depends on."""
    digest = hashlib.sha256(f"{numba.__version__} {numba.config.SLP_VECTORIZE}".encode())
    for file in kernel_sources(path):
        digest.update(os.path.relpath(file, ROOT).encode() + _file_digest(file))
    return digest.hexdigest()


# ---- the folder ------------------------------------------------------------------------------------------------------


def _print_notice(text):
    print(f"gyro: {text}", file=sys.stderr, flush=True)


def _fault(folder):
    """Why a folder is no place for machine code, in words, or None; it is made, and closed to others."""
    try:
        if link := shared_files.foreign_link(folder):
            return f"is reached through {link}, a link of another user"
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        folder_status = folder.stat()
        if not stat.S_ISDIR(folder_status.st_mode):
            return "is no folder"
        if folder_status.st_uid != os.geteuid():
            return f"belongs to another user (uid {folder_status.st_uid})"
        if folder_status.st_mode & SHARED_WRITE_BITS:
            folder.chmod(0o700)
    except (OSError, RuntimeError) as problem:
        return f"cannot be written: {getattr(problem, 'strerror', None) or problem}"
    return None if os.access(folder, os.W_OK | os.X_OK) else "cannot be written"


@functools.cache
def cache_root():
    """Folder that all caches lie in, or None; where the user has none, libraries and children use the private one."""
    cache_setting = os.environ.get("GYRO_CACHE") or os.environ.get("XDG_CACHE_HOME")
    if cache_setting == "0":
        return None
    try:
        root = Path(cache_setting) if cache_setting else Path.home() / ".cache"
        fault = _fault(root / FOLDER)
    except RuntimeError:  # neither HOME nor an entry in passwd
        root, fault = None, "no writable home folder"
    if fault is None:
        return root / FOLDER
    where = f"{root / FOLDER} {fault}" if root else fault
    private = Path(tempfile.gettempdir()) / f"{FOLDER}-{os.geteuid()}"
    if _fault(private) or _fault(private / FOLDER):
        _print_notice(
            f"{where}: kernels are not stored, so each process compiles them; set GYRO_CACHE to a folder of your own"
        )
        return None
    _print_notice(f"{where}: compiled kernels are stored in {private}; set GYRO_CACHE to a folder of your own")
    os.environ["GYRO_CACHE"] = os.environ["XDG_CACHE_HOME"] = str(private)
    os.environ.setdefault("MPLCONFIGDIR", str(private))
    return private / FOLDER


@functools.cache
def cache_folder(path):
    """The folder that only kernels of these very sources use; None when caching is off or not possible."""
    if DISABLED or numba.config.BOUNDSCHECK or cache_root() is None:
        return None
    name = os.path.relpath(path, ROOT).removesuffix(".py").replace(os.sep, ".").lstrip(".")
    home = cache_root() / name
    folder = home / source_digest(path)[:16]
    try:
        new = not folder.is_dir()
        if _fault(home) or _fault(folder):
            return None
        os.utime(folder)
        if new:
            for old in sorted(home.glob("?" * 16), key=lambda p: p.stat().st_mtime)[:-MOST_OLD_CACHES]:
                if time.time() - old.stat().st_mtime > LEAST_CACHE_AGE_S:
                    shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return None
    return folder


# ---- files -----------------------------------------------------------------------------------------------------------


def argument_types(signature):
    """Types of the arguments, whichever way a signature is given."""
    return tuple(sigutils.normalize_signature(signature)[0])


def _seal(identity, body):
    return hashlib.sha256(identity.encode() + b"\0" + body).digest()


def read_sealed(path, identity):
    """Contents of a file that was written for `identity`; None if there is none, or, with one line, another."""
    try:
        with open(shared_files.open_regular(path, os.O_RDONLY), "rb") as file:
            file_status = os.fstat(file.fileno())
            data = file.read()
        body = memoryview(data)[SEAL_BYTES:]
        if file_status.st_uid != os.geteuid() or file_status.st_mode & SHARED_WRITE_BITS:
            fault = "can be written by another user"
        elif data[:SEAL_BYTES] != _seal(identity, body):
            fault = "is damaged"
        else:
            return body
    except FileNotFoundError:
        return None
    except OSError as problem:
        fault = problem.strerror
    _print_notice(f"{path}: {fault}: its kernel is compiled again")
    with contextlib.suppress(OSError):
        path.unlink()
    return None


def write_sealed(path, identity, body):
    """Keep contents under their seal, whole or not at all; a full disk keeps nothing."""
    with contextlib.suppress(OSError):
        handle, part = tempfile.mkstemp(dir=path.parent)  # mode 0600 whatever the umask
        try:
            with open(handle, "wb") as file:
                file.write(_seal(identity, body) + body)
            os.replace(part, path)
        except BaseException:
            os.unlink(part)
            raise


class KernelCache:
    """Machine code of one function, in the place of Numba's own cache.

    units(library)            what a compiled library links to: picklable
    find_units(linked_units)  True if that is there
    """

    def __init__(self, dispatcher, folder, units, find_units):
        self.cache_path = str(folder)
        self._folder, self._function = folder, dispatcher.py_func
        self._units, self._find_units = units, find_units
        self._label = f"{self._function.__module__}.{self._function.__qualname__} {self._function.__code__.co_filename}"
        self._stem = f"{self._function.__qualname__}-{hashlib.sha256(self._label.encode()).hexdigest()[:8]}"
        self._machine = dispatcher.targetctx.codegen().magic_tuple()
        self._read = {}

    @property
    def lock(self):
        """File that is locked while this function is compiled; its folder is made again if it was removed."""
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return self._folder / f"{self._function.__qualname__}.lock"

    def _kernel_file(self, arguments):
        """(path, identity) of the machine code for these arguments."""
        source_key = f"{self._folder.name} {sys.version} {bound.digest(self._function)}"
        identity = f"{self._label} {source_key} {self._machine} {arguments!r}"
        key = hashlib.sha256(identity.encode()).hexdigest()[:24]
        return self._folder / f"{self._stem}-{key}{ENDING}", identity

    def read(self, signature):
        """True if the machine code is there with all that it links to: `load_overload` has it then."""
        arguments = argument_types(signature)
        body = read_sealed(*self._kernel_file(arguments))
        if body is None:
            return False
        units, result = pickle.loads(body)
        if not self._find_units(units):
            return False
        self._read[arguments] = result
        return True

    def load_overload(self, signature, target_context):
        """Numba's question for a compiled function; None if `read` found none."""
        result = self._read.pop(argument_types(signature), None)
        target_context.refresh()
        return None if result is None else compiler.CompileResult._rebuild(target_context, *result)

    def save_overload(self, signature, result):
        """Keep what Numba has compiled."""
        if not result.library.has_dynamic_globals and all(lifted.can_cache for lifted in result.lifted):
            body = serialize.dumps((self._units(result.library), result._reduce()))
            write_sealed(*self._kernel_file(argument_types(signature)), body)

    def flush(self):
        """Forget the machine code for all arguments, before it is compiled anew."""
        for path in self.kernel_files():
            path.unlink(missing_ok=True)

    def kernel_files(self):
        """Files of the function; copies of the same sources have symbols, and so files, of their own."""
        return list(self._folder.glob(f"{self._stem}-*{ENDING}"))


def is_cached(dispatcher):
    """Whether the cache has machine code of a function, made from this copy of its source."""
    return bool(dispatcher._cache.kernel_files())

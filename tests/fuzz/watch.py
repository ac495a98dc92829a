"""Whether a file that is read runs or reaches what it names: audit events of Python, and files that anybody opens."""

import contextlib
import ctypes
import os
import struct
import sys
from pathlib import Path

from tests.fuzz.hostile import LIBRARY, MODULE, PLANT

RUNS = ("import", "ctypes.dlopen", "subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "pickle.find_class",
        "compile", "exec")  # fmt: skip
CHANGES = ("os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink", "os.link", "os.truncate", "os.chmod")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
# importlib has no event of its own; the module's code has
WORDS = (MODULE, MODULE.replace(".", "/"), LIBRARY, PLANT)
IN_NONBLOCK, IN_OPEN = 0o4000, 0x20
_STATE = {"seen": None, "roots": (), "hooked": False}


def _hook(event, args):
    seen = _STATE["seen"]
    if seen is None:
        return
    if event in RUNS:
        named = [str(getattr(arg, "co_filename", arg)) for arg in args[:2]]
        if any(word in name for name in named for word in WORDS):
            seen.append(f"{event} {named[0][:100]}")
    elif _STATE["roots"] and (event in CHANGES or (event == "open" and (args[2] or 0) & WRITING)):
        for path in args[: 1 if event == "open" else 2]:
            if isinstance(path, (str, bytes)) and not _inside(os.path.abspath(os.fsdecode(path))):
                seen.append(f"{event} for writing {path!r}")


def _inside(path):
    return any(path == root or path.startswith(f"{root}/") for root in _STATE["roots"])


@contextlib.contextmanager
def over(*roots):
    """A list that takes a line for each hostile name that is run, and for what is written outside of `roots`."""
    if not _STATE["hooked"]:
        sys.addaudithook(_hook)
        _STATE["hooked"] = True
    seen = []
    _STATE["roots"] = (*map(str, roots), "/dev") if roots else ()
    _STATE["seen"] = seen
    try:
        yield seen
    finally:
        _STATE["seen"] = None


class Opened:
    """Which of some files anybody opens, also a library in C or a child: inotify, Linux alone."""

    def __init__(self, *paths):
        libc = ctypes.CDLL(None)
        self.notes = libc.inotify_init1(IN_NONBLOCK)
        self.paths = {libc.inotify_add_watch(self.notes, os.fsencode(path), IN_OPEN): Path(path) for path in paths}

    def since(self):
        """Those that were opened since the last call."""
        out = []
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self.notes, 1 << 16):
                while data:
                    watched, _, _, size = struct.unpack_from("iIII", data)
                    out.append(self.paths[watched])
                    data = data[16 + size :]
        return list(dict.fromkeys(out))

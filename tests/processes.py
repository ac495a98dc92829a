"""Command lines as processes of their own: started, killed at a moment, and their folders compared byte for byte.

    start         `gyro ARGUMENTS`, a session of its own          run_to_end    the same, waited for
    killed_after  a signal to it after some seconds                tree_of       {path: SHA-256} of a folder
    wrong_end     what is wrong with how it ended, in one line     difference    of two trees, in one line

A process that does not end within PATIENCE_S hangs, and is ended with all that it started.
"""

import contextlib
import fnmatch
import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PATIENCE_S = 120.0
HUNG = "hung"


class Ended(NamedTuple):
    """How a process ended: exit code (minus the signal that killed it, or HUNG), output, errors, duration (s)."""

    code: int | str
    out: str
    err: str
    wall_s: float


def environment(**more):
    """Environment in which a child finds this checkout, wherever it runs."""
    places = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places), "MPLBACKEND": "Agg", **more}


def start(arguments, cwd, **env):
    """`gyro ARGUMENTS`, or a Python text, in the folder `cwd`, not waited for."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background job; a child would ignore Ctrl-C too
        signal.signal(signal.SIGINT, signal.default_int_handler)
    text = isinstance(arguments, str)
    process = subprocess.Popen(
        [sys.executable, *(("-c", arguments) if text else ("-m", "testbench.commands.main", *map(str, arguments)))],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env=environment(**env),
        start_new_session=True,
    )
    process.began = time.monotonic()
    return process


def ended(process, timeout_s=PATIENCE_S):
    """`Ended` of a process, once it and all that hold its output have ended."""
    try:
        out, err = process.communicate(timeout=timeout_s)
        code = process.returncode
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        out, err = process.communicate()
        code = HUNG
    return Ended(code, out, err, time.monotonic() - process.began)


def run_to_end(arguments, cwd, timeout_s=PATIENCE_S, **env):
    """`Ended` of `gyro ARGUMENTS`."""
    return ended(start(arguments, cwd, **env), timeout_s)


def killed_after(process, seconds, number, timeout_s=PATIENCE_S):
    """`Ended` of a process that gets a signal so many seconds after its start, if it has not ended by then."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(max(0.0, process.began + seconds - time.monotonic()))
    if process.poll() is None:
        process.send_signal(number)
    return ended(process, timeout_s)


def wrong_end(found, codes=(0, 2, 130)):
    """None if a command line ended as it may, else one line: a hang, a traceback, more than one line of error."""
    if found.code == HUNG:
        return f"hangs for {found.wall_s:.0f} s: {found.err[-300:]!r}"
    if "Traceback" in found.err:
        return f"ends in a traceback: {found.err.strip().splitlines()[-1]}"
    if found.code not in codes:
        return f"ends with exit code {found.code}: {found.err[-300:]!r}"
    errors = [line for line in found.err.splitlines() if line.startswith("gyro: ")]
    if found.code == 2 and len(errors) > 1:
        return f"says {len(errors)} lines: {errors}"
    if found.code == 2 and not errors and not found.out:
        return "ends with exit code 2 and says nothing"
    return None


def before_sources(found):
    """True if Ctrl-C came while the interpreter itself was loaded, which says so in its own way."""
    first = "testbench/commands/__init__.py"  # from its end on it is one line
    return "KeyboardInterrupt" in found.err and (first in found.err or "testbench/" not in found.err)


def tree_of(folder, ignore=(), content=Path.read_bytes):
    """{relative path: SHA-256} of the files below a folder.

    ignore   patterns of relative paths, as fnmatch
    content  (path) -> bytes that must be the same, where a file holds times too
    """
    folder = Path(folder)
    out = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and not any(fnmatch.fnmatch(name, pattern) for pattern in ignore):
            out[name] = hashlib.sha256(content(path)).hexdigest()
    return out


def difference(expected, found):
    """None if two trees are the same, else what differs, in one line."""
    parts = [f"{name} is missing" for name in expected if name not in found]
    parts += [f"{name} was not there" for name in found if name not in expected]
    parts += [f"{name} differs" for name in expected if name in found and found[name] != expected[name]]
    return "; ".join(parts[:5]) or None

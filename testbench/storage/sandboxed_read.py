"""A first reading in a process of its own, for libraries that damage can stop, crash or make take all memory.

    read_in_subprocess(module, path, what, *more)   `python -m MODULE PATH MORE...`, whose __main__ calls `main(read)`

A process that ends otherwise than well, or takes more time or memory than such a file may, is one line.
Source  docs/inputs.md
"""

import os
import subprocess
import sys
from pathlib import Path

from testbench.errors import FileError
from testbench.storage.inputs import MOST_EXPANSION

LONGEST_S, BYTES_PER_S = 15.0, 1 << 20  # time: at least, and more for large files
# address space, libraries included, and what of it is the process's own (bytes); more for large files
MOST_MEMORY, MOST_DATA_BYTES = 1 << 31, 3 << 28
REFUSED = 3
ROOT = str(Path(__file__).resolve().parents[2])


def read_in_subprocess(module, path, what, *more):
    """Standard output of `module`; FileError unless it reads the file to its end within the limits."""
    longest_s = LONGEST_S + os.path.getsize(path) / BYTES_PER_S
    # threads of the linear algebra would take most of the address space
    quiet = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
    paths = os.pathsep.join(filter(None, (ROOT, os.environ.get("PYTHONPATH"))))
    command = [sys.executable, "-P", "-m", module, str(path), *more]
    try:
        process = subprocess.run(
            command,
            env=os.environ | quiet | {"PYTHONPATH": paths},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=longest_s,
        )
    except subprocess.TimeoutExpired:
        raise FileError(f"{path}: is not a readable {what}: reading takes longer than {longest_s:.0f} s") from None
    except (OSError, ValueError) as problem:
        raise FileError(f"{path}: cannot be read: {problem}") from None
    if process.returncode == REFUSED:
        raise FileError(process.stderr.decode("utf-8", "replace"))
    if process.returncode:
        how = f"signal {-process.returncode}" if process.returncode < 0 else f"exit code {process.returncode}"
        raise FileError(f"{path}: is not a readable {what}: the library fails ({how})")
    return process.stdout


def main(read):
    """Body of the process: limits, then `read(path)`; a FileError goes to standard error as one line."""
    path = Path(sys.argv[1])
    try:
        import resource

        more = MOST_EXPANSION * path.stat().st_size
        for limit, least in ((resource.RLIMIT_AS, MOST_MEMORY), (resource.RLIMIT_DATA, MOST_DATA_BYTES)):
            resource.setrlimit(limit, (least + more, least + more))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, ValueError, OSError):
        pass  # no such limits here: the limit of time is left
    try:
        read(path)
    except FileError as problem:
        print(problem, file=sys.stderr)
        sys.exit(REFUSED)

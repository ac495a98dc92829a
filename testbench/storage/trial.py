"""A first reading in a process of its own, for libraries that damage can stop, crash or make take all memory.

    tried(module, path, what)   runs `python -m MODULE PATH`, whose __main__ calls `main(read)`

A process that ends otherwise than well, takes longer than LONGEST_S or more memory than MOST_MEMORY is one line.
Source  docs/inputs.md
"""

import os
import subprocess
import sys
from pathlib import Path

from testbench.errors import FileError

LONGEST_S = 20.0
MOST_MEMORY = 1 << 31  # address space (bytes), libraries included
REFUSED = 3
ROOT = str(Path(__file__).resolve().parents[2])


def tried(module, path, what):
    """FileError unless `module` reads the file to its end within the limits."""
    # threads of the linear algebra would take most of the address space
    quiet = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
    paths = os.pathsep.join(filter(None, (ROOT, os.environ.get("PYTHONPATH"))))
    command = [sys.executable, "-P", "-m", module, str(path)]
    try:
        done = subprocess.run(
            command,
            env=os.environ | quiet | {"PYTHONPATH": paths},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=LONGEST_S,
        )
    except subprocess.TimeoutExpired:
        raise FileError(f"{path}: is no {what} that can be read: it takes longer than {LONGEST_S:g} s") from None
    except (OSError, ValueError) as problem:
        raise FileError(f"{path}: cannot be read: {problem}") from None
    if done.returncode == REFUSED:
        raise FileError(done.stderr.decode("utf-8", "replace"))
    if done.returncode:
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
        raise FileError(f"{path}: is no {what} that can be read: the library fails ({how})")


def main(read):
    """Body of the process: limits, then `read(path)`; a FileError goes to standard error as one line."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, ValueError, OSError):
        pass  # no such limits here: the limit of time is left
    try:
        read(Path(sys.argv[1]))
    except FileError as problem:
        print(problem, file=sys.stderr)
        sys.exit(REFUSED)

"""What a fresh clone compiles before its suite, side by side: the engines; and the tests themselves with the blocks.

python -m tests.warm, which `make test` calls. Bytecode and runners of blocks would cost each worker of the suite the
same seconds; where they are there already, only the engines are looked at.
"""

import contextlib
import io
import subprocess
import sys

import numpy as np
import pytest

from fpga_model import jit
from fpga_model.block import runner
from testbench.golden.stimulus import blocks

ENGINES = ("-m", "testbench.run.warmup", "lanes", "baseband")


def tests_and_blocks():
    """Bytecode of all tests, which collecting them writes, and the runner of each block."""
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main(["--collect-only", "-qq", "--benchmark-disable"])
    for block in blocks.BLOCKS.values():
        blocks.run(block, next(iter(block.cases)), np.zeros((1, len(block.columns)), np.int64))


def main():
    """Compile what is not there."""
    engines = subprocess.Popen([sys.executable, *ENGINES], cwd=jit.ROOT)
    if jit.CACHE and not all(jit.is_cached(runner(stem)) for stem in blocks.BLOCKS):
        tests_and_blocks()
    sys.exit(engines.wait())


if __name__ == "__main__":
    main()

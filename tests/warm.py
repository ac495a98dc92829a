"""What a fresh clone compiles before its suite, side by side: engines, replays, tests with the blocks.

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
# tests that call, before all others, a large kernel that no engine has
CALLERS = (
    "tests/testbench/measured/test_residuals.py::test_another_seed_does_not",
    "tests/testbench/golden/test_recompute.py::test_the_whole_design_is_proved_from_its_recording",
    "tests/testbench/rtl/test_rtl_top.py::test_the_stimulus_moves_every_register",
    "tests/analog_frontend/test_top.py::test_copy_shares_nothing",
)


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
        # whatever they find is told by the suite
        subprocess.run([sys.executable, "-m", "pytest", "-q", *CALLERS], cwd=jit.ROOT, capture_output=True)
    sys.exit(engines.wait())


if __name__ == "__main__":
    main()

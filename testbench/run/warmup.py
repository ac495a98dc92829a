"""The first compilation of the frame engine, on two cores instead of one.

The large parts, clocked ticks and blocks, are compiled side by side in child processes that leave them in the
kernel cache. With a filled cache, without a cache or on one core nothing happens.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from fpga_model.jit import CACHE, cache_folder
from testbench.engines import engine, frame, pins

CHILD = "from testbench.run import warmup; warmup.compile_{}()"
TIMEOUT_S = 600
ROOT = Path(__file__).resolve().parents[2]


def cached(function):
    """Whether the kernel cache has this function."""
    return any(cache_folder(Path(function.__code__.co_filename).resolve()).rglob(f"*.{function.__name__}-*.nbi"))


def _chunk():
    return engine.Chunk(
        0,
        np.zeros(1),
        np.zeros(1),
        0,
        0,
        0,
        engine.Faults(),
        engine.streams(),
        np.zeros((engine.MAX_EDGES, 2), np.int64),
    )


def _fresh():
    from testbench.config import Config
    from testbench.run import build

    params = build.params(Config(), 25.0, 25.0)
    return params, engine.reset(params, 25.0)


def compile_ticks():
    """No tick of the clocked engine, for the sake of its compilation."""
    params, s = _fresh()
    engine.run_ticks(params, s.fpga, s.chips, s.plant, _chunk(), 0, 0, -1, 1)


def compile_blocks():
    """No block of the frame engine, likewise."""
    params, s = _fresh()
    frame.blocks(params, s.fpga, s.chips, s.plant, _chunk(), 0, 0, -1, pins.buffers())


def warm_up():
    """Fill the kernel cache if it is empty. A child that fails leaves its part to be compiled on first use."""
    if not CACHE or (os.cpu_count() or 1) < 2 or cached(engine.run_ticks) or cached(frame.blocks):
        return
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    calls = [CHILD.format(part) for part in ("ticks", "blocks")]
    children = [subprocess.Popen([sys.executable, "-c", call], cwd=ROOT, **quiet) for call in calls]
    try:
        for child in children:
            child.wait(TIMEOUT_S)
    finally:
        for child in children:
            child.kill()


if __name__ == "__main__":
    warm_up()

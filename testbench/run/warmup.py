"""The first compilation of the engines: in child processes that leave it in the kernel cache.

    frame_run    what advances a gyroscope of the frame engine: `frame.run`; on an empty cache the clocked engine, which
                 has the same bits and compiles sooner, until a child has compiled the frame engine
    wait         for that child, before the cache is removed
    warm_up      compile engines side by side, and wait: before tests and campaigns

With a filled cache, without a cache or on one core nothing is started.
"""

import contextlib
import functools
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np

from analog_frontend import tick
from analog_frontend import top as plant
from fpga_model import shared_files
from fpga_model.jit import CACHE, cache_root, is_cached
from fpga_model.rates import FRAME_TICKS
from testbench.engines import engine as clocked

CHILD = "from testbench.run import warmup; warmup.compile_{}()"
TIMEOUT_S = 600
ROOT = Path(__file__).resolve().parents[2]
QUIET = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
EDGE_TICKS = 1000  # of a chunk that reaches every function of an engine


def _possible():
    return CACHE and (os.cpu_count() or 1) > 1


def _fresh():
    from testbench.config import Config
    from testbench.run import build

    params = build.params(Config(), 25.0, 25.0)
    return params, clocked.reset(params, 25.0)


def _run_warmup_chunk(run):
    """A chunk of an engine, for the sake of its compilation."""
    params, s = _fresh()
    frames = EDGE_TICKS // FRAME_TICKS
    values = np.zeros(frames + 2)
    run(
        params,
        s,
        EDGE_TICKS,
        values,
        values + 25.0,
        clocked.NO_WRITE,
        clocked.Faults(),
        clocked.streams(EDGE_TICKS, frames),
    )


def compile_clocked():
    """The clocked engine."""
    _run_warmup_chunk(clocked.run)


def _compile_plant(params, s, edges):
    """The plant's tick, which the clocked engine of another process waits for."""
    numbers = plant.Pins(0, -1, 0, -1, 0)
    tick.step.compile(tuple(map(numba.typeof, (params.plant, s.plant, 0, numbers, edges))))


def compile_frame():
    """The frame engine; what other processes do not compile first."""
    from testbench.engines import frame, pins

    params, s = _fresh()
    edges = np.zeros((clocked.MAX_EDGES, 2), np.int64)
    _compile_plant(params, s, edges)
    chunk = clocked.Chunk(0, np.zeros(1), np.zeros(1), 0, 0, 0, clocked.Faults(), clocked.streams(), edges)
    frame.run_blocks(params, s.fpga, s.chips, s.plant, chunk, 0, 0, -1, pins.buffers())
    _run_warmup_chunk(frame.run)


def compile_lanes():
    """The lanes engine."""
    from testbench.engines import lanes

    params, s = _fresh()
    ticks = 4 * FRAME_TICKS
    zeros, o = np.zeros(ticks // FRAME_TICKS + 2), clocked.streams(ticks, ticks // FRAME_TICKS)
    lanes.Engine([params]).run([s], ticks, [zeros], [zeros + 25.0], [clocked.Faults()], [o])


def compile_baseband():
    """The baseband engine."""
    from testbench.engines import baseband

    _run_warmup_chunk(baseband.run)


def _child(part):
    return subprocess.Popen([sys.executable, "-c", CHILD.format(part)], cwd=ROOT, **QUIET, start_new_session=True)


@functools.cache
def _frame_child():
    """The child that compiles the frame engine: one for all gyroscopes, kept so that nobody drops it unfinished."""
    return _child("frame")


@functools.cache
def _turn():
    """A lock that one process of a user holds; `shared_files.LockedError` says whose it is, if another one has it."""
    try:
        return shared_files.try_lock(cache_root() / "standby.lock")
    except shared_files.LockedError as held:
        return held


class Standby:
    """As `frame.run`; the clocked engine does it, to the same bits, until a child has compiled the frame engine.

    It does so in one process. Others wait: they would take the time of what compiles for all of them.
    """

    def __init__(self):
        self.child = _frame_child()

    def __call__(self, *chunk):
        if self.child.poll() is None:
            if not isinstance(lock_or_error := _turn(), shared_files.LockedError):
                return clocked.run(*chunk)
            try:
                self.child.wait(shared_files.PATIENCE_S)
            except subprocess.TimeoutExpired:
                waits = f"waits for process {self.child.pid}, which compiles the frame engine"
                print(f"gyro: {waits}; {lock_or_error.strerror} runs in the meantime", file=sys.stderr, flush=True)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.child.wait(TIMEOUT_S)
        from testbench.engines import frame

        return frame.run(*chunk)


def frame_run():
    """`run` of the frame engine, or what stands in for it while it is compiled."""
    from testbench.engines import frame

    return Standby() if _possible() and not is_cached(frame.run_blocks) else frame.run


def wait():
    """Wait for the child that compiles the frame engine, if this process has started it."""
    if _frame_child.cache_info().currsize:
        _frame_child().wait(TIMEOUT_S)


def warm_up(*others):
    """Fill the kernel cache if it is empty; `others` are engines beside clocked and frame.

    A child that fails leaves its part to be compiled on first use.
    """
    from testbench.engines import frame

    if not _possible() or (is_cached(frame.run_blocks) and not others):
        return
    children = [_child(part) for part in ("frame", "clocked", *others)]
    try:
        for child in children:
            child.wait(TIMEOUT_S)
    finally:
        for child in children:
            child.kill()


if __name__ == "__main__":
    warm_up(*sys.argv[1:])

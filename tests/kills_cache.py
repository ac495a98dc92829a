"""Runs on a kernel cache that was damaged: the codes of a run that nothing disturbed, and no traceback.

    pair(seed, folder)           two runs at once on a cache of which one file is damaged, mostly of the frame engine
    kill(seed, folder, number)   the same of one run, which gets a signal, and of one after it

Source  docs/speed.md (The cache)
"""

import functools
import json
import os
import random
import shutil
import tempfile
import time
from pathlib import Path

from fpga_model import kernel_cache
from tests.processes import ended, killed_after, run_to_end, start, wrong_end

RUN = ("run", "--seconds", "0.01", "--set", "scenario.diagnose=false", "--set", "output.pictures=false",
       "--set", "output.html=false", "--json", "--out")  # fmt: skip
TIMEOUT_S = 600.0
ENGINE = "testbench.engines.frame"


@functools.cache
def _undisturbed():
    """(folder of a warm cache, hash of the codes)."""
    folder = Path(tempfile.mkdtemp(prefix="gyro-cache-"))
    for _ in range(2):  # the first one begins with the other engine
        done = run_to_end((*RUN, "out"), folder, TIMEOUT_S, GYRO_CACHE=str(folder / "cache"))
        if done.code != 0:
            raise AssertionError(f"undisturbed: exit code {done.code}: {done.err[-300:]}")
        while not list((folder / "cache").rglob(f"{ENGINE}/*/run-*{kernel_cache.ENDING}")):
            time.sleep(1.0)
    return folder / "cache", json.loads(done.out)["codes_sha256"]


def _damaged(draw, folder):
    """A copy of the warm cache with one file that is not as it was written."""
    cache = shutil.copytree(_undisturbed()[0], Path(folder) / "cache")
    paths = sorted(cache.rglob(f"*{kernel_cache.ENDING}"))
    frame = [path for path in paths if ENGINE in path.as_posix()]
    path, other = draw.choice(frame if draw.random() < 0.7 else paths), draw.choice(paths)
    data = bytearray(path.read_bytes())
    way = draw.choice(("flip", "flip", "truncate", "zeros", "exchange"))
    if way == "flip":
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif way == "truncate":
        del data[draw.randrange(len(data)) :]
    elif way == "zeros":
        begin = draw.randrange(len(data))
        data[begin : begin + 512] = bytes(len(data[begin : begin + 512]))
    else:
        data = other.read_bytes()
    mode = path.stat().st_mode
    path.write_bytes(data)
    os.chmod(path, mode)
    return str(cache)


def _wrong(done):
    wrong = wrong_end(done, (0,))
    if wrong is None and json.loads(done.out)["codes_sha256"] != _undisturbed()[1]:
        wrong = "other codes than on an undamaged cache"
    return wrong


def pair(seed, folder):
    """Two runs at once."""
    cache = _damaged(random.Random(seed), folder)
    processes = [start((*RUN, f"out{k}"), folder, GYRO_CACHE=cache) for k in range(2)]
    return next(filter(None, [_wrong(ended(process, TIMEOUT_S)) for process in processes]), None)


def kill(seed, folder, number):
    """A run that gets a signal, and the next one."""
    draw = random.Random(seed)
    cache = _damaged(draw, folder)
    killed_after(start((*RUN, "out"), folder, GYRO_CACHE=cache), draw.uniform(0.0, 30.0), number, TIMEOUT_S)
    return _wrong(run_to_end((*RUN, "other"), folder, TIMEOUT_S, GYRO_CACHE=cache))


CASES = {"cache": (pair, kill)}

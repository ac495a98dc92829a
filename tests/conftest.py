"""Settings of the whole suite: Hypothesis profiles, and a home for what a run leaves behind.

Hypothesis has no deadline, because the first call of a kernel compiles it. CI draws the same examples every time
(`CI` is set there), so that a red run can be repeated; at a desk each run draws new ones. `make test-all` draws more.
"""

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import fpga_model.jit  # noqa: F401  with its compiler, whichever command a test calls first

os.environ.setdefault("MPLBACKEND", "Agg")
# matrices here are small: threads of the linear algebra cost three times the work that they share
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large]}
settings.register_profile("thorough", **COMMON)
settings.register_profile("desk", max_examples=25, **COMMON)
settings.register_profile("ci", max_examples=25, derandomize=True, print_blob=True, **COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE") or ("ci" if os.environ.get("CI") else "desk"))

# a shell that starts a suite in the background has it ignore Ctrl-C, and the tests that send one would wait for ever
signal.signal(signal.SIGINT, signal.default_int_handler)

# files of ten seconds and more begin first: no worker ends with one of them while the other has nothing to do
LONG = (
    *("test_kills.py", "test_benches.py", "test_checkpoint.py", "test_evidence.py", "test_frame.py", "test_top.py"),
    *("test_loop.py", "test_paper.py", "test_record.py", "test_damaged.py", "test_boards.py", "test_recompute.py"),
    *("test_baseband.py", "test_linkage.py", "test_designs.py", "test_streams.py", "test_kill.py", "test_blocks.py"),
    *("test_residuals.py", "test_stimulus.py", "test_ranges.py"),
)

BEGAN = time.monotonic()


def pytest_addoption(parser):
    parser.addoption("--minutes", type=float, help="draw the order of files by the commit, and begin no test later")


def pytest_collection_modifyitems(config, items):
    """Long files first; under a limit of time another commit tests others first, so that none is left out for ever."""
    if config.option.minutes is None:
        items.sort(key=lambda item: item.path.name not in LONG)
        return
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True)
    draw = random.Random(head.stdout)
    place = {path: draw.random() for path in sorted({item.path for item in items})}
    items.sort(key=lambda item: place[item.path])


def pytest_runtest_setup(item):
    limit = item.config.option.minutes
    if limit is not None and time.monotonic() - BEGAN > 60 * limit:
        pytest.skip(f"--minutes {limit:g} are over")

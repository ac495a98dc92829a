"""Settings of the whole suite: Hypothesis profiles, and a home for what a run leaves behind.

Hypothesis has no deadline, because the first call of a kernel compiles it. CI draws the same examples every time
(`CI` is set there), so that a red run can be repeated; at a desk each run draws new ones. `make test-all` draws more.
"""

import gc
import os
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("MPLBACKEND", "Agg")
# matrices here are small: threads of the linear algebra cost three times the work that they share, and more under load;
# said before NumPy is loaded, which reads it once
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import fpga_model.jit  # noqa: F401  with its compiler, whichever command a test calls first

COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large]}
settings.register_profile("thorough", **COMMON)
settings.register_profile("desk", max_examples=25, **COMMON)
settings.register_profile("ci", max_examples=25, derandomize=True, print_blob=True, **COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE") or ("ci" if os.environ.get("CI") else "desk"))

# a shell that starts a suite in the background has it ignore Ctrl-C, and the tests that send one would wait for ever
signal.signal(signal.SIGINT, signal.default_int_handler)

# files of five seconds and more begin first, in this order: no worker ends with one while the other has nothing to do
LONG = (
    *("test_paper.py", "test_benches.py", "test_boards.py", "test_loop.py", "test_designs.py", "test_frame.py"),
    *("test_top.py", "test_checkpoint.py", "test_fuzz.py", "test_linkage.py", "test_diagnose.py", "test_export.py"),
    *("test_damaged.py", "test_baseband.py", "test_architecture.py", "test_classes.py", "test_study.py"),
    *("test_simulate.py", "test_import.py", "test_streams.py", "test_residuals.py", "test_records.py"),
    *("test_record.py", "test_inference_board.py", "test_mutate.py", "test_docs.py", "test_recompute.py"),
    *("test_plant_port.py", "test_nodes.py", "test_driven_resonator.py", "test_ring.py", "test_loop_simulated.py"),
    *("test_second_mode.py", "test_lanes.py", "test_noise.py", "test_kill.py", "test_edges.py", "test_recording.py"),
    *("test_dac_levels.py", "test_references.py", "test_rtl.py"),
)
PLACE = {name: place for place, name in enumerate(LONG)}

BEGAN = time.monotonic()
# modules and tests stay until the end: the collector need not look at them, neither while they are made nor later
gc.disable()


def pytest_addoption(parser):
    parser.addoption("--minutes", type=float, help="draw the order of files by the commit, and begin no test later")


def pytest_collection_modifyitems(config, items):
    """Long files first; under a limit of time another commit tests others first, so that none is left out for ever."""
    if config.option.minutes is None:
        items.sort(key=lambda item: PLACE.get(item.path.name, len(LONG)))
        return
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True)
    draw = random.Random(head.stdout)
    place = {path: draw.random() for path in sorted({item.path for item in items})}
    items.sort(key=lambda item: place[item.path])


def pytest_collection_finish():
    gc.freeze()
    gc.enable()


def pytest_runtest_setup(item):
    limit = item.config.option.minutes
    if limit is not None and time.monotonic() - BEGAN > 60 * limit:
        pytest.skip(f"--minutes {limit:g} are over")

"""Settings of the whole suite: Hypothesis profiles, and a home for what a run leaves behind.

Hypothesis has no deadline, because the first call of a kernel compiles it. CI draws the same examples every time
(`CI` is set there), so that a red run can be repeated; at a desk each run draws new ones. `make test-all` draws more.
"""

import os
import signal

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

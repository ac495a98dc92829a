"""Where something was measured: the processor, and the versions of what computes."""

import platform
from pathlib import Path

import llvmlite
import numba
import numpy as np
import scipy


def cpu():
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def versions():
    """What the codes must not depend on, and speeds may."""
    package_modules = (("numba", numba), ("llvmlite", llvmlite), ("numpy", np), ("scipy", scipy))
    return {"python": platform.python_version()} | {name: module.__version__ for name, module in package_modules}

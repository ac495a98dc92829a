"""Where a bundle comes from: version, commit and libraries; no hash covers it.

Source  docs/golden.md
"""

import platform
import subprocess
from pathlib import Path

import numpy as np

from testbench.version import VERSION

ROOT = Path(__file__).resolve().parents[3]


def git_head(root=ROOT):
    """Commit of the working tree that this package lies in; "unknown" where there is no tree or no git."""
    if not (root / ".git").exists():
        return "unknown"
    try:
        head = subprocess.run(["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return head.stdout.strip() if head.returncode == 0 else "unknown"


def provenance():
    """Entry of a manifest."""
    return {"version": VERSION, "git": git_head(), "python": platform.python_version(), "numpy": np.__version__}

"""Run an external tool, with one clear error if it fails or hangs."""

import subprocess

from testbench.errors import FileError

TOOL_S = 1800  # a tool that runs longer than this has hung


def run_tool(command, folder, what):
    """Standard output of a tool; FileError with its last words if it fails."""
    try:
        completed_process = subprocess.run(
            [str(word) for word in command], cwd=folder, capture_output=True, text=True, timeout=TOOL_S
        )
    except subprocess.TimeoutExpired:
        raise FileError(f"{what}: {command[0]} did not end within {TOOL_S} s") from None
    if completed_process.returncode:
        last_lines = "\n".join((completed_process.stdout + completed_process.stderr).strip().splitlines()[-8:])
        raise FileError(f"{what}: {command[0]} failed with exit code {completed_process.returncode}:\n{last_lines}")
    return completed_process.stdout

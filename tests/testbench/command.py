"""The command line in this process, whose kernels are loaded: what a process of its own would print and return."""

import contextlib
import io
from typing import NamedTuple

import pytest

from testbench.commands import main


class Done(NamedTuple):
    """Exit code, standard output and standard error of a command line."""

    returncode: int
    stdout: str
    stderr: str


def gyro(*argv, folder="."):
    """`gyro ARGV` with `folder` as working directory."""
    out, err = io.StringIO(), io.StringIO()
    redirected = contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with redirected[0], redirected[1], redirected[2], pytest.raises(SystemExit) as caught:
        main.main([str(part) for part in argv])
    return Done(caught.value.code, out.getvalue(), err.getvalue())

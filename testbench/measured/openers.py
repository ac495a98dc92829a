"""What `gyro measured trace` can open: each opener reads the content of the files, never their names.

    opener(paths, options) -> testbench.tracing.problem.problem.Problem, or None if the content is not its kind
`options` is a dictionary of what the command line was given with --option KEY=VALUE, as text.
"""

import contextlib
import os

from numpy.linalg import LinAlgError

from testbench.errors import FileError


def closed_loop(paths, options):
    """Records of the closed loop (gyrorec). Options: those of `loop_record`, and priors = sheet or a file."""
    from testbench.measured.closed_loop import loop_record
    from testbench.measured.wide.of_record import Calibrated

    return loop_record.open_record(paths, options, Calibrated(options.get("priors")))


def single_part(paths, options):
    """Recordings of single parts: the first kind whose `opener` knows the content."""
    from testbench.measured import kinds

    return kinds.first(kind.opener(paths, options) for kind in kinds.KINDS)


@contextlib.contextmanager
def determined(paths):
    """Data that fix no model end in the linear algebra: one line."""
    try:
        yield
    except LinAlgError as problem:
        raise FileError(f"{paths[0]}: the data do not determine the model: {problem}") from None


OPENERS = [closed_loop, single_part]


def open_problem(paths, options):
    """`Problem` of the first opener that knows the content; FileError if none does."""
    for path in paths:
        if not os.path.exists(path):
            raise FileError(f"{path}: no such file")
    with determined(paths):
        for opener in OPENERS:
            problem = opener(paths, options)
            if problem is not None:
                return problem
    raise FileError(f"{paths[0]}: content of no known kind; docs/measured_parts.md lists those that can be read")

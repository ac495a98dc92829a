"""What `gyro measured trace` can open: each opener looks at the content of the files, never at their names.

    opener(paths, options) -> testbench.tracing.problem.problem.Problem, or None if the content is not its kind
`options` is a dictionary of what the command line was given with --option KEY=VALUE, as text.
"""

import importlib
import pkgutil

from testbench.errors import FileError


def closed_loop(paths, options):
    """Records of the closed loop (gyrorec)."""
    from testbench.measured.closed_loop import loop_record

    return loop_record.opened(paths, options)


def single_part(paths, options):
    """Recordings of single parts: the first module of `parts` whose `opener` knows the content."""
    from testbench.measured import parts

    for info in sorted(pkgutil.iter_modules(parts.__path__), key=lambda item: item.name):
        known = getattr(importlib.import_module(f"{parts.__name__}.{info.name}"), "opener", None)
        problem = known(paths, options) if known else None
        if problem is not None:
            return problem
    return None


OPENERS = [closed_loop, single_part]


def open_problem(paths, options):
    """`Problem` of the first opener that knows the content; FileError if none does."""
    for path in paths:
        if not path.exists():
            raise FileError(f"{path}: no such file")
    for opener in OPENERS:
        problem = opener(paths, options)
        if problem is not None:
            return problem
    raise FileError(f"{paths[0]}: content of no known kind ({len(OPENERS)} kinds were tried)")

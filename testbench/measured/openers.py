"""What `gyro measured trace` can open: each opener reads the content of the files, never their names.

    opener(paths, options) -> testbench.tracing.problem.problem.Problem, or None if the content is not its kind
`options` is a dictionary of what the command line was given with --option KEY=VALUE, as text.
"""

import contextlib
import os

from numpy.linalg import LinAlgError

from testbench.errors import FileError
from testbench.measured.formats import mat_file, readers
from testbench.measured.formats.table import ARCHIVE, PARQUET
from testbench.storage import inputs
from testbench.storage.hdf5_input import is_hdf5


def open_closed_loop_record(paths, options):
    """Records of the closed loop (gyrorec). Options: those of `loop_record`, and priors = sheet or a file."""
    from testbench.measured.closed_loop import loop_record
    from testbench.measured.wide.wide_calibration import Calibrated

    return loop_record.open_record(paths, options, Calibrated(options.get("priors")))


def single_part(paths, options):
    """Recordings of single parts: the first kind whose `opener` knows the content; QualityError before it fits."""
    from testbench.measured import kinds
    from testbench.measured.formats import sheets
    from testbench.measured.quality import examine

    quality_findings = examine.enforce_quality(
        sheets.examine(paths, options.get("channel")), options.get("quality", "")
    )
    problem = kinds.first_not_none(kind.opener(paths, options) for kind in kinds.KINDS)
    if problem is not None:
        problem.quality = quality_findings
    return problem


def part_findings(paths):
    """Findings about recordings of a part; None if the files are none."""
    from testbench.measured.formats import sheets
    from testbench.measured.quality.finding import QualityError

    try:
        if not all(os.path.isfile(path) and readers.content(path) is not None for path in paths):
            return None
        return sheets.examine(paths)
    except QualityError as problem:
        return problem.findings


@contextlib.contextmanager
def refuse_singular_data(paths):
    """Data that fix no model end in the linear algebra: one line."""
    try:
        yield
    except LinAlgError as problem:
        raise FileError(f"{paths[0]}: the data do not determine the model: {problem}") from None


WAYS = (
    "for the closed loop (four ADC channels): gyro measured import FILE --map MAP.toml -o FILE.h5; for a part "
    "(ring-down, sweep, DAC, meter): write a column map, docs/quality.md, and give it in place of FILE"
)


def unreadable(path):
    """FileError about a file that nothing reads."""
    return FileError(f"{path}: unknown kind of content; nearest is {readers.describe_unreadable_file(path)}; {WAYS}")


def _refuse_combination(paths):
    from testbench.measured.formats import sheets

    kinds_by_path = {}
    for path in paths:
        if len(paths) > 1 and is_hdf5(path):
            raise FileError(f"{path}: is HDF5; a record is traced by itself, so import all power-ons into one record")
        content = readers.content(path)
        if content is None or len(paths) == 1:
            raise unreadable(path)
        kinds_by_path[path] = sheets.content_sheet(content).kind
    kinds = sorted(set(kinds_by_path.values()))
    if len(kinds) > 1:
        raise FileError(f"{paths[0]}: files of several kinds ({', '.join(kinds)}); trace one kind at a time")
    raise FileError(f"{paths[0]}: {len(paths)} files of kind {kinds[0]}, which takes one; trace each by itself")


def refuse_unreadable(path):
    """FileError about a text or a table that is neither a record nor a recording."""
    if os.path.isfile(path):
        head = inputs.head(path, readers.HEAD_BYTES)
        if head and (b"\0" not in head or head.startswith((ARCHIVE, PARQUET)) or mat_file.is_mat(head)):
            raise unreadable(path)


OPENERS = [open_closed_loop_record, single_part]


def open_problem(paths, options):
    """`Problem` of the first opener that knows the content; FileError if none does."""
    for path in paths:
        if not os.path.exists(path):
            raise FileError(f"{path}: no such file")
    with refuse_singular_data(paths):
        for opener in OPENERS:
            problem = opener(paths, options)
            if problem is not None:
                return problem
    return _refuse_combination(paths)

"""Trace a recording of a part, and describe the result: one way for `gyro measured trace` and for the page of all sets.

    trace_table     files of a kind that is no problem of the core, such as a table of numbers
    trace_problem   segments that set themselves up: `exam.report`; many small laws: `part_page.run`
Source    docs/measured_results.md
"""

import json

from testbench.measured import kinds
from testbench.measured.exam import exam, part_page
from testbench.measured.models.part_problem import PartProblem
from testbench.measured.parts.part import Part


def trace_table(paths, options):
    """(JSON, picture) of files that a kind reports by itself; None if none does."""
    return kinds.first_not_none(kind.report(paths, options) for kind in kinds.KINDS)


def trace_problem(problem, settings=None, progress=None):
    """(JSON, picture) of a part's problem with `trace.Options`; None if it is no part (a record of the closed loop)."""
    if not isinstance(problem, PartProblem):
        return None
    if isinstance(problem, Part):
        data, image = exam.report(problem, settings, progress)
    else:
        data, rows = part_page.run(problem, settings, progress)
        image = part_page.picture(problem, rows) if rows else ""
    return data | {"quality": [f.as_json() for f in problem.quality]}, image


def text(data):
    """JSON text of a report, without its page."""
    report_data = {key: value for key, value in data.items() if key != "html"}
    return json.dumps(report_data, indent=1, sort_keys=True, allow_nan=False) + "\n"


def report_section(label, data, image):
    """Part of a page: the report's own, or the usual one."""
    return data.get("html") or part_page.part_section(label, data, image)

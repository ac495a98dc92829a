"""A recording of a part, traced and told: one way for `gyro measured trace` and for the page of all sets.

    whole        a part that is no problem of the core, such as a table of numbers, reports by itself
    most_laws    many small laws: `tell.run`
    report       segments that set themselves up: `exam.report`
    else         no part (a record of the closed loop): None, the caller traces it
Source    docs/measured_parts.md
"""

import importlib
import json
import pkgutil

from testbench.measured import parts
from testbench.measured.exam import tell


def modules():
    """Modules of the parts, by name."""
    found = sorted(pkgutil.iter_modules(parts.__path__), key=lambda item: item.name)
    return [importlib.import_module(f"{parts.__name__}.{info.name}") for info in found]


def whole(paths, options):
    """(JSON, picture) of files that a module reports by itself; None if none does."""
    for module in modules():
        own = getattr(module, "whole", None)
        found = own(paths, options) if own else None
        if found is not None:
            return found
    return None


def of_problem(problem, settings=None, progress=None):
    """(JSON, picture) of a part's problem with `trace.Options`; None if it is no part."""
    if getattr(problem, "most_laws", 0):
        data, rows = tell.run(problem, settings, progress)
        return data, tell.picture(problem, rows) if rows else ""
    own = getattr(problem, "report", None)
    return own(settings, progress) if own else None


def text(data):
    """JSON text of a report, without its page."""
    kept = {key: value for key, value in data.items() if key != "html"}
    return json.dumps(kept, indent=1, sort_keys=True, allow_nan=False) + "\n"


def section(label, data, image):
    """Part of a page: the report's own, or the usual one."""
    return data.get("html") or tell.section(label, data, image)

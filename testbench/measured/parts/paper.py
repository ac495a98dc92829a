"""Numbers printed in the paper beside what the model says: explained, not explained, and by what it could be.

    a row      quantity, paper's value, model's value from testbench.run.budget or a stated equation, their difference
    a rival    an explanation with what it predicts for the same number, and what would tell it from the others
Only one number stands behind most questions, so no rival is a winner: a row is "explained" if the model's value agrees
within the paper's own spread, else "not explained" with its rivals, never "caused by".
Source    docs/measured_parts.md, docs/phases.md
"""

import html

from testbench.measured.exam import part_page
from testbench.measured.formats.paper_numbers import AGREE, HEAD, Numbers
from testbench.measured.parts.paper_questions import rows
from testbench.storage import inputs


def looks_like(path):
    """True if the first line is that of the list of numbers."""
    return inputs.head(path, len(HEAD)).decode("ascii", "replace") == HEAD


def jobs(paths):
    """[(label, paths, options)] of the lists among the files; what lies beside them is not traced."""
    lists = [p for p in paths if looks_like(p)]
    return [("the paper's numbers", [p, *[q for q in paths if q != p]], {}) for p in lists]


def report(paths, options):
    """(JSON, "") of a list of the paper's numbers; None if the first file is none."""
    if not paths or not looks_like(paths[0]):
        return None
    found = rows(Numbers(paths[0]))
    left = [r.name for r in found if not r.explained]
    data = {
        "verdict": "unexplained" if left else "none",
        "sentence": f"{len(found) - len(left)} of {len(found)} agree within {AGREE:g} of the paper's own spread; "
        "the others have rivals that one printed number each does not tell apart: none is declared the cause",
        "effects": [],
        "heldout": {},
        "questions": [
            r._asdict() | {"explained": r.explained, "rivals": [x._asdict() for x in r.rivals]} for r in found
        ],
    }
    data["html"] = _html(found, data)
    return data, ""


def _html(found, data):
    cells = []
    for r in found:
        verdict = "agrees" if r.explained else "not explained"
        first = True
        for rival in r.rivals:
            model = part_page.number(r.model) if r.model is not None else "-"
            spread = part_page.number(r.spread, 2) if r.spread is not None else "not printed"
            head = (r.name, f"{part_page.number(r.paper, 5)} {r.unit}", spread, model, verdict) if first else ("",) * 5
            cells.append((*head, rival.name, rival.predicts, rival.experiment))
            first = False
    head = ("number", "paper", "its spread", "model", "", "explanation", "predicts", "experiment that would decide")
    return f"<h3>The paper's numbers</h3><p>{html.escape(data['sentence'])}</p>" + part_page.table(head, cells)

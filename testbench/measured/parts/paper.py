"""Numbers printed in the paper beside what the model says without a simulation, judged, with what else could make them.

    a row      number, role, model's value by phase budget and linear loop, verdict and its basis: testbench.judge
    a rival    an explanation with what it predicts for the same number, and what would tell it from the others
Only one number stands behind most questions, so no rival is a winner: a number is never "caused by" one.
Source    docs/measured_results.md, docs/phases.md
"""

import html

from testbench.judge import judge
from testbench.judge.number_verdict import CONTRADICTED
from testbench.judge.numbers import HEAD
from testbench.measured.exam import part_page
from testbench.measured.formats.paper_numbers import Numbers
from testbench.measured.parts.paper_questions import rivals
from testbench.paper import closed_form
from testbench.paper.judge_table import sentence, tables
from testbench.storage import inputs


def is_numbers_list(path):
    """True if the first line is that of the list of numbers."""
    return inputs.head(path, len(HEAD)).decode("ascii", "replace") == HEAD


def jobs(paths):
    """[(label, paths, options)] of the lists among the files; what lies beside them is not traced."""
    lists = [p for p in paths if is_numbers_list(p)]
    return [("the paper's numbers", [p, *[q for q in paths if q != p]], {}) for p in lists]


def report(paths, options):
    """(JSON, "") of a list of the paper's numbers; None if the first file is none."""
    if not paths or not is_numbers_list(paths[0]):
        return None
    rows = judge.rows(closed_form.default(), paths[0])
    rivals_by_number = rivals(Numbers(paths[0]))
    data = {
        "verdict": "unexplained" if any(r.verdict == CONTRADICTED for r in rows) else "none",
        "sentence": f"{sentence(rows)} Each contradicted number has rival explanations. One printed number cannot "
        "distinguish them, so none is declared the cause",
        "effects": [],
        "heldout": {},
        "questions": [_question(r, _find_rivals(r.number, rivals_by_number)) for r in rows],
    }
    data["html"] = _html(rows, data)
    return data, ""


def _find_rivals(number, rivals_by_number):
    for (symbol, case, temperature), matching_rivals in rivals_by_number.items():
        if number.symbol == symbol and number.case.startswith(case) and number.temperature == temperature:
            return matching_rivals
    return ()


def _question(row, matching_rivals):
    n, part = row.number, row.part
    return {
        "name": n.quantity,
        "case": n.case,
        "temperature": n.temperature,
        "paper": n.text,
        "sigma": n.sigma,
        "model": part.model.value if part and part.model else None,
        "role": row.rule.role,
        "rests_on": list(row.rule.rests_on),
        "verdict": row.verdict,
        "basis": row.basis,
        "rivals": [x._asdict() for x in matching_rivals],
    }


def _html(rows, data):
    parts = [f"<h3>The paper's numbers</h3><p>{html.escape(data['sentence'])}</p>"]
    for table in tables(rows):
        parts.append(f"<h4>{html.escape(table.title)}</h4>" + part_page.table(table.heads, table.rows))
        parts.append(f"<p>{html.escape(table.note)}</p>" if table.note else "")
    cells = []
    for q in data["questions"]:
        for k, rival in enumerate(q["rivals"]):
            head = (q["name"], q["case"], q["temperature"], q["verdict"]) if not k else ("",) * 4
            cells.append((*head, rival["name"], rival["predicts"], rival["experiment"]))
    head = ("number", "case", "degC", "verdict", "explanation", "predicts", "experiment that would decide")
    return "".join(parts) + "<h4>Rivals</h4>" + part_page.table(head, cells)

"""Tables of docs/inference.md from what `gyro report infer` wrote beside the board: docs/boards/paper_inferred.json.

Source  docs/inference.md
"""

import json
from pathlib import Path

from testbench.console.markdown import markdown
from testbench.paper.inference import inference_page

FOUND = Path(__file__).parent / "boards" / "paper_inferred.json"


def found():
    """What the study found, as data."""
    return json.loads(FOUND.read_text())


def _part(*tables):
    def part():
        data = found()
        made = [table(data) for table in tables]
        return "\n\n".join(f"{markdown(table)}\n\n{table.note}".strip() for table in made)

    return part


def summary_part():
    """The sentences of the page."""
    return "\n".join(f"- {line}" for line in inference_page.summary(found()))


PARTS = {
    "summary": summary_part,
    "classes": _part(inference_page.classes_table),
    "changes": _part(inference_page.changes_table),
    "held_changes": _part(inference_page.heldout_changes_table, inference_page.sign_table),
    "decide": _part(inference_page.measurements_table),
    "choices": _part(inference_page.choices_table, inference_page.modes_table),
    "numbers": _part(inference_page.numbers_table),
    "rows": _part(inference_page.rows_table),
    "held": _part(inference_page.heldout_rows_table),
}

"""Measured tables of the pages, stored as data in a file NAME.json of docs/results; the site shows them as Markdown.

    {"command": "what measures them", "tables": [{"title", "heads", "rows", "numeric", "note"}, ...]}
Source  docs/architecture.md
"""

import json

from testbench.console.markdown import ROOT, markdown
from testbench.console.text_table import Table
from testbench.storage.files import write_text

FOLDER = ROOT / "docs" / "results"
FIELDS = ("title", "heads", "rows", "numeric", "note")


def write_results(name, command, tables):
    """Store tables with the command that measured them; returns the path."""
    stored = [{field: getattr(table, field) for field in FIELDS} for table in tables]
    path = FOLDER / f"{name}.json"
    write_text(path, json.dumps({"command": command, "tables": stored}, indent=1) + "\n")
    return path


def read_results(name):
    """(command, [Table, ...]) of a file that `write_results` wrote."""
    data = json.loads((FOLDER / f"{name}.json").read_text())
    tables = []
    for one in data["tables"]:
        rows = [tuple(row) for row in one["rows"]]
        tables.append(Table(one["title"], tuple(one["heads"]), rows, one.get("note", ""), tuple(one["numeric"])))
    return data["command"], tables


def results_markdown(name):
    """Tables of a file with their titles and notes, then the command."""
    command, tables = read_results(name)
    parts = []
    for table in tables:
        parts += [f"**{table.title}**" if table.title else "", markdown(table), table.note]
    return "\n\n".join([*filter(None, parts), f"Measured with `{command}`."])

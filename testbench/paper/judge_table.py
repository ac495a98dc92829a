"""The judge's rows as tables, for the page, the terminal and the documents; the paper's means for the pictures.

Source    docs/paper.md
"""

import re
from collections import Counter

from testbench.console.text_table import Table
from testbench.judge import numbers
from testbench.judge.judge import NAME_OF
from testbench.judge.number_verdict import VERDICTS, K

MEANS = ("SF", "Vq", "bias", "ARW", "BI", "SF nonlinearity")
HEADS = ("quantity", "case", "degC", "unit", "paper", "sigma", "model", "sigma", "pull", "role", "verdict", "notes")
NOTE = (
    f"All rows follow one rule. A row is met if model and paper differ by at most {K:g} combined standard "
    "uncertainties; for a bound only the excess counts. A row that is met is called input or fitted "
    "by its role, or predicted if its role is free. A row that is not met is contradicted. A row with several "
    "statements is met only if each one is; its pull is that of the deciding statement, which its note names. "
    "Sigma of the paper: from its printed values. Sigma of the model: scatter of seeds and readings."
)


def format_value(value, digits=5):
    """A number with so many digits, or a dash."""
    return "-" if value is None else f"{value:.{digits}g}"


def paper_means():
    """{quantity: {temperature: (value, sigma)}} of the paper's cases 1 to 3."""
    rows = numbers.numbers()
    rows_by_name = {NAME_OF[s]: [n for n in rows if n.symbol == s and n.case == numbers.MEAN] for s in MEANS}
    return {name: {n.temp_degc: (n.values[0], n.sigma) for n in mine} for name, mine in rows_by_name.items()}


def short(text):
    """A text without the brackets at its end."""
    return re.sub(r"\s*\([^)]*\)$", "", text)


def _row_cells(row, notes):
    n, part = row.number, row.part
    unit = short(n.unit).replace("dimensionless", "1").replace("not stated", "")
    name = short(n.quantity.replace(", mean over cases 1-3", ""))
    paper = n.text if len(n.text) < 12 else short(n.text)
    # of several bounds the one that decides; else the number itself, not a difference of it
    displayed_part = row.parts[0] if row.parts and not row.parts[0].bound else part
    model = displayed_part.model if displayed_part else None
    pull = part.pull if part and part.pull is not None else None
    return (
        name,
        short(n.case),
        short(n.temperature).split(" temp")[0],
        unit,
        paper,
        format_value(n.sigma, 2),
        format_value(model and model.value),
        format_value(model and (model.sigma or None), 2),
        "-" if pull is None else f"{pull:+.1f}" if abs(pull) < 100 else "> 100",
        row.rule.role,
        row.verdict,
        notes,
    )


def _notes(row):
    """What the verdict is based on, what the number was read as, and the fitted values it rests on."""
    rests = f"depends on {', '.join(row.rule.rests_on)}" if row.rule.role in ("fitted", "free") else ""
    reading = row.rule.reading if row.rule.role != "none" else ""
    return tuple(text for text in (row.basis, reading, rests) if text)


def tables(rows):
    """[Table of all rows, Table of what the notes say] of `judge.rows`."""
    note_texts = list(dict.fromkeys(text for row in rows for text in _notes(row)))
    number = {text: f"({k})" for k, text in enumerate(note_texts, 1)}
    cells = [_row_cells(row, " ".join(number[text] for text in _notes(row))) for row in rows]
    table = Table(f"Each number that the paper prints ({len(rows)})", HEADS, cells, NOTE, (4, 5, 6, 7, 8))
    return [table, Table("Notes", ("note", "text"), [(number[t], t) for t in note_texts], numeric=())]


def document(rows):
    """[Table of all rows with the basis of each verdict, Table of the fitted values behind them] for a page."""
    rows_by_fitted_keys = {}
    for row in rows:
        if row.rule.role in ("fitted", "free"):
            rows_by_fitted_keys.setdefault(row.rule.rests_on, []).append(row)
    letter = {keys: chr(ord("A") + k) for k, keys in enumerate(rows_by_fitted_keys)}
    cells = []
    for row in rows:
        name, case, temp, unit, paper = _row_cells(row, "")[:5]
        sigma = f" +- {row.number.sigma:.2g}" if row.number.sigma else ""
        quantity = f"{name} ({unit})" if unit not in ("", "1") else name
        cells.append((quantity, case, temp, f"{paper}{sigma}", row.rule.role, letter.get(row.rule.rests_on, ""),
                      row.verdict, row.basis))  # fmt: skip
    heads = ("quantity", "case", "degC", "paper", "role", "depends on", "verdict", "basis")
    keys = [(letter[k], ", ".join(f"`{key}`" for key in dict.fromkeys(k))) for k in rows_by_fitted_keys]
    return [Table("", heads, cells, numeric=()), Table("", ("", "fitted values"), keys, numeric=())]


def counts(rows):
    """{verdict: number of rows}, every verdict in its order."""
    verdict_counts = Counter(row.verdict for row in rows)
    return {v: verdict_counts[v] for v in VERDICTS}


def sentence(rows):
    """How many rows have which verdict, in one sentence."""
    return f"Of {len(rows)} numbers: " + ", ".join(f"{n} {v}" for v, n in counts(rows).items()) + "."

"""What a command prints on standard output: tables, lists, or one JSON object."""

import json
import math
import sys

PLAIN_WIDTH = 120  # columns where standard output is no terminal
WORDS_WIDTH = 12  # columns that a cell of words needs at least


def _nonfinite_to_null(value):
    """The same data with numbers that JSON cannot hold as null."""
    if isinstance(value, dict):
        return {key: _nonfinite_to_null(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_nonfinite_to_null(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_json(data):
    print(json.dumps(_nonfinite_to_null(data), allow_nan=False))


def _console():
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else PLAIN_WIDTH)


def _least_table_width(table):
    """Columns of the terminal below which numbers would be cut or words stand one letter to a line."""
    width = 2
    for k, head in enumerate(table.heads):
        longest = max(len(str(cell)) for cell in (head, *(row[k] for row in table.rows)))
        width += 2 + (longest if k in table.numeric else min(longest, WORDS_WIDTH))
    return width


def _print_rows(console, table, note):
    """A table whose columns do not fit side by side: each cell behind its head, a blank line between rows."""
    console.print(table.title, markup=False)
    for row in table.rows:
        console.print()
        for head, cell in zip(table.heads, row):
            if str(cell):
                console.print(f"{head}: {cell}" if head else str(cell), markup=False)
    if note:
        console.print(f"\n{note}", markup=False)
    console.print()


def _rich_table(table, note):
    from rich import box
    from rich.table import Table
    from rich.text import Text  # not markup: titles, cells and notes may have [brackets]

    title, caption = Text(table.title, "table.title"), note and Text(note, "table.caption")
    grid = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, caption=caption)
    grid.caption_justify = "left"
    for k, head in enumerate(table.heads):
        grid.add_column(Text(head), justify="right" if k in table.numeric else "left", no_wrap=k in table.numeric)
    for k, row in enumerate(table.rows):
        grid.add_row(*map(Text, map(str, row)), style="bold" if k in table.sums else None)
    return grid


def print_tables(tables):
    """Print tables on standard output, as grids or, on a terminal that is too narrow, cell by cell."""
    console = _console()
    for table, after in zip(tables, [*tables[1:], None]):
        # a note that the next table has, too, stands behind that one
        note = None if after and after.note == table.note else table.note or None
        if _least_table_width(table) > console.width:
            _print_rows(console, table, note)
        else:
            console.print(_rich_table(table, note), markup=False)


def print_reference(tables, as_json):
    """Tables, or one JSON object: {title up to its colon: [{head: cell}, ...]}."""
    if as_json:
        print_json({t.title.partition(":")[0]: [dict(zip(t.heads, row)) for row in t.rows] for t in tables})
    else:
        print_tables(tables)


def print_list(head, items):
    console = _console()
    if items and head:
        console.print(head, markup=False)
    for item in items:
        console.print(f"  - {item}" if not head else f"  {item}", markup=False, soft_wrap=True)

"""What a command prints on standard output: tables, lists, or one JSON object."""

import json
import math
import sys

PLAIN_WIDTH = 120  # columns where standard output is no terminal


def _finite(value):
    """The same data with numbers that JSON cannot hold as null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_json(data):
    print(json.dumps(_finite(data), allow_nan=False))


def _console():
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else PLAIN_WIDTH)


def print_tables(shown):
    from rich import box
    from rich.table import Table

    console = _console()
    for table, after in zip(shown, [*shown[1:], None]):
        # a note that the next table has, too, stands behind that one
        note = None if after and after.note == table.note else table.note or None
        grid = Table(title=table.title, title_justify="left", box=box.SIMPLE_HEAD, caption=note)
        grid.caption_justify = "left"
        for k, head in enumerate(table.heads):
            grid.add_column(head, justify="right" if k in table.numeric else "left", no_wrap=k in table.numeric)
        for k, row in enumerate(table.rows):
            grid.add_row(*row, style="bold" if k in table.sums else None)
        console.print(grid, markup=False)


def print_list(head, items):
    console = _console()
    if items and head:
        console.print(head, markup=False)
    for item in items:
        console.print(f"  - {item}" if not head else f"  {item}", markup=False, soft_wrap=True)

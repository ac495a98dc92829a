"""Tables as Markdown."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def need_repository():
    """End the process with one line where only the package is installed: pages lie in the repository."""
    if not (ROOT / "docs" / "conventions.md").is_file():
        print(
            f"gyro: {ROOT / 'docs'}: no such folder: this command needs the repository, not only the installed package",
            file=sys.stderr,
        )
        sys.exit(2)


def markdown(table):
    """A `tables.Table` as Markdown; sums are bold, empty cells stay empty."""
    align = ["---:" if k in table.numeric else "---" for k in range(len(table.heads))]
    lines = [f"| {' | '.join(table.heads)} |", f"|{'|'.join(align)}|"]
    for k, row in enumerate(table.rows):
        cells = (f"**{cell}**" if cell and k in table.sums else cell for cell in row)
        lines.append(re.sub(r" +\|", " |", f"| {' | '.join(cells)} |"))
    return "\n".join(lines)

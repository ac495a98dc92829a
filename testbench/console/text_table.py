"""A table as plain data: the terminal, the pages and the HTML reports draw the same one."""

from typing import NamedTuple


class Table(NamedTuple):
    """A table: title, column heads, rows of texts, a sentence below it, which columns are numbers, which rows sums."""

    title: str
    heads: tuple
    rows: list
    note: str = ""
    numeric: tuple = (1,)
    sums: tuple = ()


def to_decimals(value, decimals):
    """Number with fixed decimals, or a dash where there is none."""
    return "-" if value is None else f"{value:.{decimals}f}"

"""What machines read: JSON has no infinity and no NaN. What people read: tables whose numbers are never cut."""

import json
import math

import pytest

from testbench.console import show
from testbench.console.text_table import Table


def test_numbers_that_json_cannot_hold_are_null(capsys):
    show.print_json({"far": [math.inf, -math.inf], "none": (math.nan, 1.5), "text": "inf"})
    assert json.loads(capsys.readouterr().out) == {"far": [None, None], "none": [None, 1.5], "text": "inf"}


TABLE = Table(
    "A title of some length",
    ("contribution", "clocks", "deg"),
    [("DDS output register", "1.00", "0.1523"), ("", "-12345.75", "2.5898")],
    "A note.",
    (1, 2),
)


@pytest.mark.parametrize("width", [120, 60, 40, 20, 10])
def test_numbers_and_words_are_whole_on_a_terminal_of_any_width(capsys, monkeypatch, width):
    monkeypatch.setattr(show, "PLAIN_WIDTH", width)
    show.print_tables([TABLE])
    shown = capsys.readouterr().out
    assert all(len(line) <= width for line in shown.splitlines())
    assert "…" not in shown
    for text in ("1.00", "0.1523", "-12345.75", "2.5898", "A note."):
        assert text in shown
    words = shown.split()
    assert all(word.strip(":") in words or f"{word}:" in words for word in ("output", "register", "clocks", "deg"))

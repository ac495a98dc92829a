"""The checker of language finds planted offences, and nothing in text that is plain."""

import itertools
import re
import sys
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "docs"))

import language  # noqa: E402

LONG = "The exporter writes " + "one file and " * 12 + "one more."
LAID_OUT = f"| {LONG} |\n\n```text\n{LONG}\n```\n\n<!-- a: written by b -->\n{LONG}\n<!-- end -->\n"


def found(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return [line.removeprefix(f"{path}: ") for line in language.findings(path)]


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("a.md", f"# Page\n\nShort. {LONG}\n", "41 words, limit 35: The exporter writes"),
        ("a.md", "The two were measured once.\n", "'measured once': write the figure into the lab notebook"),
        ("a.py", f'"""Does it.\n\n{LONG}\n"""\n', "41 words, limit 35"),
        ("a.py", "def f(n):\n    raise ValueError(f'{n}: is there twice')\n", "'is there twice': write duplicate"),
    ],
)
def test_a_planted_offence_is_found(tmp_path, name, text, line):
    (only,) = found(tmp_path, name, text)
    assert only.startswith(line)


@pytest.mark.parametrize(
    "text",
    ['"the design did not lock"', 'f"give {n} or none"', '"plan.toml: x is missing."', '"a: b\\nc"', '"plan.toml: "'],
)
def test_an_error_of_another_form_is_found(tmp_path, text):
    (only,) = found(tmp_path, "a.py", f"def f(n):\n    raise ConfigError({text})\n")
    assert only.startswith("an error is one line 'PLACE: WHAT' without a full stop")


@pytest.mark.parametrize(
    "text", ['f"{path} line {n}: 6 numbers, not 9"', '"--clock: not a number"', 'f"rate_dps = {n} is"']
)
def test_an_error_of_the_form_passes(tmp_path, text):
    assert found(tmp_path, "a.py", f"def f(n):\n    raise FileError({text})\n") == []


def test_code_tables_and_generated_parts_are_not_read(tmp_path):
    assert found(tmp_path, "a.md", LAID_OUT) == []
    assert found(tmp_path, "a.py", f'"""Equations.\n\n    {LONG}\n\nShape   {LONG}\n"""\n') == []


def test_lists_and_paragraphs_are_sentences_of_their_own(tmp_path):
    assert found(tmp_path, "a.md", "\n".join(f"- {'one item and ' * 6}" for _ in range(6))) == []


def test_only_the_notebook_says_what_was_measured_once(tmp_path, monkeypatch):
    text = "The two were measured once.\n"
    assert len(found(tmp_path, "notebook.md", text)) == 1
    monkeypatch.setattr(language, "NOTEBOOK", tmp_path / "notebook.md")
    assert found(tmp_path, "notebook.md", text) == []
    assert len(found(tmp_path, "other.md", text)) == 1


def test_every_file_is_read_and_the_exit_code_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(language, "ROOT", tmp_path)
    (tmp_path / "README.md").write_text("Plain.\n")
    (tmp_path / "CHANGELOG.md").write_text(LONG + "\n")
    assert language.main([]) == 1
    assert capsys.readouterr().out.startswith("CHANGELOG.md: 41 words")
    (tmp_path / "CHANGELOG.md").write_text("Plain.\n")
    assert language.main([]) == 0


def emphasised_formulas(text):
    """What stands before each emphasis that begins within a word: a product or power that loses its asterisks."""
    for block in MarkdownIt("commonmark").enable("table").parse(text):
        for before, part in itertools.pairwise(block.children or ()):
            if part.type in ("em_open", "strong_open") and re.search(r"[\w)\]]$", before.content):
                yield before.content


def test_products_and_powers_keep_their_asterisks_on_the_pages():
    assert len(list(emphasised_formulas("- ki*e is below 2 times ki*e; 2**3 or 2**4"))) == 2
    assert not list(emphasised_formulas("**No bump.** `ki*e` is *one* product and `2**4`"))
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    assert {str(p.relative_to(ROOT)) for p in pages if list(emphasised_formulas(p.read_text()))} == set()

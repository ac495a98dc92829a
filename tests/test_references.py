"""No text cites a document that is neither in the repository nor on the page of references."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REFERENCES = (ROOT / "docs" / "references.md").read_text()
LINE = re.compile(r"^ *Sources? +(\S.*(?:\n {4,}\S.*)*)", re.M)
SOURCES = [
    path for name in ("fpga_model", "analog_frontend", "testbench", "tests") for path in (ROOT / name).rglob("*.py")
]


def cited(text):
    """Citations of a docstring: each a path of the repository, or begins with the name of its author or maker."""
    for found in LINE.findall(text):
        for part in re.split(r"[;\n]|, (?=docs/|testbench/)", re.sub(r"\([^)]*\)", "", found)):
            if part.strip():
                yield part.strip()


def missing(text):
    """What is cited and is nowhere."""
    for one in cited(text):
        path = re.match(r"(?:docs|testbench|tests|analog_frontend|fpga_model)/[\w./-]*", one)
        if path and not (ROOT / path[0].rstrip(".")).exists():
            yield one
        first = re.match(r"(?:IEEE|NIST|doi:\S+|[\w.-]+)", one)
        if not path and (first is None or first[0].removesuffix(".").removesuffix("'s") not in REFERENCES):
            yield one


def test_what_docstrings_cite_is_there():
    for path in SOURCES:
        assert not list(missing(ast.get_docstring(ast.parse(path.read_text())) or "")), path


def test_a_planted_citation_of_nothing_is_found():
    assert list(missing("Source    FACTS.md 6.3; docs/tracing.md")) == ["FACTS.md 6.3"]
    assert list(missing("Source  docs/gone.md")) == ["docs/gone.md"]
    assert list(missing("Source  Nobody & Nowhere (1999)")) == ["Nobody & Nowhere"]
    assert list(missing("Source    docs/tracing.md, docs/loop.md; Vuong, Econometrica 57 (1989)")) == []

"""Citations lead somewhere: to a file of the repository, or to an entry of docs/references.md that names its users."""

import ast
import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("fpga_model", "analog_frontend", "testbench", "tests", "docs")
REFERENCES = ROOT / "docs" / "references.md"
SOURCES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py")) if path != Path(__file__)]
PAGES = [ROOT / "README.md", *(p for p in sorted((ROOT / "docs").rglob("*.md")) if p.parent.name != "api")]
FILE = re.compile(r"\b(?:docs|testbench|tests|fpga_model|analog_frontend)/[\w./-]*[\w/]")
# documents that are named by an identifier, a year or a capital name
CITED = (
    r"\b(?:SLAS|SBAS)\w+",
    r"\b(?:AD|ADS|DAC|LT)\d+ Rev\. [A-Z]",
    r"\bIEEE (?:Std )?\d{3,4}\b",
    r"\bNIST SP \d+",
    r"\b10\.\d{4,}/[\w.-]*\w",
    r"\b[A-Z]\w+(?:, [A-Z]\w+)* (?:& [A-Z]\w+|et al\.)?,? ?[^.;()|\n]{0,60}\((?:19|20)\d\d\)",
    r"\b[A-Z]\w+(?:, [A-Z]\w+)+,? (?:[A-Z]{3,8} )?(?:19|20)\d\d\b",
)
NAMED = re.compile(r"\b[A-Z][A-Z_]{3,}\.md\b|\bFACTS\b|\b(?:internal|private) (?:document|report|note)\b")
THE_PAPER = re.compile(r"\bthe paper(?:'s)?\b", re.I)
KNOWN = {"RANGES.md", *(path.name for path in PAGES), "CHANGELOG.md"}  # the first is a file of every bundle
LEADS_TO_THE_PAPER = re.compile(
    r"(?:docs/)?\b(?:paper|references|phases|loop|measured_results|inference)\.md|10\.1038/s41378-025-01144-6"
)


@functools.cache
def tree(path):
    """Syntax tree of a source."""
    return ast.parse(path.read_text())


@functools.cache
def entries():
    """[(cited as, source, [files])] of the page."""
    rows = re.findall(r"^\| (.+?) \| (.+?) \| (`.*`) \|$", REFERENCES.read_text(), re.M)
    return [(key, source, re.findall(r"`([^`]+)`", users)) for key, source, users in rows]


def docstrings(node):
    """Those of a module, of its classes and functions, and of what is defined in them."""
    if text := ast.get_docstring(node):
        yield text
    for part in node.body:
        if isinstance(part, (ast.ClassDef, ast.FunctionDef)):
            yield from docstrings(part)


KEYS = [key for key, _, _ in entries()]


def source_clauses(text):
    """Parts of a docstring's `Source` line, and of the lines that continue it."""
    for found in re.finditer(r"(?:^|[. ]) *Source {2,}(.+(?:\n {6,}\S.*)*)", text, re.M):
        yield from (" ".join(part.split()) for part in found[1].split(";"))


def wrong_clause(clause):
    """True unless a clause names files that exist, or an entry."""
    files = FILE.findall(clause)
    if files:
        return not all((ROOT / name.rstrip(".")).exists() for name in files)
    return not any(key in clause for key in KEYS)


def unknown_citations(text):
    """What the text cites in one of the known forms and no entry has."""
    for form in CITED:
        for found in re.finditer(form, text):
            if not any(key in found[0] or found[0] in source for key, source, _ in entries()):
                yield found[0]
    yield from (name for name in NAMED.findall(text) if name not in KNOWN)


@pytest.mark.parametrize("entry", entries(), ids=KEYS)
def test_the_files_of_an_entry_cite_it(entry):
    key, _, users = entry
    assert users
    for name in users:
        assert key in " ".join((ROOT / name).read_text().split()), name


def test_keys_of_entries_are_unique():
    assert len(KEYS) > 40
    assert len(set(KEYS)) == len(KEYS)


def test_sources_of_docstrings_exist():
    seen = 0
    for path in SOURCES:
        if not re.search("Source {2}", path.read_text()):
            continue
        for text in docstrings(tree(path)):
            clauses = list(source_clauses(text))
            seen += len(clauses)
            assert not [clause for clause in clauses if wrong_clause(clause)], path
    assert seen > 150


def test_documents_that_pages_and_sources_cite_have_an_entry():
    for path in [*PAGES, *SOURCES]:
        assert not list(unknown_citations(path.read_text())), path


def test_files_that_sources_name_exist():
    for path in SOURCES:
        named = re.findall(r"\bdocs/[\w/-]+\.(?:md|toml|json|png)\b", path.read_text())
        # tests name files of their own copies, and files that must not exist
        if path.relative_to(ROOT).parts[0] != "tests":
            assert not [name for name in named if not (ROOT / name).exists()], path


def test_who_speaks_of_the_paper_leads_to_it():
    for path in [*PAGES, *SOURCES]:
        text = path.read_text()
        if path.suffix == ".py" and THE_PAPER.search(text):
            text = ast.get_docstring(tree(path)) or ""
        # what commands print, and parts that the code writes, use its words
        text = re.sub(r"^```.*?^```$|<!-- .*?written by.*?<!-- end -->", "", text, flags=re.M | re.S)
        if THE_PAPER.search(text):
            assert LEADS_TO_THE_PAPER.search(text), path


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("Source    docs/golden.md (rows)", []),
        ("Source    docs/nowhere.md", ["docs/nowhere.md"]),
        ("Source    docs/golden.md; Nobody (1999)", ["Nobody (1999)"]),
        ("Title. Source  docs/rtl.md", []),
        ("Source    Ljung, System Identification (1999), 16.6; docs/tracing.md", []),
    ],
)
def test_a_wrong_source_would_be_found(text, wrong):
    assert [clause for clause in source_clauses(text) if wrong_clause(clause)] == wrong


@pytest.mark.parametrize("text", ["as SBAS000Z says", "see Nobody, Nothing (1999)", "IEEE Std 9999", "see FACTS.md"])
def test_an_unknown_citation_would_be_found(text):
    assert list(unknown_citations(text))

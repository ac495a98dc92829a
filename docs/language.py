"""The language of pages, messages and docstrings: python docs/language.py [FILE ...] prints findings, exit code 1.

    a sentence of more than WORDS words
    a phrase of FORBIDDEN, with the one to use instead
    a message of an error that is not `PLACE: WHAT` in one line

Code, tables, generated parts and headings are left out. Of a Python file the docstrings and the texts of raised errors
are read, except what is indented or laid out in columns. Without arguments all pages and sources are read. Only the lab
notebook may say NOTED.
"""

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "docs" / "notebook.md"
WORDS = 35
# of a tool that failed, what it said stands below
PLAIN = re.compile(r"[^\n!]*[^\n!.](\n\{.*\})?")
ERRORS = ("ConfigError", "FileError", "ClusterError")
NOTED = r"measured once\b"
FORBIDDEN = {
    NOTED: "the figure into the lab notebook, or name the command that measures it",
    r"\bout of nothing\b": "spurious",
    r"\btold apart\b": "distinguished",
    r"\bfor certain\b": "significantly, with the level",
    r"\blook(s|ed) at\b": "test, evaluate or use",
    r"\bnobody types\b": "is no input",
    r"\bis there twice\b": "duplicate",
    r"\bloudly\b": "with a message",
    r"\bbears? it out\b": "support it",
    r"\bgoes again\b": "is removed",
    r"\bbirths?\b": "start-up",
    r"\bdeaths?\b": "end",
}
CUT = (
    re.compile(r"^```.*?^```$", re.M | re.S),
    re.compile(r"<!-- .*?written by.*?<!-- end -->", re.S),
    re.compile(r"<!--.*?-->", re.S),
    re.compile(r"^(\||#| {4}).*$", re.M),
)
SENTENCE = re.compile(r"(?<=[.!?:;])\s+(?=[A-Z*`\[(])|\n\s*\n|\n\s*(?:[-*]|\d+\.) ")
WORD = re.compile(r"[A-Za-z][A-Za-z'-]+")


def sentences(text):
    """Sentences of Markdown, without markup that is not read aloud."""
    for cut in CUT:
        text = cut.sub(lambda found: "\n" * found[0].count("\n"), text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    for part in SENTENCE.split(text):
        if part and part.strip():
            yield " ".join(part.split())


def texts_of_python(source):
    """Docstrings, without what is laid out, and the constant parts of raised errors."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
            plain = (p for p in text.split("\n\n") if not re.search(r"^\s|\S {2,}\S", p, re.M))
            yield "\n\n".join(plain)
        if isinstance(node, ast.Raise) and node.exc:
            parts = [n.value for n in ast.walk(node.exc) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
            yield " ".join(parts)


def messages(source):
    """Texts of our own errors that are raised with a text, values as {expression}."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
            name, text = ast.unparse(node.exc.func).split(".")[-1], node.exc.args[0]
            if name in ERRORS and isinstance(text, ast.Constant):
                yield str(text.value)
            elif name in ERRORS and isinstance(text, ast.JoinedStr):
                yield "".join(
                    v.value if isinstance(v, ast.Constant) else f"{{{ast.unparse(v.value)}}}" for v in text.values
                )


def is_error(text):
    """Whether a message has the form of all: a place, a colon or ' = ', what is wrong; one line, without a full stop.

    A value at the begin may hold place and colon itself.
    """
    place, colon, what = text.partition(": ")
    if not colon:
        place, colon, what = text.partition(" = ")
    if not colon and text.startswith("{"):
        place, colon, what = text.partition("} ")
    return bool(place and what.strip()) and PLAIN.fullmatch(text) is not None


def findings(path):
    """Lines about one file."""
    source = Path(path).read_text()
    for text in messages(source) if Path(path).suffix == ".py" else ():
        if not is_error(text):
            yield f"{path}: an error is one line 'PLACE: WHAT' without a full stop: {text}"
    texts = texts_of_python(source) if Path(path).suffix == ".py" else [source]
    for text in texts:
        for sentence in sentences(text):
            count = len(WORD.findall(re.sub(r"`[^`]*`", "", sentence)))
            if count > WORDS:
                yield f"{path}: {count} words, limit {WORDS}: {sentence}"
            for pattern, better in FORBIDDEN.items():
                if re.search(pattern, sentence, re.I) and (pattern != NOTED or Path(path) != NOTEBOOK):
                    yield f"{path}: {re.search(pattern, sentence, re.I)[0]!r}: write {better}: {sentence}"


def everything():
    """Pages and sources of the repository, except generated pages of the API."""
    pages = [path for path in sorted((ROOT / "docs").rglob("*.md")) if path.parent.name != "api"]
    sources = [
        p for name in ("fpga_model", "analog_frontend", "testbench") for p in sorted((ROOT / name).rglob("*.py"))
    ]
    return [ROOT / "README.md", ROOT / "CHANGELOG.md", *pages, *sources]


def main(paths):
    """Print the findings; returns the exit code."""
    found = [line for path in paths or everything() for line in findings(path)]
    print(*(line.replace(f"{ROOT}/", "") for line in found), sep="\n", end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

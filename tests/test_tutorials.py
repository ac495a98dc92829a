"""Every tutorial is done word for word; the runner finds an output that a page does not say."""

import re
import shutil
from pathlib import Path

import numba
import pytest

from tests import tutorials

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "tutorials"
NEEDED = {
    "your_bench": ("cc", "gcc", "make"),
    "your_host": ("cc", "g++", "make", "verilator"),
    "your_registers": ("cc",),
    "your_rtl": ("iverilog",),
    "your_scoreboard": ("g++", "make", "verilator"),
    "your_simulator": ("cc", "make", "unzip"),
    "your_soc": ("cc", "g++", "make", "verilator", "yosys"),
}
PACKAGES = dict.fromkeys(("your_host", "your_registers", "your_soc"), "systemrdl")
PAGES = sorted(path.stem for path in FOLDER.glob("*.md"))


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
@pytest.mark.slow  # .ci/run does all of them
@pytest.mark.parametrize("stem", PAGES)
def test_a_tutorial_does_what_it_says(stem, tmp_path):
    absent = [tool for tool in NEEDED.get(stem, ()) if shutil.which(tool) is None]
    if absent:
        pytest.skip(f"not installed: {', '.join(absent)}")
    if stem in PACKAGES:
        pytest.importorskip(PACKAGES[stem], reason="the extra registers is not installed")
    tutorials.follow(FOLDER / f"{stem}.md", tmp_path)


def test_all_are_there():
    assert PAGES == [
        "first_run",
        "your_bench",
        "your_board",
        "your_host",
        "your_recording",
        "your_registers",
        "your_rtl",
        "your_scoreboard",
        "your_simulator",
        "your_soc",
    ]
    for stem in PAGES:
        assert any(isinstance(step, tutorials.Command) for step in tutorials.steps(FOLDER / f"{stem}.md"))


def test_the_glossary_defines_every_abbreviation():
    """Of the README and the tutorials, outside of code."""
    known = set(re.findall(r"\b[A-Z][A-Z0-9]+\b", (FOLDER.parent / "glossary.md").read_text()))
    for page in (FOLDER.parents[1] / "README.md", *sorted(FOLDER.glob("*.md"))):
        text = re.sub(r"^```.*?^```$|`[^`]*`|\]\([^)]*\)|^ {4}.*$", "", page.read_text(), flags=re.M | re.S)
        assert set(re.findall(r"\b[A-Z][A-Z]+\b", text)) <= known, page


PAGE = """# Page
<!-- file: a.txt -->
```text
one
two
```
```console
$ cat a.txt
one
{second}
$ echo "took 12 s" >&2; true
took ... s
```
"""


@pytest.mark.parametrize("second", ["two", "t...", "..."])
def test_outputs_with_any_text_are_compared(second, tmp_path):
    (tmp_path / "page.md").write_text(PAGE.format(second=second))
    tutorials.follow(tmp_path / "page.md", tmp_path)


@pytest.mark.parametrize("second", ["three", "two\nthree", "two two", "t...e"])
def test_a_planted_difference_is_found_with_its_line(second, tmp_path):
    (tmp_path / "page.md").write_text(PAGE.format(second=second))
    with pytest.raises(tutorials.Different, match=r"page.md:8: \$ cat a.txt\nthe page says\none\n"):
        tutorials.follow(tmp_path / "page.md", tmp_path)

"""The site of `make docs`: a page for every public function, and what a browser shows of it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.testbench.paper import browser

ROOT = Path(__file__).resolve().parents[1]
SITE = ROOT / "build" / "site"
sys.path.append(str(ROOT / "docs"))

import api_pages  # noqa: E402

built = pytest.mark.skipif(not (SITE / "index.html").exists(), reason="make docs has not been run")


# ---- pages of the API ------------------------------------------------------------------------------------------------


def test_every_public_function_has_its_signature_on_a_page():
    for name, path in api_pages.modules().items():
        page = api_pages.page(name, path)
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and ast.get_docstring(node):
                shown = page.replace("(\n    ", "(").replace(",\n    ", ", ").replace("\n)\n", ")\n")
                assert f"\n{node.name}({ast.unparse(node.args)})\n" in shown, (name, node.name)


def test_what_is_laid_out_stays_and_prose_is_not_marked_up(tmp_path):
    source = tmp_path / "one.py"
    source.write_text('"""Two *stars* and a_name.\n\n    y = a * x\n"""\n\ndef f(x, *, n=1):\n    """Double."""\n')
    text = "# one\n\n`one`\n\nTwo \\*stars\\* and a\\_name.\n\n```text\ny = a * x\n```\n\n"
    assert api_pages.page("one", source) == f"{text}## f\n\n```python\nf(x, *, n=1)\n```\n\nDouble.\n"


def test_pages_of_modules_that_are_gone_go(tmp_path):
    (tmp_path / "gone.md").write_text("# gone\n")
    api_pages.write(tmp_path)
    assert not (tmp_path / "gone.md").exists()
    assert {path.stem for path in tmp_path.glob("*.md")} == set(api_pages.modules())


# ---- the site --------------------------------------------------------------------------------------------------------


def dom(folder, name):
    """Source of a page of the site after its scripts have run."""
    command = [browser.BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}/profile"]
    command += ["--virtual-time-budget=10000", "--dump-dom", f"{SITE.as_uri()}/{name}"]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout


@built
@browser.needed
@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("index.html", "register by register at 26 MHz"),
        ("api/fpga_model.pi.html", "PI controller with a clamped integrator"),
        ("api/fpga_model.pi.html", 'href="#step"'),
        ("search.html?q=quadrature", 'href="api/fpga_model.quadrature_loop.html'),
    ],
)
def test_a_browser_shows(tmp_path, name, wanted):
    source = dom(tmp_path, name)
    assert wanted in source
    assert "FTR gyro" in source


@built
def test_nothing_comes_from_the_network():
    loaded = ("<script src=", '<link rel="stylesheet"', "<img src=", "@import", "url(")
    for path in [*SITE.rglob("*.html"), *SITE.rglob("*.css")]:
        text = path.read_text()
        for way in loaded:
            for part in text.split(way)[1:]:
                assert not part[:60].lstrip(" \"'(").startswith(("http:", "https:", "//")), (path, part[:60])

"""The site, `make docs`: these Markdown pages, and pages of the API that are read from the sources without import."""

import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

import api_pages  # noqa: E402

from testbench.version import VERSION  # noqa: E402

project = "FTR gyro"
copyright = "the authors of ftr-gyro"
release = VERSION
extensions = ["myst_parser"]
root_doc = "README"
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"FTR gyro {VERSION}"
html_copy_source = False
myst_heading_anchors = 4
# the generated index has headings of the third level
suppress_warnings = ["myst.header"]
CHAPTERS = {
    "Tutorials": tuple(
        f"tutorials/{stem}"
        for stem in (
            "first_run",
            "your_rtl",
            "your_board",
            "your_simulator",
            "your_bench",
            "your_scoreboard",
            "your_registers",
            "your_host",
            "your_soc",
            "your_recording",
        )
    ),
    "How-to guides": ("how_to/*",),
    "First": ("limits", "conventions", "architecture", "phases"),
    "Reference": (
        "references",
        "glossary",
        "configuration",
        "boards/README",
        "faults",
        "record",
        "inputs",
        "plant_port",
        "register_map",
        "c_model",
        "fmu",
        "api",
    ),
    "Experiments": ("paper", "inference", "loop", "design_of_loops", "word_lengths", "campaigns"),
    "Verification": (
        "verification",
        "golden",
        "foreign_designs",
        "diagnosis",
        "rtl",
        "ranges",
        "portability",
        "speed",
        "notebook",
    ),
    "Measured data": (
        "measured",
        "import",
        "quality",
        "wide_priors",
        "measured_parts",
        "measured_resonators",
        "tracing",
        "sealed",
    ),
    "Firmware": ("blocks/*",),
    "Plant": ("parts/*",),
    "Effects": ("effects/*",),
    "Decisions": ("decisions/*",),
    "API": ("api/*",),
}


def contents():
    """Tables of contents for the side bar; on a code host the index is plain Markdown."""
    lines = []
    for caption, patterns in CHAPTERS.items():
        pages = [path.relative_to(DOCS) for pattern in patterns for path in sorted(DOCS.glob(f"{pattern}.md"))]
        lines += ["```{toctree}", ":hidden:", f":caption: {caption}", "", *map(str, pages), "```", ""]
    return "\n".join(lines)


def setup(app):
    """Write the pages of the API, add the side bar to the index, and let the site begin at index.html."""
    api_pages.write(DOCS / "api")

    def extended(_, name, source):
        if name == root_doc:
            source[0] += f"\n\n{contents()}"

    def begun(built, error):
        if error is None:
            shutil.copyfile(Path(built.outdir) / f"{root_doc}.html", Path(built.outdir) / "index.html")

    app.connect("source-read", extended)
    app.connect("build-finished", begun)

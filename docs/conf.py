"""The site, `make docs`: these Markdown pages with their generated parts, and a page for each module of the model."""

import os
import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

import api_pages  # noqa: E402
import effects_pages  # noqa: E402
import pages  # noqa: E402

from testbench.console.markdown import markdown  # noqa: E402
from testbench.golden.port_table import port_table  # noqa: E402
from testbench.golden.stimulus import blocks  # noqa: E402
from testbench.version import VERSION  # noqa: E402

project = "FTR gyro"
copyright = "the authors of ftr-gyro"
release = VERSION
extensions = ["myst_parser"]
root_doc = "README"
exclude_patterns = ["_build", "results", "changes"]
html_theme = "furo"
html_title = f"FTR gyro {VERSION}"
html_copy_source = False
html_use_index = False
smartquotes = False  # a command keeps its dashes, a value its quotes
html_static_path = ["static"]
html_css_files = ["tables.css"]
myst_heading_anchors = 4
# the generated parts have headings of the third level
suppress_warnings = ["myst.header"]
TUTORIALS = (
    "first_run your_rtl your_board your_recording your_simulator your_bench your_scoreboard your_registers your_host "
    "your_soc"
)
CHAPTERS = {
    "Begin": ("quick_reference", "troubleshooting", "gallery", "why_ye1", "glossary", "limits"),
    "Tutorials": tuple(f"tutorials/{stem}" for stem in TUTORIALS.split()),
    "How-to guides": ("how_to/*",),
    "The model": ("conventions", "architecture", "firmware", "plant", "effects", "phases", "loop", "faults"),
    "Configuration": ("configuration", "boards/README", "design_of_loops", "word_lengths", "inputs", "record"),
    "Golden vectors and RTL": (
        "golden",
        "foreign_designs",
        "diagnosis",
        "rtl",
        "host_port",
        "register_map",
        "c_model",
        "fmu",
        "plant_port",
    ),
    "Experiments": ("paper", "inference", "campaigns"),
    "Measured data": ("measured", "import", "quality", "wide_priors", "tracing", "measured_results"),
    "Python": ("api", *(f"api/testbench.{name}" for name in ("config.load", "run.*", "errors"))),
    "Blocks of the firmware": ("api/fpga_model*",),
    "Parts of the plant": ("api/analog_frontend*",),
    "For developers": (
        "verification",
        "sealed",
        "ranges",
        "portability",
        "speed",
        "notebook",
        "references",
        "decisions/*",
    ),
}


def _sorted_pages(pattern):
    return sorted(DOCS.glob(f"{pattern}.md"), key=lambda path: path.name.removesuffix(".md"))


def contents():
    """Tables of contents for the side bar; on a code host the front page is plain Markdown."""
    lines = []
    for caption, patterns in CHAPTERS.items():
        names = [path.relative_to(DOCS) for pattern in patterns for path in _sorted_pages(pattern)]
        lines += ["```{toctree}", ":hidden:", f":caption: {caption}", "", *map(str, names), "```", ""]
    return "\n".join(lines)


def link_modules(docname, text):
    """The page with links to sources of the model led to the pages of these modules."""
    here = (DOCS / docname).parent
    built = {path: DOCS / "api" / f"{name}.md" for name, path in api_pages.modules().items()}

    def lead(found):
        goal = built.get((here / found[1]).resolve())
        return f"]({os.path.relpath(goal, here)})" if goal else found[0]

    return re.sub(r"\]\((\.\./[^)#\s]+\.py)\)", lead, text)


def ports_section(stem):
    """Ports of a block's page."""
    table = port_table(stem)
    return f"## Ports\n\n{markdown(table)}\n\n{table.note}"


def setup(app):
    """Write the pages of modules, fill in generated parts, and let the site begin at index.html."""
    for stem in blocks.BLOCKS:
        api_pages.EXTRAS[f"fpga_model.{stem}"] = lambda stem=stem: ports_section(stem)
    for name in api_pages.modules():
        package, _, stem = name.rpartition(".")
        if package == "analog_frontend.effects":
            api_pages.EXTRAS[name] = lambda stem=stem: effects_pages.effect_section(stem)
    api_pages.write(DOCS / "api")

    def complete(_, name, source):
        text = f"{source[0]}\n\n{contents()}" if name == root_doc else source[0]
        source[0] = link_modules(name, pages.with_parts(text))

    def copy_front_page(built, error):
        if error is None:
            shutil.copyfile(Path(built.outdir) / f"{root_doc}.html", Path(built.outdir) / "index.html")

    app.connect("source-read", complete)
    app.connect("build-finished", copy_front_page)

"""Pictures of the pages: they exist, are small PNG files, and show what exists and what their captions say."""

import re
import sys
from pathlib import Path

import pytest

from testbench import config
from testbench.paper.loop import advisor
from testbench.paper.loop.loop_parameters import loop_parameters

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
sys.path.append(str(DOCS))

import pictures  # noqa: E402

PAGES = [ROOT / "README.md", *(path for path in sorted(DOCS.rglob("*.md")) if path.parent.name != "api")]
MOST_BYTES = 2_000_000
WIDTH = 1200  # pixels


def shown():
    """[(page, alternative text, file)] of all pictures in pages."""
    found = []
    for page in PAGES:
        for text, target in re.findall(r"!\[([^\]]*)\]\(([^)]*)\)", page.read_text()):
            found.append((page, text, (page.parent / target).resolve()))
    return found


def test_every_picture_is_shown_has_a_text_and_is_written_by_one_command():
    files = {path for _, _, path in shown()}
    assert files == set(pictures.FOLDER.iterdir())
    assert {path.stem for path in files} == set(pictures.PICTURES)
    for page, text, _ in shown():
        assert len(text.split()) >= 8, (page, "alternative text")
    gallery = (DOCS / "gallery.md").read_text()
    for path in files:
        assert f"](pictures/{path.name})" in gallery
        assert f"`python docs/pictures.py {path.stem}`" in gallery


def test_pictures_of_a_run_are_files_that_it_writes():
    assert f"`gyro {' '.join(pictures.RUN)}`" in (DOCS / "gallery.md").read_text()
    first_run = (DOCS / "tutorials" / "first_run.md").read_text()
    assert f"$ gyro {' '.join(pictures.RUN)}\n" in first_run
    for picture in pictures.OF_RUN:
        assert f"  out/{picture.__name__}.png\n" in first_run


def test_pictures_are_png_of_the_width_of_reports_and_small():
    files = list(pictures.FOLDER.iterdir())
    for path in files:
        head = path.read_bytes()[:24]
        assert head[:8] == b"\x89PNG\r\n\x1a\n", path
        assert int.from_bytes(head[16:20], "big") == WIDTH, path
    assert sum(path.stat().st_size for path in files) < MOST_BYTES


def test_every_block_of_the_diagram_exists():
    for name, box in pictures.BOXES.items():
        assert (ROOT / box.folder / f"{name}.py").is_file(), name
    folders = {box.folder for box in pictures.BOXES.values()}
    assert folders == {"fpga_model", "analog_frontend/parts"}


def test_every_connection_of_the_diagram_begins_in_a_box_and_ends_at_one():
    starts = {(box.x, box.y) for box in pictures.BOXES.values()}
    for corners, *_ in pictures.EDGES:
        x, y = pictures.clipped(corners)[-1]
        assert any(
            max(abs(box.x - x) / pictures.HALF[0], abs(box.y - y) / pictures.HALF[1]) == pytest.approx(1)
            for box in pictures.BOXES.values()
        ), corners
        inside = any(abs(bx - corners[0][0]) < pictures.HALF[0] and by == corners[0][1] for bx, by in starts)
        branch = any(corners[0] in other[1:-1] for other, *_ in pictures.EDGES)
        assert inside or branch or corners[0] == (pictures.C[3], 2.4), corners


def test_margins_in_the_text_are_those_of_the_loop():
    page = " ".join((DOCS / "loop.md").read_text().split())
    advice = advisor.analyse(loop_parameters(config.Config()))
    assert f"gain margin {advice.gain_margin_up_db:.1f} dB at 37.5 Hz" in page
    margins = [f"{min(c.lag_deg, c.lead_deg):.0f} deg at {c.hz:.1f} Hz" for c in advice.crossings]
    assert f"phase margins {', '.join(margins[:-1])} and {margins[-1]}" in page


def test_the_effect_of_the_trace_is_named_and_its_held_out_residual_falls_to_the_noise():
    tracer, result = pictures.traced()
    assert result.verdict == "named"
    (effect,) = result.effects
    assert effect["law"] == "duffing"
    assert abs(effect["value"] - pictures.TRUTH_HZ) < 4 * effect["sd"]
    row = result.heldout["f"]
    assert row["before"] > 3 * row["floor"]
    assert row["after_ci"][0] < row["expected"] < row["after_ci"][1]
    assert tracer.fits["before"].model.names == ()

"""Pages of effects: every candidate of tracing and every row of the fact sheet stands in the tables, and what they name
exists."""

import re
from pathlib import Path

import pytest

from analog_frontend import device
from analog_frontend.effects import catalogue
from testbench import config

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "effects"
README = (FOLDER / "README.md").read_text()
IDS = [f"E{k:02d}" for k in range(1, 25)] + [f"N{k:02d}" for k in range(1, 5)]


def rows(text):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]


def test_every_candidate_and_every_row_of_the_fact_sheet_is_there():
    first, second = README.split("## The fact sheet")
    assert [r[0] for r in rows(first)][2:] == IDS
    assert [r[0] for r in rows(second)][2:] == [str(k) for k in range(1, 39)]


def test_what_the_tables_name_exists():
    sections = {"effects": config.Effects, "plant": config.Plant, "firmware": config.Firmware, "noise": config.Noise}
    sections["scenario"] = config.Scenario
    named = re.findall(r"`(effects|plant|firmware|noise|scenario)\.(\w+)`", README)
    assert len(named) > 60
    for section, key in named:
        assert key in sections[section].model_fields or key in ("files",), f"{section}.{key}"


@pytest.mark.parametrize("effect", catalogue.LAWS, ids=lambda e: e.INFO.name)
def test_a_page_says_physics_source_fingerprint_and_what_it_changes(effect):
    page = (FOLDER / f"{effect.INFO.name}.md").read_text()
    for text in ("**Source.**", "**Applied**", "**Fingerprint.**", effect.INFO.fingerprint, "| change |"):
        assert text in page
    for term in effect.terms(effect.EXAMPLE, device.Device()):
        assert term in page
    assert f"[{effect.INFO.name}]({effect.INFO.name}.md)" in README or effect.IDS.startswith("FACTS")

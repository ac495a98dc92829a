"""Pages of effects: every candidate of tracing and every row of the fact sheet stands in the tables, and what they name
exists."""

import math
import re
from pathlib import Path

import pytest

from analog_frontend.effects import (
    acceleration,
    bias_cubic,
    catalogue,
    damping_coupling,
    parasitic_mode,
    sid_absorption,
)
from analog_frontend.parts import device
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


def test_scale_factors_of_pages_are_those_that_were_derived():
    """Rebalance force as x has grown behind power-on, as a second compliance takes it, as its electrodes give it."""
    d = device.Device()
    share, g = (d.fx_hz**2 - d.fy_hz**2) / (parasitic_mode.MODE_HZ**2 - d.fx_hz**2), acceleration.EXAMPLE
    # half a second into a dwell that begins 1.5 s behind a state of 1.75 s
    decayed = math.exp(-3.75 / sid_absorption.TAU_S)
    wanted = {
        "sid_absorption": sid_absorption.tail(sid_absorption.EXAMPLE, d.sid_r_ohm * d.sid_c_f) * decayed,
        "parasitic_mode": parasitic_mode.EXAMPLE * share / (1 - parasitic_mode.EXAMPLE * share),
        "acceleration": -acceleration.shift(g, d) / (1 + acceleration.shift(g, d)),
    }
    for name, value in wanted.items():
        found = re.search(r"\| scale factor \| (\S+) ppm \|", (FOLDER / f"{name}.md").read_text())
        assert float(found.group(1)) == pytest.approx(1e6 * value, rel=0.03), name


def test_biases_of_pages_are_the_rates_that_their_forces_are():
    """-2 m Omega vx is a rate: d vx is d/2m, d x^2 vx by its fundamental d A^2/8m; in quadrature there is none."""
    d = device.Device()
    deg_per_h = math.degrees(3600 / d.coriolis_mass_kg)
    wanted = {
        "damping_coupling": damping_coupling.EXAMPLE / 2 * deg_per_h,
        "bias_cubic": bias_cubic.EXAMPLE * 5e-6**2 / 8 * deg_per_h,
        "quadrature_cubic": 0.0,
    }
    for name, value in wanted.items():
        found = re.search(r"\| bias \| (\S+) deg/h \|", (FOLDER / f"{name}.md").read_text())
        assert float(found.group(1)) == pytest.approx(value, abs=0.2), name

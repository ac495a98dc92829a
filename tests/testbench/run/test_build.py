"""What a configuration becomes: numbers of the pages that follow from it."""

from pathlib import Path

from testbench.config import Config
from testbench.run import build


def test_the_leads_of_both_electrodes_are_those_of_the_page():
    cfg = Config()
    drive, sense = build.electrode_leads(cfg, cfg.device())
    page = (Path(__file__).resolve().parents[3] / "docs" / "effects.md").read_text()
    assert f"{drive + 0.5:.2f} for u and {sense + 0.5:.2f} for w" in page

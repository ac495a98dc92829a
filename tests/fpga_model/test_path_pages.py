"""Pages of the 26 MHz path: the cost they state is the width of the registers, the formats are those of the code."""

import importlib
import re
from pathlib import Path

import pytest

from testbench.flatten import format_leaves

ROOT = Path(__file__).resolve().parents[2]
STEMS = ["rates", "dds", "sine", "references", "modulator", "spi_dac", "spi_adc"]


@pytest.mark.parametrize("stem", STEMS)
def test_page_states_the_register_bits(stem):
    block = importlib.import_module(f"fpga_model.{stem}")
    page = (ROOT / "docs" / "blocks" / f"{stem}.md").read_text()
    (stated,) = re.findall(r"(\d+) register bits", page)
    assert int(stated) == sum(fmt.width for _, fmt in format_leaves(block.STATE_FMT))


@pytest.mark.parametrize("stem", [*STEMS, "delay"])
def test_header_and_page_name_every_register_format(stem):
    """A format of more than a flag's width appears in the block's header."""
    block = importlib.import_module(f"fpga_model.{stem}")
    for name, fmt in format_leaves(block.STATE_FMT):
        if fmt.width > 7:
            assert str(fmt) in block.__doc__, (name, str(fmt))
    for line in ("Formats", "Latency", "Rounding", "Overflow", "Source"):
        assert re.search(rf"^{line}\s", block.__doc__, re.M), line

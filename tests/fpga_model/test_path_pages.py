"""Headers of the blocks: the cost they state is the width of the registers, the formats are those of the code."""

import importlib
import re

import pytest

from fpga_model.block import block_modules
from testbench.flatten import format_leaves

STEMS = ["rates", "dds", "sine", "references", "modulator", "spi_dac", "spi_adc"]
WIRED = ["control", "top", "host", "host_axi"]


@pytest.mark.parametrize("stem", [stem for stem in (*block_modules(), *WIRED) if stem != "delay"])
def test_header_states_the_register_bits(stem):
    block = importlib.import_module(f"fpga_model.{stem}")
    (stated,) = re.findall(r"^Cost +(\d+) register bits", block.__doc__, re.M)
    assert int(stated) == sum(fmt.width for _, fmt in format_leaves(block.STATE_FMT))


@pytest.mark.parametrize("stem", [*STEMS, "delay"])
def test_header_names_every_register_format(stem):
    """A format of more than a flag's width appears in the block's header."""
    block = importlib.import_module(f"fpga_model.{stem}")
    for name, fmt in format_leaves(block.STATE_FMT):
        if fmt.width > 7:
            assert str(fmt) in block.__doc__, (name, str(fmt))
    for line in ("Formats", "Latency", "Rounding", "Overflow", "Cost"):
        assert re.search(rf"^{line}\s", block.__doc__, re.M), line

"""Clocks of one path: none is no part of the design, and what is too long is refused by name."""

import pytest

from fpga_model import delay, path_clocks, spi_dac
from fpga_model.block import python_function
from fpga_model.design_record import DEFAULT


def test_none_is_none():
    assert path_clocks.design(3) is None
    assert python_function(path_clocks.pipes)(delay.design(3), None) == (delay.design(3), delay.design(3))
    assert python_function(path_clocks.codes)(None) == (spi_dac.CODE_TICK, spi_dac.CODE_TICK)
    assert python_function(path_clocks.loads)(None) == (spi_dac.LOAD_TICK, spi_dac.LOAD_TICK)


def test_each_clock_is_where_it_belongs():
    p = path_clocks.design(3, (0, 2), (1, 4))
    assert python_function(path_clocks.pipes)(delay.design(3), p) == (delay.design(3), delay.design(5))
    assert python_function(path_clocks.codes)(p) == (2, 5)
    assert python_function(path_clocks.loads)(p) == (3, 6)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((7, (0, 2)), r"firmware\.pipeline_registers \+ sense_sine_registers = 9 is outside 0 \.\. 8"),
        ((0, (0, 0), (9, 0)), r"firmware\.drive_code_registers = 9 is outside 0 \.\. 8"),
        ((0, (0, 0), (0, 8), DEFAULT._replace(tick_clocks=10)), r"sense_code_registers = 8 is outside 0 \.\. 7"),
    ],
)
def test_what_does_not_fit_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        path_clocks.design(*given)

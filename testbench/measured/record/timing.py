"""When the firmware sees a frame of the converter, in edges from power-on: the one number that ties codes to words.

    valid edge of conversion m = first edge that sees DRDY low + clocks of the read

Source    docs/architecture.md, analog_frontend/parts/adc.py
"""

import numpy as np

from analog_frontend.parts import adc
from fpga_model.rates import FRAME_CYCLES
from testbench.engines.window import valid_clocks
from testbench.errors import ConfigError
from testbench.run import build


def valid_edges(config, count):
    """(count,) edges at which conversions 0 .. count - 1 after power-on are valid."""
    part = build.adc_part(config, config.device(), 0.0)
    clock = adc.reset(part).clock
    ready = getattr(adc.clocks_to_ready, "py_func", adc.clocks_to_ready)
    read = valid_clocks(config.design_record())
    return np.array([int(ready(part, clock, m)) + read for m in range(count)], np.int64)


def valid_clock(config, first_drdy=None):
    """Clock within every frame at which the codes of a synchronous converter are valid; none in the first frame.

    first_drdy  clock at which DRDY falls first, of a plant behind the port; None: the own converter's
    Raises ConfigError for a free-running converter, whose rate is no ratio of the clock, and for a first frame of codes
    that is not valid in the second frame.
    """
    if config.firmware.adc_clock != "synchronous":
        raise ConfigError(
            f'firmware.adc_clock = "{config.firmware.adc_clock}": '
            'a record needs "synchronous", because its rates are exact'
        )
    if first_drdy is None:
        return int(valid_edges(config, 1)[0]) - FRAME_CYCLES
    read = valid_clocks(config.design_record())
    if not 0 < first_drdy + read - FRAME_CYCLES < FRAME_CYCLES:
        limits = f"{FRAME_CYCLES - read + 1} .. {2 * FRAME_CYCLES - read - 1} clocks"
        raise ConfigError(f"scenario.plant: DRDY falls first at {first_drdy} clocks; a record needs {limits}")
    return first_drdy + read - FRAME_CYCLES

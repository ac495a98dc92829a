"""The plant's tick as units of machine code, for callers that step 26 MHz: `top.retune` and `top.step`.

Apart from the firmware, so that an edit of a block leaves them compiled. The fast engines include `top.block` instead.
Source  docs/decisions/0015-compile-units.md
"""

from analog_frontend import top as plant
from fpga_model.jit import unit


@unit
def retune(p, a, rate_rad_s, quad_code, temp_degc):
    """`plant.retune`, in place."""
    plant.retune(p, a, rate_rad_s, quad_code, temp_degc)


@unit
def step(p, a, tick, pins, edges):
    """`plant.step`; returns the clock of DRDY."""
    return plant.step(p, a, tick, pins, edges)


@unit
def sar_code(p, a, tick, channel):
    """`plant.sar_code`, for the board without the analog SID."""
    return plant.sar_code(p, a, tick, channel)

"""The plant as units of machine code: `top.retune`, `top.step` and `top.advance_ticks`.

Apart from the firmware, so that an edit of a block leaves them compiled. The fast engines include `top.advance_ticks`
instead: for them the call would be a few per cent.
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
def advance_ticks(p, a, tick, n, drive_cycle, sense_cycle, edge_count, edges):
    """`plant.advance_ticks`, in place."""
    plant.advance_ticks(p, a, tick, n, drive_cycle, sense_cycle, edge_count, edges)


@unit
def sar_code(p, a, tick, channel):
    """`plant.sar_code`, for the board without the analog SID."""
    return plant.sar_code(p, a, tick, channel)

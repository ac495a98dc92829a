"""Eight plants: a block of ticks, strip by strip; what `top.advance_ticks` is for one.

Source    docs/decisions/0012-lanes.md
"""

from analog_frontend.lanes.side_by_side import STRIP
from analog_frontend.lanes.side_by_side_linear import linear
from analog_frontend.lanes.side_by_side_sid import demodulate, schedule_first_edges
from fpga_model.jit import outlined


@outlined
def advance_lanes(kind, floats, ints, tick, n):
    """`n` ticks of all eight from `tick` on, all of one frame. Mutates both arrays.

    kind  of an effects.Params. v.codes holds what the DACs put out, v.edges the reference edges
    """
    schedule_first_edges(floats, ints)
    for first in range(0, n, STRIP):
        count = min(STRIP, n - first)
        linear(kind, floats, ints, tick, first, count)
        demodulate(floats, ints, tick, first, count)

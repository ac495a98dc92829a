"""Bandwidth and phase of the linear loop over both sense phases: the paper's Fig. 6 b and its bounds.

Source    docs/paper.md
"""

import math

import numpy as np

from testbench.paper.loop import advisor
from testbench.paper.loop import loop as loops
from testbench.paper.loop import loop_parameters as loop_parts


def phased_parameters(config, ye1_deg=0.0, ye2_deg=0.0):
    """Loop parts of a configuration with the sense phases at these angles."""
    return advisor.set_sense_phases(loop_parts.loop_parameters(config), ye1_deg, ye2_deg)


def sense_grid(config, ye1_deg=(-9.0, -4.5, 0.0, 4.5, 9.0), ye2_deg=(-6.0, 0.0, 6.0)):
    """[(ye1, ye2, bandwidth Hz, phase at 10 Hz deg), ...] of the linear loop."""
    rows = []
    for b in ye2_deg:
        for a in ye1_deg:
            closed = loops.close(phased_parameters(config, a, b))
            slow_response, at = loops.response(closed, np.array([0.01, 10.0]))
            rows.append((a, b, advisor.bandwidth(closed)[0], math.degrees(np.angle(np.sign(slow_response.real) * at))))
    return rows


def closed_bandwidth(p):
    """Bandwidth (Hz) of the linear loop of these parts."""
    return advisor.bandwidth(loops.close(p))[0]

"""Phases over temperature from the parts' own laws, and how far a calibration holds.

    xe1, ye1    registers and frames turn with f_d; output poles with their RC (dac_rc_tc_per_k)
    xe2, ye2    ring diode slightly down, op amps up (GBW falls), f_d

A calibration holds as long as every residual stays within the paper's level; the limits are found on a grid of 1 K.
Source    docs/phases.md, docs/paper.md
"""

import math

from analog_frontend.parts import thermal
from testbench.paper.calibration.calibrate_phases import NODES
from testbench.run.budget import budget

LEVEL_DEG = 0.012
GRID_DEGC = tuple(-40.0 + 5.0 * k for k in range(26))


def phases(config, temps_degc=GRID_DEGC):
    """{node: [deg, ...]}: node phases of xe1 and ye1, loop phases of xe2 and ye2, at each temperature."""
    out = {node: [] for node in NODES}
    for temp in temps_degc:
        f = thermal.device_at_temperature(config.device(), temp).fx_hz
        phase_budget = budget(config, temp, f)
        node, loop = phase_budget.node_deg(), phase_budget.loop_deg()
        for name in NODES:
            out[name].append(loop.get(name, node[name]))
    return out


def drift_limits_k(config, temp_degc=25.0, level_deg=LEVEL_DEG, reach_k=80.0):
    """{node: (below, above)}: K by which the temperature may move until a phase has moved by `level_deg`, or inf."""
    start = phases(config, (temp_degc,))
    limits = {node: [] for node in NODES}
    for sign in (-1, 1):
        steps = [k for k in range(1, int(reach_k) + 1) if -55.0 <= temp_degc + sign * k <= 125.0]
        drifted_phases = phases(config, [temp_degc + sign * k for k in steps])
        for node in NODES:
            exceeding = [k for k, value in zip(steps, drifted_phases[node]) if abs(value - start[node][0]) > level_deg]
            limits[node].append(float(exceeding[0]) if exceeding else math.inf)
    return {node: tuple(limit_pair) for node, limit_pair in limits.items()}


def rise_after_s(heating_k, tau_s, band_k):
    """Time after power-on from which the package stays within `band_k` of where it ends (s)."""
    return 0.0 if heating_k <= band_k else tau_s * math.log(heating_k / band_k)

"""Gain and phase margins of a designed rate loop, and their map over bandwidth and split.

    gain margin    least 1 / |L| above 1 where L is real and negative
    phase margin   least |angle(-L)| where |L| = 1

Source  docs/design_of_loops.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.config import changed
from testbench.design import rate_loop_design


class Margins(NamedTuple):
    """Gain margin upwards (dB) and least phase margin (deg) of a loop; infinite where nothing is crossed."""

    gain_db: float
    phase_deg: float


def margins(o, zero_hz, gain):
    """`Margins` of an opened loop, linear between the points of its grid."""
    back = -gain * rate_loop_design.controller(o, zero_hz) * o.word
    size, turn = np.log(np.abs(back)), np.angle(-back)
    k = np.flatnonzero(np.sign(size[1:]) != np.sign(size[:-1]))
    part = size[k] / (size[k] - size[k + 1])
    phase = np.abs(turn[k] + part * np.angle(back[k + 1] / back[k]))
    j = np.flatnonzero((np.sign(turn[1:]) != np.sign(turn[:-1])) & (np.abs(turn[1:] - turn[:-1]) < math.pi))
    share = turn[j] / (turn[j] - turn[j + 1])
    level = size[j] + share * (size[j + 1] - size[j])
    up = -level[level < 0]
    return Margins(
        float(np.min(up) * 20 / math.log(10)) if len(up) else math.inf,
        float(np.degrees(np.min(phase))) if len(phase) else math.inf,
    )


class MarginMap(NamedTuple):
    """Margins of the best loop for each (split, bandwidth); NaN where no loop keeps the peak and is stable."""

    bandwidth_hz: np.ndarray
    split_hz: np.ndarray
    gain_db: np.ndarray  # (split, bandwidth)
    phase_deg: np.ndarray


def margin_map(config, bandwidths_hz, splits_hz, limits, progress=None):
    """`MarginMap` of a board with other splits: each cell is designed, SID capacitor included."""
    shape = len(splits_hz), len(bandwidths_hz)
    out = MarginMap(np.asarray(bandwidths_hz), np.asarray(splits_hz), np.full(shape, np.nan), np.full(shape, np.nan))
    sign = math.copysign(1.0, config.nominal.fx_hz - config.nominal.fy_hz)
    for row, split in enumerate(splits_hz):
        other = changed(config, {"nominal.fy_hz": float(config.nominal.fx_hz - sign * split)})
        bands = rate_loop_design.boards(other, None, *bandwidths_hz)
        for column, bandwidth in enumerate(bandwidths_hz):
            ranked = sorted(rate_loop_design.feasible_points(bands, bandwidth, limits), key=lambda m: -m.modulus)
            m = next((m for m in ranked if rate_loop_design.is_stable(m.board.nominal, m.gain, m.zero_hz)), None)
            if m is not None:
                at = margins(m.board.nominal, m.zero_hz, m.gain)
                out.gain_db[row, column], out.phase_deg[row, column] = at
        if progress:
            progress("margins over bandwidth and split", row + 1, len(splits_hz))
    return out

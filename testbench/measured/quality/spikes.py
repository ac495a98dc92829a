"""Single rows far off their neighbours.

found    |row less its neighbours| > (4 + sqrt(2 ln n)) robust sd of the rows around, the neighbours agree, and all
         but one of the eight rows beside them stay within a third of it: a narrow peak that rings does not
fast     signals less their prediction from rows on either side; what is left has the shape that one row makes
dips     of a power in decibels are nature, unless its noise is below QUIET_DB
sweep    rows of the complex response that no pole explains, resting or moving with its amplitude: see `off_curve`
"""

import numpy as np

from testbench.measured.quality.finding import REPORT, finding
from testbench.measured.quality.rows.off_curve import off_curve
from testbench.measured.quality.rows.series import (
    TAPS,
    largest_expected,
    neighbour_residual,
    prediction,
    rounding_noise,
    running_scale,
)
from testbench.measured.quality.sheet import DB_PER_NEPER, SIGNAL

AGREE = 0.5  # of the row's own distance: how far apart its neighbours may be
ISOLATION_RATIO = 1 / 3
QUIET_DB = 0.1
ALIKE = 0.9  # cosine of the rest and of what one row makes of it
RELATIVE = 1e-6  # of a usual response: the least noise
FEW = 0.01  # of the levels of a converter, which are averaged in blocks


def spike_rows(v, fast=False, dips=False):
    """Mask of the rows that stand out."""
    if fast:
        return _fast_spike_mask(v)
    residual = neighbour_residual(v)
    scale = np.maximum(running_scale(residual), rounding_noise(v))
    out = np.abs(residual) > largest_expected(len(v)) * scale
    midpoint_residual = np.zeros(len(v))
    midpoint_residual[1:-1] = v[1:-1] - (v[:-2] + v[2:]) / 2
    out[1:-1] &= np.abs(v[2:] - v[:-2]) < AGREE * np.abs(midpoint_residual[1:-1])
    out[[0, -1]] = False
    step = np.abs(np.diff(v))
    flank = np.minimum(step[:-3], step[3:])  # a node between two slopes is none
    out[[1, -2]] = False
    out[2:-2] &= flank < AGREE * np.abs(midpoint_residual[2:-2])
    around = np.sort([np.abs(np.roll(midpoint_residual, k)) for k in (-5, -4, -3, -2, 2, 3, 4, 5)], axis=0)
    out &= around[-2] < ISOLATION_RATIO * np.abs(midpoint_residual)
    return out & ~(dips & (midpoint_residual < 0) & (scale > QUIET_DB))


def _fast_spike_mask(v):
    residual, shape = prediction(v)
    out = np.abs(residual) > largest_expected(len(v)) * running_scale(residual)
    norm = np.linalg.norm(shape)
    for row in np.flatnonzero(out):
        piece = residual[max(row - TAPS, 0) : row + TAPS + 1]
        is_complete = len(piece) == len(shape)
        out[row] = is_complete and abs(piece @ shape) > ALIKE * norm * np.linalg.norm(piece)
    return out


def _response_spike_mask(sheet):
    """Mask of the rows of S21 that are off the curve of their neighbours."""
    frequency, size, angle, re, im = (sheet.column(n) for n in ("frequency", "s21", "s21 angle", "s21 re", "s21 im"))
    s = re.values + 1j * im.values
    polar = np.abs(s) * np.hypot(rounding_noise(size.values) / DB_PER_NEPER, np.radians(rounding_noise(angle.values)))
    printed = np.hypot(polar, np.hypot(rounding_noise(re.values), rounding_noise(im.values)))
    return off_curve(frequency.values, s, np.maximum(printed, RELATIVE * np.median(np.abs(s)))) > largest_expected(
        len(s)
    )


def check(sheet):
    """Findings about the signals of a sheet."""
    if sheet.kind == "sweep":
        mask = _response_spike_mask(sheet) if sheet.column("s21") else np.zeros(sheet.rows, bool)
        if mask.any():
            words = f"{np.count_nonzero(mask)} row(s) off every resonance curve through their neighbours"
            yield finding(sheet, "spikes", "s21", mask, words)
        return
    for c in sheet.columns_by_role(SIGNAL):
        mask = spike_rows(sheet.reorder_values(c.course), c.fast, c.unit.startswith("dB"))
        if mask.any():
            rows = sheet.file_rows(np.flatnonzero(mask))
            action = REPORT if sheet.kind == "levels" and len(rows) < FEW * sheet.rows else None
            yield finding(sheet, "spikes", c.name, rows, f"{len(rows)} row(s) far off their neighbours", action)

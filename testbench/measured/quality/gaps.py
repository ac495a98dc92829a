"""Rows that are missing: an axis that is regular but for a few long steps; a signal that is cut in all its columns.

found    step > LONG times the usual one where most steps are alike; or, without an axis, one row from which on
         no fast signal follows from the rows before
"""

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.series import largest_expected, predicted, running_scale
from testbench.measured.quality.sheet import AXIS, SIGNAL

LONG = 1.6
ALIKE, MOST = 0.2, 0.9  # steps within 20 % of the median: 90 % of them at least


def check(sheet):
    """Findings about the axis of a sheet, or about its fast signals."""
    for c in sheet.of(AXIS):
        step = np.diff(c.values)
        usual = np.median(step)
        slack = ALIKE * usual + 1.01 * c.resolution
        if usual <= 0 or np.mean(np.abs(step - usual) <= slack) < MOST:
            continue
        long = step > LONG * usual + 2.02 * c.resolution
        if long.any():
            lost = int(np.round(np.sum(step[long] / usual - 1)))
            words = f"{np.count_nonzero(long)} step(s) of up to {step.max() / usual:.3g} times the usual one"
            yield finding(sheet, "gap", c.name, np.flatnonzero(long) + 1, f"{words}: about {lost} row(s) are missing")
    fast = [c for c in sheet.of(SIGNAL) if c.fast]
    if len(fast) > 1 and not sheet.of(AXIS):
        torn = np.ones(sheet.rows, bool)
        for c in fast:
            rest = predicted(c.values)
            size = np.abs(rest) / running_scale(rest)
            wide = np.maximum.reduce([np.roll(size, k) for k in range(-2, 3)])
            torn &= wide > largest_expected(sheet.rows)
        if torn.any():
            words = "both signals jump at the same row: rows are missing there"
            yield finding(sheet, "gap", ", ".join(c.name for c in fast), torn, words)

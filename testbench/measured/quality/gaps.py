"""Rows that are missing: an axis that is regular but for a few long steps; signals that are cut.

found    step > LONG times the usual one where most steps are alike; or, without an axis, one row from which on
         no fast signal follows from the rows before
"""

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import largest_expected, running_scale
from testbench.measured.quality.sheet import AXIS

LONG = 1.6
PAST, TORN, FEW = 4, 1.2, 10  # rows of the past; of what chance makes; places at most
ALIKE, MOST = 0.2, 0.9  # steps within 20 % of the median: 90 % of them at least


def check(sheet):
    """Findings about the axis of a sheet, or about input and output."""
    for c in sheet.columns_by_role(AXIS):
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
    if sheet.kind == "driven":
        yield from _torn(sheet)


def _torn(sheet):
    """A gap of input and output at once: the output does not follow there from both their pasts, but next to it."""
    u, y = (sheet.column(n).values for n in ("input", "output"))
    lags = [np.roll(y, k) for k in range(1, PAST + 1)] + [np.roll(u, k) for k in range(PAST)]
    a = np.column_stack(lags)[PAST:]
    residual = np.zeros(sheet.rows)
    residual[PAST:] = y[PAST:] - a @ np.linalg.lstsq(a, y[PAST:], rcond=1e-12)[0]
    torn = np.abs(residual) > TORN * largest_expected(sheet.rows) * running_scale(residual)
    gap_rows = np.flatnonzero(torn)
    if len(gap_rows) and 1 + np.count_nonzero(np.diff(gap_rows) > PAST) <= FEW:
        words = "the output does not follow from earlier rows of both signals: rows are missing there"
        yield finding(sheet, "gap", "input, output", gap_rows, words)

"""Points that were not measured but drawn between others: they carry no noise of their own.

on a line   rows exactly between their neighbours (to the print), far more than noise makes, rows or axis counted
by a curve  rows at a regular spacing k from which the rows between follow far better than from any other such rows
            the parts of a complex response together: a peak or a zero may bend one of them so, but not both alike
"""

import numpy as np
from scipy.ndimage import maximum_filter1d

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import grid_step, local_step
from testbench.measured.quality.sheet import AXIS, DB_PER_NEPER, SETTING, SIGNAL

FINE = 30.0  # steps of the print in a second difference, from which on exact lines can be told
REACH = 13  # rows to the knots on either side, where a drawn course bends
LEAST_ROWS, LEAST_SHARE = 8, 0.03
SPACINGS = range(2, 13)
KNOTS = (-3, -2, -1, 0, 1, 2, 3, 4)
FAR_BETTER, BETTER = 0.1, 0.35  # of the rest at the other phases of the same spacing; where a coarse print adds to it
TOGETHER = 0.2  # where two parts bear each other out
SMALLEST, LARGEST, WINDOWS = 260, 1200, 8  # rows that are looked at for curves, and how often
AGREEING = 2  # windows at least
QUANTILES = (0.5, 0.9)  # of the rest: peaks make either of them differ between phases, a curve that was drawn both


def on_a_line(v, x, resolution):
    """Mask of rows between their neighbours to the resolution; all False where it cannot be told."""
    tol = np.full(len(v) - 2, 2.5 * max(resolution, 4 * np.finfo(float).eps * np.max(np.abs(v))))
    if np.any(np.diff(v) == 0):  # ties are those of a grid, of one that floats where there is none for all
        tol = np.maximum(tol, 2.5 * local_step(v)[1:-1])
    out = np.zeros(len(v), bool)
    neighbours_differ = (np.diff(v)[1:] != 0) & (np.diff(v)[:-1] != 0)
    for weight in _weights(x, len(v)):
        bend = np.abs(v[1:-1] - (1 - weight) * v[:-2] - weight * v[2:])
        # between bends that are not far above the print, on both sides, an exact line says nothing
        before, after = (maximum_filter1d(bend, REACH, origin=o, mode="nearest") for o in (REACH // 2, -(REACH // 2)))
        usable = np.minimum(before, after) > FINE * tol / 2.5
        exact, other = (bend <= tol) & neighbours_differ & usable, (bend > tol) & usable
        if np.count_nonzero(other) < LEAST_ROWS:
            continue
        chance = np.mean(bend[other] < 3 * tol[other]) / 2  # of falling into a band as wide beside it
        share = np.count_nonzero(exact) / np.count_nonzero(usable)
        if share > LEAST_SHARE + 3 * chance and np.count_nonzero(exact) >= LEAST_ROWS:
            out[1:-1] |= exact
    return out


def _weights(x, n):
    yield np.full(n - 2, 0.5)
    if x is not None and np.all(np.diff(x) > 0):
        yield (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])


def spacing(parts, step=0.0, far_better=FAR_BETTER):
    """Spacing k of rows from which all others follow, in AGREEING windows; 0: none.

    parts (c, n): columns that would have been drawn alike        step: of the print
    """
    parts = np.atleast_2d(parts)
    n = parts.shape[1]
    size = min(LARGEST, max(SMALLEST, n // 4))
    starts = np.linspace(0, max(n - size, 0), WINDOWS).astype(int)
    windows = (parts[:, a : a + size] for a in starts)
    window_spacings = [_spacing(v - v.mean(axis=1, keepdims=True), step, far_better) for v in windows]
    k = max((j for j in window_spacings if j), key=window_spacings.count, default=0)
    return k if window_spacings.count(k) >= AGREEING else 0


def _spacing(v, step, far_better):
    for k in SPACINGS:
        if v.shape[1] < 26 * k + 40:
            break
        residual_quantiles = np.array([_knot_residual_quantiles(v, k, phase) for phase in range(k)])
        best = np.argmin(residual_quantiles[:, 0])
        other_quantiles = np.median(np.delete(residual_quantiles, best, axis=0), axis=0)
        limit = np.maximum(far_better * other_quantiles, np.minimum(BETTER * other_quantiles, 0.6 * step))
        if other_quantiles[0] > 1e-9 * np.std(v) and np.all(residual_quantiles[best] < limit):
            return k
    return 0


def _knot_residual_quantiles(v, k, phase):
    """QUANTILES of what rows between the knots phase, phase + k, .. have beside their best prediction from eight."""
    at = np.arange(phase + 3 * k, v.shape[1] - 5 * k, k)
    knots = np.column_stack([v[:, at + j * k].ravel() for j in KNOTS])
    between = np.column_stack([v[:, at + j].ravel() for j in range(1, k)])
    residual = between - knots @ np.linalg.lstsq(knots, between, rcond=1e-10)[0]
    return np.quantile(np.abs(residual), QUANTILES)


def check(sheet):
    """Findings about the signals of a sheet."""
    axis = next(iter(sheet.columns_by_role(AXIS, SETTING)), None)
    for c in sheet.columns_by_role(SIGNAL):
        grid = grid_step(c.values)
        courses = [(c.course, None if axis is None else axis.values, None)]
        if sheet.order is not None:
            courses.append((sheet.reorder_values(c.course), sheet.reorder_values(axis.values), sheet.order))
        for v, x, order in courses:
            mask = on_a_line(v, x, max(grid, c.resolution))
            if mask.any():
                rows = np.flatnonzero(mask) if order is None else order[mask]
                words = "rows lie exactly between their neighbours: interpolated, not measured"
                yield finding(sheet, "interpolated", c.name, rows, words)
                break
            k = spacing(v, grid) if sheet.kind != "sweep" else 0
            if k:
                yield _by_curve(sheet, c.name, k)
                break
    if sheet.kind == "sweep" and sheet.column("s21"):
        yield from _check_response(sheet)


def _by_curve(sheet, name, k):
    words = f"all rows follow from every {k}th row: interpolated, not measured"
    return finding(sheet, "interpolated", name, np.arange(sheet.rows) % k != 0, words)


def _check_response(sheet):
    size, angle, re, im = (sheet.column(n).values for n in ("s21", "s21 angle", "s21 re", "s21 im"))
    k = spacing([re, im], far_better=TOGETHER) or spacing([size / DB_PER_NEPER, np.unwrap(np.radians(angle))])
    if k:
        yield _by_curve(sheet, "s21", k)

"""A signal that stands still: a run of equal values longer than its grid and noise make by chance.

found    run of L equal rows, n p^(L-1) < CHANCE, p the share of equal neighbours outside the longest run
print    a run whose neighbours move by single steps of the grid is a flat course in a coarse print
"""

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import grid_step
from testbench.measured.quality.sheet import SIGNAL

CHANCE = 1e-6
BESIDE = 5  # changes on either side
SHORTEST = 4  # rows: two equal ones are a duplicate


def runs(v):
    """(first row, length) of every run of equal values of two rows or more."""
    same = np.concatenate([[False], v[1:] == v[:-1], [False]]).astype(int)
    change = np.diff(same)
    first, last = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return first, last - first + 1


def stuck_rows(v):
    """Mask of the rows of runs that chance does not make."""
    first, length = runs(v)
    mask = np.zeros(len(v), bool)
    if not len(length):
        return mask
    short = length[length < max(SHORTEST, np.max(length))]
    step, grid = np.abs(np.diff(v)), grid_step(v)
    p = max((np.sum(short - 1) + 1) / len(v), 1e-4)
    least = max(SHORTEST, 1 + int(np.ceil(np.log(CHANCE / len(v)) / np.log(p)))) if p < 0.9 else len(v)
    for a, count in zip(first, length):
        if count >= least:
            beside = np.concatenate([step[max(a - BESIDE, 0) : a], step[a + count - 1 : a + count - 1 + BESIDE]])
            mask[a : a + count] = len(beside) == 0 or np.max(beside) > 1.5 * grid
    return mask


def check(sheet):
    """Findings about the signals of a sheet; equal values at the extreme are the business of `clipped`."""
    for c in sheet.of(SIGNAL):
        v = c.values
        mask = stuck_rows(v) & (v != v.max()) & (v != v.min())
        if mask.any():
            yield finding(sheet, "stuck", c.name, mask, "stands still while other rows move")

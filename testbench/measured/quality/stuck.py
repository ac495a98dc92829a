"""A signal that stands still: a run of equal values longer than its grid and noise make by chance.

found    run of L equal rows, n p^(L-1) < CHANCE, p the share of equal neighbours outside it and outside flat courses
print    a run that a smooth course makes in steps coarser than its noise is none
"""

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import grid_step, noise_sd
from testbench.measured.quality.sheet import SIGNAL

CHANCE = 1e-6
NEIGHBOUR_CHANGES = 5  # changes on either side
LEVEL = 3  # times shorter at most is the next level of a plateau, one step away
SHORTEST = 4  # rows: two equal ones are a duplicate


def runs(v):
    """(first row, length) of every run of equal values of two rows or more."""
    is_repeat = np.concatenate([[False], v[1:] == v[:-1], [False]]).astype(int)
    change = np.diff(is_repeat)
    first, last = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return first, last - first + 1


def flat_rows(v):
    """Mask of runs, single rows too, that a smooth course makes in steps of a grid coarser than its noise.

    Beside them v gains pace by no more than a step per row and a parabola's that stays within one step on the run,
    or the next level is as long.
    """
    grid = grid_step(v)
    if grid <= noise_sd(v):
        return np.zeros(len(v), bool)
    first = np.concatenate([[0], np.flatnonzero(np.diff(v)) + 1])
    length = np.diff(first, append=len(v))
    step, out = np.pad(np.abs(np.diff(v)), NEIGHBOUR_CHANGES), length < len(v)
    for away in range(1, NEIGHBOUR_CHANGES + 1):
        most = grid * (0.5 + away + 8 * (length / 2 + away) / np.maximum(length - 1, 1) ** 2)
        out &= (
            np.maximum(step[NEIGHBOUR_CHANGES + first - away], step[NEIGHBOUR_CHANGES + first + length - 2 + away])
            <= most
        )
    joined = np.concatenate(
        [[False], step[NEIGHBOUR_CHANGES + first[1:] - 1] <= 1.5 * grid, [False]]
    )  # to the level before
    neighbour_run_length = np.maximum(joined[:-1] * np.roll(length, 1), joined[1:] * np.roll(length, -1))
    return np.repeat(out | (LEVEL * neighbour_run_length >= length), length)


def stuck_rows(v):
    """Mask of the rows of runs that chance does not make."""
    first, length = runs(v)
    mask = np.zeros(len(v), bool)
    if not len(length):
        return mask
    flat = flat_rows(v)
    short = length[(length < max(SHORTEST, np.max(length))) & ~flat[first]]
    p = max((np.sum(short - 1) + 1) / len(v), 1e-4)
    least = max(SHORTEST, 1 + int(np.ceil(np.log(CHANCE / len(v)) / np.log(p)))) if p < 0.9 else len(v)
    for a, count in zip(first, length):
        mask[a : a + count] = count >= least
    return mask & ~flat


def check(sheet):
    """Findings about the signals of a sheet; equal values at the extreme are the business of `clipped`."""
    for c in sheet.columns_by_role(SIGNAL):
        v = c.unwrapped_values
        mask = stuck_rows(v) & (v != v.max()) & (v != v.min())
        if mask.any():
            yield finding(sheet, "stuck", c.name, mask, "is constant here while other rows change")

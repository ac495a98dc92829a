"""Rows that are there twice: whole rows, neighbours, or a block that comes again somewhere else.

row        equal in every column, the axis too
neighbour  equal to the row before in every signal, more often than grid and noise make
block      W rows, all signals, found again to the last bit; W so that chance makes none in the whole recording
"""

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import ties_expected
from testbench.measured.quality.sheet import AXIS, OTHER, SIGNAL
from testbench.measured.quality.stuck import stuck_rows

CHANCE = 1e-4
LONGEST = 64
PAIRS = 4


def _bits(columns):
    """(n, c) of the columns' bits; -0 and 0 are the same."""
    table = np.column_stack([np.asarray(c, float) for c in columns]) + 0.0
    return np.ascontiguousarray(table).view(np.uint64)


def _again(bits, length):
    """Mask of windows of `length` rows that were there before."""
    rng = np.random.default_rng(0)
    count = len(bits) - length + 1
    total = np.zeros(count, np.uint64)
    for k in range(length):
        for column in range(bits.shape[1]):
            odd = np.uint64(int(rng.integers(1 << 62)) * 2 + 1)
            word = bits[k : k + count, column]
            total += (word ^ (word >> np.uint64(29))) * odd
    order = np.argsort(total, kind="stable")
    is_repeated = np.zeros(count, bool)
    is_repeated[order[1:]] = total[order[1:]] == total[order[:-1]]
    return is_repeated


def repeated_rows(columns):
    """Indices of rows that were there before, equal in every column."""
    return np.flatnonzero(_again(_bits([c.values for c in columns]), 1))


def _chance(sheet, signals):
    """Chance that one row equals another by grid and noise alone; the parts of a response are flat together."""
    p = [min(1.0, ties_expected(v) / len(v)) for v in signals]
    return max(min(p) if sheet.kind == "sweep" else float(np.prod(p)), 1e-12)


def check(sheet):
    """Findings about a sheet; what stands still is the business of `stuck`."""
    signals = [c.unwrapped_values for c in sheet.columns_by_role(SIGNAL)]
    axis = [c.values for c in sheet.columns_by_role(AXIS)]
    name = ", ".join(c.name for c in sheet.columns_by_role(SIGNAL)[:3])
    still = np.any([stuck_rows(v) for v in signals], axis=0)
    bits, n, p = _bits([c.values for c in sheet.columns_by_role(SIGNAL)]), sheet.rows, _chance(sheet, signals)
    pairs = np.concatenate([[False], np.all(bits[1:] == bits[:-1], axis=1)]) & ~still
    twin_rows = repeated_rows([c for c in sheet.columns if c.role != OTHER]) if axis else ()
    ties = n - len(np.unique(axis[0])) if axis else 0
    if len(twin_rows) and (len(twin_rows) == ties or len(twin_rows) > PAIRS + 3 * n * p):
        yield finding(sheet, "duplicated", name, twin_rows, "duplicate rows, equal in every column")
        return
    if pairs.sum() >= PAIRS + 3 * n * p:
        yield finding(sheet, "duplicated", name, pairs, "rows equal to the row before")
        return
    length = int(np.ceil(np.log(2 * CHANCE / n**2) / np.log(p))) if p < 1 else LONGEST + 1
    if length <= min(LONGEST, n // 4):
        is_repeated = _again(bits, max(length, 3))
        change_counts = np.concatenate([[0], np.cumsum(np.any(bits[1:] != bits[:-1], axis=1))])
        # a flat course is none
        is_repeated &= (
            change_counts[max(length, 3) - 1 :] - change_counts[: len(is_repeated)] >= (max(length, 3) - 1) / 2
        )
        is_repeated &= ~np.any(
            [still[k : len(still) - max(length, 3) + 1 + k] for k in (0, max(length, 3) - 1)], axis=0
        )
        if is_repeated.any():
            rows = np.unique(np.flatnonzero(is_repeated)[:, None] + np.arange(max(length, 3)))
            yield finding(sheet, "duplicated", name, rows, "a block of rows repeats an earlier block exactly")

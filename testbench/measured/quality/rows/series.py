"""What the checks share: the grid that values lie on, their noise, and what a row has beside its neighbours.

grid_step(v)            step of the grid on which all values lie; 0: they lie on none coarser than their numbers
neighbour_residual(v)   each value less the median of its four neighbours: trends go, single rows stay
prediction_residual(v)  each value less its best linear prediction from TAPS rows on both sides: fast signals go, too
noise_sd(v)             robust standard deviation of that
running_measure(v, ..)  a measure of the rows around each row
rounding_noise(v)       noise that the grid alone makes: step / sqrt(12)
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

TAPS = 8
MOST_FITTED = 5_000
MOST_STEPS = 300  # between values that a grid is found from; all values must lie on it
HALF = 40  # rows on either side that give a scale
PACE_WINDOW_ROWS = 11  # changes around a row: how fast it moves there
SURE = 4.0  # robust sd beyond the largest of as many normal values


def grid_step(v):
    """Step of the coarsest grid through all values, to their own precision; 0: none."""
    distinct = np.unique(np.asarray(v, float))
    if len(distinct) < 2:
        return 0.0
    error = np.finfo(float).eps * np.max(np.abs(distinct))
    printed = _decimal(distinct, error)
    return max(_estimate_grid_step(distinct, error), _estimate_grid_step(distinct, max(error, 0.6 * printed)), printed)


def _fits(distinct, step, error):
    return np.max(np.abs(distinct - step * np.round(distinct / step))) < 3 * error


def _decimal(distinct, error):
    """Last decimal place of numbers that were printed with a fixed one; 0: none."""
    exponents = range(3, -16, -1)
    return next((10.0**k for k in exponents if 10.0**k > 30 * error and _fits(distinct, 10.0**k, error)), 0.0)


def _estimate_grid_step(distinct, error):
    step_estimate, its, steps = 0.0, error, np.diff(distinct)
    steps = steps[steps > 3 * error]
    if not len(steps):
        return 0.0
    steps = steps[:: max(1, len(steps) // MOST_STEPS)]
    small = np.diff(np.sort(steps))  # steps differ by few of the grid, so that their errors stay small
    for step in (*small[small > 6 * error], *steps):
        step_estimate, its = _common((step_estimate, its), (float(step), error))
        if step_estimate < 30 * its or step_estimate < 100 * error:
            return 0.0
    span = distinct - distinct[0]
    for end in np.geomspace(1, len(distinct) - 1, 30).astype(int):  # many steps add up the error of one
        if span[end] > step_estimate / 2:
            step_estimate = span[end] / round(span[end] / step_estimate)
    return float(step_estimate) if _fits(span, step_estimate, error) else 0.0


def _common(a, b):
    """Largest number of which both are multiples, and its error; each is (number, error)   (Euclid)."""
    a, b = max(a, b), min(a, b)
    while b[0] > 3 * b[1]:
        times = round(a[0] / b[0])
        a, b = b, (abs(a[0] - times * b[0]), a[1] + times * b[1])
    return a


def rounding_noise(v):
    """Noise (rms) that the column's own grid makes."""
    return grid_step(v) / np.sqrt(12.0)


def neighbour_residual(v):
    """(n,) each value less the median of the two before and the two behind it; the ends use what there is."""
    padded = np.concatenate([v[2:0:-1], v, v[-2:-4:-1]])
    around = np.stack([padded[k : k + len(v)] for k in (0, 1, 3, 4)])
    return v - np.median(around, axis=0)


def prediction_residual(v):
    """(n,) each value less its least-squares prediction from TAPS rows on either side; 0 at the ends."""
    return prediction(v)[0]


def prediction(v):
    """(rest as of `prediction_residual`, weights (2 TAPS + 1,) by which a row itself shows in the rest around it)."""
    n = len(v)
    if n < 16 * TAPS:
        return neighbour_residual(v), np.concatenate([np.zeros(TAPS), [1.0], np.zeros(TAPS)])
    out, x = np.zeros(n), v - np.mean(v)
    offsets = [k for k in range(-TAPS, TAPS + 1) if k]
    at = np.arange(TAPS, n - TAPS)
    sample = at[:: max(1, len(at) // MOST_FITTED)]
    used = np.ones(len(sample), bool)
    for _ in range(3):  # rows that do not fit are left out, so that they do not bend the prediction
        a = np.column_stack([x[sample + k] for k in offsets])
        c = np.linalg.lstsq(a[used], x[sample][used], rcond=1e-10)[0]
        residual = x[sample] - a @ c
        bad = np.abs(residual) > 6 * robust(residual[used])
        if bad.mean() > 0.5:
            break
        used = ~bad
    shape = np.concatenate([-c[:TAPS], [1.0], -c[TAPS:]])
    out[at] = np.convolve(x, shape[::-1], "valid")
    return out, shape[::-1]


def robust(v):
    """Standard deviation of most values, by the median of their magnitudes."""
    return float(np.median(np.abs(v)) / 0.6745)


def noise_sd(v, fast=False):
    """Robust sd of what a row has beside its neighbours, for one row."""
    return robust(prediction_residual(v)) if fast else robust(neighbour_residual(v)) / np.sqrt(1.25)


def running_measure(v, measure, half=HALF):
    """(n,) `measure` of the values around each row."""
    n = len(v)
    half = max(half, n // 200)
    window_rows = 2 * half + 1
    if n <= window_rows:
        return np.full(n, measure(v))
    centres = np.unique(np.clip(np.arange(half, n + half, half), half, n - half - 1))
    return np.interp(np.arange(n), centres, [measure(v[c - half : c + half + 1]) for c in centres])


def running_scale(v, half=HALF):
    """(n,) robust sd of the values around each row, at least a tenth of that of all."""
    scale, least = running_measure(v, robust, half), max(0.1 * robust(v), 1e-300)
    # where noise begins or ends, the larger side counts
    sides = [np.roll(scale, k) for k in (-min(half, len(v) // 2), 0, min(half, len(v) // 2))]
    return np.maximum(np.maximum.reduce(sides), least)


def local_step(v):
    """(n,) smallest change between neighbours around each row: what the digits of a floating grid leave."""
    change, rounding = np.abs(np.diff(v, append=v[-1])), 8 * np.finfo(float).eps * np.max(np.abs(v))
    return running_measure(change, lambda x: np.min(x[x > rounding], initial=np.ptp(v)))


def ties_expected(v):
    """How many rows equal the one before by grid and noise alone."""
    change = np.abs(np.diff(v))
    step = grid_step(v)
    if np.any(change == 0):  # ties are those of a grid, of one that floats where there is none for all
        step = np.maximum(step, local_step(v)[:-1])
    step = np.maximum(step, 1e-6 * running_scale(change))
    pace_in_steps = (
        uniform_filter1d(change, PACE_WINDOW_ROWS, mode="nearest") / step
    )  # of steps; of noise, or of a slow course
    p = np.maximum.reduce(
        [1 - pace_in_steps, 1 / (3.1 * np.maximum(pace_in_steps, 0.1)), step / (3.5 * running_scale(change))]
    )
    return float(np.sum(np.minimum(1.0, p)))


def largest_expected(count):
    """Robust sd that no value of `count` normal ones exceeds."""
    return SURE + np.sqrt(2 * np.log(max(count, 2)))

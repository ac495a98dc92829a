"""What of a recorded power is a free decay, what stands beside it, and what its noise is.

    stretch     the largest fall of the smoothed power: it ends where the power rises by more than its own scatter
                above its lowest value so far, or jumps; a level that stands before or behind it is left out
    background  mean power that stands behind the fall, or before the first jump of the record
    noise       `models.noise`: white, and coloured of variance c + d / P (dB^2), as of a background beside the signal;
                from what a spline over the fall leaves
Source    docs/measured_results.md
"""

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import median_filter

from testbench.measured.models.row_noise import likeliest

STEP_DB, MOST_STEP_DB, JUMP_DB = 0.5, 1.5, 6.0
SHARE, NARROW = 100, 9  # width of the running median: a share of the record, at least so many samples
FLAT = 3.0  # an end that takes so many times as long as the same fall before it is none
HEAD, CORNERS = 8, 200  # fall in which the corner is looked for, in rises, and places
SURE = 25.0  # of chi2, by which a later corner may be worse: five sigmas of its place
STILL = 0.3  # of the first half's fall: an end of a record that falls less is at its background
TAIL, LEAST_SAMPLES_AFTER, LEAST_SAMPLES_BEFORE = (
    5,
    30,
    60,
)  # share of a record that is its end; samples that a background needs
KNOTS = 8  # of the smooth curve
LEAST_NOISE_DB = 1e-6
DB = 10.0 / np.log(10.0)


def median_filter_width(p):
    """Samples of the running median."""
    return max(NARROW, len(p) // SHARE) | 1


def running_median(p):
    """Running median: dips of a background that fades go, steps stay."""
    return median_filter(p, median_filter_width(p), mode="nearest")


def _rise(smooth, width):
    """By how much (dB) the smoothed power may rise for its scatter's sake: second differences, before and behind.

    The smaller of both counts: what beats before a decay begins is no scatter of the decay.
    """
    lag = 2 * width
    if len(smooth) < 6 * lag:
        return np.full(len(smooth), STEP_DB)
    bend = np.abs(smooth[2 * lag :] - 2 * smooth[lag:-lag] + smooth[: -2 * lag]) / np.sqrt(6)
    size = 4 * lag + 1
    sides = [median_filter(bend, size, mode="nearest", origin=o) for o in (-(size // 2), size // 2)]
    local = np.pad(np.minimum(*sides) / 0.6745, lag, mode="edge")
    return np.clip(4 * local, STEP_DB, MOST_STEP_DB)


def jumps(p):
    """Places at which the power jumps by JUMP_DB from one sample to the next, and stays there."""
    smooth, width = running_median(p), 3 * median_filter_width(p)
    at = np.flatnonzero(np.abs(np.diff(smooth)) > JUMP_DB) + 1
    jump_sizes_db = [abs(np.median(p[i : i + width]) - np.median(p[max(i - width, 0) : i])) for i in at]
    return at[np.array(jump_sizes_db) > JUMP_DB] if len(at) else at


def stretch(p):
    """(first, end) of the decay; (0, 0) if nothing falls."""
    smooth, best, first, least = running_median(p), (0.0, 0, 0), 0, 0
    rise = _rise(smooth, median_filter_width(p))
    jump_rows = set(jumps(p).tolist())
    for i in range(1, len(p)):
        if i in jump_rows or smooth[i] > smooth[least] + rise[i]:
            first = least = i
        elif smooth[i] < smooth[least]:
            least = i
        if smooth[i] >= smooth[first]:
            first = least = i
        best = max(best, (smooth[first] - smooth[least], first, least))
    fall, first, least = best
    if fall == 0.0:
        return 0, 0
    head = first + int(np.argmax(smooth[first : least + 1] < smooth[first] - HEAD * rise[first]))
    last = [first + int(np.argmax(smooth[first : least + 1] <= smooth[least] + k * rise[least])) for k in (1, 2)]
    flat = least - last[0] > FLAT * (last[0] - last[1])
    return first + _corner(p[first : max(head, first + NARROW)]), (last[0] if flat else least) + 1


def _corner(p):
    """Samples that may stand at one level before a straight fall begins: the latest corner that is not worse."""
    k, costs = np.arange(len(p), dtype=float), []
    corner_rows = np.unique(np.linspace(0, len(p) - NARROW // 2, CORNERS).astype(int))
    for at in corner_rows:
        a = np.column_stack([np.ones(len(p)), np.maximum(k - at, 0.0)])
        residual = p - a @ np.linalg.lstsq(a, p, rcond=None)[0]
        costs.append(float(residual @ residual))
    return int(corner_rows[np.flatnonzero(np.array(costs) <= min(costs) * (1 + SURE / len(p)))[-1]])


def background(p):
    """Power (dBm) that stands in a record beside its decay: behind it up to a jump, or before it; None if neither does.

    What is short (LEAST_SAMPLES_AFTER samples behind, LEAST_SAMPLES_BEFORE before, where an earlier decay may still
    ring) or still falls is none.
    """
    smooth, (a, b) = running_median(p), stretch(p)
    if b - a < LEAST_SAMPLES_AFTER:
        return None
    ends = jumps(p)
    last = next((int(e) for e in ends if e >= b + 5), len(p))
    first = next((int(e) for e in ends if e < a), 0)
    pieces, samples_after, tail = (
        [],
        p[b + 5 : last],
        p[max(a, last - max((last - a) // TAIL, LEAST_SAMPLES_AFTER)) : last],
    )
    half = a + int(np.argmax(smooth[a:b] < (smooth[a] + smooth[b - 1]) / 2))
    usual = (smooth[a] - smooth[half]) / max(half - a, 1) * len(tail) / 2
    if len(samples_after) >= LEAST_SAMPLES_AFTER and abs(_fall(samples_after)) < JUMP_DB:
        pieces.append(samples_after)
    elif _fall(tail) < STILL * usual:
        pieces.append(p[a + int(np.argmax(smooth[a:last] < np.median(tail) + JUMP_DB / 2)) : last])
    if first >= LEAST_SAMPLES_BEFORE and abs(_fall(p[:first])) < JUMP_DB:
        pieces.append(p[:first])
    return min((float(10 * np.log10(np.mean(10 ** (piece / 10)))) for piece in pieces), default=None)


def _fall(p):
    """From the first to the second half (dB)."""
    return float(np.median(p[: len(p) // 2]) - np.median(p[len(p) // 2 :]))


def _spline(t, p):
    """Cubic splines over the fall, (n, KNOTS + 3): knots at equal shares of its dB."""
    fall = np.maximum.accumulate(running_median(p)[0] - running_median(p)) + 1e-9 * np.arange(len(p))
    inner = np.interp(np.linspace(0, fall[-1], KNOTS + 1)[1:-1], fall, t)
    knots = np.concatenate([np.full(4, t[0]), np.unique(inner), np.full(4, t[-1])])
    return BSpline.design_matrix(np.clip(t, t[0], t[-1]), knots, 3).toarray()


def noise(t, p):
    """`Noise` of all rows of a decay (s, dBm): level over power and colour; None if it has none."""
    a = _spline(t, p)
    smooth = a @ np.linalg.lstsq(a, p, rcond=None)[0]
    return likeliest(p, a, 10 ** ((smooth[-1] - smooth) / 10)) if np.std(p - smooth) > LEAST_NOISE_DB else None

"""Columns in each other's place, where physics or their digits can tell.

meters    the source has finer digits than its reading; the room follows the source, and the reading does not
driven    the gain from output to input has a peak and falls beyond it: that is the resonator, the other way round
sweep     S11 has the peak that S21 lacks; decibels that are angles
"""

import numpy as np
from scipy.signal import csd, welch

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import grid_step
from testbench.measured.quality.sheet import SETTING, SIGNAL, SLOW

MEASURED = 2e-8  # of the range: steps of what was measured; a source is programmed in coarser ones
COHERENT = 0.7
PASSIVE_DB = 40.0


def _check_swapped_meters(sheet):
    (source,) = sheet.columns_by_role(SETTING)
    step = grid_step(source.values)
    for c in sheet.columns_by_role(SIGNAL):
        other = grid_step(c.values)
        if step < MEASURED * np.ptp(source.values) and step < 0.11 * other:
            words = (
                f"{source.name} has steps of {step:.3g} V, {c.name} of {other:.3g} V: the source seems to be a reading"
            )
            yield finding(sheet, "swapped", f"{source.name}, {c.name}", None, words)
        follows = [e.name for e in sheet.columns_by_role(SLOW) if _alike(e.values, source.values) > 0.999]
        if follows and _alike(c.values, source.values) < 0.9:
            words = f"{follows[0]} follows the source, {c.name} does not"
            yield finding(sheet, "swapped", f"{follows[0]}, {c.name}", None, words)


def _alike(a, b):
    return abs(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0 and np.ptp(b) > 0 else 0.0


def gain(u, y, length=1024):
    """(|H|^2, coherent) over frequency of output y over input u."""
    length = min(length, len(u) // 4)
    _, puu = welch(u, nperseg=length)
    _, pyy = welch(y, nperseg=length)
    _, puy = csd(u, y, nperseg=length)
    size = np.abs(puy) ** 2
    coherent = size > COHERENT * puu * pyy
    coherent[:2] = False
    return size / np.maximum(puu, 1e-300) ** 2, coherent


def _resonates(u, y):
    """True if the gain from u to y has a peak and falls beyond it; False too where they have little in common."""
    h, used = gain(u, y)
    at = np.flatnonzero(used)
    if len(at) < 16:
        return False
    quarter = len(at) // 4
    low, high = np.median(h[at[:quarter]]), np.median(h[at[-quarter:]])
    return high < 0.5 * low and np.max(h[at]) > 1.4 * low


def _check_swapped_driven(sheet):
    u, y = (sheet.column(n).values for n in ("input", "output"))
    if _resonates(y, u) and not _resonates(u, y):
        words = "the gain from output to input has a resonance peak, that from input to output has none"
        yield finding(sheet, "swapped", "input, output", None, words)


def _peak(v):
    return (np.max(v) - np.median(v)) / max(np.median(v), 1e-300)


def _check_swapped_sweep(sheet):
    s21, s11 = (sheet.column(n) for n in ("s21", "s11"))
    if np.max(s21.values) > PASSIVE_DB:
        words = f"decibels up to {np.max(s21.values):.3g}: these are angles, or the part is not passive"
        yield finding(sheet, "swapped", "s21, s21 angle", None, words)
    elif s11 is not None:
        a, b = (_peak(10 ** (c.values / 20)) for c in (s21, s11))
        if b > 1.0 and a < 0.3 * b:
            yield finding(sheet, "swapped", "s11, s21", None, "s11 has the peak of a transmission, s21 has none")


RULES = {"meters": _check_swapped_meters, "driven": _check_swapped_driven, "sweep": _check_swapped_sweep}


def check(sheet):
    """Findings about a sheet."""
    return list(RULES[sheet.kind](sheet)) if sheet.kind in RULES else []

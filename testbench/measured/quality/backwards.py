"""Rows in the reverse order, where the axis or physics can tell.

axis       time or frequency falls (`rising_order` is what loaders ask)
ring-down  power grows as a free decay falls               meters   readings fall as their source rises
levels     volts fall as the code rises                    driven   the output comes before its input
"""

import numpy as np

from testbench.measured.quality.duplicated import repeated_rows
from testbench.measured.quality.finding import CORRECT, QualityError, finding
from testbench.measured.quality.sheet import SETTING, SIGNAL
from testbench.measured.quality.swapped import gain

LEAST_DB = 6.0
GROWTH = 3.0  # rise over fall, and before over after
REACH = 128  # rows: an input of few lines gives an answer that comes again


def rising_order(sheet, strictly, correct):
    """(order (n,) in which the first column rises, findings); (None, ()) where it does; QualityError if it never does.

    strictly   True: no two rows may stand at one place        correct   False: rows in reverse order are refused
    """
    axis, other = sheet.columns[0], sheet.columns[-1]
    step = np.diff(axis.values)
    if np.all(step > 0) or (not strictly and np.all(step >= 0)):
        return None, ()
    if np.all(step < 0) or (not strictly and np.all(step <= 0)):
        words = f"{axis.name} falls in every row"
        reversal_finding = finding(sheet, "reversed", axis.name, None, words, CORRECT if correct else None)
        if not correct:
            raise QualityError([reversal_finding])
        return np.arange(sheet.rows)[::-1], (reversal_finding,)
    back = np.flatnonzero(step < 0) + 1
    if len(back) and np.all(np.diff(other.values) >= 0) and np.ptp(other.values) > 0:
        words = f"{axis.name} falls and {other.name} rises in every row"
        raise QualityError([finding(sheet, "swapped", f"{axis.name}, {other.name}", None, words)])
    again = repeated_rows(sheet.columns)
    if len(again):
        raise QualityError([finding(sheet, "duplicated", axis.name, again, "duplicate rows")])
    if len(back):
        words = f"{axis.name} falls, first in row {back[0] + 1}: rows are out of order"
        raise QualityError([finding(sheet, "reversed", axis.name, back, words)])
    still = np.flatnonzero(step == 0) + 1
    raise QualityError(
        [finding(sheet, "stuck", axis.name, still, f"{axis.name} repeats a value while other columns change")]
    )


def _check_reversed_ringdown(sheet):
    p = sheet.column("power").values
    span = max(len(p) // 40, 2)
    smooth = np.array([np.median(p[k : k + span]) for k in range(0, len(p) - span + 1, span)])
    change = np.diff(smooth)
    jump = np.abs(change) > 0.25 * np.ptp(smooth)
    fall, rise = -np.sum(change[(change < 0) & ~jump]), np.sum(change[(change > 0) & ~jump])
    ends = np.argmax(smooth) >= len(smooth) - 2 and smooth[-1] - smooth[0] > LEAST_DB
    if ends or (rise > GROWTH * fall and rise > LEAST_DB):
        yield finding(
            sheet, "reversed", "power", None, f"rises by {rise:.3g} dB and falls by {fall:.3g} dB: not a decay"
        )


def _check_reversed_meters(sheet):
    (source,) = sheet.columns_by_role(SETTING)
    for c in sheet.columns_by_role(SIGNAL):
        slope = np.polyfit(source.values, c.values, 1)[0]
        back = np.polyfit(source.values[::-1], c.values, 1)[0]
        if slope < -0.8 or (abs(slope) < 0.5 and abs(back - 1) < 0.1):
            yield finding(sheet, "reversed", c.name, None, "readings fall while their source rises")


def _check_reversed_levels(sheet):
    for c in sheet.columns_by_role(SIGNAL):
        if np.polyfit(np.arange(sheet.rows), c.values, 1)[0] < 0:
            yield finding(sheet, "reversed", c.name, None, "volts fall as the code rises")


def _check_reversed_driven(sheet):
    u, y = (sheet.column(n).values for n in ("input", "output"))
    _, used = gain(u, y)
    if np.count_nonzero(used) < 16:
        return
    n = 1 << int(np.log2(min(len(u), 1 << 15)))
    a, b = (np.fft.rfft((v[:n] - v[:n].mean()) * np.hanning(n)) for v in (u, y))
    power = np.abs(a) ** 2
    h = np.fft.irfft(b * np.conj(a) / (power + 1e-3 * np.mean(power)))
    after, before = np.sum(h[1:REACH] ** 2), np.sum(h[-REACH:] ** 2)
    if before > GROWTH * after:
        yield finding(sheet, "reversed", "input, output", None, "the output comes before its input")


RULES = {"ringdown": _check_reversed_ringdown, "meters": _check_reversed_meters}
RULES |= {"levels": _check_reversed_levels, "driven": _check_reversed_driven}


def check(sheet):
    """Findings about a sheet."""
    return list(RULES[sheet.kind](sheet)) if sheet.kind in RULES else []

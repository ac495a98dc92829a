"""Repeats that are not of one part in one state: what changes between them beyond what their own noise allows.

levels     difference of two sessions, smoothed, above SESSION_LSB
ring-down  rate of decay of a run, 1.5 times that of the others or 1/1.5 of it
driven     gain from period to period of an input that repeats itself: a trend above PERIODS sigmas and 0.2 %
"""

from itertools import pairwise

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.sheet import SIGNAL
from testbench.measured.quality.units import decay_rate

SESSION_LSB = 0.5
RATE = 1.5
SMOOTH = 64  # blocks of levels


def _check_levels_drift(sheets):
    for a, b in pairwise(sheets):
        for c in b.columns_by_role(SIGNAL):
            other = a.column(c.name)
            if other is None or a.rows != b.rows or a.rows < SMOOTH:
                continue
            lsb = abs(np.mean(np.diff(c.values)))
            smoothed_difference = (c.error - other.error)[: a.rows // SMOOTH * SMOOTH].reshape(SMOOTH, -1).mean(
                axis=1
            ) / lsb
            noise = np.std(np.diff(c.error - other.error)) / np.sqrt(2) / lsb / np.sqrt(a.rows / SMOOTH)
            worst = float(np.max(np.abs(smoothed_difference)))
            if worst > SESSION_LSB + 5 * noise:
                yield finding(b, "drift", c.name, None, f"differs from {a.place} by up to {worst:.3g} LSB")


def _check_ringdown_drift(sheets):
    rates = [decay_rate(s.column("time").values, s.column("power").values) for s in sheets]
    for k, (sheet, rate) in enumerate(zip(sheets, rates)):
        usual = np.median([r for j, r in enumerate(rates) if j != k])
        if rate > 0 and usual > 0 and not 1 / RATE < rate / usual < RATE:
            yield finding(sheet, "drift", "power", None, f"decays at {rate:.3g} 1/s, the other runs at {usual:.3g}")


RULES = {"levels": _check_levels_drift, "ringdown": _check_ringdown_drift}


def check(sheets):
    """Findings about sheets of one part: files that were given together."""
    kinds = {s.kind for s in sheets}
    rule = RULES.get(next(iter(kinds))) if len(kinds) == 1 else None
    return list(rule(sheets)) if rule and len(sheets) > 1 else []

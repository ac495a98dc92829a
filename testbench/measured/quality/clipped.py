"""Values that pile up at their own extreme: a range that ends inside the signal.

many     more rows at the extreme than within as wide a bin beside it: a tail becomes thinner, and ever faster
two      rows at the extreme are equal to the last digit, as no others are and chance does not make
print    a course that becomes flat at its extreme, in steps coarser than its noise, is not clipped
"""

import numpy as np

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import grid_step, noise_sd
from testbench.measured.quality.sheet import SIGNAL
from testbench.measured.quality.stuck import flat_rows

MANY, SIGMAS = 4, 5.0
CHANCE = 1e-3
PILE, PILE_FAST = 1.5, 3.0  # a sine in coarse steps has 2.4 times as many at its top as beside it


def _not_thinner(n1, n2, n3):
    """True if the counts of three bins, from the extreme inwards, are not log-concave as those of a tail are."""
    if min(n1, n2, n3) < 1:
        return False
    return bool(np.log(n1 * n3 / n2**2) > SIGMAS * np.sqrt(1 / n1 + 4 / n2 + 1 / n3))


def check(sheet):
    """Findings about the signals of a sheet."""
    for c in sheet.columns_by_role(SIGNAL):
        values = c.unwrapped_values
        grid, noise = grid_step(values), noise_sd(sheet.reorder_values(c.course), c.fast)
        bin_width = grid if grid > 0.02 * noise else 0.2 * noise
        flat = np.zeros(len(values), bool) if c.fast else flat_rows(values)
        ties = len(values) - len(np.unique(values))
        for side, v in (("highest", values), ("lowest", -values)):
            top = v.max()
            at, inner = v == top, v[v < top]
            count = np.count_nonzero(at)
            second = np.count_nonzero(inner >= top - 1.01 * bin_width)
            pile = count > (PILE_FAST if c.fast else PILE) * second
            many = count >= MANY and count > second + SIGMAS * np.sqrt(second + 1) and pile
            if not c.fast and count >= MANY:
                many = many or _not_thinner(count, second, np.count_nonzero(inner >= top - 2.01 * bin_width) - second)
            ends = count - 1 + max(np.count_nonzero(v == v.min()) - 1, 0)
            two = count > 1 and ties == ends and (grid / (top - inner.max())) ** (count - 1) < CHANCE
            if (many or two) and not np.all(flat[at]):
                words = f"{count} rows at its {side} value {values[at][0]:.6g} {c.unit}"
                yield finding(sheet, "clipped", c.name, at, words)

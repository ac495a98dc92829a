"""Values on a grid coarser than their noise: the noise seen is the grid's. Reported, with the floor that the grid sets.

found    step of the grid > NOISES times the sd of what a row has beside its neighbours
"""

from testbench.measured.quality.finding import finding
from testbench.measured.quality.rows.series import grid_step, noise_sd
from testbench.measured.quality.sheet import SIGNAL

NOISES = 1.0


def check(sheet):
    """Findings about the signals of a sheet."""
    for c in sheet.columns_by_role(SIGNAL):
        step, sd = grid_step(c.values), noise_sd(sheet.reorder_values(c.course), c.fast)
        if step > NOISES * sd:
            words = f"values in steps of {step:.4g} {c.unit}, coarser than their noise of {sd:.3g}; "
            yield finding(
                sheet, "quantised", c.name, None, words + f"the noise floor cannot be below {step / 12**0.5:.3g}"
            )

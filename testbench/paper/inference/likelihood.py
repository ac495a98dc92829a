"""What a paper says and how well: rows as the fit compares them, and papers drawn from boards with noise and rounding.

    compared   value, or ln(value) of scale factor, ARW, bias instability and V_q; sigma likewise, the paper's own
    drawn      the model's rows plus that noise, rounded to the digits that the text prints
    steps      |relative change| with the noise of two repeats; of the bias it grows as the bias falls

Source    docs/inference.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, rows

FITTED, STEPPED = rows.fitted(), rows.steps()
DIGIT = {"scale_factor": 1.0}  # of other rows 1e-4


class Paper(NamedTuple):
    """Numbers that a text prints: {name: value}, of fitted rows and steps."""

    values: dict


class Compared(NamedTuple):
    """Rows of a fit: names, what is compared, and its sigma."""

    names: tuple
    value: np.ndarray
    sigma: np.ndarray


def sigma_compared(row):
    """Sigma of the value, or of its logarithm."""
    return row.sigma / row.value if row.logarithmic else row.sigma


def the_paper():
    """The paper's own numbers."""
    return Paper({row.name: row.value for row in (*FITTED, *STEPPED)})


def compared(paper, without=()):
    """`Compared` of the fitted rows but those left out."""
    kept = [row for row in FITTED if row.name not in without]
    value = [math.log(paper.values[r.name]) if r.logarithmic else paper.values[r.name] for r in kept]
    return Compared(tuple(r.name for r in kept), np.array(value), np.array([sigma_compared(r) for r in kept]))


def noisy(found, rng):
    """{name: array} as printed: the rows of boards with noise of their own."""
    out = {}
    for row in FITTED:
        noise = sigma_compared(row) * rng.standard_normal(found[row.name].shape)
        exact = found[row.name] * np.exp(noise) if row.logarithmic else found[row.name] + noise
        digit = DIGIT.get(row.group, 1e-4)
        out[row.name] = np.maximum(np.round(exact / digit), 1.0) * digit if row.logarithmic else _rounded(exact)
    for row in STEPPED:
        sigma = row.sigma
        if row.group.startswith("bias"):
            sigma = math.sqrt(2) * rows.SPREAD_DPS / np.abs(found[f"bias_{row.temp_degc:g}"])
        out[row.name] = _rounded(np.abs(found[row.name] + sigma * rng.standard_normal(found[row.name].shape)))
    return out


def _rounded(value):
    return np.round(value * 1e4) * 1e-4


def drawn(z, mode, rng):
    """A `Paper` for each board."""
    printed = noisy(forward.predict(z, mode), rng)
    return [Paper({name: float(a[k]) for name, a in printed.items()}) for k in range(len(z))]

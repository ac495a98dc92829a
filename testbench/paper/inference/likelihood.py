"""What a paper says and how well: rows as the fit compares them, and papers drawn from boards with noise and rounding.

    compared_rows  value, or ln(value) of scale factor, ARW, bias instability and V_q; sigma likewise, the paper's own
    drawn      the model's rows plus that noise, rounded to the digits that the text prints
    steps      |relative change| with the noise of two repeats; of the bias it grows as the bias falls

Source    docs/inference.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, rows

FITTED, STEPPED, REPEATS_DPS = rows.fitted_rows(), rows.steps(), rows.repeats_dps()


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


def compared_rows(paper, excluded_names=()):
    """`Compared` of the fitted rows but those left out."""
    fit_rows = [row for row in FITTED if row.name not in excluded_names]
    value = [math.log(paper.values[r.name]) if r.logarithmic else paper.values[r.name] for r in fit_rows]
    return Compared(tuple(r.name for r in fit_rows), np.array(value), np.array([sigma_compared(r) for r in fit_rows]))


def noisy(predictions, rng):
    """{name: array} as printed: the rows of boards with noise of their own, rounded."""
    out = {}
    for row in (*FITTED, *STEPPED):
        exact, sigma = predictions[row.name], sigma_compared(row)
        if row.group in ("bias_3to4", "bias_4to5"):
            sigma = math.sqrt(2) * REPEATS_DPS[row.temp_degc] / np.abs(predictions[f"bias_{row.temp_degc:g}"])
        noise = sigma * rng.standard_normal(exact.shape)
        value = exact * np.exp(noise) if row.logarithmic else exact + noise
        value = np.abs(value) if row in STEPPED else value
        steps = np.round(value / row.digit)
        out[row.name] = (np.maximum(steps, 1.0) if row.logarithmic else steps) * row.digit
    return out


def simulate_papers(z, mode, rng):
    """A `Paper` for each board."""
    printed = noisy(forward.predict(z, mode), rng)
    return [Paper({name: float(a[k]) for name, a in printed.items()}) for k in range(len(z))]

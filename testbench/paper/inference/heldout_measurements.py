"""Rows that a fit did not see, against what its draws predict: interval by interval, and class by class.

    predicted   a printed number for each draw, noise and rounding included: quantiles by weight
    distance    D^2 = (y - m)' C^-1 (y - m), m and C of the predicted numbers of a fold's class
    p           share of the predicted numbers that are as far from m; below LEVEL the class is contradicted
    width       largest standard deviation predicted, in the row's own; from WIDE on the class is covered, not predicted

Nothing is added to C: a class that is not met is called contradicted, and by how much.
Source    docs/inference.md
"""

from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, infer, likelihood, rows

LEVEL, WIDE = 0.01, 10.0
TEMPERATURE = "the temperature is left out"  # a rule of the list
SHARES = (0.05, 0.5, 0.95)
GROUPS = {row.name: row.group for row in (*likelihood.FITTED, *likelihood.STEPPED)}
SIGMAS = {row.name: row.sigma for row in (*likelihood.FITTED, *likelihood.STEPPED)}


class Predicted(NamedTuple):
    """One row that was held out."""

    fold: str
    name: str
    paper: float
    low: float
    middle: float
    high: float

    @property
    def is_in_interval(self):
        return self.low <= self.paper <= self.high


class Class(NamedTuple):
    """Rows of one class in one fold: squared distance, how many rows, share of predictions as far away, width."""

    fold: str
    group: str
    distance: float
    count: int
    p: float
    width: float

    @property
    def verdict(self):
        if self.p < LEVEL:
            return "contradicted"
        return "covered" if self.width > WIDE else "predicted"


def draw_noisy_predictions(post, rng):
    """{row: array} of what a paper would print, one for each draw."""
    return likelihood.noisy(forward.predict(post.z, post.mode), rng)


def class_row_names(fold, group):
    """Names of a fold's rows of one class."""
    return [name for name in fold.rows if GROUPS[name] == group]


def compare_class(fold, group, names, row_draws, weight, paper):
    """`Class` of the rows `names` of a group."""
    values = np.stack([row_draws[name] for name in names], axis=1)
    mean = weight @ values
    cov = (weight[:, None] * (values - mean)).T @ (values - mean)
    far = np.linalg.inv(cov)

    def chi2(y):
        return np.einsum("...i,ij,...j->...", y - mean, far, y - mean)

    paper_chi2 = float(chi2(np.array([paper.values[name] for name in names])))
    width = max(np.sqrt(np.diag(cov)) / [SIGMAS[name] for name in names])
    return Class(fold, group, paper_chi2, len(names), float(weight[chi2(values) >= paper_chi2].sum()), float(width))


def judge_folds(paper, rng, draws, least, progress=None):
    """([Predicted], [Class], {fold name: (fold, posterior, predictions)}) of every fold of the committed list."""
    out, classes, fits_by_fold = [], [], {}
    folds = rows.folds()
    for number, fold in enumerate(folds):
        excluded_names = () if fold.rule == "never fitted" else fold.rows
        post = infer.posterior(likelihood.compared_rows(paper, excluded_names), rng, draws, least)
        row_draws = draw_noisy_predictions(post, rng)
        fits_by_fold[fold.name] = fold, post, row_draws
        for name in fold.rows:
            quantiles = [infer.quantile(row_draws[name], post.weight, share) for share in SHARES]
            out.append(Predicted(fold.name, name, paper.values[name], *quantiles))
        for group in dict.fromkeys(GROUPS[name] for name in fold.rows):
            classes.append(compare_class(fold.name, group, class_row_names(fold, group), row_draws, post.weight, paper))
        if progress:
            progress("held-out rows", number + 1, len(folds))
    return out, classes, fits_by_fold

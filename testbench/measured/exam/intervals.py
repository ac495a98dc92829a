"""Deviations of fitted numbers as a report states them: what the noise says, or what the rest of the fit says if more.

    C       covariance of the fit;   g_b = J_b' z_b: score of block b, BLOCKS blocks of rows in each group
    sd^2    diagonal of C, or of C (sum g_b g_b') C n / (n - 1) where that is larger
A rest that is no noise pulls all rows of a block in one direction: the scores of the blocks know it, C does not.
Source    White (1982); Liang & Zeger (1986)
"""

import numpy as np

BLOCKS = 8


def stated_sd(fit):
    """(nuisances and laws,) of a fit; see the module."""
    scores = []
    for group in fit.model.space.groups:
        for rows in np.array_split(np.arange(group.rows.start, group.rows.stop), BLOCKS):
            scores.append(fit.jacobian[rows].T @ fit.z[rows])
    g, n = np.array(scores), len(scores)
    pulled = fit.covariance @ g.T
    return np.sqrt(np.maximum(np.diag(fit.covariance), np.sum(pulled**2, axis=1) * n / (n - 1)))

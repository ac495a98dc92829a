"""Deviations of fitted numbers as a report states them: what the noise says, or what the rest of the fit says if more.

    C       covariance of the fit;   g_b = J_b' z_b: score of cluster b, n clusters
    sd^2    diagonal of C, or of C (sum g_b g_b') C n / (n - 1) where that is larger
Clusters are 8, 32 and 128 blocks of rows in each group, and the groups themselves where there are several: a rest that
is no noise pulls all rows of a block in one direction, what differs between recordings all rows of a group.
Source    White (1982); Liang & Zeger (1986)
"""

import numpy as np

BLOCKS = (8, 32, 128)


def stated_sd(fit):
    """(nuisances and laws,) of a fit; see the module."""
    groups = [np.arange(group.rows.start, group.rows.stop) for group in fit.model.space.groups]
    split = [[rows for group in groups for rows in np.array_split(group, min(k, len(group)))] for k in BLOCKS]
    variance = np.diag(fit.covariance)
    for clusters in (groups, *split):
        n = len(clusters)
        if n > 1:
            pulled = fit.covariance @ np.stack([fit.jacobian[rows].T @ fit.z[rows] for rows in clusters], axis=1)
            variance = np.maximum(variance, np.sum(pulled**2, axis=1) * n / (n - 1))
    return np.sqrt(variance)

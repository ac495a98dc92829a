"""Phase meters: a frequency counter on zero crossings, and a joint least-squares fit, at any node.

Every phase is a lag against the DDS phase theta, in degrees, positive when late:

    node(t) = B sin(theta(t) - lag) + offset [+ free line of the sense mode]        (least squares)
    lag     = mean of theta at the rising zero crossings, modulo one turn            (counter)

The counter sees instants only, as the instrument does; its `resolution_deg` is two standard errors of the mean that the
spread of its instants allows. The fit uses every sample. Its `sigma_deg` is that of a sum of correlated shares: what
each of SHARES parts of the record adds to the lag by its residual. Images of a staircase cancel within a part.
Plain correlation over a broken number of periods would err by up to 2.5 mdeg.
Source  docs/phases.md
"""

from typing import NamedTuple

import numpy as np

SHARES = 256  # parts of a record; fewer where it has fewer samples
MEMORY = 0.25  # of a record: correlations of shares are counted up to here
BLOCK = 1 << 13  # samples whose rows stay in the cache, and are too few for threads of the matrix product


class Reading(NamedTuple):
    """One phase reading (degrees of lag); `shares_deg` is what the residual of each part of the record adds to it."""

    lag_deg: float
    sigma_deg: float
    amplitude: float
    count: int
    shares_deg: np.ndarray


class Crossings(NamedTuple):
    """A counter reading (degrees of lag): mean, spread of single instants, and what the mean resolves."""

    lag_deg: float
    spread_deg: float
    resolution_deg: float
    count: int


def wrap_deg(angle_deg):
    """Angle in [-180, 180)."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def sum_sigma(shares):
    """Standard deviation of the sum of n correlated shares that a fit has left without a mean.

    sigma^2 = sum over i, j of s_i s_j k((i - j)/(MEMORY n)) / c     k Parzen's window, so that it is never negative
    c       the same of white shares over its value with their mean left in
    Source  Parzen 1957; Newey and West 1987
    """
    lags = np.arange(len(shares)) / (MEMORY * len(shares))
    window = np.where(lags < 0.5, 1 - 6 * lags**2 * (1 - lags), 2 * np.clip(1 - lags, 0, None) ** 3)
    kernel = window[np.abs(np.subtract.outer(np.arange(len(shares)), np.arange(len(shares))))]
    white = 1.0 - kernel.mean()
    return float(np.sqrt(max(shares @ kernel @ shares, 0.0) / white))


class Fit:
    """Joint least squares of sine, cosine and offset at theta, block by block: memory does not grow with the record.

    samples  how many there will be: parts of the record and the ramp of the free line follow from it
    nodes    values of each sample, fitted one by one
    free     True if one free line is fitted too, such as the ringing sense mode
    Each part keeps its gram matrix and right-hand sides, from which its share in the residual follows as well.
    """

    def __init__(self, samples, nodes, free=False):
        if samples < 16:
            raise ValueError(f"phase fit: needs at least 16 finite samples, got {samples}")
        self.samples, self._rows, self._done = samples, 7 if free else 3, 0
        self._ends = np.linspace(0, samples, min(SHARES, samples // 4) + 1).astype(int)
        self._table = np.empty((self._rows + nodes, min(BLOCK, samples)))
        self._products = np.zeros((len(self._ends) - 1, self._rows, len(self._table)))

    def add(self, theta_turns, nodes, free_turns=None):
        """The samples that come next: reference phase (turns), values of each node, phase of the free line (turns)."""
        begin, part = 0, np.searchsorted(self._ends, self._done, "right") - 1
        while begin < len(theta_turns):
            end = min(begin + BLOCK, len(theta_turns), begin + self._ends[part + 1] - self._done)
            table, block = self._table[:, : end - begin], slice(begin, end)
            self._fill(table, theta_turns[block], [samples[block] for samples in nodes], free_turns, block)
            self._products[part] += table[: self._rows] @ table.T
            self._done += end - begin
            begin, part = end, part + (self._done == self._ends[part + 1])

    def _fill(self, table, theta_turns, nodes, free_turns, block):
        """Rows of the basis, then the nodes; in place: millions of samples take longer to copy than to compute."""
        table[self._rows :] = nodes
        if not np.isfinite(table[self._rows :]).all():
            raise ValueError(f"phase fit: needs at least 16 finite samples, got {self.samples}, not all finite")
        table[2] = 1.0
        for row, turns in [(0, theta_turns)] + ([] if free_turns is None else [(3, free_turns[block])]):
            cosine, angle = table[row : row + 2]
            np.multiply(2 * np.pi, turns, out=angle)
            np.cos(angle, out=cosine)
            np.sin(angle, out=angle)
        if self._rows > 3:
            first = 2.0 * self._done / (self.samples - 1) - 1.0
            ramp = first + 2.0 / (self.samples - 1) * np.arange(table.shape[1])
            np.multiply(ramp, table[3:5], out=table[5:7])

    def readings(self):
        """A `Reading` for each node; infinite sigma for one without a tone."""
        grams, sides = np.split(self._products, [self._rows], axis=2)
        gram = grams.sum(axis=0)
        coefficients = np.linalg.solve(gram, sides.sum(axis=0))
        parts = sides - grams @ coefficients  # what each part's residual has of each row of the basis
        return [_reading(gram, c, parts[:, :, k], self.samples) for k, c in enumerate(coefficients.T)]


def _reading(gram, coefficients, parts, samples):
    lag = float(np.degrees(np.arctan2(-coefficients[0], coefficients[1])))
    amplitude = float(np.hypot(*coefficients[:2]))
    if not amplitude > 0:
        return Reading(lag, np.inf, 0.0, samples, np.zeros(len(parts)))
    turned = np.zeros(len(gram))
    turned[:2] = -coefficients[1] / amplitude, coefficients[0] / amplitude
    shares = np.degrees(parts @ np.linalg.solve(gram, turned) / amplitude)
    return Reading(lag, sum_sigma(shares), amplitude, samples, shares)


def fit_samples(theta_turns, nodes, free_turns=None):
    """`Fit` of samples that are all there.

    theta_turns  reference phase at each sample (turns)
    nodes        list of node values, one array each
    free_turns   phase of a second line (turns), such as the ringing sense mode, or None
    Returns a `Reading` for each node. Raises ValueError on fewer than 16 samples or values that are not finite.
    """
    joint = Fit(np.size(theta_turns), len(nodes), free_turns is not None)
    joint.add(theta_turns, nodes, free_turns)
    return joint.readings()


def fit(theta_turns, samples, free_turns=None):
    """`fit_samples` of a single node."""
    return fit_samples(theta_turns, [samples], free_turns)[0]


def count(theta_turns_at_crossings):
    """Counter reading from the reference phase (turns) at each rising crossing."""
    theta = np.asarray(theta_turns_at_crossings, float)
    if theta.size < 2:
        raise ValueError(f"counter: needs at least 2 rising crossings, got {theta.size}")
    centre = np.angle(np.mean(np.exp(2j * np.pi * theta))) / (2 * np.pi)
    deviation = (theta - centre + 0.5) % 1.0 - 0.5
    spread = float(np.std(deviation) * 360.0)
    return Crossings(
        float(wrap_deg((centre + np.mean(deviation)) * 360.0)), spread, 2.0 * spread / np.sqrt(theta.size), theta.size
    )


def rising_crossings(theta_turns, samples):
    """Reference phase (turns, unwrapped by the caller or not) at each rising zero crossing, by linear interpolation."""
    samples = np.asarray(samples, float)
    before = np.flatnonzero((samples[:-1] < 0) & (samples[1:] >= 0))
    part = samples[before] / (samples[before] - samples[before + 1])
    step = (theta_turns[before + 1] - theta_turns[before]) % 1.0
    return theta_turns[before] + part * step

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

import itertools
from typing import NamedTuple

import numpy as np

SHARES = 256  # parts of a record; fewer where it has fewer samples
MEMORY = 0.25  # of a record: correlations of shares are counted up to here


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


def fits(theta_turns, nodes, free_turns=None):
    """Joint least squares of sine, cosine and offset at theta, and of one free line if its phase is given, per node.

    theta_turns  reference phase at each sample (turns)
    nodes        list of node values, one array each
    free_turns   phase of a second line (turns), such as the ringing sense mode, or None
    Returns a `Reading` for each node. Raises ValueError on fewer than 16 samples or values that are not finite.
    """
    lines = [(0, theta_turns)] + ([] if free_turns is None else [(3, free_turns)])
    basis = np.empty((7 if len(lines) > 1 else 3, np.size(theta_turns)))
    basis[2] = 1.0
    # in place: millions of samples take longer to copy than to compute
    for row, turns in lines:
        cosine, angle = basis[row : row + 2]
        np.multiply(2 * np.pi, turns, out=angle)
        np.cos(angle, out=cosine)
        np.sin(angle, out=angle)
    if len(lines) > 1:
        np.multiply(np.linspace(-1.0, 1.0, basis.shape[1]), basis[3:5], out=basis[5:])
    gram = basis @ basis.T
    return [_reading(basis, gram, np.asarray(samples, float)) for samples in nodes]


def _reading(basis, gram, samples):
    if samples.size < 16 or not np.all(np.isfinite(samples)):
        raise ValueError(f"phase fit: needs at least 16 finite samples, got {samples.size}")
    scale = max(samples.max(), -samples.min()) or 1.0
    scaled = samples / scale
    coefficients = np.linalg.solve(gram, basis @ scaled)
    residual = coefficients @ basis
    np.subtract(scaled, residual, out=residual)
    lag, power = np.degrees(np.arctan2(-coefficients[0], coefficients[1])), coefficients[0] ** 2 + coefficients[1] ** 2
    ends = np.linspace(0, samples.size, min(SHARES, samples.size // 4) + 1).astype(int)
    if not power > 0:
        return Reading(float(lag), np.inf, 0.0, samples.size, np.zeros(len(ends) - 1))
    turned = np.zeros(len(basis))
    turned[:2] = -coefficients[1] / power, coefficients[0] / power
    parts = [basis[:, begin:end] @ residual[begin:end] for begin, end in itertools.pairwise(ends)]
    shares = np.degrees(np.array(parts) @ np.linalg.solve(gram, turned))
    return Reading(float(lag), sum_sigma(shares), float(np.sqrt(power) * scale), samples.size, shares)


def fit(theta_turns, samples, free_turns=None):
    """`fits` of a single node."""
    return fits(theta_turns, [samples], free_turns)[0]


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

"""Noise of a measured segment: autoregressive, with a level that may change from row to row.

    e_n = s_n r_n      r_n = sum_j a_j r_(n-j) + b w_n,  w white, r of unit variance      order 0: r = w
whiten(e) = w.   Source    Box & Jenkins, Time Series Analysis (1976), ch. 3 (Levinson-Durbin)
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter


class Noise(NamedTuple):
    """a (order,), b: see the module; sd: scalar or (n,) in the unit of the features; parts: rows that begin anew."""

    a: np.ndarray
    b: float
    sd: np.ndarray
    starts: tuple = (0,)

    @classmethod
    def white(cls, sd, starts=(0,)):
        return cls(np.zeros(0), 1.0, np.asarray(sd, float), starts)

    @classmethod
    def from_autocorrelation(cls, rho, sd, starts=(0,)):
        """rho: autocorrelation at lags 0 .. order, rho[0] = 1."""
        rho = np.asarray(rho, float)
        a = solve_toeplitz(rho[:-1], rho[1:]) if len(rho) > 1 else np.zeros(0)
        return cls(a, float(np.sqrt(max(1.0 - a @ rho[1:], 1e-9))), np.asarray(sd, float), starts)

    def _pieces(self, n):
        edges = [*self.starts, n]
        return [slice(p, q) for p, q in itertools.pairwise(edges)]

    def whiten(self, v):
        """Whitened rows, (n,) or (n, c); the first rows of each piece are taken as white."""
        v = np.asarray(v, float)
        sd = self.sd if v.ndim == 1 or np.ndim(self.sd) == 0 else self.sd[:, None]
        r = v / sd
        if not len(self.a):
            return r
        taps = np.concatenate([[1.0], -self.a])
        out = np.concatenate([lfilter(taps, [1.0], r[piece], axis=0) for piece in self._pieces(len(v))])
        for piece in self._pieces(len(v)):  # until the filter has its past, unit variance is kept, not whiteness
            head = slice(piece.start, min(piece.start + len(self.a), piece.stop))
            out[head] = r[head] * self.b
        return out / self.b

    def draw(self, n, rng):
        """One draw of n rows."""
        return self.draws(n, 1, rng)[:, 0]

    def draws(self, n, count, rng):
        """(n, count) draws."""
        if not len(self.a):
            return (self.sd * rng.normal(size=(count, n))).T
        taps, warm = np.concatenate([[1.0], -self.a]), 40 * len(self.a) + 400
        ends = np.cumsum([piece.stop - piece.start + warm for piece in self._pieces(n)])
        kicks = np.split(rng.normal(size=(count, ends[-1])), ends[:-1], axis=1)
        return (self.sd * np.concatenate([lfilter([self.b], taps, u)[:, warm:] for u in kicks], axis=1)).T


def neighbours(ratio):
    """Correlation r from row to row, by the mean square of second differences over one row and over far more.

    ratio = 1 - (8 r - 2 r^2) / 6
    """
    return float(np.clip(2.0 - np.sqrt(1.0 + 3.0 * min(ratio, 1.0)), 0.0, 0.98))


def turns(count, blocks):
    """(rows of the even, rows of the odd) of so many blocks of rows that take turns."""
    block = np.minimum(np.arange(count) * blocks // count, blocks - 1)
    return np.flatnonzero(block % 2 == 0), np.flatnonzero(block % 2 == 1)


def starts_of(rows):
    """Places at which rows begin anew: the first, and those behind a gap."""
    return (0, *(np.flatnonzero(np.diff(rows) > 1) + 1).tolist())

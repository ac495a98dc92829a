"""Noise of a measured segment: an autoregressive part whose level may change from row to row, and a white one.

    e_n = s_n r_n + w u_n     r_n = sum_j a_j r_(n-j) + b v_n;  u, v white, r of unit variance      order 0: r = v
whiten(e): innovations of the Kalman filter over their deviations, exact from the first row of each piece on.
Source    Box & Jenkins, Time Series Analysis (1976), ch. 3 (Levinson-Durbin); Harvey, Forecasting (1989), ch. 3
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.optimize import minimize
from scipy.signal import lfilter

from fpga_model.jit import kernel

ORDERS = range(4)
MOST = 0.95  # of a reflection: a random walk cannot be told from the curve below the noise
SIMPLEX = {"xatol": 1e-2, "fatol": 1e-2, "maxfev": 400}
SHARES = ((0.02, 0.02), (0.3, 0.1), (0.1, 0.8))  # of the mean square, white and coloured, from which a search begins


@kernel
def _innovations(a, start, sd, white, v, out):
    """Sum of ln of the variances of the innovations of v (n, c), which `out` gets in units of their deviations.

    start: covariance of r_n .. r_(n-p+1) in the first row.
    """
    p, rows, columns = len(a), v.shape[0], v.shape[1]
    cov, now, filtered_cov = start.copy(), np.zeros((p, columns)), start.copy()
    driving_variance = 1.0
    for j in range(p):
        driving_variance -= a[j] * _lag(start, a, j + 1)
    total = 0.0
    for n in range(rows):
        variance = sd[n] * sd[n] * cov[0, 0] + white * white
        total += np.log(variance)
        root = np.sqrt(variance)
        for c in range(columns):
            e = v[n, c] - sd[n] * now[0, c]
            out[n, c] = e / root
            for i in range(p):
                now[i, c] += cov[i, 0] * sd[n] / variance * e
            first = 0.0
            for i in range(p):
                first += a[i] * now[i, c]
            for i in range(p - 1, 0, -1):
                now[i, c] = now[i - 1, c]
            now[0, c] = first
        for i in range(p):
            for j in range(p):
                filtered_cov[i, j] = cov[i, j] - cov[i, 0] * cov[0, j] * sd[n] * sd[n] / variance
        for i in range(p):
            for j in range(p):
                cov[i, j] = filtered_cov[i - 1, j - 1] if i > 0 and j > 0 else 0.0
        for j in range(p):
            cross = 0.0
            for i in range(p):
                cross += a[i] * filtered_cov[i, j]
            if j + 1 < p:
                cov[0, j + 1] = cov[j + 1, 0] = cross
            cov[0, 0] += a[j] * cross
        cov[0, 0] += driving_variance
    return total


@kernel
def _lag(start, a, k):
    """Autocorrelation at lag k, 1 .. p."""
    if k < len(a):
        return start[0, k]
    value = 0.0
    for j in range(len(a)):
        value += a[j] * start[0, len(a) - 1 - j]
    return value


def correlations(a):
    """Autocorrelation at lags 0 .. p - 1 of an autoregression, (p,)."""
    p = len(a)
    m, right = np.eye(p + 1), np.zeros(p + 1)
    right[0] = 1.0
    for k in range(1, p + 1):
        for j in range(1, p + 1):
            m[k, abs(k - j)] -= a[j - 1]
    return np.linalg.solve(m, right)[:p]


class Noise(NamedTuple):
    """a (order,), b: see the module; sd: scalar or (n,) in the unit of the features; starts: rows that begin anew."""

    a: np.ndarray
    b: float
    sd: np.ndarray
    starts: tuple = (0,)
    white_sd: float = 0.0

    @classmethod
    def white_noise(cls, sd, starts=(0,)):
        return cls(np.zeros(0), 1.0, np.asarray(sd, float), starts)

    @classmethod
    def from_autocorrelation(cls, rho, sd, starts=(0,)):
        """rho: autocorrelation at lags 0 .. order, rho[0] = 1."""
        rho = np.asarray(rho, float)
        a = solve_toeplitz(rho[:-1], rho[1:]) if len(rho) > 1 else np.zeros(0)
        return cls(a, float(np.sqrt(max(1.0 - a @ rho[1:], 1e-9))), np.asarray(sd, float), starts)

    def select_rows(self, rows):
        """The noise of some rows of a segment (indices that rise): it begins anew behind each gap."""
        sd = self.sd if np.ndim(self.sd) == 0 else self.sd[rows]
        return self._replace(sd=sd, starts=piece_starts(rows))

    @property
    def rms(self):
        """Over all rows."""
        return float(np.sqrt(np.mean(self.sd**2) + self.white_sd**2))

    def _pieces(self, n):
        edges = [*self.starts, n]
        return [slice(p, q) for p, q in itertools.pairwise(edges)]

    def whiten(self, v):
        """Whitened rows, (n,) or (n, c)."""
        return self.innovations(v)[0]

    def innovations(self, v):
        """(whitened rows, sum of ln of their variances)."""
        v = np.asarray(v, float)
        table = np.ascontiguousarray(v.reshape(len(v), -1))
        sd = np.broadcast_to(np.asarray(self.sd, float), len(table))
        if not len(self.a):
            level = np.sqrt(sd**2 + self.white_sd**2)
            return (table / level[:, None]).reshape(v.shape), 2 * float(np.sum(np.log(level)))
        out, start, total = np.empty_like(table), toeplitz(correlations(self.a)), 0.0
        for piece in self._pieces(len(table)):
            level = np.ascontiguousarray(sd[piece])
            total += _innovations(self.a, start, level, self.white_sd, table[piece], out[piece])
        return out.reshape(v.shape), total

    def draw(self, n, rng):
        """One draw of n rows."""
        return self.draw_many(n, 1, rng)[:, 0]

    def draw_many(self, n, count, rng):
        """(n, count) draws."""
        if not len(self.a):
            return (np.sqrt(self.sd**2 + self.white_sd**2) * rng.normal(size=(count, n))).T
        taps, warm = np.concatenate([[1.0], -self.a]), 40 * len(self.a) + 400
        ends = np.cumsum([piece.stop - piece.start + warm for piece in self._pieces(n)])
        kicks = np.split(rng.normal(size=(count, ends[-1])), ends[:-1], axis=1)
        coloured_noise = self.sd * np.concatenate([lfilter([self.b], taps, u)[:, warm:] for u in kicks], axis=1)
        return (coloured_noise + self.white_sd * rng.normal(size=(count, n))).T


def likeliest(v, smooth, inverse):
    """`Noise` of rows v about a sum of the columns `smooth`: white, and coloured of variance c + d `inverse` of a row.

    Levels and colour of most likelihood, the order of the least BIC, then all of most restricted likelihood: the
    columns take low frequencies away, which the noise has.
    """

    def minus_log_likelihood(q, residual):
        rows, logs = _build_noise(q, inverse).innovations(residual)
        return logs + float(rows @ rows)

    def restricted_likelihood_cost(q):
        rows, logs = _build_noise(q, inverse).innovations(np.column_stack([v, smooth]))
        r = np.linalg.qr(rows[:, [*range(1, rows.shape[1]), 0]], mode="r")
        return logs + 2 * float(np.sum(np.log(np.abs(np.diag(r)[:-1])))) + float(r[-1, -1] ** 2)

    e, best = v - smooth @ np.linalg.lstsq(smooth, v, rcond=None)[0], None
    begun = [np.log(np.mean(e * e) * np.array([x, y, (1 - x - y) / np.mean(inverse)])) for x, y in SHARES]
    for order in ORDERS:
        starts = [np.append(best[1], 0.0)] if best else []
        if order < 2:  # white and coloured parts are told apart once there is colour: each share is tried again
            starts += [np.append(q, np.full(order, 0.7)) for q in begun]
        tried = [minimize(minus_log_likelihood, q, (e,), method="Nelder-Mead", options=SIMPLEX) for q in starts]
        best_fit = min(tried, key=lambda one: one.fun)
        value = best_fit.fun + order * np.log(len(e))
        if best is not None and value >= best[0]:
            break
        best = value, best_fit.x
    return _build_noise(minimize(restricted_likelihood_cost, best[1], method="Nelder-Mead", options=SIMPLEX).x, inverse)


def _build_noise(q, inverse):
    """`Noise` of ln variances (white, coloured, growing with `inverse`) and inverse tanh of the reflections."""
    a, innovation_variance = np.zeros(0), 1.0
    for k in MOST * np.tanh(q[3:]):  # Levinson: any reflections below 1 give a stationary autoregression
        a, innovation_variance = np.concatenate([a - k * a[::-1], [k]]), innovation_variance * (1 - k * k)
    white, still, grown = np.exp(np.clip(q[:3], -60.0, 60.0))
    return Noise(a, float(np.sqrt(innovation_variance)), np.sqrt(still + grown * inverse), (0,), float(np.sqrt(white)))


def neighbours(ratio):
    """Correlation r from row to row, by the mean square of second differences over one row and over far more.

    ratio = 1 - (8 r - 2 r^2) / 6
    """
    return float(np.clip(2.0 - np.sqrt(1.0 + 3.0 * min(ratio, 1.0)), 0.0, 0.98))


def turns(count, blocks):
    """(rows of the even, rows of the odd) of so many blocks of rows that take turns."""
    block = np.minimum(np.arange(count) * blocks // count, blocks - 1)
    return np.flatnonzero(block % 2 == 0), np.flatnonzero(block % 2 == 1)


def piece_starts(rows):
    """Places at which rows begin anew: the first, and those behind a gap."""
    return (0, *(np.flatnonzero(np.diff(rows) > 1) + 1).tolist())

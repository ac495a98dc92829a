"""A second resonance in the window of a sweep: chosen before anything is traced, by a limit that knows the search.

    T(f2, g2) = |h' r|^2 / (2 sd^2 h' h)       r: rest of one settled mode;   h: response of a mode of f2, g2
    both less all that f0, g, path, a slow sweep, Duffing and damping of the first mode can do (`tangents`)
    limit     ln(N / ALPHA), N from the mean of the largest T of simulated single-mode sweeps: ln N + Euler's constant
    taken     T, told in what is left with the mode, is above the limit; what is left is at the floor; and no law of the
              first mode, refitted with all its unknowns, leaves less than the limit more
Rows: those that are fitted.   Source    Gross & Vitells (2010) for the limit; docs/measured_results.md
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

ALPHA = 1e-3
DRAWS = 60
AT_FLOOR = 1.5  # rms of what is left over the noise
NARROWEST, WIDEST, WIDTHS = 1.0, 0.25, 8  # points; share of the window; widths that are tried
FROM = 10.0  # where the scaled unknowns start: steps of differences are shares of them
TWO_PI = 2 * np.pi


class Second(NamedTuple):
    """f2 (Hz), ln of g2 (1/s), both modes' unknowns q, linear unknowns, deviations of f2 and ln g2, T and its limit."""

    f_hz: float
    ln_g: float
    q: np.ndarray
    linear: np.ndarray
    sd: tuple
    gain: float
    limit: float

    def words(self):
        hz, sd = float(np.exp(self.ln_g)) / TWO_PI, self.sd
        mode_text = f"a second mode at {self.f_hz:.2f} +- {sd[0]:.2g} Hz, {hz:.3g} +- {hz * sd[1]:.2g} Hz wide"
        significance = f"{np.sqrt(2 * self.gain):.1f} sigma (limit {np.sqrt(2 * self.limit):.1f})"
        return f"{mode_text}, {significance}: included in the model"


def fit(columns_of, piece, s, used, q, scales, law=""):
    """(unknowns, linear, rest on `used`, Jacobian) by least squares; the last of q is the coefficient of `law`."""

    def solve(v):
        columns, _ = columns_of(piece, v[:-1] if law else v, {law: float(v[-1])} if law else {})
        if not np.all(np.isfinite(columns)):
            return np.zeros(columns.shape[1], complex), np.full(len(used), np.inf + 0j)
        c = np.linalg.lstsq(columns[used], s[used], rcond=None)[0]
        return c, columns[used] @ c - s[used]

    def residual_function(u):
        complex_residual = solve(q + (u - FROM) * scales)[1]
        complex_residual = np.where(np.isfinite(complex_residual), complex_residual, 1e3)
        return np.concatenate([complex_residual.real, complex_residual.imag])

    solution = least_squares(
        residual_function, np.full(len(q), FROM), diff_step=1e-6, xtol=1e-10, ftol=1e-12, max_nfev=60
    )
    v = q + (solution.x - FROM) * scales
    c, complex_residual = solve(v)
    return v, c, complex_residual, solution.jac / scales


def tangents(columns_of, piece, q, linear):
    """Orthonormal columns (n, .) of what the first mode alone can do, to first order."""
    g = float(np.exp(q[1]))
    now, _ = columns_of(piece, q, {})
    shifted_points = [(q + np.array([1e-4 * g, 0.0]), {}), (q + np.array([0.0, 1e-4]), {})]
    laws = [{"duffing": 1e-4 * g}, {"damping_cubic": 1e-4 * g}, {"sweep_rate": 0.1 * g}, {"sweep_rate": g}]
    bent = [columns_of(piece, *at)[0][:, 0] - now[:, 0] for at in (*shifted_points, *((q, law) for law in laws))]
    table = np.column_stack([now, *bent])
    return table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)


def search(columns_of, piece, q, used, table, residual, sd, rng):
    """(largest T, limit, f2, g2) over a grid of frequencies half a width apart and of WIDTHS widths."""
    f = piece.data.f_hz
    base = np.linalg.qr(table[used])[0]
    noise = sd * (rng.normal(size=(len(used), DRAWS)) + 1j * rng.normal(size=(len(used), DRAWS)))
    residual_and_noise = np.column_stack([residual, noise])
    residual_and_noise = residual_and_noise - base @ (base.conj().T @ residual_and_noise)
    step, span = f[1] - f[0], f[-1] - f[0]
    top, at = np.zeros(DRAWS + 1), (f[0], 1.0)
    for width in np.geomspace(NARROWEST * step, WIDEST * span, WIDTHS):
        g = TWO_PI * width
        for f2 in np.arange(f[0], f[-1], max(width / 2, step / 2)):
            h = columns_of(piece, np.array([*q, f2, np.log(g)]), {})[0][used, -1]
            unprojected_norm = np.linalg.norm(h)
            h = h - base @ (base.conj().T @ h)
            size = np.linalg.norm(h)
            if size < 1e-3 * unprojected_norm:
                continue
            t = np.abs(h.conj() @ residual_and_noise) ** 2 / (2 * sd**2 * size**2)
            at = (f2, g) if t[0] > top[0] else at
            top = np.maximum(top, t)
    return float(top[0]), float(np.mean(top[1:]) - np.euler_gamma - np.log(ALPHA)), *at


def choose(columns_of, piece, s, used, q, sd):
    """`Second` of a sweep s (n,) whose single mode has q = (f0, ln g), or None; sd: of real and imaginary part."""
    step = piece.data.f_hz[1] - piece.data.f_hz[0]
    scales = np.array([step, 0.1])
    q, linear, single, _ = fit(columns_of, piece, s, used, np.array(q), scales)
    rng = np.random.default_rng(0)
    largest_statistic, limit, f2, g2 = search(
        columns_of, piece, q, used, tangents(columns_of, piece, q, linear), -single, sd, rng
    )
    if not largest_statistic > limit:
        return None
    start = np.array([*q, f2, np.log(g2)])
    both, linear, two_mode_residual, jacobian = fit(columns_of, piece, s, used, start, np.tile(scales, 2))
    power = float(np.sum(np.abs(two_mode_residual) ** 2)) / 2  # of one part
    variance = max(sd**2, power / (len(used) - 4.5))
    f = piece.data.f_hz
    if (
        power > (AT_FLOOR * sd) ** 2 * len(used)
        or not f[0] <= both[2] <= f[-1]
        or largest_statistic * sd**2 < limit * variance
    ):
        return None
    g = float(np.exp(q[1]))
    for law, begin in (("sweep_rate", 0.1 * g), ("sweep_rate", g), ("duffing", 0.0), ("damping_cubic", 0.0)):
        scale = 0.1 * begin or 0.1 * g / TWO_PI
        other = fit(columns_of, piece, s, used, np.array([*q, begin]), np.array([*scales, scale]), law)[2]
        if np.sum(np.abs(other) ** 2) / 2 < power + limit * variance:
            return None
    covariance = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True) * variance
    return Second(
        float(both[2]), float(both[3]), both, linear, tuple(np.sqrt(np.diag(covariance))[2:]), largest_statistic, limit
    )

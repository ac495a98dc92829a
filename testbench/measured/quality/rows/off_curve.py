"""How far each row of a complex response is off the curve that its neighbours are on, in errors of their prediction.

smooth   s = sum_k c_k x^k, k = 0 .. 3                                             4 rows on either side
poles    s = (c0 + c1 x + c2 x^2) / (1 + c3 x + c4 x^2): any two poles, no smoothness             5
bent     a pole that moves with |s|^2, up to its fold and over the jump: the cubic                7
         c0 + c1 x + c2 x^2 + c3 x s + c4 s* + c5 s^2 + c6 |s|^2 + c7 s |s|^2 = s
judged   by the curve that its neighbours support best, and by those within AGREEMENT_FACTOR of it, without its own row
error    the rest of the neighbours, or the noise of the rows around, times sqrt(1 + what the prediction adds)
Source   Levy, Trans. IRE AC-4 (1959) 37, with the weights of Sanathanan and Koerner, IEEE Trans. AC-8 (1963) 56
"""

import numpy as np

from testbench.measured.quality.rows.series import running_scale

AGREEMENT_FACTOR = 3.0
MISFIT = 1.5  # a rest beyond the noise is no chance: it may be as much larger one row on
RAYLEIGH = 0.6745 / np.sqrt(np.log(2.0))  # rms of a complex normal value over its `series.robust`
FEWEST = 9


def _smooth(x, s):
    return [(x**k, 0, 0) for k in range(4)]


def _two_pole_terms(x, s):
    return [*_smooth(x, s)[:3], (x * s, x, 0), (x * x * s, x * x, 0)]


def _bent(x, s):
    c, size = np.conj(s), np.abs(s) ** 2
    cubic = [(c, 0, 1), (s * s, 2 * s, 0), (size, c, s), (s * size, 2 * size, s * s)]
    return [*_smooth(x, s)[:3], (x * s, x, 0), *cubic]


CURVES = ((4, _smooth), (5, _two_pole_terms), (7, _bent))


def _around(n, half):
    """(n, 2 half) rows around each, without it; the ends use the nearest."""
    rows = np.clip(np.arange(n) - half, 0, n - 2 * half - 1)[:, None] + np.arange(2 * half + 1)
    return rows[rows != np.arange(n)[:, None]].reshape(n, 2 * half)


def _stack_terms(terms, s):
    """(n, m, p) of the terms, of their derivatives by s and by its conjugate."""
    return (np.stack([np.broadcast_to(t[k], s.shape) for t in terms], axis=-1) for k in range(3))


def _off(f, s, half, terms):
    """(off (n,) of each row, rest (n,) of its neighbours, gain (n,) of noise) for one kind of curve."""
    rows = _around(len(f), half)
    x = f[rows] - f[:, None]
    x = x / np.max(np.abs(x), axis=1, keepdims=True)
    middle = s[rows].mean(axis=1, keepdims=True)
    size = np.maximum(np.max(np.abs(s[rows] - middle), axis=1), 1e-300)
    scaled_neighbours, scaled_centre = (s[rows] - middle) / size[:, None], (s[:, None] - middle) / size[:, None]
    a, by_s, by_c = _stack_terms(terms(x, scaled_neighbours), scaled_neighbours)
    weight = np.ones(x.shape)
    for _ in range(2):
        used = weight
        scaled = a * used[..., None]
        norm = np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)
        inverse = np.linalg.pinv(scaled / norm[:, None], rcond=1e-9)
        c = ((inverse @ (scaled_neighbours * used)[..., None])[..., 0] / norm)[..., None]
        slope = np.abs(1 - (by_s @ c)[..., 0]) + np.abs((by_c @ c)[..., 0])
        weight = 1 / np.maximum(slope, 1e-3)
    residual = (scaled_neighbours - (a @ c)[..., 0]) * used
    neighbour_rms = np.linalg.norm(residual, axis=1) / np.sqrt(a.shape[1] - a.shape[2])
    a, by_s, by_c = _stack_terms(terms(np.zeros(scaled_centre.shape), scaled_centre), scaled_centre)
    added = np.linalg.norm((a / norm[:, None]) @ inverse, axis=(1, 2))
    slope = (np.abs(1 - (by_s @ c)[..., 0]) + np.abs((by_c @ c)[..., 0]))[:, 0]
    return (
        np.abs(scaled_centre - (a @ c)[..., 0])[:, 0] / slope * size,
        neighbour_rms * size,
        np.hypot(1, added / slope),
    )


def off_curve(f, s, floor=0.0):
    """(n,) distance of each row of s(f) over its expected error; `floor` (scalar or (n,)): the least rms noise."""
    n = len(f)
    if n < FEWEST:
        return np.zeros(n)
    off, neighbour_rms, gain = (np.array(v) for v in zip(*(_off(f, s, *curve) for curve in CURVES if 2 * curve[0] < n)))
    best = np.argmin(neighbour_rms * gain, axis=0), np.arange(n)
    noise = np.maximum(RAYLEIGH * running_scale(off[best] / gain[best]), floor)
    error = np.maximum(MISFIT * neighbour_rms, noise) * gain
    counts = error <= AGREEMENT_FACTOR * np.min(error, axis=0)
    return np.min(np.where(counts, off / error, np.inf), axis=0)

"""Sweeps of resonators as an analyser sees them, drawn by seed; by formulas of this file alone.

draw(rng)               `Drawn`: linear, stiff up to and beyond its fold, or of two modes; 2 .. 20 rows per bandwidth
spiked(drawn, rng)      (rows, s) with single rows off, each enough to move a parameter by 3 of its sigmas
write(drawn, s, path)   a Touchstone file
printed(drawn, ..)      the same in dB, with few digits
"""

from typing import NamedTuple

import numpy as np

MOVED = 3.0  # sigmas of a parameter of the curve's own
SIZES = (1.2, 3.0)  # decades above the noise


class Drawn(NamedTuple):
    """`f` (n,) Hz; `s` (n,) with noise of `noise` (rms of each part); `clean(parameters) -> (n,)` at `parameters`."""

    kind: str
    f: np.ndarray
    s: np.ndarray
    noise: float
    clean: object
    parameters: np.ndarray


def settled(detuning, stiffening):
    """(n,) a of a = 1 / (1 + 2j (detuning - stiffening |a|^2)), swept in the order given: it jumps where a branch ends.

    detuning (n,) and stiffening in bandwidths; with u = |a|^2: u (1 + 4 (detuning - stiffening u)^2) = 1
    """
    u, out = 1.0 / (1 + 4 * detuning[0] ** 2), np.empty(len(detuning))
    for k, d in enumerate(detuning):
        found = np.roots([4 * stiffening**2, -8 * stiffening * d, 1 + 4 * d * d, -1.0]) if stiffening else None
        real = found[np.abs(found.imag) < 1e-6].real if stiffening else np.array([1.0 / (1 + 4 * d * d)])
        u = out[k] = real[np.argmin(np.abs(real - u))]
    return 1 / (1 + 2j * (detuning - stiffening * out))


def draw(rng):
    """A sweep without damage."""
    kind = ("linear", "stiff", "two modes")[rng.integers(3)]
    per_bandwidth, n = 2 * 10 ** rng.uniform(0, 1), int(rng.integers(80, 320))
    f0, q = 10 ** rng.uniform(4, 7), 10 ** rng.uniform(2, 6)
    width = f0 / q
    x = (np.arange(n) - n * rng.uniform(0.3, 0.7)) / per_bandwidth
    up = rng.random() < 0.5
    turn = rng.uniform(-0.5, 0.5) * x / np.ptp(x)  # of a cable
    second = rng.uniform(-4, 4), 10 ** rng.uniform(-0.5, 0.5), rng.uniform(0.1, 1)
    stiffening = 0.77 * rng.uniform(-3, 3) if kind == "stiff" or (kind != "linear" and rng.random() < 0.3) else 0.0
    phase = rng.uniform(0, 2 * np.pi, 4)
    background, slope = rng.uniform(0, 1) * np.exp(1j * phase[0]), rng.uniform(0, 0.1) * np.exp(1j * phase[1])

    def clean(p):
        f0_, width_, size, angle, re, im, stiff = p
        d = (x - f0_) / width_
        a = settled(d, stiff) if up else settled(d[::-1], stiff)[::-1]
        total = size * np.exp(1j * angle) * a + re + 1j * im + slope * x / np.ptp(x)
        if kind == "two modes":
            total = total + second[2] * np.exp(1j * phase[3]) / (1 + 2j * (x - second[0]) / second[1])
        return total * np.exp(1j * turn)

    parameters = np.array([0.0, 1.0, 1.0, phase[2], background.real, background.imag, stiffening])
    noise = 10 ** rng.uniform(-6, -2)
    s = clean(parameters)
    s = s + noise * (rng.normal(size=n) + 1j * rng.normal(size=n))
    return Drawn(kind, f0 + width * x, s, noise, clean, parameters)


def _tangents(drawn):
    out = []
    for k in range(len(drawn.parameters)):
        step = np.zeros(len(drawn.parameters))
        step[k] = 1e-6
        out.append((drawn.clean(drawn.parameters + step) - drawn.clean(drawn.parameters - step)) / 2e-6)
    t = np.array(out).T
    return np.concatenate([t.real, t.imag])


def spiked(drawn, rng):
    """(rows, s): one to three rows off; None if no draw moves a parameter."""
    t = _tangents(drawn)
    moves, n = np.linalg.pinv(t), len(drawn.s)
    sigma = drawn.noise * np.linalg.norm(moves, axis=1)
    for _ in range(60):
        rows = rng.choice(n, int(rng.integers(1, 4)), replace=False)
        off = np.zeros(n, complex)
        size = drawn.noise * 10 ** rng.uniform(*SIZES, len(rows))
        off[rows] = size * np.exp(2j * np.pi * rng.random(len(rows)))
        if np.any(np.abs(moves @ np.concatenate([off.real, off.imag])) > MOVED * sigma):
            return rows, drawn.s + off
    return None


def write(drawn, s, path):
    """A Touchstone file of one transmission."""
    rows = (f"{f:.4f} 0.01 0 {v.real:.9e} {v.imag:.9e} 0 0 0.01 0" for f, v in zip(drawn.f, s))
    path.write_text("\n".join(["! made", "# Hz S RI R 50", *rows]) + "\n")
    return path


def printed(drawn, path, rng, damage=None):
    """The same with one to four digits of dB, none to three of degrees, after `damage(size, step) -> size or None`."""
    db, deg = int(rng.integers(1, 5)), int(rng.integers(4))
    size, angle = 20 * np.log10(np.abs(drawn.s)), np.angle(drawn.s, deg=True)
    size = damage(size, 10.0**-db) if damage else size
    if size is None:
        return None
    rows = (f"{f:.4f} -40 0 {a:.{db}f} {b:.{deg}f} -100 0 -40 0" for f, a, b in zip(drawn.f, size, angle))
    path.write_text("\n".join(["! made", "# Hz S dB R 50", *rows]) + "\n")
    return path

"""One mode of the plant, free-run: exact propagation of the plant's resonator, laws of `effects.law` as impulses.

    force = k_vf u(t), u straight between its samples           z' = A z + b0 u_n + b1 u_(n+1)    z = (x, vx/W)
    at each tick first  vx/W += sum of the laws' impulses       the order of the plant (analog_frontend/top.py)
The mode has 1 kg and 1 V per metre at its pick-off: data in volts fix neither.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from analog_frontend.effects import law
from analog_frontend.parts import resonator
from fpga_model.jit import kernel

MASS_KG = 1.0
WIDTH = 16  # states that a law may name
U, X, VX = law.STATES["u"], law.STATES["x"], law.STATES["vx"]


class Device(NamedTuple):
    """What `resonator.resonator_matrices` reads; the other mode is there and coupled to nothing."""

    mass_kg: float
    fx_hz: float
    qx: float
    fy_hz: float = 1e5
    qy: float = 1e3
    dxy_ratio: float = 0.0
    coriolis_mass_kg: float = 0.0


@lru_cache(maxsize=512)
def generator(f_hz, q):
    """2 x 2 of the drive mode from the plant's block, and its force column (m/(N s))."""
    block = resonator.resonator_matrices(Device(MASS_KG, f_hz, q))
    rows = (resonator.X, resonator.VX)
    a = np.array([[float(block.base.get((i, j), 0)) for j in rows] for i in rows])
    return a, np.array([float(block.force.get((i, resonator.FX), 0)) for i in rows])


def propagator(f_hz, q, h_s):
    """A (2, 2), b0, b1 (2,): one tick with a force (N) that is straight between both of its ends."""
    a, force = generator(float(f_hz), float(q))
    m = np.zeros((4, 4))
    m[:2, :2], m[:2, 2], m[2, 3] = a * h_s, force * h_s, 1.0
    e = expm(m)
    return np.ascontiguousarray(e[:2, :2]), e[:2, 2] - e[:2, 3], e[:2, 3].copy()


@kernel
def _run(a, b0, b1, force, table, gain, indices, w, u, ticks, x):
    """x at every `ticks`-th tick; w holds the states. Mutates w and x. True if it stays finite."""
    k = 0
    for n in range(len(x)):
        x[n] = w[X]
        if not abs(x[n]) < 1e6:
            return False
        for _ in range(ticks):
            w[U] = u[k]
            kick, _ = law.impulses(force, table, gain, w, indices, 0, 0, law.NO_LEADS)
            v = w[VX] + kick
            after = u[k + 1] if k + 1 < len(u) else u[k]
            at = a[0, 0] * w[X] + a[0, 1] * v + b0[0] * u[k] + b1[0] * after
            w[VX] = a[1, 0] * w[X] + a[1, 1] * v + b0[1] * u[k] + b1[1] * after
            w[X] = at
            k += 1
    return True


def laws(effects, f_ref_hz, grammar):
    """`law.Law`s of relative coefficients {name: value}: F = -k c (product), k = m w^2, velocities over w of f_ref."""
    w, out = 2 * np.pi * f_ref_hz, []
    for name, value in effects.items():
        text = grammar.get(name)
        if text is None or value == 0.0:
            continue
        item = law.parse(f"force_x = 1 {text}")
        speeds = sum(f.power for f in item.factors if f.name == "vx" and f.dress != law.SGN)
        out.append(item._replace(coefficient=-value * MASS_KG * w ** (2 - speeds)))
    return out


def run(f_hz, q, force_n, drive_v, plant_laws, h_s, ticks, state):
    """x (samples,) in V from a force (N) and the drive voltage with it, both (samples ticks,); None: it diverges.

    force_n is force per volt times drive_v; state (x, v/w) in V at the first sample, w of f_hz.
    """
    a, b0, b1 = propagator(f_hz, q, h_s)
    p = law.design(plant_laws, MASS_KG, h_s, resonator.W_RAD_PER_S, 0.0)
    w = np.zeros(WIDTH)
    w[X], w[VX] = state[0], state[1] * 2 * np.pi * f_hz / resonator.W_RAD_PER_S
    x = np.empty(len(drive_v) // ticks)
    indices = np.arange(WIDTH)
    fine = _run(a, b0 * force_n, b1 * force_n, p.force, p.table, p.numbers[:, 0].copy(), indices, w, drive_v, ticks, x)
    return x if fine else None


def upsample(u, times):
    """Band-limited interpolation of u (n,) to n times samples, ends mirrored."""
    pad = min(512, len(u) - 1)
    v = np.concatenate([2 * u[0] - u[pad:0:-1], u, 2 * u[-1] - u[-2 : -pad - 2 : -1]])
    spectrum = np.fft.rfft(v)
    wide = np.zeros(len(v) * times // 2 + 1, complex)
    wide[: len(spectrum)] = spectrum
    if len(v) % 2 == 0:
        wide[len(spectrum) - 1] *= 0.5
    return np.fft.irfft(wide, len(v) * times)[pad * times : (pad + len(u)) * times] * times

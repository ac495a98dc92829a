"""The modes over a hundred thousand periods, and the block against a direct balance of forces."""

import math

import mpmath
import numba
import numpy as np
import pytest

from analog_frontend.parts import device, propagator, resonator
from fpga_model.jit import kernel

INTERPRETED = numba.config.DISABLE_JIT
TICKS = 2_000 if INTERPRETED else 9_090_000
OMEGA, KAPPA = math.radians(100.0), 0.02


def chain(_device, _channel, _temp_degc):
    return 9.04e4, 240e-9


@kernel
def propagate(g, vector, out, ticks):
    """The tick of the plant: every output summed over the inputs in their order, from 0.0."""
    for _ in range(ticks):
        out[:] = 0.0
        for j in range(24):
            for i in range(24):
                out[i] += g[j, i] * vector[j]
        vector[:16] = out[:16]


def modes_exact(dev, time, start, omega, kappa):
    """x, x'/W, y, y'/W after `time` from the equations of motion in physical units."""
    m, mc = mpmath.mpf(dev.mass_kg), mpmath.mpf(dev.coriolis_mass_kg)
    wx, wy = (2 * mpmath.pi * mpmath.mpf(f) for f in (dev.fx_hz, dev.fy_hz))
    dx, dy = m * wx / mpmath.mpf(dev.qx), m * wy / mpmath.mpf(dev.qy)
    dxy = mpmath.mpf(dev.dxy_ratio) * dx
    omega, kappa = mpmath.mpf(omega), mpmath.mpf(kappa)
    a = mpmath.matrix(
        [
            [0, 1, 0, 0],
            [-(wx**2), -dx / m, -kappa / m, (2 * mc * omega - dxy) / m],
            [0, 0, 0, 1],
            [-kappa / m, (-2 * mc * omega - dxy) / m, -(wy**2), -dy / m],
        ]
    )
    size = [1, 2 * mpmath.pi * 11000, 1, 2 * mpmath.pi * 11000]
    # modal solution: eigenvalues and eigenvectors, exponentials of the eigenvalues
    values, vectors = mpmath.eig(a)
    z = mpmath.lu_solve(vectors, mpmath.matrix([mpmath.mpf(s) * k for s, k in zip(start, size)]))
    z = vectors * mpmath.matrix([v * mpmath.exp(w * time) for v, w in zip(z, values)])
    return [mpmath.re(v) / k for v, k in zip(z, size)]


def run(omega, kappa, start, ticks):
    g = np.zeros((24, 24))
    propagator.combine(propagator.build(device.make(), 25.0, chain).g_jet, omega, kappa, g)
    vector, out = np.zeros(24), np.zeros(24)
    vector[6:10] = start
    propagate(g, vector, out, ticks)
    return vector[6:10].copy()


@pytest.mark.parametrize("ticks", [TICKS // 9, pytest.param(TICKS, marks=pytest.mark.slow)])
def test_phase_error_after_100000_periods(ticks):
    """Modes, rate and coupling on: below 1e-9 rad, from the rounding of the table; a ninth of it after a ninth.

    An entry near 0.9976 errs by at most 2^-54, one near 0.069 by 2^-57. The phase per tick errs by half the sum of the
    sines' errors and sin(0.069) times half that of the cosines', 1.2e-17 rad; the 24 sums of a tick add errors of
    either sign. 9.09e6 ticks of the first make 1.1e-10; ten times that is the limit. The amplitude errs by the cosines'
    5.6e-17 per tick, 5e-10 in all; again doubled for the sums.
    """
    start = (5e-6, 0.0, 0.0, 1e-7)
    actual = run(OMEGA, KAPPA, start, ticks)
    with mpmath.workdps(50):
        exact = [float(v) for v in modes_exact(device.make(), mpmath.mpf(ticks) / 10**6, start, OMEGA, KAPPA)]
    limit = 1e-9 * (ticks / 9.09e6) + 1e-13
    for first, name in ((0, "x"), (2, "y")):
        ours = complex(actual[first], actual[first + 1])
        theirs = complex(exact[first], exact[first + 1])
        # x and v/W differ in size by at most 1.3 %
        assert abs(math.remainder(np.angle(ours) - np.angle(theirs), 2 * math.pi)) < limit, name
        assert abs(abs(ours) / abs(theirs) - 1) < limit, name


def test_ring_down_takes_5_79_s():
    """Amplitude falls as exp(-t/tau), tau = 2Q/w = 5.786 s; the rounding of the cosines is 3.2e-10 of 1/tau."""
    ring_down_s = device.make().qx / (math.pi * device.make().fx_hz)
    assert ring_down_s == pytest.approx(5.79, abs=0.005)
    ticks = TICKS // 9
    w = 2 * math.pi * device.make().fx_hz
    # without d_xy the modes are independent at no rate and no coupling
    g = np.zeros((24, 24))
    propagator.combine(propagator.build(device.make(dxy_ratio=0.0), 25.0, chain).g_jet, 0.0, 0.0, g)
    vector, out = np.zeros(24), np.zeros(24)
    vector[6] = 5e-6
    damping = w / (2 * device.make().qx)

    def energy(z):
        # with this cross term it falls as exp(-2 damping t) exactly
        v = z[7] * resonator.W_RAD_PER_S
        return v * v + (w * z[6]) ** 2 + 2 * damping * z[6] * v

    before = energy(vector)
    propagate(g, vector, out, ticks)
    tau = -2 * ticks * 1e-6 / math.log(energy(vector) / before)
    # per tick: 2^-54 of rounding against 1.7e-7 of damping, and the end values to 1e-15 of themselves
    limit = 2.0**-53 / 1.7e-7 + 4e-15 / (ticks * 1.7e-7)
    assert abs(tau / ring_down_s - 1) < limit
    assert vector[8] == vector[9] == 0.0


def test_rate_gives_the_coriolis_motion():
    """0.101 nm of y per deg/s at 5 um: 2 m_c W Ax Omega / (m (wx^2 - wy^2))."""
    dev = device.make()
    wx, wy = 2 * math.pi * dev.fx_hz, 2 * math.pi * dev.fy_hz
    expected = 2 * wx * 5e-6 * math.radians(1.0) / (wx**2 - wy**2)
    assert expected == pytest.approx(0.101e-9, rel=0.01)
    # eigenvector of the x mode at 1 deg/s, from the exact equations; d_xy off
    with mpmath.workdps(40):
        quiet = device.make(dxy_ratio=0.0)
        period = 1 / mpmath.mpf(dev.fx_hz)
        # free y motion cancels the forced one at the start: after half a beat they add up to twice
        half_beat = mpmath.mpf(0.5) / (mpmath.mpf(dev.fx_hz) - mpmath.mpf(dev.fy_hz))
        peak = max(
            abs(float(modes_exact(quiet, half_beat + period * k / 16, (5e-6, 0, 0, 0), math.radians(1.0), 0.0)[2]))
            for k in range(16)
        )
    assert peak == pytest.approx(2 * expected, rel=0.03)


def test_the_scale_of_velocities():
    assert pytest.approx(2 * math.pi * 11000, rel=1e-15) == resonator.W_RAD_PER_S


def test_block_is_the_balance_of_forces():
    """Accelerations from the block at random states against both equations, written out."""
    dev = device.make(coriolis_mass_kg=1.9e-7, qy=1.5e5, dxy_ratio=0.2)
    block = resonator.resonator_matrices(dev)
    rng = np.random.default_rng(3)
    with mpmath.workdps(60):
        for _ in range(5):
            x, vx, y, vy, omega, kappa, fx, fy = (mpmath.mpf(float(v)) for v in rng.standard_normal(8))
            w = 2 * mpmath.pi * 11000
            z = (x, vx / w, y, vy / w)
            rate = [mpmath.mpf(0)] * 4
            for entries, factor in ((block.base, 1), (block.omega, omega), (block.stiffness, kappa)):
                for (row, col), value in entries.items():
                    rate[row] += factor * mpmath.mpf(value) * z[col]
            for (row, col), value in block.force.items():
                rate[row] += mpmath.mpf(value) * (fx, fy)[col]
            m, mc = mpmath.mpf(dev.mass_kg), mpmath.mpf(dev.coriolis_mass_kg)
            wx, wy = 2 * mpmath.pi * mpmath.mpf(dev.fx_hz), 2 * mpmath.pi * mpmath.mpf(dev.fy_hz)
            dx, dy = m * wx / mpmath.mpf(dev.qx), m * wy / mpmath.mpf(dev.qy)
            dxy = mpmath.mpf(dev.dxy_ratio) * dx
            ax = (fx - dx * vx - dxy * vy - m * wx**2 * x - kappa * y + 2 * mc * omega * vy) / m
            ay = (fy - dy * vy - dxy * vx - m * wy**2 * y - kappa * x - 2 * mc * omega * vx) / m
            for got, want in zip(rate, (vx, ax / w, vy, ay / w)):
                assert abs(got - want) < mpmath.mpf("1e-40") * (abs(want) + 1)

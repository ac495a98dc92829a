"""The plant's tick against solutions of its own: chains, coupled modes, pickoff, switches, carries."""

import numpy as np
import pytest
from scipy.linalg import expm

from analog_frontend import top as plant
from fpga_model.jit import kernel
from testbench import build
from tests.testbench.bench_setup import quiet

H = 1e-6


@kernel
def tick(p, s, k, pins, edges):
    return plant.step(p, s, k, pins, edges)


@kernel
def tune(p, s, rate, code, temp):
    plant.retune(p, s, rate, code, temp)


def bench(rate=0.0, quad_code=0, **values):
    p = build.analog(quiet(plant__sid_charge_c=0.0, **values), 25.0, 25.0)
    s = plant.reset(p, 0, 0, 25.0)
    tune(p, s, rate, quad_code, 25.0)
    return p, s


def test_a_step_of_the_drive_code_is_a_force_at_the_right_instant():
    """The electrode follows the chain's closed form from the clock of the latch on; nothing moves before."""
    p, s = bench()
    code, cycle = 12000, 19
    tick(p, s, 0, plant.Pins(code, cycle, 0, -1, 0), np.zeros((8, 2), np.int64))
    volts = code * 10.0 / 32768
    rates = 1 / np.array([100e-9, 40e-9, 40e-9])
    a = np.diag(-rates) + np.diag(rates[1:], -1)
    after = H - cycle * H / 26
    want = volts * (1 - expm(a * after).sum(axis=1))
    np.testing.assert_allclose(s.z[:3], want, rtol=1e-12)
    assert np.all(s.z[3:6] == 0.0)


@pytest.mark.parametrize(("cycle", "carried"), [(1, False), (22, False), (23, True), (25, True)])
def test_a_latch_whose_delay_leaves_the_tick_is_carried(cycle, carried):
    """130 ns are 3.38 clocks: from clock 23 on the sense output starts in the next tick."""
    p, s = bench()
    none = np.zeros((8, 2), np.int64)
    tick(p, s, 0, plant.Pins(0, -1, 200000, cycle, 0), none)
    assert (s.z[3] == 0.0) == carried
    tick(p, s, 1, plant.Pins(0, -1, 200000, -1, 0), none)
    volts = 200000 * 10.0 / 524288
    settled = 2 * H - cycle * H / 26 - 130e-9
    assert s.z[3] == pytest.approx(volts * (1 - np.exp(-settled / 68e-9)), rel=1e-12)


def test_many_ticks_equal_one_long_exponential():
    """200 us of a coupled, rotating gyroscope with constant forces, against a matrix exponential in physical units."""
    rate, code = 5.0, 30000
    p, s = bench(rate=rate, quad_code=code)
    s.z[plant.X], s.z[plant.VX] = 3e-6, 1e-6
    s.z[plant.Y], s.z[plant.VY] = -2e-8, 4e-8
    start = s.z.copy()
    none = np.zeros((8, 2), np.int64)
    for k in range(200):
        tick(p, s, k, plant.Pins(0, -1, 0, -1, 0), none)
    d = quiet().device()
    w = 2 * np.pi * 11000.0
    kappa = d.kxy_n_per_m - d.kq_n_per_m_per_v2 * (code * 5.5 / 65536) ** 2
    m = d.mass_kg
    dx, dy = (m * 2 * np.pi * f / q for f, q in ((d.fx_hz, d.qx), (d.fy_hz, d.qy)))
    dxy = d.dxy_ratio * dx
    a = np.array(
        [
            [0, 1, 0, 0],
            [-((2 * np.pi * d.fx_hz) ** 2), -dx / m, -kappa / m, (2 * m * rate - dxy) / m],
            [0, 0, 0, 1],
            [-kappa / m, -(2 * m * rate + dxy) / m, -((2 * np.pi * d.fy_hz) ** 2), -dy / m],
        ]
    )
    scale = np.diag([1, w, 1, w])
    # balanced first: all entries near w, so that expm keeps 1e-14 of the largest entry over 14 rad
    want = expm(np.linalg.inv(scale) @ a @ scale * 200e-6) @ start[6:10]
    np.testing.assert_allclose(s.z[6:10], want, rtol=0, atol=14 * 1e-14 * 3e-6)


def test_the_demodulators_see_the_pickoff_between_edges():
    """Motion with references held: the closed capacitors follow the C/V output, the open ones hold."""
    p, s = bench()
    s.z[plant.X] = 4e-6
    gain = p.tables.drive_gain_v_per_m[0] * 4e-6
    s.z[10:13] = gain, gain, 5 * gain  # the pickoff at rest
    s.switch[:] = (1, 0, 1, 0)
    none = np.zeros((8, 2), np.int64)
    cv = []
    for k in range(2000):
        cv.append(s.z[plant.CV_X])
        tick(p, s, k, plant.Pins(0, -1, 0, -1, 0), none)
    v = np.array([*cv, s.z[plant.CV_X]])
    # three stages by trapezoidal steps of their own
    rc = 10e3 * 159e-9
    w = np.zeros(3)
    for k in range(len(v) - 1):
        source = 0.5 * (v[k] + v[k + 1])
        for n in range(3):
            new = (w[n] * (1 - H / (2 * rc)) + source * H / rc) / (1 + H / (2 * rc))
            source = 0.5 * (w[n] + new)
            w[n] = new
    np.testing.assert_allclose(s.caps[0, :3], w, atol=2e-3 * np.max(np.abs(w)))
    assert np.all(s.caps[0, 3:] == 0.0)
    assert np.all(s.caps[1, :3] == 0.0)
    np.testing.assert_array_equal(s.caps[1, 3:], s.caps[0, :3])


def test_a_reference_edge_acts_after_the_switch_delay():
    """80 ns are 2.08 clocks: an edge at clock 24 acts in the next tick."""
    p, s = bench()
    edges = np.zeros((8, 2), np.int64)
    edges[0] = (24, 2)
    tick(p, s, 0, plant.Pins(0, -1, 0, -1, 1), edges)
    assert list(s.switch) == [0, 0, 0, 0]
    assert list(s.late_count) == [0, 0, 1, 0]
    assert s.late_tau_s[2, 0] == pytest.approx(24 * H / 26 + 80e-9 - H, rel=1e-12)
    tick(p, s, 1, plant.Pins(0, -1, 0, -1, 0), edges)
    assert list(s.switch) == [0, 0, 1, 0]
    assert list(s.late_count) == [0, 0, 0, 0]


def test_copy_shares_nothing():
    p, s = bench()
    other = plant.copy(s)
    tick(p, s, 0, plant.Pins(1000, 19, 0, -1, 0), np.zeros((8, 2), np.int64))
    assert np.all(other.z == 0.0)
    assert other.adc.clock[0] != s.adc.clock[0]

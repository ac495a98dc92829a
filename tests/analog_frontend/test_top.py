"""The plant's tick against solutions of its own: chains, coupled modes, pickoff, switches, carries."""

import numpy as np
import pytest
from numba import config
from scipy.linalg import expm

from analog_frontend import tick as units
from analog_frontend import top as plant
from analog_frontend.parts import sid
from fpga_model.jit import hot, kernel
from testbench.config import changed
from testbench.run import build
from tests.testbench.bench_setup import configured, quiet

H = 1e-6
CLOCKS = 3250  # of a frame


@kernel
def tick(p, s, k, pins, edges):
    return units.step(p, s, k, pins, edges)


@kernel
def tune(p, s, rate, code, temp):
    units.retune(p, s, rate, code, temp)


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


@hot
def demodulated(p, s, frames, half_period_clocks, edges, out):
    """A plant at rest whose references follow a square wave; outputs of the demodulators at the end of each frame."""
    quarter, after = 0, 0  # even quarters are edges of the sine references, odd ones of the cosines
    for n in range(frames):
        count = 0
        while after < CLOCKS * (n + 1):
            for d in range(quarter % 2, 4, 2):
                edges[count] = (after - CLOCKS * n, d)
                count += 1
            quarter += 1
            after = int(np.ceil(0.5 * quarter * half_period_clocks))
        units.advance_ticks(p, s, 125 * n, 125, -1, -1, count, edges)
        for d in range(4):
            out[d, n] = s.caps[d, 2] - s.caps[d, 5]


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="40 million ticks")
def test_the_demodulators_put_out_what_white_noise_of_the_density_would_give():
    """C/V noise alone. Each group of capacitors is driven while it is closed, by noise that knows no past: its output
    has the variance of three poles at 1/(2 pi RC) behind white noise, and the two of a demodulator are independent."""
    checked = quiet(plant__sid_charge_c=0.0, plant__sid_c_f=26e-9, noise__seed=3)
    d = checked.device()
    p = build.analog(changed(checked, {"noise.cv": True}), 25.0, 25.0)
    s = plant.reset(p, 0, 0, 25.0)
    tune(p, s, 0.0, 0, 25.0)
    frames = 40 * 8000
    out = np.zeros((4, frames))
    demodulated(p, s, frames, 13e6 / d.fx_hz, np.zeros((64, 2), np.int64), out)
    corner_hz = sid.corner_hz(d.sid_r_ohm * d.sid_c_f)
    density = d.cv_noise_v_per_rthz * d.signal_gain
    want = 2 * density**2 * corner_hz * 3 * np.pi / 8
    # of a variance estimated from noise behind three poles: 2 S4/(T S2^2), S2 and S4 the integrals of H^2 and H^4
    deviation = np.sqrt(2 * (63 / 256) / (corner_hz * 40 * np.pi * (3 / 8) ** 2))
    seen = out[:, 200:].var(axis=1)
    assert np.abs(seen / want - 1).max() < 4.5 * deviation
    assert abs(seen.mean() / want - 1) < 4.5 * deviation / 2
    assert 4.5 * deviation / 2 < 0.025, "sharp enough to see the 7 % between the two laws of sigma"
    assert np.abs(np.corrcoef(out[:, 200:]) - np.eye(4)).max() < 4.5 * deviation


def test_forces_and_dacs_have_the_stated_density_at_the_carrier():
    d = configured().device()
    p = build.analog(configured(), 25.0, 25.0).noise
    fall = np.sinc(d.fx_hz * 5 * H)
    kt = 4 * 1.380649e-23 * 298.15
    force = {m: np.sqrt(kt * d.mass_kg * 2 * np.pi * f / q) for m, f, q in (("x", d.fx_hz, d.qx), ("y", d.fy_hz, d.qy))}
    want = (force["x"], force["y"], d.drive_dac_noise_v_per_rthz, d.sense_dac_noise_v_per_rthz)
    seen = [source.sigma * np.sqrt(10 * H) * fall for source in (p.force_x, p.force_y, p.drive_dac, p.sense_dac)]
    np.testing.assert_allclose(seen, want, rtol=1e-12)


def test_copy_shares_nothing():
    p, s = bench()
    other = plant.copy(s)
    tick(p, s, 0, plant.Pins(1000, 19, 0, -1, 0), np.zeros((8, 2), np.int64))
    assert np.all(other.z == 0.0)
    assert other.adc.clock[0] != s.adc.clock[0]

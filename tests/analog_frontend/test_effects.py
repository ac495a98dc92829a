"""Effects: off is nothing to the last bit, on is the law of its docstring, and each has its fingerprint."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import config
from scipy import signal
from scipy.linalg import expm
from scipy.special import ellipk

from analog_frontend import effects
from analog_frontend.effects import (
    acceleration,
    drive_cubic,
    duffing,
    feedthrough_y,
    law,
    parasitic_mode,
    ports,
    sid_absorption,
)
from analog_frontend.parts import propagator, sid
from analog_frontend.parts.device import Device
from fpga_model.jit import kernel

H = 1e-6
W = 2 * math.pi * 11000.0
MASS = 2.325e-7
FX = 11002.3
K = MASS * (2 * math.pi * FX) ** 2


@kernel
def run(p, z, a, b, c, d, drive, x, v):
    """Free mode, rotated exactly over each tick, with the effects' impulses; records both ends of the state."""
    for k in range(drive.size):
        z[2] = drive[k]
        if p.any_force:
            z[7] += effects.force_impulse(p, z[6], z[2])
        z[6], z[7] = a * z[6] + b * z[7], c * z[6] + d * z[7]
        x[k], v[k] = z[6], z[7]


def free(p, amplitude, ticks, h=H, drive=None):
    m = expm(np.array([[0.0, W], [-((2 * math.pi * FX) ** 2) / W, 0.0]]) * h)
    z = np.zeros(24)
    z[6] = amplitude
    x, v = np.zeros(ticks), np.zeros(ticks)
    run(p, z, m[0, 0], m[0, 1], m[1, 0], m[1, 1], np.zeros(ticks) if drive is None else drive, x, v)
    return x, v


def frequency(x, v, h=H):
    """Mean frequency between the first and the last upward zero crossing; close to one the motion is a sine."""
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    w = 2 * math.pi * FX
    at = [i * h - math.atan(w * x[i] / (W * v[i])) / w for i in (up[0], up[-1])]
    return (len(up) - 1) / (at[1] - at[0])


def duffing_hz(k3, amplitude):
    """Exact frequency of m x'' + K x + k3 x^3 = 0 released at `amplitude`: a complete elliptic integral."""
    w0 = math.sqrt((K + k3 * amplitude**2) / MASS)
    return w0 / (4 * ellipk(k3 * amplitude**2 / (2 * (K + k3 * amplitude**2))))


# off ----------------------------------------------------------------------------------------------------------------

raw = st.lists(st.integers(-(2**63), 2**63 - 1), min_size=24, max_size=24)


@kernel
def off(p, z, volts):
    if p.any_force:
        z[7] += effects.force_impulse(p, z[6], z[2])
    volts[0], volts[1] = effects.cv_volts(p, volts[0], volts[1], z[2], z[2])


@given(raw)
def test_off_is_bit_for_bit_nothing(bits):
    """Any 64 bits: negative zero, subnormal, infinite, not a number."""
    z = np.array(bits, dtype=np.int64).view(np.float64)
    volts = z[:2].copy()
    before = z.tobytes(), volts.tobytes()
    for p in (effects.OFF, effects.collect()):
        off(p, z, volts)
        assert (z.tobytes(), volts.tobytes()) == before


def test_zero_coefficients_are_off():
    assert duffing.design(0.0, MASS, H, W) == duffing.OFF
    assert drive_cubic.design(0.0, 2.72e-7, MASS, H, W) == drive_cubic.OFF
    assert feedthrough_y.design(0.0) == feedthrough_y.OFF
    assert effects.collect() == effects.OFF == effects.Params()


def test_flags_follow_the_ports():
    force = effects.collect(duffing=duffing.design(1e11, MASS, H, W))
    assert (force.any_force, force.any_cv) == (1, 0)
    leak = effects.collect(feedthrough_y=feedthrough_y.design(1e-6))
    assert (leak.any_force, leak.any_cv) == (0, 1)
    # a switched-off record keeps the stage off
    assert effects.collect(duffing=duffing.OFF).any_force == 0


def test_one_effect_leaves_the_other_ports_alone():
    z = np.linspace(1.0, 24.0, 24)
    z[6], z[7], z[2] = 5e-6, 1e-9, 0.1
    before = z.copy()
    volts = np.array([-0.0, 0.25])
    off(effects.collect(drive_cubic=drive_cubic.design(1e-3, 2.72e-7, MASS, H, W)), z, volts)
    assert np.flatnonzero(z != before).tolist() == [7]
    assert volts.tobytes() == np.array([-0.0, 0.25]).tobytes()
    before = z.copy()
    off(effects.collect(feedthrough_y=feedthrough_y.design(1e-3)), z, volts)
    assert (z == before).all()
    assert math.copysign(1.0, volts[0]) == -1.0
    assert volts[1] == 0.25 + 0.5e-3 * (z[2] + z[2])


# laws ---------------------------------------------------------------------------------------------------------------


@given(st.floats(-1e-5, 1e-5), st.floats(-10.0, 10.0), st.floats(-1e12, 1e12), st.floats(-1e-2, 1e-2))
def test_impulses_are_force_times_time_over_momentum(x, v, k3, c3):
    d = duffing.design(k3, MASS, H, W)
    if d.on:
        assert duffing.kick(d, x) == pytest.approx(-k3 * x**3 * H / (MASS * W), rel=1e-14)
    c = drive_cubic.design(c3, 2.72e-7, MASS, H, W)
    if c.on:
        assert drive_cubic.kick(c, v) == pytest.approx(2.72e-7 * c3 * v**3 * H / (MASS * W), rel=1e-14)


def test_duffing_raises_the_frequency_as_the_exact_period_says():
    """1e-4 per square micrometre at 5 um: +10 Hz. The splitting errs by 5e-7 of that, and with h squared."""
    amplitude, k3 = 5e-6, duffing.k3_from_ratio(1e-4, K)
    exact = duffing_hz(k3, amplitude)
    assert exact - FX == pytest.approx(3 / 8 * 1e-4 * 25 * FX, rel=2e-3)
    seconds = 0.02 if config.DISABLE_JIT else 0.2
    miss = {}
    for h in (1e-6, 2e-6, 4e-6):
        p = effects.collect(duffing=duffing.design(k3, MASS, h, W))
        miss[h] = frequency(*free(p, amplitude, round(seconds / h), h), h) - exact
    assert abs(miss[1e-6]) < 1e-6 * (exact - FX)
    assert 3.5 < miss[2e-6] / miss[1e-6] < 4.5
    assert 3.5 < miss[4e-6] / miss[2e-6] < 4.5


def test_duffing_goes_with_the_square_of_the_amplitude_and_conserves_energy():
    k3 = duffing.k3_from_ratio(1e-5, K)
    p = effects.collect(duffing=duffing.design(k3, MASS, H, W))
    ticks = 20000 if config.DISABLE_JIT else 200000
    base = frequency(*free(effects.OFF, 5e-6, ticks))
    assert base == pytest.approx(FX, abs=1e-3)
    small = frequency(*free(p, 2.5e-6, ticks)) - base
    x, v = free(p, 5e-6, ticks)
    assert (frequency(x, v) - base) / small == pytest.approx(4.0, rel=2e-2)
    energy = K * x**2 / 2 + k3 * x**4 / 4 + MASS * (W * v) ** 2 / 2
    tenth = ticks // 10
    assert energy[-tenth:].mean() == pytest.approx(energy[:tenth].mean(), rel=1e-7)


def test_drive_cubic_changes_the_force_by_three_quarters_of_c3_a_squared():
    amplitude_v, c3, k_vf = 0.1, 0.5, 2.72e-7
    ticks = 20000
    drive = amplitude_v * np.sin(2 * np.pi * FX * H * np.arange(ticks))
    p = drive_cubic.design(c3, k_vf, MASS, H, W)
    kicks = np.array([drive_cubic.kick(p, v) for v in drive.tolist()])
    t = H * np.arange(ticks)
    basis = np.stack([f(2 * np.pi * n * FX * t) for n in (1, 3) for f in (np.sin, np.cos)], axis=1)
    s1, c1, s3, c3rd = np.linalg.lstsq(basis, kicks, rcond=None)[0]
    linear = k_vf * amplitude_v * H / (MASS * W)
    assert s1 / linear == pytest.approx(0.75 * c3 * amplitude_v**2, rel=1e-6)
    assert s3 / linear == pytest.approx(-0.25 * c3 * amplitude_v**2, rel=1e-6)
    assert abs(c1) + abs(c3rd) < 1e-9 * linear
    # and through the mode: from rest on resonance the amplitude grows as F t / (2 m w)
    x, v = free(effects.collect(drive_cubic=p), 0.0, ticks, drive=drive)
    grown = math.hypot(x[-1], v[-1])
    force = 0.75 * c3 * k_vf * amplitude_v**3
    assert grown == pytest.approx(force * ticks * H / (2 * MASS * 2 * math.pi * FX), rel=2e-3)


def test_feedthrough_is_the_mean_of_the_tick():
    p = effects.collect(feedthrough_y=feedthrough_y.design(1e-4))
    assert effects.cv_volts(p, 1.0, 2.0, 0.3, 0.5) == pytest.approx((1.0, 2.0 + 1e-4 * 0.4), rel=1e-15)
    stepped = effects.collect(feedthrough_y=feedthrough_y.design(1e-4, 0.25))
    assert effects.cv_volts(stepped, 1.0, 2.0, 0.3, 0.5) == pytest.approx((1.0, 2.0 + 1e-4 * 0.35), rel=1e-15)


# laws whose sizes are derived ----------------------------------------------------------------------------------------


def test_absorption_is_what_switched_stages_with_a_slow_branch_do():
    """Half a turn on, half a turn isolated; in parallel with each capacitor k C behind a resistor, tau together."""
    d, share, half_s = Device(), 0.01, 0.5 / FX
    rc, tau = d.sid_r_ohm * d.sid_c_f, sid_absorption.TAU_S

    def rates(on):
        a = np.zeros((7, 7))  # w1 s1 w2 s2 w3 s3 and the input, which is constant
        for stage in range(3):
            w, s, fed = 2 * stage, 2 * stage + 1, 2 * stage - 2 if stage else 6
            a[w, w] -= share / tau + on / rc
            a[w, s], a[s, w], a[s, s] = share / tau, 1 / tau, -1 / tau
            a[w, fed] += on / rc
        return a

    turn = expm(rates(0) * half_s) @ expm(rates(1) * half_s)
    empty = np.array([0.0] * 6 + [1.0])
    for seconds in (1.0, 5.0, 20.0):
        lacks = 1 - (np.linalg.matrix_power(turn, round(seconds * FX)) @ empty)[4]
        assert lacks == pytest.approx(sid_absorption.tail(share, rc) * math.exp(-seconds / tau), rel=0.03)


def test_a_parasitic_mode_is_its_compliance_at_the_drive_frequency():
    """A resonator of its own at f_d, by a solver of differential equations' transfer function."""
    d, p = Device(), 0.3
    (text,) = parasitic_mode.terms(p, d)
    per_m = propagator.cv_chain(d, "sense", d.temp_ref_degc)[0] * d.signal_gain
    w3 = 2 * math.pi * parasitic_mode.MODE_HZ
    mode = signal.TransferFunction([1 / d.mass_kg], [1, w3 / 1e5, w3**2])
    _, h = signal.freqresp(mode, [2 * math.pi * d.fx_hz])
    assert law.parse(text).coefficient == pytest.approx(p * per_m * d.k_vf_sense_n_per_v * h[0].real, rel=1e-9)
    # what the loops cannot follow of its pole: three poles of the demodulator
    corner = sid.corner_hz(d.sid_r_ohm * d.sid_c_f)
    assert (parasitic_mode.MODE_HZ - d.fx_hz) / corner > 59


def test_acceleration_moves_a_pair_by_its_mismatch():
    """Two plates of parallel-plate electrodes, the second one smaller by 2 s, at d - y0 and d + y0."""
    d = Device()
    gap, s = acceleration.GAP_M, acceleration.MISMATCH
    y0 = 3.0 * acceleration.G_M_PER_S2 / (2 * math.pi * d.fy_hz) ** 2

    def slope(y):
        # dC/dy of both sides, one of them smaller by twice the mismatch of each from their mean
        return (1 + s) / (gap - y) ** 2 + (1 - s) / (gap + y) ** 2

    relative = slope(y0) / slope(0.0) - 1
    assert acceleration.shift(3.0, d) == pytest.approx(relative, rel=0.05)


def test_amplifiers_neither_slew_nor_clip_at_start_up():
    """Why no effect is needed: the converter ends first, and what reaches it rises fifty times too slowly."""
    d = Device()
    largest = d.adc_vref_v * math.pi / 4 / min(d.adc_pga_drive, d.adc_pga_sense)
    assert d.amplifier_slew_v_per_s / (2 * math.pi * d.fx_hz * largest) > 50
    # a full drive, through the worst feedthrough that a configuration may have, is 0.1 V there
    assert largest + 0.01 * d.drive_dac_span_v < d.amplifier_swing_v


# catalogue ----------------------------------------------------------------------------------------------------------


def test_every_effect_says_where_what_and_whence():
    assert [e.INFO.name for e in effects.EFFECTS] == list(effects.Params._fields[2:])
    for e in effects.EFFECTS:
        info = e.INFO
        assert info.port in ports.NAMES
        assert info.mechanism.split()[0] in ports.MECHANISMS
        assert all(info)
        assert e.OFF == e.Params()
        assert e.OFF.on == 0
        assert e.__name__.endswith("." + info.name)


def test_impossible_effects_are_refused():
    with pytest.raises(ValueError, match="k3_n_per_m3"):
        duffing.design(1e20, MASS, H, W)
    with pytest.raises(ValueError, match="duffing"):
        duffing.design(1.0, 0.0, H, W)
    with pytest.raises(ValueError, match="c3_per_v2"):
        drive_cubic.design(2.0, 1e-7, MASS, H, W)
    with pytest.raises(ValueError, match="coefficient"):
        feedthrough_y.design(2.0)
    with pytest.raises(ValueError, match="unknown_effect"):
        effects.collect(unknown_effect=duffing.OFF)

"""The 8 kHz firmware around an averaged gyroscope: start-up, rates, dropouts, lost lock and bandwidth in closed loop.

The plant is a sketch of two resonators seen at the drive frequency, three 50 Hz poles, the delay of the ADC and its
10-code step; it is here to prove gains and sequence, not to predict numbers.
"""

import cmath
import math
from typing import NamedTuple

import numba
import numpy as np
import pytest

from fpga_model import agc, fault_monitor, frequency_tracker, quadrature_loop, rate_loop, registers, sequencer
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel

# every block is compared with its oracle in both modes; interpreted, this loop of 200000 frames takes minutes
pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")

FRAME_S = 1 / 8000
CORDIC_GAIN = 1.646760258
CODE_PER_DEG_S = 57.9e-6 / (4 / 12) * 2**23
WORD_PER_DEG_S = 10.31e-3 / 10 * 2**23
QUADRATURE_PER_V2 = 100 / 4.52**2
SPLIT_HZ, TAU_S = 139.0, 5.79
STATE, AMPLITUDE, OFFSET_HZ, WORD, VOLTS, FLAGS, LOCKED, DRIVE_LOCKED = range(8)


class Firmware(NamedTuple):
    """Parameters, or states, of the blocks at 8 kHz."""

    agc: tuple
    tracker: tuple
    rate: tuple
    quadrature: tuple
    sequencer: tuple


@kernel
def run(p, z, bank, mechanics, plant, rate, quadrature, ok, noise, log):
    """One frame per entry of `rate` (deg/s); `plant` is the complex state, kept for the next call."""
    fx, lag = mechanics
    pole = 1 - math.exp(-2 * math.pi * 50 * FRAME_S)
    codes = (0, 0, 0, 0)
    amp = agc.amplitude(p.agc, z.agc, sequencer.outputs(z.sequencer).agc_mode)
    for n in range(len(rate)):
        f = z.tracker.word * 26e6 / 2**48
        spin = 2j * math.pi * (fx - f)
        fall = 1 / TAU_S
        plant[0] = plant[0] * cmath.exp((spin - fall) * FRAME_S) + 12.18 * amp / 2**23 * FRAME_S
        split = spin - 2j * math.pi * SPLIT_HZ
        volts = z.quadrature.root.y * 5.5 / 2**16
        x = plant[0] / 0.72
        force = (rate[n] + 1j * (quadrature[n] - QUADRATURE_PER_V2 * volts * volts)) * x
        force -= z.rate.loop.y / WORD_PER_DEG_S * cmath.exp(-1j * lag)
        decay = cmath.exp((split - fall) * FRAME_S)
        plant[1] = plant[1] * decay + force * split / (split - fall) * (1 - decay)
        x, y = plant[0], plant[1]
        for k in range(3):
            plant[2 + k] += (x - plant[2 + k]) * pole
            plant[5 + k] += (y - plant[5 + k]) * pole
            x, y = plant[2 + k], plant[5 + k]
        # the sinc filter of the ADC is 1.5 frames late
        late_x, late_y = (plant[9] + plant[8]) / 2, (plant[11] + plant[10]) / 2
        plant[9], plant[8], plant[11], plant[10] = plant[8], x, plant[10], y
        values = (
            late_x.imag * 2**23,
            -late_x.real * 2**23,
            late_y.real * CODE_PER_DEG_S,
            -late_y.imag * CODE_PER_DEG_S,
        )
        if ok[n]:
            codes = (
                10 * round((values[0] + noise[n, 0]) / 10),
                10 * round((values[1] + noise[n, 1]) / 10),
                10 * round((values[2] + noise[n, 2]) / 10),
                10 * round((values[3] + noise[n, 3]) / 10),
            )
        xs, xc, ys, yc = codes
        magnitude = round(CORDIC_GAIN * math.hypot(xs, xc))
        phase = (round(math.atan2(xs, -xc) / (2 * math.pi) * 2**24) + 2**23 & (2**24 - 1)) - 2**23
        i = sequencer.Inputs(
            bank.control,
            0,
            int(ok[n]),
            0,
            xs,
            xc,
            ys,
            yc,
            magnitude,
            phase,
            bank.amplitude_setpoint,
            agc.saturated(p.agc, z.agc),
            rate_loop.saturated(p.rate, z.rate),
            quadrature_loop.railed(p.quadrature, z.quadrature),
        )
        seq = sequencer.step(p.sequencer, z.sequencer, 1, i)
        o = sequencer.outputs(seq)
        a, t, r, q = z.agc, z.tracker, z.rate, z.quadrature
        for slot in range(24):
            at_loop, at_pi = 1 if slot == 0 else 0, 1 if slot == 1 else 0
            a = agc.step(DEFAULT, p.agc, a, at_loop, at_pi, o.agc_mode, magnitude, bank.amplitude_setpoint, 0)
            t = frequency_tracker.step(
                DEFAULT,
                p.tracker,
                t,
                at_loop,
                at_pi,
                o.pll_mode,
                phase,
                o.load,
                o.adjust,
                seq.correction,
                bank.frequency_fixed,
            )
            r = rate_loop.step(DEFAULT, p.rate, r, at_loop, at_pi, o.ftr_mode, ys, 0)
            q = quadrature_loop.step(DEFAULT, p.quadrature, q, at_loop, at_pi, 1 if slot == 4 else 0, o.qsc_mode, yc, 0)
        z = Firmware(a, t, r, q, seq)
        amp = agc.amplitude(p.agc, z.agc, o.agc_mode)
        log[n, 0], log[n, 1], log[n, 2] = seq.state, abs(plant[0]) / 0.72, t.word * 26e6 / 2**48 - fx
        log[n, 3], log[n, 4], log[n, 5] = r.loop.y / WORD_PER_DEG_S, volts, seq.faults.flags
        log[n, 6], log[n, 7] = o.locked, o.drive_locked
    return z


class Gyro:
    """One gyroscope: its plant, its firmware, its time."""

    def __init__(self, fx=11002.3, lag_deg=0.0, seed=1):
        self.p = Firmware(
            agc.design(),
            frequency_tracker.design(),
            rate_loop.design(),
            quadrature_loop.design(),
            sequencer.design(power_up_s=0.01),
        )
        self.z = Firmware(
            agc.State(), frequency_tracker.State(), rate_loop.State(), quadrature_loop.State(), sequencer.State()
        )
        self.bank = registers.State()
        self.mechanics = (float(fx), math.radians(lag_deg))
        self.plant = np.zeros(12, complex)
        self.noise = np.random.default_rng(seed)

    def run(self, seconds, rate=0.0, quadrature=100.0, ok=1):
        n = round(seconds / FRAME_S)
        columns = [
            np.broadcast_to(np.asarray(v, t), n).copy() for v, t in ((rate, float), (quadrature, float), (ok, int))
        ]
        log = np.empty((n, 8))
        noise = self.noise.normal(0, (26, 26, 45, 45), (n, 4))
        self.z = run(self.p, self.z, self.bank, self.mechanics, self.plant, *columns, noise, log)
        return log

    @property
    def state(self):
        return sequencer.STATES[self.z.sequencer.state]

    @property
    def latch(self):
        return self.z.sequencer.faults.latch


def locked(**what):
    """A gyroscope some time after lock."""
    g = Gyro(**what)
    g.run(2.0)
    assert g.state == "LOCKED"
    return g


@pytest.mark.parametrize("fx", [10930.5, 10971.2, 11000.01, 11002.3, 11069.5])
@pytest.mark.parametrize("rate", [0.0, 500.0, -500.0])
def test_start_up_at_every_frequency_and_rate(fx, rate):
    g = Gyro(fx=fx, seed=round(fx))
    log = g.run(2.0, rate=rate)
    assert g.state == "LOCKED"
    assert g.latch == 0
    assert g.z.sequencer.attempts == 0
    lock_s = np.argmax(log[:, LOCKED]) * FRAME_S
    # the sequence itself takes 0.15 s, acquisition 0.15 to 0.4 s, the 1 Hz loop 0.48 s from 100 to 5 deg/s
    assert 0.5 < lock_s < 1.3
    assert np.all(np.diff(np.argmax(log[:, LOCKED : DRIVE_LOCKED + 1], axis=0)) < 0), "the drive locks first"
    assert log[:, AMPLITUDE].max() < 1.0039, "overshoot"
    tail = log[-800:]
    assert np.mean(tail[:, WORD]) == pytest.approx(rate, abs=0.2)
    assert np.abs(np.mean(tail[:, OFFSET_HZ])) < 2e-3
    assert np.mean(tail[:, AMPLITUDE]) == pytest.approx(1, abs=1e-3)


def test_quadrature_is_nulled_by_the_voltage_that_nulls_it():
    g = locked()
    log = g.run(1.5)
    assert np.mean(log[-800:, VOLTS]) == pytest.approx(4.52, abs=2e-3)
    assert np.mean(g.run(1.5, quadrature=60.0)[-800:, VOLTS]) == pytest.approx(4.52 * math.sqrt(0.6), abs=4e-3)


@pytest.mark.parametrize("lag_deg", [0.0, 8.88])
def test_rate_steps_and_full_rates_keep_the_lock(lag_deg):
    g = locked(lag_deg=lag_deg)
    rates = np.repeat([300.0, 0.0, -300.0, 0.0, 150.0, -150.0], 2400)
    log = g.run(len(rates) * FRAME_S, rate=rates)
    ramp = np.interp(np.arange(24000), [0, 6000, 12000, 18000, 24000], [0, 500, 0, -500, 0])
    log = np.vstack([log, g.run(3.0, rate=ramp)])
    assert log[:, DRIVE_LOCKED].all()
    assert log[:, LOCKED].all()
    # with the phase of the force uncompensated, the quadrature it leaks takes the voltage to 0 V or to the rail
    assert g.latch & ~fault_monitor.QSC_RAIL == 0
    assert bool(g.latch & fault_monitor.QSC_RAIL) == (lag_deg > 0)


def test_short_dropout_keeps_the_lock():
    g = locked()
    log = g.run(0.05, rate=5.0, ok=0)
    assert (log[:, FLAGS] == fault_monitor.STALE).all()
    log = g.run(1.0, rate=5.0)
    assert log[:, LOCKED].all()
    assert np.mean(log[-800:, WORD]) == pytest.approx(5, abs=0.2)
    assert g.latch == fault_monitor.STALE


def test_long_dropout_stops_the_drive_and_starts_again():
    g = locked()
    log = g.run(0.3, ok=0)
    assert g.state == "STANDBY"
    assert np.count_nonzero(log[:, STATE] == sequencer.LOCKED) == pytest.approx(800, abs=2)
    assert g.z.agc.loop.y == 0
    log = g.run(1.5)
    assert g.state == "LOCKED"
    assert log[:, AMPLITUDE].max() < 1.1, "the kick adds to what still rings"


def test_dead_adc_in_acquire_does_not_overdrive():
    g = Gyro()
    log = g.run(0.2)
    while g.state != "ACQUIRE":
        log = g.run(0.01)
    g.run(0.02)
    log = g.run(0.5, ok=0)
    assert log[:, AMPLITUDE].max() < 1
    assert g.state == "STANDBY"
    g.run(1.5)
    assert g.state == "LOCKED"


def test_lost_lock_starts_again():
    g = locked()
    g.plant[0] *= 0.4
    log = g.run(0.2)
    assert sequencer.KICK in log[:, STATE]
    assert g.latch == fault_monitor.LOST_LOCK
    assert g.z.rate.loop.y == 0
    g.run(1.5)
    assert g.state == "LOCKED"
    assert g.z.sequencer.faults.flags == 0


def test_resonance_outside_the_search_is_refused():
    g = Gyro(fx=11090.0)
    g.run(1.0)
    assert g.z.sequencer.attempts >= 5
    assert g.latch == fault_monitor.SEARCH_FAILED
    assert g.state in ("KICK", "DECAY", "SEARCH")


def test_bandwidth_of_the_rate():
    """-3 dB between 18 and 33 Hz, and no peak above 3 dB."""
    g = locked()
    t = np.arange(8000) * FRAME_S
    gain = {}
    for hz in (4.0, 10.0, 18.0, 33.0):
        word = g.run(1.0, rate=20 * np.sin(2 * np.pi * hz * t))[:, WORD]
        kept = slice(4000, 8000)
        gain[hz] = abs(np.mean(word[kept] * np.exp(-2j * np.pi * hz * t[kept]))) * 2 / 20
    assert gain[4.0] == pytest.approx(1, abs=0.05)
    assert gain[18.0] > 10 ** (-3 / 20) > gain[33.0]
    assert max(gain.values()) < 10 ** (3 / 20)

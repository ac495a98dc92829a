"""Start-up predicted: the drive's envelope through the sequencer's states, then the linear loops of the sense mode.

    a        drive signal at the converter (magnitude LSB), complex, in the frame of the DDS:
             a' = -(w/2Q + j 2 pi (f_word - f_x)) a + G V e^(-j (xe1 + xe2')),   V the amplitude word
    seen     three SID poles, the converter's (1, 4, 1)/6 over three frames, the SID's offset
    states   KICK, DECAY, SEARCH, RETUNE, ACQUIRE, SETTLE with the firmware's own Params; BALANCE by `paper.loop.loop`
    promise  slowest corner of the tolerances, and MARGIN for noise and what is left out

Left out   noise, interaction of drive and sense
Source     docs/design_of_loops.md
"""

import cmath
import itertools
import math
from typing import NamedTuple

import numpy as np

from analog_frontend.parts import sid
from fpga_model import cordic, frequency_tracker, pi
from testbench.config import changed
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.run import build
from testbench.run.budget import budget

MARGIN = 1.05
LIMIT_S = 60.0
BLOCK = 64  # frames that one product plays
BETWEEN_STATES = 3  # frames from power-up to the kick that no timer counts
COEF = 2.0**pi.COEF.f


class StartUp(NamedTuple):
    """Instants (s from power-on) at which states end, or what failed; `lock_s` is None then."""

    found_hz: float | None  # correction of the search
    magnitude_um: float  # seen at the end of the search
    reached_s: float | None  # 95 % of the set-point
    drive_s: float | None  # drive locked
    lock_s: float | None
    failure: str = ""


class _Drive:
    """Envelope of the drive with the demodulator behind it, a frame a step."""

    def __init__(self, config):
        d, self.design = config.device(), config.design_record()
        self.frame_s = 1 / self.design.frame_hz
        gain = float(cordic.gain(self.design.cordic_iterations))
        plant_as_nominal = changed(config, {f"nominal.{k}": v for k, v in config.plant.model_dump().items()})
        phases = budget(config)
        lag = math.radians(phases.node_deg()["xe1"] + phases.loop_deg()["xe2"])
        self.gain = build.nominal(plant_as_nominal)["plant_fs_per_s"] * gain * cmath.exp(-1j * lag)
        self.fx_hz, self.decay = d.fx_hz, math.pi * d.fx_hz / d.qx
        self.stage = -math.expm1(-2 * math.pi * sid.corner_hz(d.sid_r_ohm * d.sid_c_f) * self.frame_s)
        self.a, self.o, self.past = 0j, [0j] * 3, [0j] * 2
        sine_v, cosine_v = loop_parameters(config).sid_offset_v  # both pairs of channels have the same switches
        self.offset = complex(-cosine_v, sine_v) * d.adc_pga_drive / d.adc_vref_v * 2**23 * gain

    def step(self, word_hz, amplitude):
        """One frame; the signal that the firmware has in the next one."""
        rate = -self.decay - 2j * math.pi * (word_hz - self.fx_hz)
        grown = cmath.exp(rate * self.frame_s)
        self.a = self.a * grown + self.gain * amplitude * (grown - 1) / rate
        stage_signal = self.a
        for n in range(3):
            self.o[n] += self.stage * (stage_signal - self.o[n])
            stage_signal = self.o[n]
        converter_signal = (self.past[0] + 4 * self.past[1] + stage_signal) / 6
        self.past = [self.past[1], stage_signal]
        return converter_signal + self.offset


def _turns(z):
    return cmath.phase(z) / (2 * math.pi)


class _Pi:
    """pi.py in floating point."""

    def __init__(self, p):
        self.kp, self.ki, self.lo, self.hi, self.acc = p.kp / COEF, p.ki / COEF, p.lo, p.hi, 0.0

    def step(self, e, run=True):
        """The output for an error; without `run` the integrator is held."""
        if run:
            self.acc = min(max(self.acc + self.ki * e, self.lo), self.hi)
        return min(max(self.kp * e + self.acc, self.lo), self.hi)


def _simulate_search(p, drive, word_hz, kick):
    """(frames, correction Hz, magnitude): from the kick to the end of the search."""
    drive_signal = 0j
    for n in range(p.kick + p.decay):
        drive_signal = drive.step(word_hz, kick if n < p.kick else 0)
    rotation = 0.0
    for _ in range(p.search):
        before, drive_signal = drive_signal, drive.step(word_hz, 0)
        rotation += _turns(drive_signal * before.conjugate())
    return p.kick + p.decay + p.search, rotation / p.search / drive.frame_s, abs(drive_signal)


def _drive_locked(p, control, drive, word_hz, setpoint):
    """(frames to 95 %, frames to drive lock) from ACQUIRE on; None where a state takes longer than its limit."""
    agc, pll = _Pi(control.agc.loop), _Pi(control.frequency_tracker.loop)
    limit_agc, limit_pll = p.lock.limit_in[0] / 2**16 * setpoint, p.lock.limit_in[1]
    amplitude, offset, reached, good = 0.0, 0.0, None, [0, 0]
    per_hz = frequency_tracker.word_per_hz(drive.design)
    for n in range(2 * p.timeout):
        drive_signal = drive.step(word_hz + offset, amplitude)
        error, phase = setpoint - abs(drive_signal), _turns(drive_signal) * 2**24
        amplitude = agc.step(error, reached is not None)
        offset = pll.step(phase) / per_hz
        if reached is None:
            if abs(drive_signal) * 2**16 >= setpoint * p.reached:
                reached = n
            elif n >= p.timeout:
                return None, None
            continue
        good = [good[0] + 1 if abs(error) <= limit_agc else 0, good[1] + 1 if abs(phase) <= limit_pll else 0]
        if good[0] >= p.lock.frames_in[0] and good[1] >= p.lock.frames_in[1]:
            return reached, n
        if n - reached >= p.timeout:
            break
    return reached, None


def _sense_codes(config):
    """Yield |sine and cosine code| (BLOCK, 2) of the linear loops, frame by frame from BALANCE on."""
    q = loop_parameters(config)
    frame, gains = lp.frame(q), lp.gains(q)
    a, b, codes, codes_b = lp.assemble(frame, gains)
    inputs = np.array([q.dxy_n_s_per_m / (2 * q.coriolis_mass_kg), q.kxy_n_per_m, *q.sid_offset_v])
    still = lp.Loop(*lp.assemble(frame, gains, 0.0, 0.0)[:2], None, None, None, q.frame_s)
    n = len(a)
    # constant inputs as one more state, so that a block of frames is one product
    transition_matrix, output_matrix = np.eye(n + 1), np.zeros((2, n + 1))
    transition_matrix[:n, :n], transition_matrix[:n, n] = a, b @ inputs
    output_matrix[:, :n], output_matrix[:, n] = codes, codes_b @ inputs
    rows, power = [], np.eye(n + 1)
    for _ in range(BLOCK):
        rows.append(output_matrix @ power)
        power = transition_matrix @ power
    state = np.append(lp.steady_state(still, inputs), 1.0)
    for _ in range(round(LIMIT_S / q.frame_s / BLOCK)):
        yield np.abs(np.stack(rows) @ state)
        state = power @ state


def _balance_frames(p, config):
    """Frames from BALANCE to all four in lock; None if it takes longer than LIMIT_S."""
    good, locked, n = [0, 0], [False, False], 0
    for block in _sense_codes(config):
        for codes in block:
            for k in range(2):
                good[k] = good[k] + 1 if codes[k] <= p.lock.limit_in[2 + k] else 0
                stays_locked = locked[k] and codes[k] <= p.lock.limit_out[2 + k]
                locked[k] = stays_locked or good[k] >= p.lock.frames_in[2 + k]
            if all(locked):
                return n
            n += 1
    return None


class Driven(NamedTuple):
    """The drive's part of a start-up: what does not depend on the sense loops."""

    so_far: StartUp
    frames: int


def predict_drive_start(config):
    """`Driven` of the board [plant]: from power-on to the lock of the drive."""
    control = build.firmware(config).control
    p, setpoint = control.sequencer, _setpoint(config)
    drive = _Drive(config)
    word_hz = config.firmware.nominal_frequency_hz
    search_frames, correction_hz, magnitude = _simulate_search(p, drive, word_hz, control.agc.kick)
    first = StartUp(correction_hz, magnitude / setpoint * config.firmware.amplitude_um, None, None, None)
    limit_hz = p.search_limit / frequency_tracker.word_per_hz(drive.design)
    if magnitude < p.min_magnitude:
        needed = p.min_magnitude / setpoint * config.firmware.amplitude_um
        text = f"search: signal of {first.magnitude_um:.3g} um is below {needed:.3g} um (firmware.search_min_v)"
        return Driven(first._replace(failure=text), 0)
    if abs(correction_hz) > limit_hz:
        text = f"search: correction of {correction_hz:.4g} Hz is above firmware.search_limit_hz = {limit_hz:.4g} Hz"
        return Driven(first._replace(failure=text), 0)
    word_hz += correction_hz
    for _ in range(p.retune):
        drive.step(word_hz, 0)
    frames = p.power_up + p.init + p.recover + BETWEEN_STATES + search_frames + p.retune
    reached, settled = _drive_locked(p, control, drive, word_hz, setpoint)
    if settled is None:
        state = (
            "the amplitude does not reach firmware.acquire_share" if reached is None else "the drive does not settle"
        )
        what = f"{state} within firmware.acquire_timeout_s = {p.timeout * drive.frame_s:g} s"
        return Driven(first._replace(failure=what), 0)
    ends = [(frames + n) * drive.frame_s for n in (reached, settled)]
    return Driven(first._replace(reached_s=ends[0], drive_s=ends[1]), frames + settled)


def add_sense_lock(before, config):
    """`StartUp` behind a `Driven`, with the sense loops of a configuration."""
    if before.so_far.failure:
        return before.so_far
    balance_frames = _balance_frames(build.firmware(config).control.sequencer, config)
    if balance_frames is None:
        return before.so_far._replace(failure=f"the sense loops do not settle within {LIMIT_S:g} s")
    return before.so_far._replace(lock_s=(before.frames + balance_frames) / config.design_record().frame_hz)


def predict(config):
    """`StartUp` of the board [plant] with the firmware of [nominal]."""
    return add_sense_lock(predict_drive_start(config), config)


def _setpoint(config):
    return dict(build.register_writes(config))["amplitude_setpoint"]


def corners(config):
    """Configurations whose [plant] stands at corners of the tolerances of [nominal].

    Signs of frequency (with it Q), of the SID's capacitor, and of what makes the quadrature loop slow: a small pickoff
    gain of y, a small amplitude of x, a large split.
    """
    n = config.nominal
    root = math.sqrt(n.q_tolerance)
    corner_configs = []
    for f, fast, capacitor in itertools.product((-1, 1), (-1, 1), (-1, 1)):
        fx = n.fx_hz * (1 + f * n.f_tolerance)
        split = (n.fx_hz - n.fy_hz) * (1 - fast * n.split_tolerance)
        values = {"fx_hz": fx, "fy_hz": fx - split, "sid_c_f": n.sid_c_f * (1 + capacitor * n.capacitor_tolerance)}
        for sign, names in (
            (fast, ("k_vf_drive_n_per_v", "k_vf_sense_n_per_v", "dcdy_f_per_m")),
            (-fast, ("dcdx_f_per_m",)),
        ):
            values |= {name: getattr(n, name) * (1 + sign * n.transducer_tolerance) for name in names}
        values |= {name: getattr(n, name) * root ** (-f) for name in ("qx", "qy")}
        corner_configs.append(changed(config, {f"plant.{key}": value for key, value in values.items()}))
    return corner_configs


def slowest(predicted_start_ups):
    """The latest lock of some start-ups; one that fails is later than all."""
    return max(predicted_start_ups, key=lambda s: math.inf if s.lock_s is None else s.lock_s)


def promised_s(start_up):
    """Time of lock (s) that the slowest start-up allows to promise; None if it fails."""
    return None if start_up.lock_s is None else MARGIN * start_up.lock_s

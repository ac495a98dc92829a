"""Oracle: the sense channel as circuits at the carrier, half a microsecond at a time; takes nothing from `loop`.

Real signals: mode, three C/V poles, demodulator (three stages with two groups of capacitors, or a plain low-pass behind
a sign), sinc3 by its definition, a PI. The force is a tone, so that the exponential of a step is exact.
"""

import math

import numpy as np
from scipy.linalg import expm

STEP_S = 0.5e-6
FRAME_STEPS = 250
TAPS = np.convolve(np.convolve(np.ones(64), np.ones(64)), np.ones(64)) / 64**3
SAMPLES = np.round(np.arange(64) * 125 / 64 / 0.5).astype(int)


class Carrier:
    """State and clock; `parts` gives numbers of parts, nothing else."""

    def __init__(self, parts, stages=3):
        p, w = parts, parts.w_rad_s
        self.p, self.stages, self.time_s = parts, stages, 0.0
        n = 2 + len(p.cv_s)
        a = np.zeros((n + 2, n + 2))
        a[0, 1] = 1.0
        a[1, 0], a[1, 1], a[1, n] = -(p.wy_rad_s**2), -p.wy_rad_s / p.qy, 1 / p.mass_kg
        for k, tau in enumerate(p.cv_s):
            a[2 + k, 2 + k] = -1 / tau
            a[2 + k, 0 if k == 0 else 1 + k] = (p.cv_v_per_m if k == 0 else 1.0) / tau
        a[n, n + 1], a[n + 1, n] = w, -w
        self.step, self.state, self.seen = expm(a * STEP_S), np.zeros(n + 2), n - 1
        self.caps = np.zeros((2, 2, 3))
        self.samples = np.zeros((2, 192))
        self.chain = p.k_vf_n_per_v * p.volts_per_word * -1j * np.exp(-1j * p.ye1_rad)
        for tau in p.chain_s:
            self.chain /= abs(1 + 1j * w * tau)
        x = -p.amplitude_m * np.exp(1j * p.xe2_rad)
        self.coriolis = -2 * p.coriolis_mass_kg * 1j * w * x

    def frame(self, word, rate_rad_s):
        """One frame under a constant word and rate; returns volts of both channels at its end."""
        p, w, n = self.p, self.p.w_rad_s, len(self.state) - 2
        force = (self.chain * word + self.coriolis * rate_rad_s) * np.exp(1j * w * self.time_s)
        self.state[n], self.state[n + 1] = force.real, -force.imag
        rate = 4 * math.pi * p.sid_hz if self.stages == 3 else 2 * math.pi * p.sid_hz
        decay = 1 - math.exp(-STEP_S * rate)
        outputs = np.empty((2, FRAME_STEPS))
        begin_s = self.time_s
        for k in range(FRAME_STEPS):
            before = self.state[self.seen]
            self.state = self.step @ self.state
            volts = (before + self.state[self.seen]) / 2
            angle = w * (begin_s + (k + 0.5) * STEP_S) - p.switch_rad
            for channel, positive in enumerate((math.sin(angle) > 0, math.cos(angle) > 0)):
                if self.stages == 3:
                    group = self.caps[channel, 0 if positive else 1]
                    group += decay * (np.array([volts, group[0], group[1]]) - group)
                    outputs[channel, k] = self.caps[channel, 0, 2] - self.caps[channel, 1, 2]
                else:
                    signed = 2 * volts if positive else -2 * volts
                    self.caps[channel, 0, 0] += decay * (signed - self.caps[channel, 0, 0])
                    outputs[channel, k] = self.caps[channel, 0, 0]
        self.time_s = begin_s + FRAME_STEPS * STEP_S
        self.samples = np.hstack([self.samples[:, 64:], outputs[:, SAMPLES]])
        return outputs[:, -1]

    def codes(self):
        """What the converter sends of the last three frames."""
        return self.samples[:, -len(TAPS) :] @ TAPS * self.p.code_per_v

    def closed(self, frames, rate_rad_s):
        """Words of the force loop alone, from rest."""
        p, words, acc, word, coming = self.p, np.empty(frames), 0.0, 0.0, 0.0
        for k in range(frames):
            self.frame(word, rate_rad_s)
            error = self.codes()[0]
            acc += p.word_ki * error
            word, coming = coming, p.word_kp * error + acc
            words[k] = word
        return words

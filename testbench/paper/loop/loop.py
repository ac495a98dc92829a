"""Force-to-rebalance and quadrature loop as one linear system, exact from frame to frame.

    envelopes   every signal at the drive frequency is Re V(t) e^(j psi), psi the phase of the drive's sgn(sin) pin:
                a part v' = a v + ... becomes V' = (a - j w) V + ...; nothing is dropped, so both sidebands are there
    x           -Ax e^(j xe2'), because the drive's demodulator sees it in quadrature
    force on y  k_vf v - (2 m_c Omega + d_xy) x' - kappa x;  v behind the chain's poles, kappa = k_xy - kq V_q^2
    SID         RC at half its rate: o_1' = 2 pi f3 (4/pi Re(S j e^(j sw)) - o_1), two more; cosine: Re(S e^(j sw));
                S = V - j V'/w: the first capacitor is read while it is being charged
    ADC         190 taps of sinc3 at the modulator's instants, 64 a frame by default, in three sums as the part has them
    firmware    word = kp e + acc, acc += ki e, acts at `word_acts_s` of the next frame; u += ki_q e, acts a frame later

    frame k     z(k+1) = F z(k) + G (Omega, kappa, word before, word after word_acts_s, offsets)        by expm
    loop        s(k+1) = A s(k) + B (Omega, k_xy, offset_sin, offset_cos),   s = z, sums, words         `Loop`

Limits    linear: no rounding (`limit_cycles`), no rails; the drive mode is not disturbed, because y is nulled
Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm, matrix_balance

from analog_frontend.parts import adc
from testbench.paper.loop.loop_parameters import LoopParameters

RATE, STIFFNESS, OFFSET_SIN, OFFSET_COS = range(4)  # what acts on the loop: rad/s, N/m, V, V
DEG = math.pi / 180
# columns of the frame's inputs
IN_RATE, IN_KAPPA, IN_BEFORE, IN_AFTER, IN_SIN, IN_COS = range(6)


def _plant(p: LoopParameters):
    """Generator (A, B, C) of everything between the word and the converter, real; inputs: rate, kappa, word."""
    w = p.w_rad_s
    n_chain, n_cv = len(p.chain_s), len(p.cv_s)
    y, v, cv = n_chain, n_chain + 1, n_chain + 2
    size = cv + n_cv
    a = np.zeros((size, size), complex)
    b = np.zeros((size, 3), complex)
    for n, tau in enumerate(p.chain_s):
        a[n, n] = -1 / tau
        if n:
            a[n, n - 1] = 1 / tau
    chain_rad = sum(math.atan(w * tau) for tau in p.chain_s)
    before_chain = -1j * np.exp(1j * (p.sense_turn_rad - (p.ye1_rad - chain_rad)))
    b[0, 2] = p.volts_per_word * before_chain / p.chain_s[0]
    # v is the velocity by w, so that both states of the mode are metres
    a[y, v] = w
    a[v, y] = -(p.wy_rad_s**2) / w
    a[v, v] = -p.wy_rad_s / p.qy
    per_force = 1 / (p.mass_kg * w)
    a[v, n_chain - 1] = p.k_vf_n_per_v * per_force
    x = -p.amplitude_m * np.exp(1j * p.xe2_rad)
    b[v, 0] = -2 * p.coriolis_mass_kg * 1j * w * x * per_force
    b[v, 1] = -x * per_force
    for n, tau in enumerate(p.cv_s):
        a[cv + n, cv + n] = -1 / tau
        a[cv + n, cv + n - 1] = 1 / tau
    a[cv, cv - 1] = 0.0
    a[cv, y] = p.cv_v_per_m / p.cv_s[0]
    a -= 1j * w * np.eye(size)
    switch_phasor = np.exp(1j * (p.switch_rad - p.sense_turn_rad))
    rate = 2 * math.pi * p.sid_hz
    sid = np.diag(np.full(p.sid_stages, -rate)) + np.diag(np.full(p.sid_stages - 1, rate), -1)
    real = np.block([[a.real, -a.imag], [a.imag, a.real]])
    full = block_diag(real, sid, sid)
    out = np.zeros((2, len(full)))
    half_wave = -1j * a[-1] / w if p.sid_switched else np.zeros(size, complex)
    half_wave[-1] += 1.0
    for channel, turn in enumerate((1j * switch_phasor, switch_phasor)):
        first = 2 * size + channel * p.sid_stages
        full[first, :size] = rate * p.sid_gain * (turn * half_wave).real
        full[first, size : 2 * size] = -rate * p.sid_gain * (turn * half_wave).imag
        out[channel, first + p.sid_stages - 1] = 1.0
    return full, np.vstack([b.real, b.imag, np.zeros((2 * p.sid_stages, 3))]), out


class Frame(NamedTuple):
    """One frame: state, and volts of the three conversions that its samples belong to, oldest conversion first."""

    f: np.ndarray  # (n, n)
    g: np.ndarray  # (n, 6)
    c: np.ndarray  # (3, 2, n) volts of sine and cosine
    d: np.ndarray  # (3, 2, 6)


def _piece_map(a, b, seconds):
    n, m = b.shape
    both = expm(np.block([[a, b], [np.zeros((m, n + m))]]) * seconds)
    return both[:n, :n], both[:n, n:]


def frame(p: LoopParameters):
    """`Frame` of the parts: samples at equal distances, 1.953 us by default, the word changing at `word_acts_s`."""
    a, b, out = _plant(p)
    sample_s = p.frame_s / p.samples
    old, new = np.zeros((len(a), 6)), np.zeros((len(a), 6))
    for wide, column in ((old, IN_BEFORE), (new, IN_AFTER)):
        wide[:, [IN_RATE, IN_KAPPA, column]] = b
    at, part_s = divmod(p.word_acts_s, sample_s)
    plain, change = (_piece_map(a, old, sample_s), (_piece_map(a, old, part_s), _piece_map(a, new, sample_s - part_s)))
    after = _piece_map(a, new, sample_s)
    f, g = np.eye(len(a)), np.zeros((len(a), 6))
    c, d = np.zeros((3, 2, len(a))), np.zeros((3, 2, 6))
    for m in range(p.samples):
        weights = [w / p.samples**3 for w in reversed(adc.weights.py_func(p.samples, m))]
        for k, weight in enumerate(weights):
            c[k] += weight * (out @ f)
            d[k] += weight * (out @ g)
            d[k, 0, IN_SIN] += weight
            d[k, 1, IN_COS] += weight
        for phi, gamma in change if m == at else (plain if m < at else after,):
            f, g = phi @ f, phi @ g + gamma
    return Frame(f, g, c, d)


class Gains(NamedTuple):
    """Of the firmware's two controllers, and of the converters next to them."""

    kp: float
    ki: float
    u_ki: float
    code_per_v: float
    u_n_per_m: float  # stiffness taken away per LSB of u


def gains(p: LoopParameters):
    return Gains(p.word_kp, p.word_ki, p.u_ki, p.code_per_v, p.u_full_n_per_m / 2.0**32)


class Loop(NamedTuple):
    """Closed loop from frame to frame; `row` picks the word that a record's row shows, `codes` what the ADC sends."""

    a: np.ndarray
    b: np.ndarray  # columns RATE, STIFFNESS, OFFSET_SIN, OFFSET_COS
    row: np.ndarray
    codes: np.ndarray  # (2, n) of the state
    codes_b: np.ndarray  # (2, 4) of the inputs
    frame_s: float


NEXT_SIN, NEXT_COS, LATER_SIN, LATER_COS, WORD, WORD_BEFORE, ACC, U, U_BEFORE = range(-9, 0)
TAIL = 9


def assemble(fr: Frame, k: Gains, ftr=1.0, qsc=1.0, broken=False):
    """(A, B, code rows, code inputs[, word column]) of the loop over one frame.

    ftr, qsc  factors on the gains of the two controllers; 0 opens one
    broken    the word that acts is an input of its own, and the controller's word is still made: (..., W)
    """
    n = len(fr.f)
    size = n + TAIL
    a, b, word_in = np.zeros((size, size)), np.zeros((size, 4)), np.zeros(size)
    hold = np.zeros((6, size))
    hold_b = np.zeros((6, 4))
    hold[IN_KAPPA, U_BEFORE] = -k.u_n_per_m
    hold[IN_BEFORE, WORD_BEFORE] = 1.0
    hold[IN_AFTER, WORD] = 1.0
    hold_b[IN_RATE, RATE] = hold_b[IN_KAPPA, STIFFNESS] = hold_b[IN_SIN, OFFSET_SIN] = hold_b[IN_COS, OFFSET_COS] = 1.0
    state = np.zeros((n, size))
    state[:, :n] = np.eye(n)
    a[:n] = fr.f @ state + fr.g @ hold
    b[:n] = fr.g @ hold_b
    sums = [fr.c[j] @ state + fr.d[j] @ hold for j in range(3)]
    sums_b = [fr.d[j] @ hold_b for j in range(3)]
    codes, codes_b = k.code_per_v * sums[0], k.code_per_v * sums_b[0]
    for channel, (now, later) in enumerate(((NEXT_SIN, LATER_SIN), (NEXT_COS, LATER_COS))):
        codes[channel, now] += k.code_per_v
        a[now], b[now] = sums[1][channel], sums_b[1][channel]
        a[now, later] += 1.0
        a[later], b[later] = sums[2][channel], sums_b[2][channel]
    a[ACC] = ftr * k.ki * codes[0]
    a[ACC, ACC] += 1.0 if ftr else 0.0
    b[ACC] = ftr * k.ki * codes_b[0]
    word, word_b = a[ACC] + ftr * k.kp * codes[0], b[ACC] + ftr * k.kp * codes_b[0]
    a[WORD_BEFORE, WORD] = 1.0
    a[U] = -qsc * k.u_ki * codes[1]
    a[U, U] += 1.0 if qsc else 0.0
    b[U] = -qsc * k.u_ki * codes_b[1]
    a[U_BEFORE, U] = 1.0
    if broken:
        word_in[WORD] = 1.0
        return a, b, codes, codes_b, word_in, word
    a[WORD], b[WORD] = word, word_b
    return a, b, codes, codes_b


def close(p: LoopParameters, ftr=1.0, qsc=1.0):
    """`Loop` of the parts, with factors on the gains of the two controllers."""
    a, b, codes, codes_b = assemble(frame(p), gains(p), ftr, qsc)
    row = np.zeros(len(a))
    row[WORD_BEFORE] = 1.0
    return Loop(a, b, row, codes, codes_b, p.frame_s)


def response(loop: Loop, f_hz, column=RATE):
    """Word of a record's row per unit of an input that is a tone at f (Hz), as complex numbers; phase against row time.

    The input is a staircase, constant over each frame at its value in the middle: what an engine is told.
    """
    z = np.exp(2j * math.pi * np.atleast_1d(f_hz) * loop.frame_s)
    return resolvent(loop.a, z, loop.b[:, column]) @ loop.row * np.sqrt(z)


def resolvent(a, z, column):
    """(z - A)^-1 column of many frequencies, (frequencies, n)."""
    right = np.broadcast_to(column[:, None], (len(z), len(a), 1))
    return np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, right)[:, :, 0]


def return_ratio(p: LoopParameters, f_hz, qsc=1.0):
    """L of the FTR loop, broken at the word with the quadrature loop closed; the distance to L = -1 is the margin."""
    a, _, _, _, word_in, word = assemble(frame(p), gains(p), 1.0, qsc, broken=True)
    z = np.exp(2j * math.pi * np.atleast_1d(f_hz) * p.frame_s)
    return -resolvent(a, z, word_in) @ word


class Pole(NamedTuple):
    """A pole of the loop, as a decaying oscillation."""

    hz: float
    tau_s: float  # negative if it grows
    z: complex

    @property
    def damping(self):
        rate = math.hypot(1 / self.tau_s, 2 * math.pi * self.hz)
        return 1 / self.tau_s / rate


def poles(loop: Loop):
    """Poles above the real axis, slowest decay first."""
    upper_poles = []
    for z in np.linalg.eigvals(loop.a):
        if abs(z) > 1e-6 and z.imag >= -1e-12:
            s = np.log(z) / loop.frame_s
            upper_poles.append(
                Pole(float(abs(s.imag)) / (2 * math.pi), float(-1 / s.real) if s.real else math.inf, complex(z))
            )
    return sorted(upper_poles, key=lambda pole: -abs(pole.z))


def radius(loop: Loop):
    """Largest magnitude of a pole; below 1 the loop is stable."""
    return float(np.max(np.abs(np.linalg.eigvals(loop.a))))


def steady_state(loop: Loop, inputs):
    """State at rest under constant inputs (rad/s, N/m, V, V).

    Metres stand beside words: without balancing the solution would be off by 1e-3 where the split is small.
    """
    a, (scale, _) = matrix_balance(loop.a, permute=False, separate=True)
    return scale * np.linalg.solve(np.eye(len(a)) - a, loop.b @ np.asarray(inputs, float) / scale)


def simulate_words(loop: Loop, inputs, state=None):
    """Words of the rows, frame by frame; inputs (frames, 4). Returns (words, state after)."""
    state = np.zeros(len(loop.a)) if state is None else state
    words = np.empty(len(inputs))
    for k, u in enumerate(inputs):
        words[k] = loop.row @ state
        state = loop.a @ state + loop.b @ u
    return words, state

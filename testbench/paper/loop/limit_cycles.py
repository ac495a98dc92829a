"""The loops with their rounding: frame by frame, linear plant, the firmware's own integers; what rests, what hunts.

    converter   10 floor(v / 10 LSB + 1/2)             a dead band of +-5 codes, 0.0035 deg/s, if nothing dithers it
    PI          kp e + acc, ties up, exact integers    no dead zone of its own
    force       codes of word * sine, rounded to the converter's bits: in phase it gives N(word) of the describing
                function a = 4/pi sum over k of sqrt(1 - ((k - 1/2)/A)^2), (k - 1/2) < A,   A = |word| / word_per_code
                nothing below half an LSB, 1.27 times too much at 0.71 LSB, 1 far above
    V_q         floor(sqrt(u)) of 16 bits: one code is 2 V_q dV kq / k_xy of the quadrature

Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import LoopParameters, loop_parameters
from testbench.run import build

FAR_CODES = 256  # beyond it rounding is lost in the sine's own sweep


def force_amplitude(word, word_per_code):
    """In-phase amplitude (word LSB) of the rounded staircase of a sine of this amplitude (word LSB)."""
    size = abs(word) / word_per_code
    if size > FAR_CODES:
        return float(word)
    k = np.arange(0.5, size, 1.0)
    return (
        math.copysign(4 / math.pi * word_per_code * float(np.sum(np.sqrt(1 - (k / size) ** 2))), word)
        if len(k)
        else 0.0
    )


class Hunt(NamedTuple):
    """Rows of a run of the quantised loops."""

    word: np.ndarray
    quadrature_code: np.ndarray
    codes: np.ndarray  # (frames, 2) sine and cosine


def simulate_hunt(config, rate_dps, seconds, code_noise=0.0, seed=1, p: LoopParameters | None = None, settled=True):
    """`Hunt` at a rate (deg/s): a number, or one value per frame.

    code_noise  rms (codes) of white noise at the converter, before rounding
    settled     begin where the linear loops rest; else from nothing
    """
    p = p or loop_parameters(config)
    fr = lp.frame(p)
    firmware = build.firmware(config).control
    ftr, qsc = firmware.rate_loop.loop, firmware.quadrature_loop.loop
    frames = round(seconds / p.frame_s)
    rates = np.broadcast_to(np.asarray(rate_dps, float), frames) * lp.DEG + p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (frames, 2)) * code_noise
    loop = lp.close(p)
    state = lp.steady_state(loop, (rates[0], p.kxy_n_per_m, *p.sid_offset_v)) if settled else np.zeros(len(loop.a))
    n = len(fr.f)
    z, later, ending = state[:n].copy(), np.zeros(2), np.zeros(2)
    ending[:] = state[lp.NEXT_SIN], state[lp.NEXT_COS]
    later[:] = state[lp.LATER_SIN], state[lp.LATER_COS]
    acc, u = round(state[lp.ACC] * 2**24), round(state[lp.U] * 2**24)
    word = word_before = round(state[lp.WORD])
    root = root_before = math.isqrt(max(u >> 24, 0))
    half, inputs = 1 << 23, np.zeros(6)
    per_volt = (p.u_full_n_per_m, 2.0**16)
    out = Hunt(np.empty(frames, np.int64), np.empty(frames, np.int64), np.empty((frames, 2), np.int64))
    gains_c, gains_d = fr.c.reshape(6, n), fr.d.reshape(6, 6)
    for k in range(frames):
        out.word[k], out.quadrature_code[k] = word_before, root_before
        kappa = p.kxy_n_per_m - per_volt[0] * (root_before / per_volt[1]) ** 2
        forces = (force_amplitude(w, p.word_per_code) for w in (word_before, word))
        inputs[:] = rates[k], kappa, *forces, *p.sid_offset_v
        conversion_parts_v = (gains_c @ z + gains_d @ inputs).reshape(3, 2)
        z = fr.f @ z + fr.g @ inputs
        volts, ending, later = ending + conversion_parts_v[0], later + conversion_parts_v[1], conversion_parts_v[2]
        code = [
            int(p.step_code) * math.floor(v * p.code_per_v / p.step_code + e / p.step_code + 0.5)
            for v, e in zip(volts, noise[k])
        ]
        out.codes[k] = code
        acc = min(max(acc + ftr.ki * code[0], ftr.lo << 24), ftr.hi << 24)
        u = min(max(u - qsc.ki * code[1], qsc.lo << 24), qsc.hi << 24)
        word_before, word = word, min(max((ftr.kp * code[0] + acc + half) >> 24, ftr.lo), ftr.hi)
        root_before, root = root, math.isqrt(min(max((u + half) >> 24, qsc.lo), qsc.hi))
    return out


class RoundingEffects(NamedTuple):
    """What rounding does at rest, in deg/s, and how the noise compares with the converter's step."""

    adc_dead_band_dps: float  # +- this much of residual shows nothing
    word_lsb_dps: float
    dac_lsb_dps: float  # below half of it, around no force at all, the force is zero
    v_q_lsb_dps: float  # quadrature of one V_q code at the null
    code_noise: float  # rms at the converter (codes)
    dither: float  # code_noise by step


def resolution(p: LoopParameters):
    """`RoundingEffects` from the parts alone."""
    loop = lp.close(p)
    lsb = float(loop.row @ lp.steady_state(loop, (lp.DEG, 0, 0, 0)))
    open_loop = lp.Loop(*lp.assemble(lp.frame(p), lp.gains(p), 0.0, 0.0)[:2], None, None, None, p.frame_s)
    codes, codes_b = lp.assemble(lp.frame(p), lp.gains(p), 0.0, 0.0)[2:]
    still = lp.steady_state(open_loop, (lp.DEG, 0, 0, 0))
    code_per_dps = abs((codes @ still + codes_b[:, lp.RATE] * lp.DEG)[0])
    full_dps = p.u_full_n_per_m / (2 * p.coriolis_mass_kg * p.w_rad_s) / lp.DEG
    at = math.sqrt(max(p.kxy_n_per_m / p.u_full_n_per_m, 0.0))
    # three equal poles pass pi/2 f3 3/8 of white noise; a sign keeps its density, the difference doubles volts
    passed_hz = math.pi / 2 * p.sid_hz * 3 / 8 if p.sid_stages == 3 else math.pi / 2 * p.sid_hz
    volts = math.hypot(p.adc_noise_v, 2 * p.cv_noise_v_per_rthz * math.sqrt(passed_hz))
    return RoundingEffects(
        p.step_code / 2 / code_per_dps,
        1 / lsb,
        p.word_per_code / lsb,
        2 * at * full_dps / 2**16,
        volts * p.code_per_v,
        volts * p.code_per_v / p.step_code,
    )

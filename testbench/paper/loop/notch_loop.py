"""A notch in the rate output: what it takes from the ring at the split, and what it costs.

    H(z)   that of `fpga_model.notch`: second order at `centre`, -3 dB over `width`, 1 at 0 Hz, on the words of the
           frames; behind the loop, so it changes no margin
    inside in front of the PI it takes away the feedback that damps the sense mode (`close_with_notch`)
    cost   bandwidth and delay of the output; and it must meet the ring, which moves with the split

Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import freqz, lfilter

from fpga_model import notch as firmware
from fpga_model.design_record import DEFAULT
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import LoopParameters

WIDTH_HZ = 20.0  # of a notch that nobody has chosen, at most half its centre
AFTER_S = 0.2  # by then a step's own response is over, the ring is not


class Filter(NamedTuple):
    """Coefficients of the notch."""

    b: np.ndarray
    a: np.ndarray
    frame_hz: float


def design(centre_hz, width_hz, frame_hz=DEFAULT.frame_hz):
    """`Filter` of the firmware's quantised coefficients; ValueError for what the firmware refuses."""
    p = firmware.design(centre_hz, width_hz, frame_hz)
    g, c = p.g / firmware.ONE, p.c / firmware.ONE
    return Filter(np.array([g, c, g]), np.array([1.0, c, 2 * g - 1]), frame_hz)


def gain(notch: Filter, f_hz):
    """Complex gain at frequencies (Hz)."""
    return freqz(notch.b, notch.a, worN=np.atleast_1d(f_hz), fs=notch.frame_hz)[1]


def apply_notch(notch: Filter, words):
    """Words behind the notch, which has been at the first of them for ever."""
    words = np.asarray(words, float)
    return words[0] + lfilter(notch.b, notch.a, words - words[0])


def step_words(p: LoopParameters, seconds=1.0, before_s=0.01):
    """(time from the step s, words per final word) of a rate step from rest."""
    loop = lp.close(p)
    time_s = np.arange(round(-before_s / p.frame_s), round(seconds / p.frame_s)) * p.frame_s
    inputs = np.zeros((len(time_s), 4))
    inputs[time_s >= 0, lp.RATE] = 1.0
    return time_s, lp.simulate_words(loop, inputs)[0] / advisor.dc_gain(loop)


def ring_share(time_s, words, final=1.0, after_s=AFTER_S, before_s=np.inf):
    """Largest swing about the slow rest, from `after_s` to `before_s` after the step, as a share of the step."""
    tail_mask = (time_s >= after_s) & (time_s < before_s)
    tail = np.asarray(words)[tail_mask] / final
    span = round(1 / 50 / (time_s[1] - time_s[0]))
    slow = np.convolve(tail, np.ones(span) / span, "valid")
    middle = tail[span // 2 : span // 2 + len(slow)]
    return float(np.max(np.abs(middle - slow)))


def close_with_notch(p: LoopParameters, notch: Filter):
    """`Loop` with the notch in front of the PI of the rate, where the firmware does not have it."""
    fr, k = lp.frame(p), lp.gains(p)
    a, b, codes, codes_b = lp.assemble(fr, k)
    size, (g, c, _), (_, _, d) = len(a), notch.b, notch.a
    wide, inputs = np.zeros((size + 2, size + 2)), np.zeros((size + 2, 4))
    # two states of the filter before all others, which keep their places from the end
    wide[2:, 2:], inputs[2:] = a, b
    code = np.concatenate([[0.0, 0.0], codes[0]])
    out, out_b = g * code, g * codes_b[0]
    out[0] += 1.0
    wide[0], inputs[0] = c * code - c * out, c * codes_b[0] - c * out_b
    wide[0, 1] += 1.0
    wide[1], inputs[1] = g * code - d * out, g * codes_b[0] - d * out_b
    wide[lp.ACC], inputs[lp.ACC] = k.ki * out, k.ki * out_b
    wide[lp.ACC, lp.ACC] += 1.0
    wide[lp.WORD], inputs[lp.WORD] = wide[lp.ACC] + k.kp * out, inputs[lp.ACC] + k.kp * out_b
    row = np.zeros(size + 2)
    row[lp.WORD_BEFORE] = 1.0
    return lp.Loop(wide, inputs, row, None, None, p.frame_s)


class Effect(NamedTuple):
    """What a notch does to the rate output."""

    centre_hz: float
    width_hz: float
    ring_without: float  # share of a step, from 0.2 s on
    ring_with: float
    bandwidth_without_hz: float
    bandwidth_with_hz: float
    delay_ms: float  # of slow rates
    left_db: dict  # ring frequency off by so many Hz -> what is left of it (dB)


def effect(p: LoopParameters, width_hz=None, centre_hz=None, off_hz=(0, 1, 2, 5, 10)):
    """`Effect` of a notch at `centre_hz`, or at the ring of these parts; None if they do not ring or are unstable.

    width_hz  of the notch; 20 Hz, or half the centre where that is less
    """
    loop = lp.close(p)
    ring = advisor.ringing_pole(loop, p.split_hz)
    if ring is None or lp.radius(loop) >= 1:
        return None
    centre_hz = centre_hz or ring.hz
    width_hz = width_hz or min(WIDTH_HZ, centre_hz / 2)
    notch = design(centre_hz, width_hz, 1 / p.frame_s)
    time_s, words = step_words(p)
    dc = abs(advisor.dc_gain(loop))
    grid = np.linspace(1.0, 100.0, 2000)
    level = np.abs(lp.response(loop, grid) * gain(notch, grid)) / dc
    past_edge_indices = np.flatnonzero(level < math.sqrt(0.5))
    slow = 1.0
    return Effect(
        centre_hz,
        width_hz,
        ring_share(time_s, words),
        ring_share(time_s, apply_notch(notch, words)),
        advisor.bandwidth(loop)[0],
        float(grid[past_edge_indices[0]]) if len(past_edge_indices) else math.nan,
        float(-np.angle(gain(notch, slow)[0]) / (2 * math.pi * slow) * 1e3),
        {off: float(20 * np.log10(np.abs(gain(notch, ring.hz + off)[0]) + 1e-5)) for off in off_hz},
    )

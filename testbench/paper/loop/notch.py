"""A notch in the rate output: what it takes from the ring at the split, and what it costs.

    H(z)   second order at `centre`, -3 dB over `width`, 1 at 0 Hz, on the words of 8 kHz; outside of the loop, so it
           changes no margin
    cost   bandwidth and delay of the output; and it must meet the ring, which moves with the split

Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import freqz, iirnotch, lfilter

from fpga_model.rates import FRAME_HZ
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.parts import Parts

AFTER_S = 0.2  # by then a step's own response is over, the ring is not


class Filter(NamedTuple):
    """Coefficients of the notch."""

    b: np.ndarray
    a: np.ndarray


def design(centre_hz, width_hz):
    """`Filter`; ValueError unless 0 < width < centre < 4 kHz."""
    if not 0 < width_hz < centre_hz < FRAME_HZ / 2:
        raise ValueError(f"notch: width {width_hz:g} Hz, centre {centre_hz:g} Hz are not 0 < width < centre < 4000 Hz")
    return Filter(*iirnotch(centre_hz, centre_hz / width_hz, fs=FRAME_HZ))


def gain(notch: Filter, f_hz):
    """Complex gain at frequencies (Hz)."""
    return freqz(notch.b, notch.a, worN=np.atleast_1d(f_hz), fs=FRAME_HZ)[1]


def applied(notch: Filter, words):
    """Words behind the notch, which has been at the first of them for ever."""
    words = np.asarray(words, float)
    return words[0] + lfilter(notch.b, notch.a, words - words[0])


def step_words(p: Parts, seconds=1.0, before_s=0.01):
    """(time from the step s, words per final word) of a rate step from rest."""
    loop = lp.close(p)
    time_s = np.arange(round(-before_s * FRAME_HZ), round(seconds * FRAME_HZ)) / FRAME_HZ
    inputs = np.zeros((len(time_s), 4))
    inputs[time_s >= 0, lp.RATE] = 1.0
    return time_s, lp.play(loop, inputs)[0] / advisor.rest_gain(loop)


def ring_share(time_s, words, final=1.0, after_s=AFTER_S, before_s=np.inf):
    """Largest swing about the slow rest, from `after_s` to `before_s` after the step, as a share of the step."""
    late = (time_s >= after_s) & (time_s < before_s)
    tail = np.asarray(words)[late] / final
    span = round(FRAME_HZ / 50)
    slow = np.convolve(tail, np.ones(span) / span, "valid")
    middle = tail[span // 2 : span // 2 + len(slow)]
    return float(np.max(np.abs(middle - slow)))


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


def effect(p: Parts, width_hz=None, centre_hz=None, off_hz=(0, 1, 2, 5, 10)):
    """`Effect` of a notch at `centre_hz`, or at the ring of these parts; None if they do not ring or are unstable.

    width_hz  of the notch; 20 Hz, or half the centre where that is less
    """
    loop = lp.close(p)
    ring = advisor.ring(loop, p.split_hz)
    if ring is None or lp.radius(loop) >= 1:
        return None
    centre_hz = centre_hz or ring.hz
    width_hz = width_hz or min(20.0, centre_hz / 2)
    notch = design(centre_hz, width_hz)
    time_s, words = step_words(p)
    dc = abs(advisor.rest_gain(loop))
    grid = np.linspace(1.0, 100.0, 2000)
    level = np.abs(lp.response(loop, grid) * gain(notch, grid)) / dc
    below = np.flatnonzero(level < math.sqrt(0.5))
    slow = 1.0
    return Effect(
        centre_hz,
        width_hz,
        ring_share(time_s, words),
        ring_share(time_s, applied(notch, words)),
        advisor.bandwidth(loop)[0],
        float(grid[below[0]]) if len(below) else math.nan,
        float(-np.angle(gain(notch, slow)[0]) / (2 * math.pi * slow) * 1e3),
        {off: float(20 * np.log10(np.abs(gain(notch, ring.hz + off)[0]) + 1e-5)) for off in off_hz},
    )

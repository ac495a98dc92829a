"""Frequency response of the rate channel: from a multisine of rate, and from a swept rate.

    H(f) = word(f) / rate(f) / K              the rate of a frame counts at its middle, its row at its beginning
    bandwidth                                 where |H| passes -3.01 dB downwards, interpolated in log f

Lines and sweep are those of the default's rate loop; with a loop n times slower they are n times lower and longer.

The multisine has whole cycles in its record, so that its lines do not leak; phases are Schroeder's, for a low peak.
Source    docs/paper.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import signal

LINES_S = 8.0  # record; lines are multiples of 1/8 Hz
LINES_HZ = (0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 19.0, 22.0, 24.0, 25.0, 26.0, 27.0, 28.0, 30.0, 33.0, 37.0,
            42.0, 48.0, 54.0, 60.0, 75.0, 100.0, 125.0)  # fmt: skip
LINE_DPS = 4.0
LEAD_S = 2.0  # the first run of the lines is left out
SWEEP_S, SWEEP_HZ, SWEEP_DPS = 10.0, (0.5, 80.0), 20.0
SWEEP_PAUSE_S, SMOOTH_HZ = 2.0, 1.0
HALF_DB = 20 * math.log10(math.sqrt(0.5))


class Response(NamedTuple):
    """Gain relative to the static scale factor (dB), phase (deg), and the bandwidth (Hz; nan if it is not reached)."""

    frequency_hz: tuple
    gain_db: tuple
    phase_deg: tuple
    bandwidth_hz: float


def crossing_hz(frequency_hz, gain_db, level_db=HALF_DB):
    """Frequency at which a gain passes a level downwards for the first time; nan if it does not."""
    f, g = np.log(np.asarray(frequency_hz)), np.asarray(gain_db)
    for k in range(1, len(g)):
        if g[k - 1] >= level_db > g[k]:
            return float(np.exp(f[k - 1] + (g[k - 1] - level_db) / (g[k - 1] - g[k]) * (f[k] - f[k - 1])))
    return math.nan


def multisine_dps(frames, frame_s, first=0, slower=1):
    """Rate per frame of the multisine (deg/s), at the middle of each frame."""
    t = (first + np.arange(frames) + 0.5) * frame_s
    count = len(LINES_HZ)
    out = np.zeros(frames)
    for k, f in enumerate(lines_hz(slower)):
        out += LINE_DPS * np.cos(2 * np.pi * f * t - math.pi * k * (k - 1) / count)
    return out


def lines_hz(slower=1):
    """Lines of the multisine for a rate loop so many times slower than the default's."""
    return np.array(LINES_HZ) / slower


def _relative_response(f, h, lsb_per_dps):
    h = h / lsb_per_dps
    gain = 20 * np.log10(np.abs(h))
    phase = np.degrees(np.unwrap(np.angle(h)))
    return Response(tuple(map(float, f)), tuple(gain.tolist()), tuple(phase.tolist()), crossing_hz(f, gain))


def multisine(bench, lsb_per_dps):
    """`Response` from the multisine; gains are relative to `lsb_per_dps`."""
    slower, frame_s = bench.slower, bench.frame_s
    lead, frames = slower * round(LEAD_S / frame_s), slower * round(LINES_S / frame_s)
    profile_dps = bench.part * multisine_dps(lead + frames + 2, frame_s, 0, slower)
    rows = bench.record(slower * (LEAD_S + LINES_S), profile_dps)
    words = rows["rate_word"][lead : lead + frames].astype(float)
    # rows of a segment begin with the first frame that begins in it
    k = lead + np.arange(frames)
    f = lines_hz(slower)
    word = np.exp(-2j * np.pi * np.outer(f, k * frame_s)) @ (words - words.mean())
    rate = np.exp(-2j * np.pi * np.outer(f, (k + 0.5) * frame_s)) @ multisine_dps(frames, frame_s, lead, slower)
    return _relative_response(f, word / (bench.part * rate), lsb_per_dps)


def sweep_response(bench, lsb_per_dps):
    """`Response` from a rate that is swept through the band; spectra smoothed over SMOOTH_HZ."""
    slower, frame_s = bench.slower, bench.frame_s
    frames, still = slower * round(SWEEP_S / frame_s), slower * round(SWEEP_PAUSE_S / frame_s)
    t = (np.arange(frames + 2) + 0.5) * frame_s / slower
    rate = bench.part * SWEEP_DPS * signal.chirp(t, SWEEP_HZ[0], SWEEP_S, SWEEP_HZ[1], method="linear")
    rate = np.concatenate([rate[:frames], np.zeros(still + 2)])
    rows = bench.record(slower * (SWEEP_S + SWEEP_PAUSE_S), rate)
    words = rows["rate_word"].astype(float)
    n = min(len(words), frames + still)
    words = words[:n] - words[-still // 4 :].mean()
    f = np.fft.rfftfreq(n, frame_s)
    x, y = np.fft.rfft(rate[:n]), np.fft.rfft(words)
    # the rate of a frame counts at its middle
    cross = y * np.conj(x) * np.exp(1j * np.pi * f * frame_s)
    width = max(1, round(SMOOTH_HZ / slower * n * frame_s))
    window = np.ones(width) / width
    h = np.convolve(cross, window, "same") / np.convolve(np.abs(x) ** 2, window, "same")
    centre = np.flatnonzero((f >= 2.0 / slower) & (f <= 60.0 / slower))[:: max(1, width // 2)]
    return _relative_response(f[centre], h[centre], lsb_per_dps)

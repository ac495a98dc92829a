"""Where a reference's edges fall on their grid, from what a host reads and a counter stamps.

    edge j   phase j/2; leaves at the first instant of the grid at which phase >= j/2, late by 0 .. one step
    phase    start + sum of the frequency words that the host reads, one a frame: only `start` is unknown
             (LSB of the DDS, `dds_bits` to a turn)
    start    each stamp n of an edge confines it: 0 <= phase(n) - j/2 < step
    late     weighted mean of the lateness less half a step, which every reference has in the long run

At one frequency the mean is not half a step: the loop answers the beat of edges and grid, and near a ratio of small
numbers it slides along the grid with edges that dwell on one side. The stamps show where.
Source    docs/paper.md
"""

from typing import NamedTuple

import numpy as np

from fpga_model.design_record import DEFAULT

SLACK = 0.05  # of a step: by so much may stamps contradict words, which act some clocks into their frame
INSIDE = 5  # values of `start` at which a mean is taken


class Grid(NamedTuple):
    """Grid of the reference edges: its period in clocks, and the design whose clocks and phases they are."""

    clocks: int
    design: object = DEFAULT

    @property
    def frame_clocks(self):
        """Clocks to a frame."""
        return self.design.frame_clocks

    @property
    def turn(self):
        """LSB of the DDS to a turn."""
        return 1 << self.design.dds_bits


class Start(NamedTuple):
    """Phase at the first instant of the first frame: low .. high modulo half a turn, in LSB of the DDS."""

    low: int
    high: int


class EdgeDelay(NamedTuple):
    """By how much edges are later than in the long run (deg), and the standard deviation that `start` leaves of it."""

    deg: float
    sd_deg: float


def _phases(words, grid):
    """Phase at the first instant of each frame, from a start at 0, modulo a turn."""
    # the sum wraps at 2^64, whole turns
    return np.concatenate([[0], np.cumsum(words[:-1] * grid.frame_clocks)]) & (grid.turn - 1)


def start(words, stamps, offset, grid):
    """`Start` from stamps of a reference's sgn(sin).

    words        frequency words, one a frame
    stamps       instants of the grid at which an edge of either slope has left, 0 the first of the first frame
    offset       phase word of the reference;  grid  its `Grid`
    Raises ValueError if there are none, or if the stamps are not of these words.
    """
    words, stamps = np.asarray(words, np.int64), np.asarray(stamps, np.int64)
    half = grid.turn // 2
    stamps = stamps[(stamps >= 0) & (stamps * grid.clocks < len(words) * grid.frame_clocks)]
    if not len(stamps):
        raise ValueError(f"edge times: none is within the {len(words)} recorded frames")
    frame, inside = np.divmod(stamps * grid.clocks, grid.frame_clocks)
    least = -(_phases(words, grid)[frame] + words[frame] * inside + offset) % half
    off = (least - least[0] + half // 2) % half - half // 2
    step = int(words.max()) * grid.clocks
    low, high = int(off.max()), int(off.min()) + step
    if high - low < -SLACK * step:
        mismatch_steps = (low - high) / step
        raise ValueError(
            f"edge times: differ from the frequency words by {mismatch_steps:.2g} grid steps, limit {SLACK}"
        )
    return Start(*sorted((int(least[0]) + low, int(least[0]) + high)))


def _mean(words, weights, turning, first, grid):
    """Weighted mean of lateness times `turning` (turns), the phase of the first frame at `first` (LSB of the DDS)."""
    half = grid.turn // 2
    phase, step, total, share = _phases(words, grid) + first, words * grid.clocks, 0.0, 0.0
    ahead = half - phase % half  # to the next edge
    for number in range(int(words.max()) * grid.frame_clocks // half + 1):
        distance = ahead + number * half
        mine = weights * (distance <= words * grid.frame_clocks)
        total = total + (mine * turning) @ (-distance % step - step / 2)
        share += float(mine.sum())
    return total / share / grid.turn


def mean_edge_delay(words, weights, begun, offset, grid):
    """`EdgeDelay` of the edges of both slopes of a reference; weights of the frames, `begun` their `Start`."""
    words, weights = np.asarray(words, np.int64), np.asarray(weights, float)
    inside = (begun.low + (2 * k + 1) * (begun.high - begun.low) // (2 * INSIDE) for k in range(INSIDE))
    delays_turns = [float(_mean(words, weights, 1.0, first + offset, grid)) for first in inside]
    return EdgeDelay(360.0 * float(np.mean(delays_turns)), 360.0 * float(np.std(delays_turns)))


def line_deg(words, weights, begun, offset, grid, omega_frame):
    """Size (deg) of the line that lateness has at `omega_frame` (rad a frame).

    Where it meets a line of the signal, their product is a mean that looks like one of the signal's own.
    """
    words = np.asarray(words, np.int64)
    turning = np.exp(1j * omega_frame * np.arange(len(words)))
    middle = (begun.low + begun.high) // 2
    return 360.0 * float(abs(_mean(words, np.asarray(weights, float), turning, middle + offset, grid)))


def hann(n):
    """Weights of a record of n frames."""
    return np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2

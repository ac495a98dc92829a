"""Rows of a file on the time line of frames: rate, lost and repeated rows, and which row is the first after power-on.

    frame of a row   cumulative sum of rint(step of time / 125 us), from the first row on
    rate             slope of frames over time; its ppm say how the two clocks differ, which is no error
    power-on         the last row of zeros in all four channels at the beginning: in frame 0 the firmware has seen no
                     conversion; without such a row the stamp at power-on, if it is stated

Source    docs/import.md
"""

from typing import NamedTuple

import numpy as np

from fpga_model.rates import FRAME_CYCLES, MASTER_HZ
from testbench.errors import FileError
from testbench.measured.importing.record_map import TIME_S
from testbench.measured.record import schema

FRAME_S = FRAME_CYCLES / MASTER_HZ
STAMP_TOLERANCE = 0.4  # of a step: how far a stamp may be from the grid of frames
MOST_S = 1e10  # of a stamp, three hundred years
MOST_LOST = 10  # times the rows of a file: what its stamps may span
RATE = 0.01  # of the frame rate, by which a stamp's clock may differ


class Line(NamedTuple):
    """Where the rows of a file belong."""

    rows: np.ndarray  # of the file, those that are kept
    frames: np.ndarray  # their frames; from power-on if `powered`, else from the first row
    decimated: int  # frames to a row
    powered: bool  # frame 0 is that of the power-on
    begin: int  # frames from power-on to frame 0, as far as they are known
    lost: tuple  # (first frame, frames) of rows that are missing
    words: tuple  # what was found, one line each


def _frame_steps(path, stamps_s):
    """(frames of each step, frames to a row, lines) of time stamps; FileError where they are no grid."""
    if np.abs(stamps_s).max() > MOST_S:
        raise FileError(f"{path}: a time stamp of {np.abs(stamps_s).max():.4g} s is above the limit {MOST_S:g} s")
    steps = np.diff(stamps_s) / FRAME_S
    if len(steps) and steps.min() < -STAMP_TOLERANCE:
        row = int(np.argmin(steps)) + 2
        raise FileError(
            f"{path}: row {row}: time goes back by {-steps.min() * FRAME_S:.6g} s; one file is one power-on"
        )
    usual = float(np.median(steps)) if len(steps) else 1.0
    decimated = max(1, round(usual))
    if abs(usual / decimated - 1) > RATE:
        raise FileError(
            f"{path}: rows are {usual * FRAME_S * 1e6:.6g} us apart, expected a multiple of 125 us within 1 %"
        )
    steps /= decimated
    counts = np.rint(steps)
    off = np.abs(steps - counts) - RATE * np.abs(counts)
    if len(off) and off.max() > STAMP_TOLERANCE:
        row = int(np.argmax(off))
        raise FileError(f"{path}: row {row + 2}: a step of {steps[row]:.3f} rows, expected a whole number")
    if counts.sum() > MOST_LOST * len(stamps_s):
        raise FileError(f"{path}: time stamps span {counts.sum():.0f} rows, but the file has {len(stamps_s)}")
    return counts.astype(np.int64), decimated, _rate(stamps_s, np.concatenate([[0], np.cumsum(counts)]) * decimated)


def _rate(stamps_s, frames):
    """What the stamps say of the rate, in words."""
    if len(frames) < 3 or frames[-1] == 0:
        return ()
    slope, at = np.polyfit(frames, stamps_s - stamps_s[0], 1)
    scatter = float(np.std(stamps_s - stamps_s[0] - slope * frames - at))
    ppm = 1e6 * (slope / FRAME_S - 1)
    return (f"rate: {1 / slope:.6f} frames/s by the time stamps, {ppm:+.3g} ppm; scatter {scatter:.2g} s",)


def line(path, stamps, time, codes):
    """`Line` of a file.

    stamps  (n,) time stamps in the unit of `time` (record_map.Time), or None: rows are frames without a gap
    codes   {stream: (n,)} with the four channels of the converter
    """
    count = len(codes["adc_xI"])
    zero = np.logical_and.reduce([codes[name] == 0 for name in schema.ADC])
    rows, frames, decimated, words = np.arange(count), np.arange(count), 1, ()
    if stamps is None:
        words = ("assumed: rows are frames of 125 us, none is missing",)
    else:
        counts, decimated, words = _frame_steps(path, stamps * TIME_S[time.unit])
        again = np.flatnonzero(counts == 0) + 1
        differing = [k for k in again if any(codes[name][k] != codes[name][k - 1] for name in schema.ADC)]
        if differing:
            raise FileError(f"{path}: row {differing[0] + 1}: two rows have the same time and different codes")
        if len(again):
            words += (f"left out: {len(again)} repeated rows, the first is row {again[0] + 1}",)
        frames = np.concatenate([[0], np.cumsum(counts)]) * decimated
        rows = np.delete(rows, again)
        frames = frames[rows]
    jumps = np.flatnonzero(np.diff(frames) > decimated)
    lost = tuple((int(frames[k]) + decimated, int(frames[k + 1] - frames[k]) - decimated) for k in jumps)
    powered, first, how = _power_on(zero[rows], frames, stamps, time, decimated)
    if lost:
        words += (
            f"lost: {sum(n for _, n in lost)} frames in {len(lost)} gaps, the first after frame {lost[0][0] - 1}",
        )
    if not powered:
        return Line(rows, frames - frames[0], decimated, False, max(first, 0), _rebase(lost, frames[0]), (*words, how))
    used = frames >= first
    return Line(rows[used], frames[used] - first, decimated, True, 0, _rebase(lost, first), (*words, how))


def _rebase(lost, first):
    return tuple((a - first, n) for a, n in lost if a + n > first)


def _power_on(zero, frames, stamps, time, decimated):
    """(whether frame 0 is found, its frame among `frames`; else that of the first row from power-on, how)."""
    stamped = time is not None and time.power_on is not None
    since_s = np.clip((stamps[0] - time.power_on) * TIME_S[time.unit], -MOST_S, MOST_S) if stamped else 0.0
    first = round(since_s / FRAME_S)
    if decimated > 1:
        return False, first, f"a row covers {decimated} frames: no word can be replayed"
    count = int(np.argmin(zero)) if not zero.all() else 0
    if count:
        how = f"power-on: frame 0 is row {count}, the last in which no channel has a conversion"
        return True, int(frames[count - 1]), how
    if not stamped:
        return False, 0, "no row without a conversion, and no time stamp of the power-on: no word can be replayed"
    if first <= 1:
        # the first conversion arrives in frame 1
        return True, int(frames[0]) - 1, "power-on: found by its time stamp; the first row is frame 1"
    text = f"the first row is frame {first} by its time stamp: {first - 1} conversions are missing"
    return False, first, f"{text}, no word can be replayed"

"""Segments of a power-on: where a condition holds, found from its profiles, its writes and the lock.

    breaks   frames at which rate, temperature, a set-point or the lock changes
    dwell    between two breaks: from a step of the rate on, if the loops had been locked and undisturbed for settle_s
             before it; else behind a settling of settle_s. All have one length, by which most frames are used
    startup  up to lock          settle  what is between dwells

Source    docs/import.md
"""

import itertools
from typing import NamedTuple

import numpy as np

from fpga_model.rates import FRAME_CYCLES, MASTER_HZ
from testbench.errors import ConfigError
from testbench.measured.record.recording_plan import RAMP_FRAMES

FRAME_HZ = MASTER_HZ // FRAME_CYCLES
LEAST_FRAMES = 800  # of a dwell: 0.1 s
MEAN_FRAMES = 100  # of codes, in which noise and ripple are small beside the drive
AMPLITUDE_TOLERANCE, MOST_ANGLE = 0.02, 0.05  # of a locked drive's amplitude; rad from minus cosine
SINGLE_DWELL_FRAMES = 3000  # of a dwell without another: 64 draws of the noise determine no more than its 40 features


class Track(NamedTuple):
    """A quantity over the frames of a power-on: values[k] holds from frames[k] on."""

    frames: tuple
    values: tuple

    def value_at(self, frame):
        """The value that holds in a frame."""
        return self.values[max(0, int(np.searchsorted(self.frames, frame, side="right")) - 1)]

    def shift_origin(self, begin):
        """The same over frames that count from frame `begin`."""
        start_index = max(0, int(np.searchsorted(self.frames, begin, side="right")) - 1)
        return Track(tuple(max(0, f - begin) for f in self.frames[start_index:]), self.values[start_index:])

    def changes(self):
        """Frames at which another value begins."""
        return [f for k, f in enumerate(self.frames) if k and self.values[k] != self.values[k - 1]]


class Tracks(NamedTuple):
    """What was set when."""

    rate_dps: Track
    temp_degc: Track
    a_um: Track
    detune_deg: Track


class Part(NamedTuple):
    """A row of /segments, in frames of its power-on."""

    id: str
    first: int
    end: int
    kind: str
    role: str
    group: str  # "": that of its condition


def track(points, linear=False):
    """`Track` of a number, or of [(seconds, value), ..]: held until the next, or joined by lines in steps of 8 ms."""
    rows = [(0.0, points)] if isinstance(points, (int, float)) else points
    frames, values = [round(t * FRAME_HZ) for t, _ in rows], [float(v) for _, v in rows]
    if linear:
        ramp_steps = [_line(*pair) for pair in itertools.pairwise(zip(frames, values))]
        frames, values = (
            [n for part in ramp_steps for n in part[k]] + [last] for k, last in ((0, frames[-1]), (1, values[-1]))
        )
    return Track(tuple(frames), tuple(values))


def _line(begin, end):
    """(frames, values) of the steps of a line; the value of a step is that of its middle."""
    (a, v), (b, w) = begin, end
    if v == w or b <= a:
        return ([a], [v]) if b > a else ([], [])
    frames = np.arange(a, b, RAMP_FRAMES)
    middle = (frames + np.minimum(frames + RAMP_FRAMES, b)) / 2
    return frames.tolist(), (v + (w - v) * (middle - a) / (b - a)).tolist()


def drive_locked(codes):
    """(frames,) of bool: the drive rests at minus cosine and at its last amplitude, judged by its codes alone.

    codes  {stream: (frames,)};  means of MEAN_FRAMES; from the last frame on in which it is not so
    """
    mean = np.ones(MEAN_FRAMES) / MEAN_FRAMES
    x, y = (np.convolve(codes[name], mean, "same") for name in ("adc_xI", "adc_xQ"))
    last = np.median(np.hypot(x, y)[-len(x) // 4 :])
    off = (np.abs(np.hypot(x, y) - last) > AMPLITUDE_TOLERANCE * last) | (np.abs(x) > MOST_ANGLE * np.abs(y)) | (y >= 0)
    half = MEAN_FRAMES // 2
    wrong = np.flatnonzero(off[half : len(off) - half])
    return np.arange(len(x)) >= (int(wrong[-1]) + half + 1 if len(wrong) else 0)


def find_segments(tracks, locked, options, role="fit"):
    """[Part] of a power-on, whose dwells have a role.

    locked   (frames,) of bool: the board is locked
    options  record_map.Dwells
    """
    lock, frames = int(np.argmax(locked)) if locked.any() else len(locked), len(locked)
    spans = list(_spans(tracks, locked, lock, round(options.settle_s * FRAME_HZ)))
    length = _common([b - begin for _, begin, b in spans], round(options.longest_s * FRAME_HZ))
    rows = [(0, lock, "startup", "startup", "none")]
    dwells = [(begin, begin + length) for _, begin, b in spans if b - begin >= length > 0]
    for number, (begin, end) in enumerate(dwells, 1):
        dwell_role = "validate" if number in options.held_out else role
        rows.append((rows[-1][1], begin, f"settle{number}", "settle", "none"))
        rows.append((begin, end, f"d{number}", "dwell", dwell_role))
    # between dwells the rate may step: no condition holds there
    rows.append((rows[-1][1], frames, "rest", "warmup", "none"))
    breaks = [f for t in tracks for f in t.changes()]
    return [
        Part(name, a, b, kind if kind != "settle" or not any(a < f < b for f in breaks) else "warmup", part, "")
        for a, b, name, kind, part in rows
        if b > a
    ]


def _spans(tracks, locked, lock, settle):
    """(first frame of a condition, first of a dwell in it, its end), where the board is locked."""
    steps = set(tracks.rate_dps.changes())
    edges = (np.flatnonzero(np.diff(locked.astype(np.int8))) + 1).tolist()
    breaks = {f for t in tracks[1:] for f in t.changes()} | set(edges)
    calm = lock
    for a, b in itertools.pairwise([lock, *sorted(f for f in steps | breaks if lock < f < len(locked)), len(locked)]):
        begin = a if a in steps and a not in breaks and a - calm >= settle else a + settle
        calm = a
        if a < len(locked) and locked[a] and b - begin >= LEAST_FRAMES:
            yield a, begin, b


def _common(lengths, longest):
    """One length for all dwells, by which most frames are used: noise is shared among dwells of one length."""
    if len(lengths) < 2:
        longest = min(longest, SINGLE_DWELL_FRAMES)
    tried = [min(n, longest) for n in lengths]
    return max(tried, key=lambda n: n * sum(m >= n for m in tried), default=0)


def stated_segments(rows, begin, frames, where):
    """[Part] of the stretches that a map states, of a file that begins `begin` frames behind power-on.

    ConfigError for one that the file does not hold.
    """
    out = []
    for one in sorted(rows, key=lambda s: s.from_s):
        first, end = (round(t * FRAME_HZ) - begin for t in (one.from_s, one.to_s))
        if first < 0 or end > frames:
            span = f"{begin / FRAME_HZ:g} .. {(begin + frames) / FRAME_HZ:g} s"
            raise ConfigError(
                f"{where}: segment {one.id}: {one.from_s:g} .. {one.to_s:g} s is outside the file, which covers {span}"
            )
        out.append(Part(one.id, first, end, one.kind, one.role, one.group or one.id))
    return out

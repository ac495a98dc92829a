"""What is kept of a point's 8 kHz rows: streams, and numbers about streams. Both are sinks of a run.

    x[k]    column, mean of `frames` frames each (first frame of truths; all, any, first of state words: `spool`)
    mean    sum x / n                        std    sqrt(sum (x - mean)^2 / (n - 1))
    rms     sqrt(sum x^2 / n)                slope  sum (t - <t>) (x - mean) / sum (t - <t>)^2, per second
    adev    overlapping Allan deviation at tau = m t0:  sqrt(sum_j (X[j+2m] - 2 X[j+m] + X[j])^2 / (2 m^2 (n + 1 - 2m)))
            with X the running sum of x, X[0] = 0;  nan where n < 2m

Sums are exact or correctly rounded (`math.fsum`, integers), so that no library decides on a last bit.
Source  docs/campaigns.md; NIST SP 1065, eq. 5.9 in the form of eq. 10 of IEEE 1139 for frequency data
"""

import math
from typing import NamedTuple

import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.storage.spool import FIELDS, SUM, Spool

STEP = "step_s"  # attribute of a stream: time from one row to the next
STATISTICS = ("mean", "std", "rms", "slope", "min", "max", "first", "last", "adev")


class Variable(NamedTuple):
    """Named data: dimensions, a number, a text or an array, and attributes (texts and numbers)."""

    dims: tuple
    data: object
    attrs: dict


def mean(x):
    """Mean of a column; of integers exact, rounded once."""
    if x.dtype.kind == "f":
        return math.fsum(x) / len(x)
    # halves, because a sum of 48-bit words of an hour does not fit 64 bits
    total = (int((x >> 32).sum()) << 32) + int((x & 0xFFFFFFFF).sum())
    return total / len(x)


def std(x):
    """Sample standard deviation; nan for one value."""
    if len(x) < 2:
        return math.nan
    d = x - mean(x)
    return math.sqrt(math.fsum(d * d) / (len(x) - 1))


def rms(x):
    """Root of the mean square."""
    v = x.astype(float)
    return math.sqrt(math.fsum(v * v) / len(v))


def slope(x, step_s):
    """Least-squares slope per second; nan for one value."""
    if len(x) < 2:
        return math.nan
    k = np.arange(len(x)) - (len(x) - 1) / 2
    return math.fsum(k * (x - mean(x))) / math.fsum(k * k) / step_s


def adev(x, m):
    """Overlapping Allan deviation of values x over m of them; nan if there are fewer than 2 m."""
    if len(x) < 2 * m:
        return math.nan
    total = np.concatenate([[0], np.cumsum(x - x[0])])
    second = (total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]).astype(float)
    return math.sqrt(math.fsum(second * second) / (2 * len(second))) / m


NUMBERS = {
    "mean": mean,
    "std": std,
    "rms": rms,
    "min": lambda x: float(x.min()),
    "max": lambda x: float(x.max()),
    "first": lambda x: float(x[0]),
    "last": lambda x: float(x[-1]),
}


class Keep(NamedTuple):
    """What a plan keeps of each point besides its numbers.

    streams     {column: frames to a row}
    statistics  {column: (statistic, ...)}
    frames      frames averaged before the statistics
    tau_s       for adev
    """

    streams: dict
    statistics: dict
    frames: int = 1
    tau_s: tuple = ()


class Keeper:
    """A sink that keeps what `keep` says of a run of a design; `variables()` at the end."""

    def __init__(self, keep, design=DEFAULT):
        self.keep = keep
        self.frame_s = 1 / design.frame_hz
        self.spools = {}
        spool_keys = [(frames, name) for name, frames in keep.streams.items()]
        spool_keys += [(keep.frames, name) for name in keep.statistics]
        for frames in sorted({frames for frames, _ in spool_keys}):
            self.spools[frames] = Spool(tuple({name for f, name in spool_keys if f == frames}), frames, design=design)

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        for spool in self.spools.values():
            spool.add(first_frame, frames, truth)

    def variables(self):
        """{name: Variable} of streams and statistics, in the order of the record's columns."""
        columns = {frames: self._columns(spool) for frames, spool in self.spools.items()}
        out = {}
        for name in FIELDS:
            if name in self.keep.statistics:
                x, divisor, attrs = columns[self.keep.frames][name]
                out |= self._statistics(name, x, divisor, attrs)
            if name in self.keep.streams:
                frames = self.keep.streams[name]
                x, divisor, attrs = columns[frames][name]
                data = x if divisor == 1 else x / divisor
                step = {"frames": frames, STEP: frames * self.frame_s}
                out[name] = Variable((f"time_{frames}",), data, {**attrs, **step})
        return out

    def _columns(self, spool):
        """{column: (sums or values, what to divide by, attributes)}."""
        blocks = list(spool.row_blocks())
        rows = np.concatenate(blocks) if blocks else np.zeros(0, spool.dtype)
        out = {}
        for stored, field in spool.fields.items():
            summed = spool.decimate > 1 and field.rule == SUM
            name = stored.removesuffix("_sum") if summed else stored
            x = np.ascontiguousarray(rows[stored])
            x = x.astype(np.int64) if summed or (x.dtype.kind != "f" and spool.decimate == 1) else x
            attrs = {"units": field.unit} | {k: v for k, v in field.attrs.items() if k in ("lsb", "tap")}
            out[name] = x, spool.decimate if summed else 1, attrs
        return out

    def _statistics(self, name, x, divisor, attrs):
        step_s, out = self.keep.frames * self.frame_s, {}
        for kind in self.keep.statistics[name]:
            if kind == "adev":
                tau = [round(t / step_s) for t in self.keep.tau_s]
                values = np.array([adev(x, m) / divisor for m in tau])
                out[f"{name}.adev"] = Variable(("tau_s",), values, {**attrs, "frames": self.keep.frames})
                continue
            if not len(x):
                value = math.nan
            elif kind == "slope":
                value = slope(x, step_s) / divisor
            else:
                value = NUMBERS[kind](x) / divisor
            unit = {"units": f"{attrs['units']}/s" if kind == "slope" else attrs["units"]}
            out[f"{name}.{kind}"] = Variable((), value, {**attrs, **unit, "frames": self.keep.frames})
        return out

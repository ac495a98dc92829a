"""Noise as a finding of its own: which channel is how many times as noisy as its model, at which frequencies.

    frames     power in bands of frequency within a dwell, against draws of the model: ln ratio, its deviation from the
               scatter of single dwells about their condition's mean, both sets together
    repeats    variance ratios of the contrasts per observable and octave (noise.py), chi2 distributed
A band is told where the chance of its ratio, times the number of bands, is below alpha, and its amplitude is off by
more than LEAST. Neighbours that are off to one side are one finding. It names no cause, and no verdict follows from it.
Source    docs/tracing.md
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, t

LEAST = 1.1  # times in amplitude: drive frequencies of single power-ons change the slips' noise by so much
LEVEL = 0.95


class Finding(NamedTuple):
    """Noise of a channel in a span, in amplitude over the model's."""

    channel: str
    source: str  # frames, repeats
    span: str
    ratio: float
    low: float
    high: float
    p: float

    @property
    def text(self):
        finding_text = f"noise of {self.channel} {self.span} is {self.ratio:.3g} times that of the model"
        return f"{finding_text} (95 % interval {self.low:.3g} .. {self.high:.3g}, from {self.source})"


class Band(NamedTuple):
    """ln of an amplitude ratio in a band with its deviation and the degrees of freedom behind that."""

    ratio: float
    sd: float
    dof: float
    first: int
    last: int


def _p(band):
    return float(2 * t.sf(abs(band.ratio) / band.sd, band.dof))


def _merge_bands(a, b):
    weight = np.array([a.sd, b.sd]) ** -2.0
    ratio = float(weight @ [a.ratio, b.ratio] / weight.sum())
    return Band(ratio, float(weight.sum() ** -0.5), a.dof + b.dof, a.first, b.last)


def band_findings(channel, bands, spans, tests, alpha):
    """`Finding`s of the `Band`s of a channel; spans(first, last) is what a span is called."""
    merged_bands = []
    for band in bands:
        if _p(band) * tests >= alpha or abs(band.ratio) < np.log(LEAST):
            continue
        is_adjacent = (
            merged_bands and merged_bands[-1].last + 1 == band.first and merged_bands[-1].ratio * band.ratio > 0
        )
        merged_bands[-1:] = [_merge_bands(merged_bands[-1], band)] if is_adjacent else [*merged_bands[-1:], band]
    out = []
    for band in merged_bands:
        half = t.ppf((1 + LEVEL) / 2, band.dof) * band.sd
        ratios = np.exp([band.ratio, band.ratio - half, band.ratio + half])
        out.append(Finding(channel, "frames", spans(band.first, band.last), *map(float, ratios), _p(band)))
    return out


def frame_findings(measured, model, channels, edges_hz, alpha=0.01):
    """`Finding`s of powers {condition: (dwells, channels, bands)}, measured and of the model's draws."""

    def spans(first, last):
        low, high = edges_hz[first], edges_hz[last + 1]
        if first == 0 and last == len(edges_hz) - 2:
            return "at all frequencies"
        return f"below {high:g} Hz" if first == 0 else f"above {low:g} Hz" if high == edges_hz[-1] else (
            f"at {low:g} .. {high:g} Hz"
        )  # fmt: skip

    groups = [g for g in measured if len(measured[g]) and len(model.get(g, ())) > 1]
    if not groups:
        return []
    tests, out = len(channels) * (len(edges_hz) - 1), []
    pairs = [[np.log(np.asarray(of[g])) / 2 for of in (measured, model)] for g in groups]
    dwell_deviations = np.concatenate([v - v.mean(axis=0) for pair in pairs for v in pair])
    dof = len(dwell_deviations) - 2 * len(groups)
    scatter = (dwell_deviations**2).sum(axis=0) / dof
    each = np.array([a.mean(axis=0) - b.mean(axis=0) for a, b in pairs])
    # of single conditions, each with the noise of its own dwells and draws
    share = np.mean([1 / len(a) + 1 / len(b) for a, b in pairs]) / len(pairs)
    for i, channel in enumerate(channels):
        bands = [
            Band(float(each[:, i, k].mean()), float(np.sqrt(scatter[i, k] * share)), dof, k, k)
            for k in range(len(edges_hz) - 1)
        ]
        out += band_findings(channel, bands, spans, tests, alpha)
    return out


def repeat_findings(noise, alpha=0.01):
    """`Finding`s of the octaves of a `noise.Noise`."""
    out = []
    for o in noise.octaves:
        s = o.ratio * o.nu
        p = float(min(1.0, 2 * min(chi2.cdf(s, o.nu), chi2.sf(s, o.nu))))
        if p * len(noise.octaves) >= alpha or abs(np.log(o.ratio) / 2) < np.log(LEAST):
            continue
        low, high = (s / chi2.ppf(q, o.nu) for q in ((1 + LEVEL) / 2, (1 - LEVEL) / 2))
        span = "in the mean of a dwell" if o.last == 0 else f"in octaves {o.first} .. {o.last} of a dwell"
        out.append(Finding(o.observable, "repeats", span, *map(float, np.sqrt([o.ratio, low, high])), p))
    return out

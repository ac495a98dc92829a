"""Observables of a segment in few numbers: means over bins that are fine at its beginning and wide at its end.

    observable   stream in physical units: V, Hz, V^2
    bins         FIRST_BIN frames, then twice as many each, up to the segment's end
    feature      mean of an observable over a bin

Source    docs/measured.md
"""

from typing import NamedTuple

import numpy as np

from testbench.errors import ConfigError

FIRST_BIN = 16  # frames
WORD_V = 10.0 / 2**23
HZ = 26e6 / 2**48


class Observable(NamedTuple):
    """A stream in physical units."""

    stream: str
    unit: str
    driven: bool  # an open-loop replay of the plant predicts it


OBSERVABLES = {
    "adc_xI": Observable("adc_xI", "V", True),
    "adc_xQ": Observable("adc_xQ", "V", True),
    "adc_yI": Observable("adc_yI", "V", True),
    "adc_yQ": Observable("adc_yQ", "V", True),
    "f_word": Observable("nco_fword", "Hz", False),
    "amplitude": Observable("amplitude_word", "V", False),
    "force": Observable("rate_word", "V", False),
    "v_q2": Observable("quadrature_code", "V^2", False),
}


def physical(name, raw, lsb_v):
    """Values of an observable from raw codes; lsb_v is that of its stream."""
    values = np.asarray(raw, float)
    if name == "f_word":
        return values * HZ
    if name in ("amplitude", "force"):
        return values * WORD_V
    return (values * lsb_v) ** 2 if name == "v_q2" else values * lsb_v


def demand(streams, names):
    """ConfigError if the stream of an observable is not among those that were recorded."""
    for name in names:
        if OBSERVABLES[name].stream not in streams:
            text = f"expected a stream with one row per frame, found none; the observable {name} is computed from it"
            raise ConfigError(f"/streams/{OBSERVABLES[name].stream}: {text}")


def bins(frames, width=FIRST_BIN):
    """First frames of the bins of a segment, and its end: `width`, then twice as many each."""
    edges = [0]
    while edges[-1] + width < frames:
        edges.append(edges[-1] + width)
        width *= 2
    # what is left joins the last bin, unless it is the longer one
    if len(edges) > 1 and frames - edges[-1] < (edges[-1] - edges[-2]):
        edges.pop()
    return np.array([*edges, frames])


def means(values, edges):
    """Means over bins, about the first value, so that a mean of a million large numbers keeps its digits."""
    return np.add.reduceat(values - values[0], edges[:-1]) / np.diff(edges) + values[0]


def features(streams, lsb_v, names, first, frames):
    """(observables, bins) means over the bins of frames first .. first + frames - 1.

    streams  {stream: codes of each frame};  lsb_v  {stream: volts per code}
    """
    out = []
    for name in names:
        stream = OBSERVABLES[name].stream
        values = physical(name, streams[stream][first : first + frames], lsb_v.get(stream, 1.0))
        out.append(means(values, bins(frames)))
    return np.array(out)

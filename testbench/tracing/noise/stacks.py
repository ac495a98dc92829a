"""Blocks of equal length together, so that what is done along time is done for all of them at once."""

from typing import NamedTuple

import numpy as np
from scipy.fft import dct, idct


class Stack(NamedTuple):
    """Blocks of one length."""

    rows: np.ndarray  # int (blocks, length)
    observables: tuple
    groups: tuple


def stacks(space, groups=None):
    """`Stack`s of a space, or of some of its groups."""
    lengths = {}
    for block in space.blocks:
        if groups is None or block.group in groups:
            lengths.setdefault(block.rows.stop - block.rows.start, []).append(block)
    return [
        Stack(
            np.array([np.arange(b.rows.start, b.rows.stop) for b in blocks]),
            tuple(b.observable for b in blocks),
            tuple(b.group for b in blocks),
        )
        for _, blocks in sorted(lengths.items())
    ]


def bands(length):
    """Octave of each DCT coefficient: 0 for the mean, then 1; 2, 3; 4 .. 7; ..."""
    j = np.arange(length)
    return np.where(j == 0, 0, np.floor(np.log2(np.maximum(j, 1))).astype(int) + 1)


def multiply(parts, v, factor):
    """v with its DCT coefficients multiplied by factor(stack): (blocks, length) or (blocks, length, columns)."""
    out = np.zeros(v.shape)
    for stack in parts:
        spectrum = dct(v[stack.rows], axis=1, norm="ortho")
        w = factor(stack)
        out[stack.rows] = idct(spectrum * (w if w.ndim == spectrum.ndim else w[..., None]), axis=1, norm="ortho")
    return out

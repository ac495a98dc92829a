"""Averaged plant, noise: the very samples of the other engines, drawn for many frames at once.

    C/V            samples and their integral: a half period of a demodulator takes a difference of the integral
    forces, DACs   growth of a mode in a frame: sum over its samples of n_k c_k, c_k from averaged.py
    converter      white_fine and flicker of each conversion, with the counters and states of adc.py

Source    docs/plant.md, analog_frontend/parts/noise.py
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.shapes import doubles, int64s
from analog_frontend.numeric.vector import LANES, integers, load, splat, store, store4, totals4
from analog_frontend.parts import adc, noise
from analog_frontend.parts.noise import HOLD
from fpga_model.jit import inlined, outlined

BATCH = 64  # frames, most
ROW = 1632  # samples, most: of 64 frames of 125 ticks, and what is read behind them
PIECE = 4 * LANES  # of a frame's table, unrolled
SCRATCH = 8 * LANES
assert ROW % PIECE == 0, "rows are filled in whole registers, four at a time"
BLOCKS = np.array([0, 1, 2, 3] * 2, np.int64)  # hashes of one conversion
# of half h of a hash, at 8 h: two channels, four hashes
DECAYS = np.array([noise.DECAY[4 * b + h] for h in range(4) for _ in range(2) for b in range(4)])
GAINS = np.array([noise.GAIN[4 * b + h] for h in range(4) for _ in range(2) for b in range(4)])


class Drawn(NamedTuple):
    """Noise of a batch of frames; arrays, mutated in place."""

    volts: doubles(2 * ROW)  # C/V samples of x, of y
    sums: doubles(2 * ROW)  # integral up to each of them (V samples)
    force: doubles(4 * ROW)  # forces on x and y, DAC outputs of drive and sense
    growth: doubles(4 * BATCH)  # of a_x and a_y, re and im
    converter: doubles(adc.CHANNELS * BATCH)  # V, of each channel's conversions
    begin: doubles(1)  # place among the samples at which the batch begins
    first: int64s(1)  # number of the first conversion
    poles: doubles(10 * LANES)  # states of the 1/f sources, two channels in a register, and two of scratch
    keys: int64s(32)  # their keys


def table(force):
    """(ticks since a sample began, 4, 2, room): averaged.Averaged.force, padded with zeros to whole pieces."""
    out = np.zeros((len(force), 4, 2, -(-force.shape[2] // PIECE) * PIECE))
    out[:, :, :, : force.shape[2]] = force.transpose(0, 1, 3, 2)
    return out


def batch(table, frame_ticks):
    """Frames of a batch, a power of two, and samples that are drawn for it: those of a frame and more behind it."""
    frame, more = -(-frame_ticks // HOLD), table.shape[3]
    frames = min(BATCH, 1 << ((ROW - more) // frame).bit_length() - 1)
    return frames, -(-(frames * frame + more) // PIECE) * PIECE


@inlined
def integral(d, row, sample_position):
    """Integral of the samples of a row of C/V noise up to `sample_position` (V samples)."""
    k = int(sample_position)
    return d.sums[row + k] + d.volts[row + k] * (sample_position - k)


@outlined
def integrate(q, at, d, sample_position, sign):
    """Add the integral of both rows up to `sample_position` to q[at ..]: x, x, y, y. Mutates `q`."""
    x, y = sign * integral(d, 0, sample_position), sign * integral(d, ROW, sample_position)
    q[at] += x
    q[at + 1] += x
    q[at + 2] += y
    q[at + 3] += y


@inlined
def _integrate(volts, sums, first, samples):
    """sums[k + 1] = sums[k] + volts[k]: four stretches side by side, because each waits for its last sum."""
    n = samples // 4
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for k in range(first, first + n):
        sums[k] = a
        sums[k + n] = b
        sums[k + 2 * n] = c
        sums[k + 3 * n] = d
        a += volts[k]
        b += volts[k + n]
        c += volts[k + 2 * n]
        d += volts[k + 3 * n]
    b += a
    c += b
    for k in range(first + n, first + 2 * n):
        sums[k] += a
    for k in range(first + 2 * n, first + 3 * n):
        sums[k] += b
    for k in range(first + 3 * n, first + 4 * n):
        sums[k] += c


@outlined
def draw(on, table, d, tick, frames, frame_ticks, samples):
    """Noise of `frames` frames of `frame_ticks` from the one that begins at `tick`. Mutates `d`.

    on       top.Noise
    samples  of each row
    """
    first = tick // HOLD
    if on.cv_x.on or on.cv_y.on:
        noise.fill_rows(on.cv_x, on.cv_y, first, 1, d.volts, 0, ROW, samples)
        _integrate(d.volts, d.sums, 0, samples)
        _integrate(d.volts, d.sums, ROW, samples)
    if not (on.force_x.on or on.force_y.on or on.drive_dac.on or on.sense_dac.on):
        return
    noise.fill_rows(on.force_x, on.force_y, first, 1, d.force, 0, ROW, samples)
    noise.fill_rows(on.drive_dac, on.sense_dac, first, 1, d.force, 2 * ROW, 3 * ROW, samples)
    c, room = table.reshape(-1), table.shape[3]
    for n in range(frames):
        begins = tick + n * frame_ticks
        at, row = begins // HOLD - first, 8 * room * (begins % HOLD)
        xr, xi, yr, yi = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for piece in range(0, room, PIECE):
            for k in range(piece, piece + PIECE, LANES):
                fx, fy = load(d.force, at + k), load(d.force, ROW + at + k)
                dx, dy = load(d.force, 2 * ROW + at + k), load(d.force, 3 * ROW + at + k)
                i = row + k
                xr = xr + (load(c, i) * fx + load(c, i + 4 * room) * dx)
                xi = xi + (load(c, i + room) * fx + load(c, i + 5 * room) * dx)
                yr = yr + (load(c, i + 2 * room) * fy + load(c, i + 6 * room) * dy)
                yi = yi + (load(c, i + 3 * room) * fy + load(c, i + 7 * room) * dy)
        store4(d.growth, 4 * n, totals4(xr, xi, yr, yi))


@inlined
def _store_white_sample(p, d, c, number, total):
    store(d.converter, c * BATCH + (number - d.first[0]), p.white[c].sigma * (total * noise.IH12_SCALE))


@inlined
def _white(p, d, c, number):
    """white_fine of eight conversions from `number` on, at their places of a channel's row. Mutates `d`."""
    ahead, white = integers(noise.ORDER, 0) * 3 + 3 * number, p.white[c]
    if white.on:
        total = noise.sum4(white.key0, white.key1, ahead)
        total = total + noise.sum4(white.key0, white.key1, ahead + 1)
        _store_white_sample(p, d, c, number, total + noise.sum4(white.key0, white.key1, ahead + 2))


@inlined
def _whites(p, d, number):
    """The same of every channel, four of them side by side. Mutates `d`."""
    a, b, c, e = p.white[0], p.white[1], p.white[2], p.white[3]
    if a.on and b.on and c.on and e.on:
        ahead = integers(noise.ORDER, 0) * 3 + 3 * number
        keys0, keys1 = (a.key0, b.key0, c.key0, e.key0), (a.key1, b.key1, c.key1, e.key1)
        s = noise.words4(keys0, keys1, (ahead, ahead, ahead, ahead))
        ahead = ahead + 1
        t = noise.words4(keys0, keys1, (ahead, ahead, ahead, ahead))
        ahead = ahead + 1
        u = noise.words4(keys0, keys1, (ahead, ahead, ahead, ahead))
        _store_white_sample(p, d, 0, number, noise.halves(s[0]) + noise.halves(t[0]) + noise.halves(u[0]))
        _store_white_sample(p, d, 1, number, noise.halves(s[1]) + noise.halves(t[1]) + noise.halves(u[1]))
        _store_white_sample(p, d, 2, number, noise.halves(s[2]) + noise.halves(t[2]) + noise.halves(u[2]))
        _store_white_sample(p, d, 3, number, noise.halves(s[3]) + noise.halves(t[3]) + noise.halves(u[3]))
    else:
        for channel in range(4):
            _white(p, d, channel, number)
    _white(p, d, 4, number)


@inlined
def _load_pole_registers(w, at):
    return load(w, at), load(w, at + LANES), load(w, at + 2 * LANES), load(w, at + 3 * LANES)


@inlined
def _step_flicker_poles(s, words):
    """States of two channels after one sample; half h of a hash is one register for both."""
    x, y = words
    a, g = _load_pole_registers(DECAYS, 0), _load_pole_registers(GAINS, 0)
    return (
        a[0] * s[0] + g[0] * ((x & noise.LOW) * 1.0 - noise.HALF),
        a[1] * s[1] + g[1] * ((x >> 16) * 1.0 - noise.HALF),
        a[2] * s[2] + g[2] * ((y & noise.LOW) * 1.0 - noise.HALF),
        a[3] * s[3] + g[3] * ((y >> 16) * 1.0 - noise.HALF),
    )


@inlined
def _pink(p, d, w, c, n, s):
    """Flicker of conversion `n` of channels c and c + 1, onto the white noise. Mutates `d` and the scratch."""
    at = SCRATCH + 4 * c
    store(w, at, (s[0] + s[1]) + (s[2] + s[3]))
    pink = p.flicker[c].level * (((w[at] + w[at + 1]) + w[at + 2]) + w[at + 3])
    i, j = c * BATCH + n, (c + 1) * BATCH + n
    d.converter[i] = (d.converter[i] if p.white[c].on else 0.0) + pink
    pink = p.flicker[c + 1].level * (((w[at + 4] + w[at + 5]) + w[at + 6]) + w[at + 7])
    d.converter[j] = (d.converter[j] if p.white[c + 1].on else 0.0) + pink


@outlined
def convert(p, d, sums, number, frames):
    """Noise of `frames` conversions from `number` on. Mutates `d` and the 1/f states in `sums`.

    The states lie in registers of eight: two channels, four hashes each; half h of a hash is one register for all.
    """
    d.first[0] = number
    for n in range(0, frames, LANES):
        _whites(p, d, number + n)
    if not (p.flicker[0].on and p.flicker[1].on and p.flicker[2].on and p.flicker[3].on):
        for c in range(4):
            if p.flicker[c].on:
                for n in range(frames):
                    pink = noise.flicker_step(p.flicker[c], sums[c, adc.FRAMES :], number + n)
                    d.converter[c * BATCH + n] = (d.converter[c * BATCH + n] if p.white[c].on else 0.0) + pink
        return
    w, keys = d.poles, d.keys
    for c in range(4):
        for k in range(noise.POLES):
            w[LANES * (4 * (c >> 1) + (k & 3)) + 4 * (c & 1) + (k >> 2)] = sums[c, adc.FRAMES + k]
        for b in range(4):
            keys[4 * c + b], keys[16 + 4 * c + b] = p.flicker[c].key0, p.flicker[c].key1
    ahead = integers(BLOCKS, 0)
    key0, key1, more0, more1 = integers(keys, 0), integers(keys, 16), integers(keys, 8), integers(keys, 24)
    keys0, keys1 = (key0, more0, key0, more0), (key1, more1, key1, more1)
    s, t = _load_pole_registers(w, 0), _load_pole_registers(w, 4 * LANES)
    for n in range(0, frames, 2):
        first, second = ahead + 4 * (number + n), ahead + 4 * (number + n + 1)
        x, y, x_next, y_next = noise.words4(keys0, keys1, (first, first, second, second))
        s, t = _step_flicker_poles(s, x), _step_flicker_poles(t, y)
        _pink(p, d, w, 0, n, s)
        _pink(p, d, w, 2, n, t)
        if n + 1 < frames:
            s, t = _step_flicker_poles(s, x_next), _step_flicker_poles(t, y_next)
            _pink(p, d, w, 0, n + 1, s)
            _pink(p, d, w, 2, n + 1, t)
    for k in range(4):
        store(w, LANES * k, s[k])
        store(w, LANES * (4 + k), t[k])
    for c in range(4):
        for k in range(noise.POLES):
            sums[c, adc.FRAMES + k] = w[LANES * (4 * (c >> 1) + (k & 3)) + 4 * (c & 1) + (k >> 2)]

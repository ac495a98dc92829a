"""Eight converters: those whose samples coincide are summed and converted together, as `adc.convert_block` does one.

    sums            row WIDTH c + j, lanes side by side: j < FRAMES: the sums of channel c, above: poles of its flicker
    lane_sums, row  sums and inputs of one converter, for adc.convert_block: where they are not in step

Source    docs/decisions/0012-lanes.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.lanes import side_by_side
from analog_frontend.lanes.side_by_side import LANES, TICKS
from analog_frontend.numeric.arena import record_layout
from analog_frontend.numeric.shapes import doubles, int64s
from analog_frontend.numeric.vector import integers, load, splat, store
from analog_frontend.parts import adc, noise
from analog_frontend.parts.adc import CHANNELS, COUNT, DUE, FRAMES, PENDING, SAMPLE, TEMPERATURE
from analog_frontend.parts.noise import DECAY, GAIN, HALF, LOW, POLES
from fpga_model.jit import inlined, outlined

WIDTH = FRAMES + POLES
MIXED = -1


class Converters(NamedTuple):
    """Eight converters; behind the arrays of the plants."""

    clock: int64s(LANES, adc.CODES + CHANNELS)  # as adc.State.clock
    sums: doubles(CHANNELS * WIDTH * LANES)
    lane_sums: doubles(LANES, CHANNELS, WIDTH)  # as adc.State.sums, of those by themselves
    row: doubles(4 * TICKS)  # outputs of one
    sensor_v: doubles(LANES)  # voltage of the temperature sensor
    fell: int64s(LANES)  # what adc.convert_block returns
    one_clock: int64s(LANES)  # 1 if all have the same period, delay and decimation
    white_on: int64s(CHANNELS)  # 1: of all, 0: of none, MIXED
    white_keys: int64s(CHANNELS * 2 * LANES)
    white_sigma: doubles(CHANNELS * LANES)
    flicker_on: int64s(CHANNELS)
    flicker_keys: int64s(CHANNELS * 2 * LANES)
    flicker_level: doubles(CHANNELS * LANES)
    offset_v: doubles(LANES, CHANNELS)  # transfer, as adc.Params
    steps_per_v: doubles(LANES, CHANNELS)
    inl: doubles(LANES, CHANNELS)
    full_steps: doubles(LANES)
    step_code: int64s(LANES)
    code_hi: int64s(LANES)
    volts: doubles(CHANNELS * LANES)  # scratch
    counts: int64s(LANES)  # scratch


AT = record_layout(Converters, side_by_side.AT.sizes)
opened = AT.opened


class Transfer(NamedTuple):
    """What adc.code needs of adc.Params."""

    offset_v: np.ndarray
    steps_per_v: np.ndarray
    inl: np.ndarray
    full_steps: float
    step_code: int
    code_hi: int


def fill(a, converters):
    """Constants of up to eight adc.Params into `a`."""
    p = converters[0]
    a.one_clock[:] = len({(c.period, c.delay, c.decimation) for c in converters}) == 1
    for name in ("offset_v", "steps_per_v", "inl", "full_steps", "step_code", "code_hi"):
        for k, p in enumerate(converters):
            getattr(a, name)[k] = getattr(p, name)
    for name, size in (("white", "sigma"), ("flicker", "level")):
        on, keys, sizes = (getattr(a, f"{name}_{part}") for part in ("on", "keys", size))
        for c in range(CHANNELS):
            sources = [getattr(p, name)[c] for p in converters]
            switches = {source.on for source in sources}
            on[c] = switches.pop() if len(switches) == 1 else MIXED
            for k, source in enumerate(sources):
                keys[2 * c * LANES + k], keys[(2 * c + 1) * LANES + k] = source.key0, source.key1
                sizes[c * LANES + k] = getattr(source, size)


@inlined
def in_step(a, active):
    """Whether the next samples of all `active` ones fall together, at one place of a frame, with the same noise."""
    if not a.one_clock[0]:
        return False
    for c in range(CHANNELS):
        if a.white_on[c] == MIXED or a.flicker_on[c] == MIXED:
            return False
    first = -1
    for k in range(LANES):
        if active[k]:
            if first < 0:
                first = k
            x, y = a.clock[k], a.clock[first]
            if x[DUE] != y[DUE] or x[SAMPLE] != y[SAMPLE] or x[PENDING] != y[PENDING]:
                return False
    return True


@inlined
def enter(a, k):
    """The sums of one converter into the registers of eight. Mutates `a`."""
    for c in range(CHANNELS):
        for j in range(WIDTH):
            a.sums[(WIDTH * c + j) * LANES + k] = a.lane_sums[k, c, j]


@inlined
def unpack_lane_sums(a, k):
    """The reverse. Mutates `a`."""
    for c in range(CHANNELS):
        for j in range(WIDTH):
            a.lane_sums[k, c, j] = a.sums[(WIDTH * c + j) * LANES + k]


@inlined
def gather_plant_outputs(a, out, k, ticks):
    """The outputs of demodulators of plant `k` as adc.convert_block wants them. Mutates a.row."""
    for c in range(TEMPERATURE):
        for t in range(ticks + 1):
            a.row[4 * t + c] = out[(c * TICKS + t) * LANES + k]


@inlined
def _accumulate_sample(a, c, w0, w1, w2, v):
    at = WIDTH * c * LANES
    store(a.sums, at, load(a.sums, at) + w0 * v)
    store(a.sums, at + LANES, load(a.sums, at + LANES) + w1 * v)
    store(a.sums, at + 2 * LANES, load(a.sums, at + 2 * LANES) + w2 * v)


@inlined
def _sum_samples(a, out, p, due, m, end):
    """Samples from `due` to `end`, or to the last of a conversion; returns when the next is due, and its place."""
    sensor = load(a.sensor_v, 0)
    tick = due // p.tick_units
    tick_offset = due - tick * p.tick_units
    while due < end and m < p.decimation:
        while tick_offset >= p.tick_units:
            tick_offset = tick_offset - p.tick_units
            tick += 1
        frac = splat(tick_offset * p.per_tick)
        w0, w1, w2 = adc.weights(p.decimation, m)
        w0, w1, w2 = splat(w0), splat(w1), splat(w2)
        for c in range(TEMPERATURE):
            start = load(out, (c * TICKS + tick) * LANES)
            _accumulate_sample(a, c, w0, w1, w2, start + frac * (load(out, (c * TICKS + tick + 1) * LANES) - start))
        _accumulate_sample(a, TEMPERATURE, w0, w1, w2, sensor)
        m += 1
        due = due + p.period
        tick_offset = tick_offset + p.period
    return due, m


@inlined
def _step_flicker(a, at, pole, word):
    """One pole of a flicker, as in noise.flicker_step."""
    x = DECAY[pole] * load(a.sums, at) + GAIN[pole] * (word * 1.0 - splat(HALF))
    store(a.sums, at, x)
    return x


@inlined
def _flicker(a, c, counts):
    """As noise.flicker_step, of channel `c`."""
    key0, key1 = integers(a.flicker_keys, 2 * c * LANES), integers(a.flicker_keys, (2 * c + 1) * LANES)
    total = splat(0.0)
    for block in range(POLES // 4):
        x, y = noise.words(key0, key1, counts * (POLES // 4) + block)
        k = 4 * block
        at = (WIDTH * c + FRAMES + k) * LANES
        s0, s1 = _step_flicker(a, at, k, x & LOW), _step_flicker(a, at + LANES, k + 1, x >> 16)
        s2, s3 = _step_flicker(a, at + 2 * LANES, k + 2, y & LOW), _step_flicker(a, at + 3 * LANES, k + 3, y >> 16)
        total = total + ((s0 + s1) + (s2 + s3))
    return load(a.flicker_level, c * LANES) * total


@outlined
def _finish_conversion(floats, ints, normal):
    """The end of a frame of all eight, as adc.convert. Mutates both arrays."""
    a, active = opened(floats, ints), side_by_side.opened(floats, ints).active
    for k in range(LANES):
        a.counts[k] = a.clock[k, COUNT]
    counts = integers(a.counts, 0)
    for c in range(CHANNELS):
        at = WIDTH * c * LANES
        volts = load(a.sums, at + 2 * LANES) * normal
        if a.white_on[c]:
            key0, key1 = integers(a.white_keys, 2 * c * LANES), integers(a.white_keys, (2 * c + 1) * LANES)
            volts = volts + load(a.white_sigma, c * LANES) * noise.ih12(key0, key1, counts)
        if a.flicker_on[c]:
            volts = volts + _flicker(a, c, counts)
        store(a.volts, c * LANES, volts)
        store(a.sums, at + 2 * LANES, load(a.sums, at + LANES))
        store(a.sums, at + LANES, load(a.sums, at))
        store(a.sums, at, splat(0.0))
    for k in range(LANES):
        if active[k]:
            a.clock[k, COUNT] = a.clock[k, COUNT] + 1
            p = Transfer(a.offset_v[k], a.steps_per_v[k], a.inl[k], a.full_steps[k], a.step_code[k], a.code_hi[k])
            for c in range(CHANNELS):
                a.clock[k, adc.CODES + c] = adc.code(p, c, a.volts[c * LANES + k])


@inlined
def convert_lanes(floats, ints, p, first, ticks):
    """`ticks` of the active converters, which are in step; `first` is one of them, p its adc.Params.

    What adc.convert_block returns is left in `fell`. Mutates both arrays
    """
    a, v = opened(floats, ints), side_by_side.opened(floats, ints)
    due, m, end = a.clock[first, DUE], a.clock[first, SAMPLE], ticks * p.tick_units
    pending = a.clock[first, PENDING]
    while due < end:
        due, m = _sum_samples(a, v.out, p, due, m, end)
        if m == p.decimation:
            m, pending = 0, due - p.period + p.delay
            _finish_conversion(floats, ints, p.normal)
    for k in range(LANES):
        if v.active[k]:
            a.clock[k, DUE], a.clock[k, SAMPLE], a.clock[k, PENDING] = due - end, m, pending
            a.fell[k] = adc.ready(p, a.clock[k], ticks)

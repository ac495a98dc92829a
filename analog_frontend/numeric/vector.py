"""Eight (or four) doubles side by side, for ticks of a block or for gyroscopes: one operation per lane, nothing else.

    load(a, i) = a[i : i + 8]     store(a, i, v)     splat(x) = x in every lane
    a + b   a - b   a * b   a / b   lane by lane; a number stands for itself in every lane
    integers(a, i)   eight int64 of an array, with + - * & ^ >>; times a double they become doubles
    larger(a, b)     the larger of a and the magnitude of b     clamped(v, lo, hi) = min(max(v, lo), hi)
    ceiling(v)   turned4(v) = i v, for two complex numbers re, im, re, im
    select_lanes(a, b, x, y) = x where a <= b, else y
    join_lanes(a, b)   eight lanes from four and four   low(v)   high(v)   the first and the last four of eight
    store_fives(a, i, v)   lane k five times, a[i + 5 k : i + 5 k + 5]   store_rows(a, i, step, v)   v[k] at i + k step
    rows4(a, i, n)   n times four lanes, one behind the other, as a tuple; join_lanes and select_lanes take tuples too
    four(a, b, c, d)   pair(a, b) = a, a, b, b   splat4, load4, store4   lane(v, k) = v[k], k a constant    four lanes
totals4(a, b, c, d)   four lanes: the sum over all eight of each

LLVM maps a vector to what the CPU has (512, 256 or 128 bit) and never fuses, reorders or rounds differently: a lane is
bit for bit the scalar operation.
`load` and `store` check no bounds; the caller's arrays have room. Without compiler the lanes are NumPy arrays.
Source    docs/decisions/0007-frame-engine.md
"""

import numpy as np

from fpga_model.jit import DISABLED

LANES, FIVE = 8, 5

if DISABLED:

    def load(a, i):
        """a[i : i + 8]."""
        return np.array(a[i : i + LANES])

    def store(a, i, v):
        """a[i : i + 8] = v."""
        a[i : i + LANES] = v

    def splat(x):
        """x in every lane."""
        return np.full(LANES, x)

    def load4(a, i):
        """a[i : i + 4]."""
        return np.array(a[i : i + 4])

    def store4(a, i, v):
        """a[i : i + 4] = v."""
        a[i : i + 4] = v

    def splat4(x):
        """x in four lanes."""
        return np.full(4, x)

    def four(a, b, c, d):
        """Four lanes."""
        return np.array((a, b, c, d))

    def pair(a, b):
        """a in the first two lanes, b in the others."""
        return np.array((a, a, b, b))

    def store_rows(a, i, step, values):
        """values[k] at a[i + k step]."""
        for k, v in enumerate(values):
            a[i + k * step : i + k * step + len(v)] = v

    def rows4(a, i, count):
        """`count` times four lanes, one behind the other."""
        return tuple(load4(a, i + 4 * k) for k in range(count))

    def join_lanes(a, b):
        """Eight lanes from four and four, or a tuple of such from two tuples."""
        return tuple(map(join_lanes, a, b)) if isinstance(a, tuple) else np.concatenate([a, b])

    def low(v):
        """The first four of eight lanes."""
        return v[:4].copy()

    def high(v):
        """The last four of eight lanes."""
        return v[4:].copy()

    def ceiling(v):
        """The next whole number, lane by lane."""
        return np.ceil(v)

    def turned4(v):
        """i v: two complex numbers, re, im, re, im."""
        return np.array((-v[1], v[0], -v[3], v[2]))

    def select_lanes(a, b, x, y):
        """x where a <= b, else y; each of tuples."""
        return tuple(select_lanes(a, b, *v) for v in zip(x, y)) if isinstance(x, tuple) else np.where(a <= b, x, y)

    def lane(v, k):
        """Lane k."""
        return float(v[k])

    def totals4(a, b, c, d):
        """Sum over eight lanes of each."""
        halves = [v[:4] + v[4:] for v in (a, b, c, d)]
        return np.array([(v[0] + v[1]) + (v[2] + v[3]) for v in halves])

    def integers(a, i):
        """a[i : i + 8] of an int64 array."""
        return np.array(a[i : i + LANES])

    def larger(a, b):
        """The larger of `a` and the magnitude of `b`."""
        return np.fmax(a, np.abs(b))

    def clamp_lanes(v, lo, hi):
        """min(max(v, lo), hi)."""
        return np.minimum(np.maximum(v, lo), hi)

    def store_fives(a, i, v):
        """Lane k five times, at a[i + 5 k : i + 5 k + 5]."""
        a[i : i + FIVE * LANES] = np.repeat(v, FIVE)

else:
    from analog_frontend.numeric.vector_native import (  # noqa: F401
        ceiling,
        clamp_lanes,
        four,
        high,
        integers,
        join_lanes,
        lane,
        larger,
        load,
        load4,
        low,
        pair,
        rows4,
        select_lanes,
        splat,
        splat4,
        store,
        store4,
        store_fives,
        store_rows,
        totals4,
        turned4,
    )


def aligned_zeros(size):
    """Zeros that start at a multiple of 64 bytes: a register of eight lanes then never straddles two cache lines."""
    padded_zeros = np.zeros(size + LANES)
    first = -(padded_zeros.ctypes.data // 8) % LANES
    return padded_zeros[first : first + size]

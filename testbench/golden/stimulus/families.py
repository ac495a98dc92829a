"""Families that the formats of the inputs alone give: idle, corners, signs, walking ones, resets, enables, random.

Source  docs/golden.md
"""

import itertools

from testbench.golden.stimulus import blocks
from testbench.golden.stimulus.writer import corners

WALKING_ROWS = 2600  # rows that the walking ones of one block may take
RANDOM_ROWS = 600


def idle(w):
    w.append_row(times=8)


def corner_values(w):
    w.family("corners")
    for port in w.wide:
        for value in corners(port.fmt):
            w.operation({**w.some(), port.name: value})


def signs(w):
    """Every sign of every wide input together: where products and sums are longest."""
    w.family("signs")
    ends = [(port.fmt.lo, port.fmt.hi) for port in w.wide]
    if len(ends) > 6:
        mixes = [[w.random.pick(pair) for pair in ends] for _ in range(64)]
    else:
        mixes = itertools.product(*ends)
    for mix in mixes:
        values = {port.name: value for port, value in zip(w.wide, mix, strict=True)}
        w.operation(values)
        w.operation(values)


def walking_ones(w):
    w.family("walking_ones")
    port_bit_pairs = [(port, k) for port in w.wide for k in range(port.width)]
    stride = max(1, -(-len(port_bit_pairs) * (1 + w.block.wait) // WALKING_ROWS))
    for port, k in port_bit_pairs[::stride]:
        value = 1 << k
        if port.signed and k == port.width - 1:
            value = port.fmt.lo
        w.operation({**w.some(), port.name: value})


def reset_at(w):
    """Reset k rows after an operation began, for every k until it is over, and again with the strobes high."""
    w.family("reset_at")
    for k in range(min(blocks.sweep_clocks(w.block), 64) + 3):
        values = w.some()
        w.append_row({**values, **dict.fromkeys(w.block.strobes, 1)})
        w.append_row({**values, **({} if w.block.wait else dict.fromkeys(w.block.strobes, 1))}, times=k)
        w.append_row({**w.some(), **w.flips()}, rst=1)
        w.append_row(times=2)


def enable_at(w):
    """A second operation k rows after the first, for every k until it is over."""
    if not w.block.strobes:
        return
    w.family("enable_at")
    least = 1 if w.block.dense else w.block.wait
    for k in range(least, max(least, blocks.sweep_clocks(w.block)) + 3):
        values = w.some()
        w.append_row({**values, **dict.fromkeys(w.block.strobes, 1)})
        w.append_row(values, times=k - 1)
        w.operation(w.some())


def controls(w):
    """Every word of the 1-bit inputs, or 64 random ones, with random data."""
    if not w.block.dense:
        return
    w.family("controls")
    count = len(w.flags)
    words = range(1 << count) if count <= 6 else [w.random.draw_integer(1 << count) for _ in range(64)]
    for word in words:
        for _ in range(2):
            w.append_row({**w.some(), **{port.name: (word >> k) & 1 for k, port in enumerate(w.flags)}})


def steady_inputs(w):
    """Steady inputs with the strobes high, 1 to 40 rows each: counters, accumulators and idle tones."""
    if not w.block.dense:
        return
    w.family("held")
    for _ in range(40):
        values = {port.name: w.random.pick(corners(port.fmt)) for port in w.wide}
        values |= w.flips(1, 4)
        values |= dict.fromkeys(w.block.strobes, 1)
        w.append_row(values, times=1 + w.random.draw_integer(40))


def random_rows(w):
    if w.block.dense:
        w.family("random_dense")
        for _ in range(RANDOM_ROWS):
            w.append_row({**w.some(), **w.flips()}, rst=int(w.random.draw_integer(100) == 0))
        w.family("random_corners")
        for _ in range(RANDOM_ROWS):
            w.append_row({**{p.name: w.random.pick(corners(p.fmt)) for p in w.wide}, **w.flips(3, 4)})
    w.family("random_sparse")
    for _ in range(RANDOM_ROWS // (1 + w.block.wait)):
        non_strobe_flags = {k: v for k, v in w.flips().items() if k not in w.block.strobes}
        w.operation({**w.some(), **non_strobe_flags})
        if w.random.draw_integer(4) == 0:
            w.append_row(w.some(), times=w.random.draw_integer(5))


of_values = (corner_values, signs, walking_ones)
of_strobes = (reset_at, enable_at, controls, steady_inputs, random_rows)

"""Comparison of register rows: the first difference by clock, register and both values."""

from testbench import flatten


def assert_same_rows(like, got, want):
    """`got` (int64 array, one row per clock) equals `want` (list of tuples) in every register of the record `like`."""
    names = flatten.names(like)
    assert got.shape == (len(want), len(names))
    for clock, (a, b) in enumerate(zip(got.tolist(), want)):
        if tuple(a) != tuple(b):
            different = {name: (x, y) for name, x, y in zip(names, a, b) if x != y}
            raise AssertionError(f"clock {clock}: (got, want) {different}")


def assert_in_formats(state_fmt, got):
    """Every register stays within its declared format."""
    for (name, fmt), lowest, highest in zip(flatten.format_leaves(state_fmt), got.min(axis=0), got.max(axis=0)):
        assert fmt.holds(int(lowest)), (name, int(lowest))
        assert fmt.holds(int(highest)), (name, int(highest))

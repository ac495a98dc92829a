"""Shared by tests of blocks: raw values at the corners of a format, records row by row, and within their formats."""

from hypothesis import strategies as st

from fpga_model.block import python_function
from fpga_model.fixed import Fmt


def raws(fmt, around=()):
    """Raw values of a format, often at its ends, around zero, and around the given values."""
    near = [fmt.lo, fmt.lo + 1, -1, 0, 1, fmt.hi - 1, fmt.hi, *(v + d for v in around for d in (-1, 0, 1))]
    return st.one_of(st.sampled_from([v for v in near if fmt.holds(v)]), st.integers(fmt.lo, fmt.hi))


def fits(fmt, value):
    """Whether every field of a record holds its format."""
    if isinstance(fmt, Fmt):
        return fmt.holds(value)
    return len(fmt) == len(value) and all(fits(f, v) for f, v in zip(fmt, value, strict=True))


def rows(step, state, inputs):
    """The records before each edge and after the last one; step(state, *inputs)."""
    record = [state]
    for values in inputs:
        record.append(step(record[-1], *values))
    return record


def assert_rows(found, expected, fmt):
    """Every register at every clock, and every register within its format."""
    for n, (got, want) in enumerate(zip(found, expected, strict=True)):
        assert got == want, f"row {n}"
        assert fits(fmt, got), f"row {n}: {got} leaves its formats"


def uncompiled(monkeypatch, *modules):
    """Leave the functions of modules in Python: what they call may be anything."""
    for module in modules:
        for name, function in list(vars(module).items()):
            if getattr(python_function(function), "__module__", None) == module.__name__ and not isinstance(
                function, type
            ):
                monkeypatch.setattr(module, name, python_function(function))

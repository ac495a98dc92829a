"""Numbers of a column as the integers that the board had: the rounding error says whether they were those integers.

    code = round(value / size),  size V, Hz or 1 of a code       error = value / size - code, in LSB
    raw      every error below RAW_LSB: these are the board's own codes
    not raw  averaged, filtered, converted with another LSB or with few digits: no word follows from them

Source    docs/import.md
"""

from typing import NamedTuple

import numpy as np

from fpga_model.rates import MASTER_HZ
from testbench.errors import FileError
from testbench.measured.importing.record_map import INTEGERS, PREFIX_V
from testbench.measured.record import schema

RAW_LSB = 0.25
WORD_V = 10.0 / 2**23
HZ = MASTER_HZ / 2**48


class Codes(NamedTuple):
    """Integers of a stream, and what rounding them has cost."""

    values: np.ndarray  # int64
    lsb_v: float | None  # of a code, stated or the model's
    assumed: bool  # lsb_v is the model's
    error_lsb: float  # largest
    raw: bool
    step: float  # smallest step between values, in the column's unit

    @property
    def text(self):
        """What rounding has found."""
        if self.raw:
            return f"rounded by at most {self.error_lsb:.2g} LSB"
        return f"not raw: rounded by up to {self.error_lsb:.2g} LSB, smallest step {self.step:.4g}"


def _code_size(name, stream, lsb_v):
    """Size of a code in the column's unit."""
    if stream.unit in INTEGERS:
        return 1.0
    if stream.unit in PREFIX_V:
        of_word = WORD_V if schema.STREAMS[name].unit == "word" else lsb_v
        return of_word / PREFIX_V[stream.unit]
    return HZ / (1e3 if stream.unit == "kHz" else 1.0)


def codes(path, name, stream, values, model_lsb_v):
    """`Codes` of a column of float64; FileError where they exceed their bits."""
    lsb_v = stream.lsb_V or model_lsb_v
    with np.errstate(over="ignore"):
        scaled = values / _code_size(name, stream, lsb_v)
    rounded = np.rint(scaled)
    fmt = schema.STREAMS[name]
    lo, hi = (-(2.0 ** (fmt.bits - 1)), 2.0 ** (fmt.bits - 1) - 1) if fmt.signed else (0.0, 2.0**fmt.bits - 1)
    outside_rows = np.flatnonzero((rounded < lo) | (rounded > hi))
    if len(outside_rows):
        k = int(outside_rows[0])
        where = f"{path}: column {stream.column!r}: row {k + 1}"
        raise FileError(
            f"{where}: {values[k]:.6g} {stream.unit} is code {rounded[k]:.0f} of {name}, outside {lo:.0f} .. {hi:.0f}"
        )
    error = float(np.max(np.abs(scaled - rounded), initial=0.0))
    steps = np.diff(np.unique(values)) if error >= RAW_LSB else np.zeros(1)
    step = float(np.min(steps, initial=np.inf))
    return Codes(rounded.astype(np.int64), lsb_v, stream.lsb_V is None, error, error < RAW_LSB, step)

"""Arguments of the public API: what NumPy holds is as good as what Python does; what cannot be is one line.

Source  docs/api.md
"""

import math
import operator
import os

from testbench.errors import ConfigError


def numpy_to_python(value):
    """Python's own number, list or dictionary in place of NumPy's."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, dict):
        return {key: numpy_to_python(item) for key, item in value.items()}
    return [numpy_to_python(item) for item in value] if isinstance(value, (list, tuple)) else value


def name_of_file(name, value):
    """`value` if it can name a file or a folder."""
    if not isinstance(value, (str, os.PathLike)) or str(value) == "" or "\0" in str(value):
        raise ConfigError(f"{name} = {value!r} is not the name of a file or folder")
    return value


def integer(name, value, lo, hi, unit=""):
    """`value` as int within lo .. hi; a float is none, even if it is whole."""
    limits = f"{lo} .. {hi} {unit}".rstrip()
    try:
        number = operator.index(value)
    except TypeError:
        raise ConfigError(f"{name} = {value!r} is not an integer within {limits}") from None
    if not lo <= number <= hi:
        raise ConfigError(f"{name} = {number} is outside {limits}")
    return number


def number(name, value, lo, hi, unit=""):
    """`value` as float within lo .. hi."""
    limits = f"{lo:g} .. {hi:g} {unit}".rstrip()
    try:
        as_float = math.nan if isinstance(value, (str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        as_float = math.nan
    if not lo <= as_float <= hi:
        raise ConfigError(f"{name} = {value!r} is not a number within {limits}")
    return as_float


def series(name, values, lo, hi, unit=""):
    """Array of a number, or of a list of numbers, all within lo .. hi."""
    import numpy as np

    try:
        array = np.atleast_1d(values)
    except ValueError:  # lists of several lengths
        array = np.zeros(0)
    if array.ndim != 1 or not array.size or array.dtype.kind not in "fiu":
        raise ConfigError(f"{name} = {values!r} is neither a number nor a list of numbers ({lo:g} to {hi:g} {unit})")
    least, greatest = array.min(), array.max()
    if not (lo <= least and greatest <= hi):  # not a number is neither
        wrong = greatest if lo <= least else least
        raise ConfigError(f"{name} = {wrong:.10g} is outside {lo:g} .. {hi:g} {unit}")
    return array

"""Priors of a data sheet: what a laboratory knows of its board before any calibration.

    [relative]  "plant.KEY" = r    sd r |value| of a value, 0 < r < 1
    [factor]    "plant.KEY" = k    sd ln k of the logarithm of a positive value, 1 < k <= 10
The value is that of the model's configuration. A prior that the record states itself stays as it is.
Source    docs/wide_priors.md
"""

import math
from pathlib import Path

from testbench.errors import ConfigError
from testbench.measured.residual.parameters import LIMITS, Parameter
from testbench.storage.inputs import read_toml

BUNDLED_PATH = Path(__file__).with_name("data_sheet.toml")
LIMIT = {"relative": (0.0, 1.0), "factor": (1.0, 10.0)}
WIDE = 2e-3  # of the value, or of the logarithm: the linear model holds for less
BUNDLED_NAME = "sheet"


def read(path):
    """{key: (kind, tolerance)} of a file; ConfigError for what is no tolerance of a key of [plant]."""
    out = {}
    for kind, table in read_toml(path).items():
        if kind not in LIMIT or not isinstance(table, dict):
            raise ConfigError(f"{path}: [{kind}]: expected the tables {' and '.join(LIMIT)}")
        lo, hi = LIMIT[kind]
        for key, value in table.items():
            if key not in LIMITS:
                raise ConfigError(f"{path}: [{kind}] {key}: not a key of [plant]")
            if key in out:
                raise ConfigError(f"{path}: [{kind}] {key}: duplicate key, it already has a tolerance")
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not lo < value <= hi:
                raise ConfigError(
                    f"{path}: [{kind}] {key}: {value!r}, expected a number above {lo:g} and at most {hi:g}"
                )
            out[key] = kind, float(value)
    return out


def parameters(model, tolerances, declared=()):
    """`Parameter`s of a sheet about a configuration, behind those that a record declares."""
    out, declared_keys = list(declared), {p.key for p in declared}
    for key, (kind, tolerance) in tolerances.items():
        field, mean = LIMITS[key], float(getattr(model.plant, key.partition(".")[2]))
        if key in declared_keys:
            continue
        if not mean or (kind == "factor" and mean < 0):
            limit = "a value above 0" if kind == "factor" else "a value other than 0"
            raise ConfigError(f"data sheet: {key} = {mean:g}, a {kind} tolerance needs {limit}")
        logarithmic = mean > 0 and key not in ("plant.fx_hz", "plant.fy_hz")
        scale = math.log(tolerance) if kind == "factor" else tolerance if logarithmic else tolerance * abs(mean)
        out.append(Parameter(key, field.unit, mean, scale, logarithmic, field.lo, field.hi))
    return tuple(out)


def wide(parameters_):
    """True if a prior is wider than a linear model holds for."""
    return any(p.scale > WIDE * (1.0 if p.logarithmic else abs(p.mean)) > 0.0 for p in parameters_)

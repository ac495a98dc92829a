"""Parameters that a record declares as nuisances: their priors, and the coordinate in which they are fitted.

    u = (x - mean) / sd              of a prior "normal" or "uniform"
    u = log(x / mean) / (sd / mean)  of gains and quality factors, whose products the data see; "lognormal": sd of log x

Source    docs/measured.md
"""

import math
from typing import NamedTuple

from analog_frontend.parts import device
from testbench.errors import ConfigError
from testbench.measured.record.schema import rows

LOGARITHMIC = ("qx", "qy", "k_vf_drive_n_per_v", "k_vf_sense_n_per_v", "dcdx_f_per_m", "dcdy_f_per_m", "mass_kg")
LOSSES = ("plant.qx", "plant.qy")  # features go with 1 / Q: straight there, where an interval is a third of a value
WALL = 2.5  # sds of a wide prior: no board is farther from its sheet
LIMITS = {f"plant.{field.name}": field for field in device.FIELDS}


class Parameter(NamedTuple):
    """A parameter with its prior."""

    key: str
    unit: str
    mean: float
    scale: float  # of u: sd, or sd of the logarithm
    logarithmic: bool
    lo: float
    hi: float
    start: float | None = None  # where a linear model begins; None: at the mean

    @property
    def start_value(self):
        """Where a linear model begins."""
        return self.mean if self.start is None else self.start

    def normal(self):
        """(mean, sd) in the parameter's unit of the normal prior that is this one near `start_value`."""
        if not self.logarithmic:
            return self.mean, self.scale
        return self.start_value * (1 - math.log(self.start_value / self.mean)), self.scale * self.start_value

    def theta(self, value):
        """The coordinate of a value in the linear model of a wide prior: itself, or s (1 + log(value / s)).

        s (2 - s / value) of a quality factor; s `start_value`. All have a slope of 1 at s.
        """
        if not self.logarithmic:
            return value
        ratio = value / self.start_value
        return self.start_value * (2 - 1 / ratio if self.key in LOSSES else 1 + math.log(ratio))

    def clip_theta(self, theta):
        """The coordinate of the linear model within WALL sds of a wide prior."""
        if self.start is None:
            return theta
        return min(max(theta, self.theta(self.value(-WALL))), self.theta(self.value(WALL)))

    def value_from_theta(self, theta):
        """The parameter at a coordinate of the linear model: itself, or that of `theta`, clipped."""
        if self.start is None:
            return theta
        theta = self.clip_theta(theta)
        if self.logarithmic:
            ahead = theta / self.start_value - 1
            theta = self.start_value * (1 / (1 - ahead) if self.key in LOSSES else math.exp(ahead))
        return min(max(theta, self.lo), self.hi)

    def value(self, u):
        """The parameter at a coordinate."""
        return self.mean * math.exp(self.scale * u) if self.logarithmic else self.mean + self.scale * u

    def coordinate(self, value):
        """The coordinate of a value."""
        return math.log(value / self.mean) / self.scale if self.logarithmic else (value - self.mean) / self.scale

    def sd(self, u, sd_u):
        """Standard deviation in the parameter's unit of one in u."""
        return abs(self.value(u) * self.scale * sd_u) if self.logarithmic else self.scale * sd_u


def read_parameters(record):
    """`Parameter`s of the table /priors, in its order; ConfigError for one that no plant has."""
    out = []
    for key, dist, mean, sd in rows(record.tables["priors"], "param", "dist", "mean", "sd"):
        if key not in LIMITS:
            raise ConfigError(f"/priors {key}: not a key of [plant]; only those can be fitted")
        field = LIMITS[key]
        logarithmic = dist == "lognormal" or (field.name in LOGARITHMIC and mean > 0)
        if logarithmic and not mean > 0:
            raise ConfigError(f"/priors {key}: mean = {mean:g}, a lognormal prior needs a mean above 0")
        scale = sd / mean if logarithmic and dist != "lognormal" else sd
        out.append(Parameter(key, field.unit, mean, scale, logarithmic, field.lo, field.hi))
    if not out:
        raise ConfigError("/priors: names no parameter; there is nothing to fit")
    return tuple(out)

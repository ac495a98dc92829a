"""What the readers give: one class per kind of recording, in the units of the product, whatever file it came from."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.measured.quality.rows.series import grid_step, rounding_noise
from testbench.measured.quality.sheet import DB_PER_NEPER


def on_grid(x):
    """An axis that is a regular grid but for its print, without the print's rounding; any other as it is."""
    grid = np.linspace(x[0], x[-1], len(x))
    return grid if np.max(np.abs(grid - x)) <= 1.01 * grid_step(x) else x


class Trace(NamedTuple):
    """Header as text; abscissa in s ("ringdown") or Hz ("spectrum"), also as printed; power in dBm; what was mended."""

    path: str
    header: dict
    kind: str
    x: np.ndarray
    power_dbm: np.ndarray
    printed_x: np.ndarray
    quality: tuple = ()

    @property
    def sample(self):
        return self.header.get("sample id", "")

    @property
    def frequency_hz(self):
        return self.number("frequency [hz]")

    def number(self, name):
        """A number of the header by its name in small letters; NaN if there is none."""
        try:
            return float(self.header.get(name, "nan"))
        except ValueError:
            return float("nan")


class Sweep(NamedTuple):
    """Complex parameters over frequency; `regular`: the grid was restored; `rounding_hz`: what the print took away."""

    path: str
    comments: tuple
    frequency_hz: np.ndarray
    s: dict
    ohm: float
    regular: bool
    rounding_hz: float
    polar: dict  # {name: (size, degrees)} as printed, where the file has no real and imaginary parts
    decibels: bool  # the unit of these sizes

    @property
    def print_noise(self):
        """Noise (rms of the real or the imaginary part) that steps of the printed sizes make of S21."""
        if "s21" not in self.polar:
            return 0.0
        noise = rounding_noise(self.polar["s21"][0])
        return float(np.median(np.abs(self.s["s21"]))) / DB_PER_NEPER * noise if self.decibels else noise


class Meters(NamedTuple):
    """Points in the order of time; `readings_v` (points, meters), `spread_v` the same or None, in V."""

    path: Path
    sha256: str
    seconds: np.ndarray
    source_v: np.ndarray
    names: tuple
    readings_v: np.ndarray
    spread_v: np.ndarray | None
    environment: dict  # {column: (points,)}
    quality: tuple = ()  # what was mended


class Levels(NamedTuple):
    """One session: channels are {name: (2^bits,) V}."""

    path: Path
    sha256: str
    bits: int
    channels: dict


class InputOutput(NamedTuple):
    """Voltages (n,), sampling rate, and whether the digitiser says that it was overloaded."""

    path: str
    input_v: np.ndarray
    output_v: np.ndarray
    fs_hz: float
    overloaded: bool


class ZeroRateRecord(NamedTuple):
    """`counts` int (samples, axes)."""

    path: Path
    sha256: str
    counts: np.ndarray
    lsb_deg_per_s: float
    rate_hz: float

"""Values of an axis: listed, evenly spaced, or drawn.

    linspace  start + (stop - start) k / (count - 1), in exact decimals, rounded once
    logspace  start (stop / start)^(k / (count - 1)), 12 digits
    range     first, first + step, ... up to and including last; integers
    drawn     value k is a function of (seed, parameter, k) alone: SHA-256 -> 53 bits u in (0, 1) -> inverse CDF

Drawn values are rounded to 12 digits, so that the last bit of a logarithm does not change what a point is. A draw
outside `limits` is drawn again with another attempt number: more points, fewer points or other parameters change none.
Source  docs/campaigns.md
"""

import hashlib
import math
from fractions import Fraction
from statistics import NormalDist

from testbench.config.toml_text import short_toml
from testbench.errors import ConfigError

ATTEMPTS = 1000
FORMS = {
    "linspace": "[start, stop, count]",
    "logspace": "[start, stop, count]",
    "range": "[first, last] or [first, last, step], integers",
    "normal": "[mean, std]",
    "uniform": "[low, high]",
    "lognormal": "[median, sigma of the logarithm]",
    "integers": "[low, high], integers",
}
DRAWN = ("normal", "uniform", "lognormal", "integers")
MOST_VALUES = 1_000_000  # of an axis


def round_12_digits(value):
    """A number to 12 significant digits."""
    return float(f"{value:.12g}")


def uniform(seed, path, k, attempt=0):
    """A number in (0, 1), 53 bits, that depends on nothing but its arguments."""
    text = f"gyro draw 1|{seed}|{path}|{k}|{attempt}"
    word = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") >> 11
    return (word + 0.5) / 2**53


def _draw(kind, a, b, u):
    if kind == "normal":
        return round_12_digits(a + b * NormalDist().inv_cdf(u)) if b else round_12_digits(a)
    if kind == "uniform":
        return round_12_digits(a + (b - a) * u)
    if kind == "lognormal":
        return round_12_digits(a * math.exp(b * NormalDist().inv_cdf(u))) if b else round_12_digits(a)
    return a + int(u * (b - a + 1))


def draw_value(kind, a, b, seed, path, k, limits=None):
    """Value k of a drawn parameter; None if `limits` were missed `ATTEMPTS` times."""
    for attempt in range(ATTEMPTS):
        value = _draw(kind, a, b, uniform(seed, path, k, attempt))
        if limits is None or limits[0] <= value <= limits[1]:
            return value
    return None


class Spec:
    """What stands behind a parameter in an axis: a list of values, or {form = [...]}.

    where  for error lines, such as "plan.toml: [axes.board] plant.fx_hz"
    """

    def __init__(self, path, value, where):
        self.path, self.where = path, where
        self.form, self.numbers, self.limits = "list", value, None
        if isinstance(value, dict):
            self._read(value)
        elif not isinstance(value, list):
            self._fail(f"= {short_toml(value)} is not a list of values; forms: {', '.join(FORMS)}")
        elif not value:
            self._fail("= [] has no values; an axis needs at least one")

    def _fail(self, text):
        raise ConfigError(f"{self.where} {text}")

    def _read(self, value):
        forms = [key for key in value if key in FORMS]
        other = [key for key in value if key not in (*FORMS, "limits")]
        if other:
            self._fail(f"= {short_toml(value)}: {other[0]} is not one of {', '.join(FORMS)}, limits")
        if len(forms) != 1:
            self._fail(f"= {short_toml(value)}: give exactly one of {', '.join(FORMS)}")
        self.form = forms[0]
        self.numbers = value[self.form]
        argument_counts = (2, 3) if self.form == "range" else (3,) if self.form.endswith("space") else (2,)
        if not isinstance(self.numbers, list) or len(self.numbers) not in argument_counts:
            self._fail(f"= {short_toml(value)} is not of the form {{ {self.form} = {FORMS[self.form]} }}")
        is_integer_form = self.form in ("range", "integers")
        for number in self.numbers:
            self._check_number(number, value, is_integer_form)
        self._check_sense(value)
        if "limits" in value:
            self._check_limits(value)

    def _check_number(self, number, value, integer):
        if isinstance(number, bool) or not isinstance(number, int if integer else (int, float)):
            self._fail(f"= {short_toml(value)}: {short_toml(number)} is not {'an integer' if integer else 'a number'}")
        if not math.isfinite(number):
            self._fail(f"= {short_toml(value)}: {short_toml(number)} is not finite")

    def _check_sense(self, value):
        a, b = self.numbers[:2]
        if self.form.endswith("space"):
            count = self.numbers[2]
            if not isinstance(count, int) or not 1 <= count <= MOST_VALUES:
                self._fail(
                    f"= {short_toml(value)}: the count {short_toml(count)} is not an integer in 1 .. {MOST_VALUES}"
                )
            if self.form == "logspace" and not (a > 0 and b > 0):
                self._fail(f"= {short_toml(value)}: a logarithmic axis needs both ends above 0")
        elif self.form == "range":
            step = self.numbers[2] if len(self.numbers) == 3 else 1
            if not range(a, b + (1 if step > 0 else -1), step or 1) or step == 0:
                self._fail(f"= {short_toml(value)} has no values")
            if abs((b - a) // step) >= MOST_VALUES:
                self._fail(f"= {short_toml(value)} has more than {MOST_VALUES} values")
        elif self.form in ("uniform", "integers") and b < a:
            self._fail(f"= {short_toml(value)}: low is above high")
        elif self.form in ("normal", "lognormal") and b < 0:
            self._fail(f"= {short_toml(value)}: the spread {b:g} is below 0")
        if self.form == "lognormal" and a <= 0:
            self._fail(f"= {short_toml(value)}: the median {a:g} is not above 0")

    def _check_limits(self, value):
        limits = value["limits"]
        if self.form not in DRAWN:
            self._fail(f"= {short_toml(value)}: limits apply to draws only ({', '.join(DRAWN)})")
        if not isinstance(limits, list) or len(limits) != 2:
            self._fail(f"= {short_toml(value)}: limits must be a list [low, high]")
        for number in limits:
            self._check_number(number, value, False)
        self.limits = limits

    @property
    def length(self):
        """Number of values; None where the axis says how many."""
        if self.form in DRAWN:
            return None
        if self.form == "list":
            return len(self.numbers)
        return len(self.values(None, None))

    def values(self, count, seed):
        """The values; `count` and `seed` are those of the axis and matter to draws only."""
        if self.form == "list":
            return list(self.numbers)
        a, b = self.numbers[:2]
        if self.form == "range":
            step = self.numbers[2] if len(self.numbers) == 3 else 1
            return list(range(a, b + (1 if step > 0 else -1), step))
        if self.form == "linspace":
            n = self.numbers[2]
            lo, hi = Fraction(repr(a)), Fraction(repr(b))
            return [float(lo + (hi - lo) * k / max(n - 1, 1)) for k in range(n)]
        if self.form == "logspace":
            n = self.numbers[2]
            inner = [round_12_digits(a * (b / a) ** (k / max(n - 1, 1))) for k in range(n)]
            return [float(a), *inner[1:-1], float(b)] if n > 1 else [float(a)]
        out = [draw_value(self.form, a, b, seed, self.path, k, self.limits) for k in range(count)]
        if None in out:
            self._fail(
                f"= {self.form} {short_toml(self.numbers)} gave no value within limits {short_toml(self.limits)}"
            )
        return out

"""What the tracing core asks of a problem: measured features, a prediction of them, their noise, what may be wrong.

    y_kr = predict_k(theta, c) + e_kr      segment k of group g, repeat r; e Gaussian with covariance N_g
    whiten(e_kr)                           has covariance 1
Segments of one group share prediction and covariance: the core asks for the first of them.
Source    docs/tracing.md
"""

import difflib
import math
from typing import NamedTuple

import numpy as np

from testbench.errors import ConfigError

LIMIT_SDS = 2.0  # sd that a coefficient may lie outside of what physics allows


class PredictionFailed(Exception):
    """A point that cannot be predicted: diverged, out of range. It is never ranked."""


class Nuisance(NamedTuple):
    """Something declared as not known exactly; it is fitted before anything is called missing."""

    name: str
    unit: str
    value: float
    prior_sd: float  # inf: free
    step: float = 0.0  # of finite differences; 0: found by the core


class Law(NamedTuple):
    """An effect that the model may lack; coefficient 0 is bit-exactly nothing."""

    name: str
    port: str
    text: str
    unit: str
    scale: float  # plausible sd of the coefficient: its prior
    sign: int = 0  # +1: only >= 0, -1: only <= 0
    step: float = 0.0  # of finite differences; 0: scale * 1e-3
    kind: str = "plant"  # plant, instrument, preparation
    page: str = ""
    term: tuple = ()  # (("x", 3.0), ...): the monomial of a law of the grammar, as it is saved in a file
    low: float = -math.inf  # what physics allows; a coefficient beyond is told as such and never named
    high: float = math.inf
    reason: str = ""  # of these limits
    same: str = ""  # laws with the same text here are one law in other parameters: no experiment tells them apart

    def beyond(self, value, sd=0.0):
        """What a coefficient breaks, in words, if it is further than LIMIT_SDS sd outside of its limits; "" if not."""
        for limit, excess, than in ((self.low, self.low - value, "below"), (self.high, value - self.high, "above")):
            if excess > LIMIT_SDS * sd:
                violation = f"{self.name}: {value:.3g} is {than} the physical limit {limit:.3g} {self.unit}"
                return f"{violation} ({self.reason})"
        return ""


class Observable(NamedTuple):
    """Rows of a segment's features that belong together, in time order."""

    name: str
    unit: str
    rows: slice


class Segment(NamedTuple):
    """One stretch of data; the role is fixed before any analysis."""

    name: str
    condition: dict
    group: str  # repeats share it
    repeat: int
    role: str  # fit, validate
    observables: tuple


class PortForce(NamedTuple):
    """Missing input at a port, estimated from the data without any law: for discovery.

    values, columns, nuisance are whitened alike; block numbers stretches that are independent of each other.
    """

    port: str
    unit: str
    values: np.ndarray  # (n,)
    columns: dict  # law of the library: (n,)
    nuisance: np.ndarray  # (n, q)
    block: np.ndarray  # int (n,)


class Problem:
    """What the core asks of a problem; docs/tracing.md says what each member means.

    Without a default: `name`, `nuisances`, `laws`, `segments`, `hashes` and the functions down to `repeatability_rms`.
    A subclass names its further public members in `adds`; any other public name, in its body or set later, is refused.
    """

    linear_in, library, library_late = frozenset(), (), False
    noise_gain = noise_estimated_from = None
    noise_along = 1.0  # variance of whitened noise along what is fitted, in units of that over all directions
    noise_from_repeats, prediction_noise = False, 0.0
    heldout_by, heldout_view, heldout_independent = "observable", None, True
    firmware = firmware_certificate = numerical_certificate = None
    warnings, noise_findings = (), ()
    least_d = 0.0  # sigmas that a law needs to be named
    _members = frozenset(("name", "nuisances", "laws", "segments", "hashes"))

    def __init_subclass__(cls, adds="", **more):
        super().__init_subclass__(**more)
        cls._members = cls._members.union(adds.split(), (n for n in dir(Problem) if not n.startswith("_")))
        for name in vars(cls):
            cls._check_member(name, TypeError)

    def __setattr__(self, name, value):
        self._check_member(name, AttributeError)
        super().__setattr__(name, value)

    @classmethod
    def _check_member(cls, name, error):
        if not name.startswith("_") and name not in cls._members:
            close_matches = difflib.get_close_matches(name, cls._members, 1)
            hint = f"; did you mean {close_matches[0]}?" if close_matches else " and is not named in adds"
            raise error(f"{cls.__name__}.{name} is not a member of a problem{hint}")

    def observed_features(self, k):
        """Features of segment k, (n,)."""
        raise NotImplementedError

    def predict(self, points, which):
        """[[(n,) per segment of `which`] per (theta, {law: coefficient}) of `points`]; PredictionFailed."""
        raise NotImplementedError

    def whiten(self, k, v):
        """Features of segment k, (n,) or (n, m), with unit covariance."""
        raise NotImplementedError

    def noise_draw(self, k, rng):
        """One draw of the noise of segment k, (n,)."""
        raise NotImplementedError

    def noise_draws(self, k, count, rng):
        """(n, count) draws of the noise of segment k."""
        return np.stack([self.noise_draw(k, rng) for _ in range(count)], axis=1)

    def repeatability_rms(self, k):
        """{observable: rms of segment k's repeatability}."""
        raise NotImplementedError

    def whitened_rows(self, k):
        """{observable: rows} behind `whiten`; None: those of the features."""
        return None

    def force_at(self, theta, effects):
        """`PortForce`s at a point; None: discovery takes the whitened residual."""
        return None

    def insufficient_data_reason(self, law):
        """Why no data of these segments can support what a law says, whatever its size; "" if they can."""
        return ""

    def experiments(self, laws):
        """A problem whose segments are conditions that could be recorded, to tell `laws` apart; None: these again."""
        return None

    def condition_text(self, k):
        """The condition of segment k as the plan of a recording takes it; "" if there is no such plan."""
        return ""

    def law_file(self, law, value, sd, hashes):
        """Text of the file of a law that was found; None: the core's own."""
        return None


def all_laws(problem):
    """{name: Law} of catalogue and library; a name is in one of them."""
    return {law.name: law for law in (*problem.laws, *problem.library)}


def duplicate_laws(problem, names):
    """{law: the first of `names` that is the same law in other parameters}."""
    laws, first = all_laws(problem), {}
    law_texts = [(name, laws[name].same) for name in names if laws[name].same]
    return {name: first[text] for name, text in law_texts if first.setdefault(text, name) != name}


def _unique(what, names):
    twice = sorted({n for n in names if list(names).count(n) > 1})
    if twice:
        raise ConfigError(f"problem: duplicate {what} {twice[0]}")


def check(problem):
    """Refuse a problem that cannot be traced; ConfigError says what, where, value, limit."""
    laws = (*problem.laws, *problem.library)
    _unique("nuisance", [n.name for n in problem.nuisances])
    _unique("law", [law.name for law in laws])
    _unique("segment", [s.name for s in problem.segments])
    for n in problem.nuisances:
        if not math.isfinite(n.value) or not n.prior_sd > 0:
            raise ConfigError(
                f"nuisance {n.name}: value {n.value}, sd {n.prior_sd} {n.unit}; expected finite numbers and sd above 0"
            )
    for law in laws:
        if not (math.isfinite(law.scale) and law.scale > 0) or law.sign not in (-1, 0, 1):
            raise ConfigError(
                f"law {law.name}: scale {law.scale} {law.unit}, sign {law.sign}; expected scale > 0, sign -1, 0 or 1"
            )
        if not law.low <= 0.0 <= law.high:
            raise ConfigError(f"law {law.name}: limits {law.low} .. {law.high} {law.unit} do not include 0")
    if not any(s.role == "fit" for s in problem.segments):
        raise ConfigError(f"{problem.name}: no segment with the role fit")
    group_shapes = {}
    for k, s in enumerate(problem.segments):
        if s.role not in ("fit", "validate"):
            raise ConfigError(f"segment {s.name}: role {s.role}, expected fit or validate")
        y = np.asarray(problem.observed_features(k))
        if y.ndim != 1 or not len(y) or not np.all(np.isfinite(y)):
            raise ConfigError(f"segment {s.name}: features must be finite and one-dimensional, shape {y.shape}")
        if group_shapes.setdefault(s.group, (len(y), s.role)) != (len(y), s.role):
            raise ConfigError(f"segment {s.name}: repeats of group {s.group} differ in role or number of features")

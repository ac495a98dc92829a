"""The closed loop as a problem of the tracing core: a linear model about an anchor that the exact engine has computed.

    y_k(theta, c) = A_k + T_k (theta - theta_a) + L_k (c - c_a)
    A T L   the linear model, its anchor and the place of each condition: loop_anchor.py
    N    covariance of the averaged plant's draws, pooled over conditions
    jitter   re-timed reference edges beat slowly with the drive frequency: a change of 1e-6 Hz moves the instants at
             which they slip, and nobody knows f_x so well. Every draw has its own f_x, JITTER_HZ wide, by a stiffness
             at force_x, as every power-on of a board has, and its own phase of the drive at a step of the rate

The core sees a problem that is linear; what it finds becomes the next anchor (loop_trace.py), until the exact engine
and the linear model agree there.
Source    docs/measured.md, docs/tracing.md
"""

import copy
import re
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from testbench.config import law_file
from testbench.measured.closed_loop import loop_noise, loop_runs, loop_spectra
from testbench.measured.closed_loop.loop_anchor import PREVIEW_DRAWS, AnchoredLoop
from testbench.measured.closed_loop.loop_offers import Offered, describe_shadowed_laws
from testbench.measured.closed_loop.loop_tangents import Tangents
from testbench.measured.residual import features
from testbench.tracing.noise import findings
from testbench.tracing.problem.problem import Nuisance, Observable, Segment

# beside wide priors: an effect of 8 sigmas, for which rates are promised, shows more in 97.5 % of records
WIDE_LEAST_D = 6.0


class Measured(NamedTuple):
    """What has been recorded: conditions (plan.Condition), features {condition id: (repeats, n)}."""

    name: str
    conditions: tuple
    values: dict
    hashes: dict
    densities: MappingProxyType = MappingProxyType({})  # {condition id: loop_spectra.densities of its dwells}


class LoopCache:
    """Anchors, tangents and noise by what they depend on: trials under the same conditions share them."""

    def __init__(self):
        self.noise, self.columns, self.steps, self.exact, self.responses = {}, {}, {}, {}, {}
        self.densities = {}


class LoopProblem(AnchoredLoop):
    """Features of a closed loop's dwells, see the module.

    model       configuration of the model; nuisances  measured.parameters.Parameter
    candidates  loop_laws.Candidate of the catalogue;   library  those of the grammar, which cost runs when asked for
    """

    library_late = True

    def __init__(self, measured, model, nuisances, candidates, library=(), bench=None, loop_cache=None, progress=None):
        # runs are shared by all records at one time from power-on; laws that ask for it have that of the record
        self.after = {c.id: c.settle_s for c in measured.conditions}
        conditions = tuple(c._replace(settle_s=loop_runs.SETTLE_S) for c in measured.conditions)
        measured = measured._replace(conditions=conditions)
        self.name, self.recorded, self.model = measured.name, measured, model
        self.parameters, self.progress = tuple(nuisances), progress
        self.bench, self.kept = bench or loop_runs.Bench(), loop_cache or LoopCache()
        # what is fitted as a nuisance is no law beside it
        nuisance_keys = {p.key for p in self.parameters}
        candidates, library = ([c for c in laws if c.key not in nuisance_keys] for laws in (candidates, library))
        self.candidates = {c.law.name: c for c in (*candidates, *library)}
        self.timed = frozenset(name for name, c in self.candidates.items() if c.is_time_dependent(model.device()))
        self.nuisances = tuple(Nuisance(p.key, p.unit, *p.normal()) for p in self.parameters)
        self.laws, self.library = tuple(c.law for c in candidates), tuple(c.law for c in library)
        self.linear_in = frozenset([n.name for n in self.nuisances] + list(self.candidates))
        self.conditions = {c.id: c for c in measured.conditions}
        self.segments = tuple(_segments(measured))
        self.hashes = dict(measured.hashes)
        # stiffness that moves the drive mode by a hertz
        self.per_hz = 8 * np.pi**2 * model.plant.mass_kg * model.plant.fx_hz
        self._sizes = {c.id: loop_runs.feature_count(c) for c in measured.conditions}
        self._count = {c.id: len(loop_runs.bins(c)) - 1 for c in measured.conditions}
        self.slope = {c.id: _feature_slope_per_hz(c) for c in measured.conditions}
        self.place, self._densities = dict.fromkeys(self.conditions, 0.0), {}
        self._set_frequency_offsets()
        draws = self._draws(loop_noise.NOISE_DRAWS, power_on=True)
        fitted = {g: (v[:, : self._sizes[g]], self.slope[g][: self._sizes[g]]) for g, v in draws.items()}
        self._noise, self.noise_gain = loop_noise.estimate_noise(fitted), loop_noise.compute_noise_gain(fitted)
        self._begun, self._middle = draws, {g: v.mean(axis=0) for g, v in draws.items()}
        self.heldout_view = Fine(self, {g: v[:, self._sizes[g] :] for g, v in draws.items()})
        self._rows = {s.group: k for k, s in enumerate(self.segments)}
        self.anchors, self.draws, self.tangent = 0, PREVIEW_DRAWS, None
        self.first = np.array([p.start_value for p in self.parameters])
        self.starts = tuple(p.start for p in self.parameters if p.start is not None)
        self.least_d = WIDE_LEAST_D if self.starts else 0.0
        self.anchor(self.first, {})
        self.tangents = Tangents(self)
        for names in (self.nuisances, self.laws):
            self.tangents.make(self.tangents.exclude_response_laws([item.name for item in names]))
        self.tangent = self.tangents.matrix("fit") | self.tangents.matrix("validate")
        self.noise_along = self._law_noise_ratio(fitted) if self.laws else 1.0
        if any(np.any(v) for v in measured.values.values()):
            self.settle()

    def observed_features(self, k):
        s = self.segments[k]
        return self.recorded.values[s.group][s.repeat][: self._sizes[s.group]]

    def predict(self, points, which):
        groups = [self.segments[k].group for k in which]
        return [[self.linear(theta, c, g)[: self._sizes[g]] for g in groups] for theta, c in points]

    def whiten(self, k, v):
        """Whitened features; those of fine bins behind them are left out."""
        n = self._noise[self.segments[k].group]
        v = np.asarray(v, float)[: len(n.sigma)]
        scaled = v / (n.sigma if v.ndim == 1 else n.sigma[:, None])
        return solve_triangular(n.chol, scaled, lower=True, check_finite=False)

    def noise_draw(self, k, rng):
        return self.noise_draws(k, 1, rng)[:, 0]

    def noise_draws(self, k, count, rng):
        """Draws of the averaged plant, either sign: slips make the noise of some power-ons larger."""
        group = self.segments[k].group
        rows = loop_noise.deviations(self._begun[group][:, : self._sizes[group]])
        return (rng.choice((-1.0, 1.0), size=(count, 1)) * rows[rng.integers(len(rows), size=count)]).T

    def _law_noise_ratio(self, draws):
        """Mean square of draws left out along the laws, in units of that of all their rows: loop_noise."""
        other, out = copy.copy(self), []
        for other._noise, excluded_draws in loop_noise.cross_validation_folds(draws):
            one = {g: v.T / np.sqrt(len(self.recorded.values[g])) for g, v in excluded_draws.items()}
            out.append(np.mean(other.pseudo(one) ** 2) / np.mean(other.whiten_fit_rows(one) ** 2))
        return float(np.mean(out))

    def repeatability_rms(self, k):
        n, s = self._noise[self.segments[k].group], self.segments[k]
        return {o.name: float(np.sqrt(np.mean(n.sigma[o.rows] ** 2))) for o in s.observables}

    @property
    def noise_findings(self):
        """Noise of the channels within the dwells against that of the draws at the anchor."""
        recorded_densities, model = (
            {g: d for g, d in of.items() if len(d) and all(v is not None for v in d)}
            for of in (self.recorded.densities, self._densities)
        )
        return tuple(findings.frame_findings(recorded_densities, model, loop_spectra.CHANNELS, loop_spectra.EDGES_HZ))

    def insufficient_data_reason(self, law):
        lags_s = [f.argument for one in self.candidates[law].unit_laws(self.model.device())
                            for f in one.factors if f.name == "lag"]  # fmt: skip
        span_s = max(self.after[c.id] + c.seconds for c in self.conditions.values()) - min(self.after.values())
        if not lags_s or span_s >= max(lags_s):
            return ""
        return f"its time constant is {max(lags_s):g} s, but the dwells cover {span_s:.2g} s of the time from power-on"

    def experiments(self, laws):
        return Offered(self, laws)

    def unidentifiable(self, fit):
        return (*super().unidentifiable(fit), *describe_shadowed_laws(self))

    def law_file(self, law, value, sd, hashes):
        """A law of the grammar as a file that `effects.files` and `gyro golden effect --law` take.

        Of a parameter of a part: its key in a configuration.
        """
        if not self.candidates[law.name].factors:
            key, now = law.name, self.model_at(self.first, {law.name: float(value)}).config
            section, _, field = key.partition(".")
            return (
                f"[{section}]\n{field} = {getattr(getattr(now, section), field)!r}  # sd {float(sd):.3g} {law.unit}\n"
            )
        name = re.sub(r"\W+", "_", law.name).strip("_")
        texts = self.candidates[law.name].law_texts(float(value))
        return law_file.text(law_file.LawFile(name, texts, (float(sd),), tuple(hashes.items())))

    def whitened_rows(self, k):
        """Rows of observables behind `whiten`: a triangle keeps each row among those before it."""
        return {o.name: o.rows for o in self.segments[k].observables}


class Fine:
    """The segments of a `LoopProblem` in bins of loop_runs.FINE frames: for held-out errors, nothing is fitted here."""

    def __init__(self, problem, draws):
        self._problem, self._draws = problem, {g: loop_noise.deviations(v) for g, v in draws.items()}
        self.segments = tuple(
            s._replace(
                observables=tuple(
                    o._replace(rows=slice(i * count, (i + 1) * count)) for i, o in enumerate(s.observables)
                )
            )
            for s in problem.segments
            for count in [draws[s.group].shape[1] // len(s.observables)]
        )

    @property
    def prediction_noise(self):
        return self._problem.prediction_noise

    def observed_features(self, k):
        s, measured = self.segments[k], self._problem.recorded
        return measured.values[s.group][s.repeat][loop_runs.feature_count(self._problem.conditions[s.group]) :]

    def predict(self, points, which):
        groups = [self.segments[k].group for k in which]
        return [
            [self._problem.linear(theta, c, g)[loop_runs.feature_count(self._problem.conditions[g]) :] for g in groups]
            for theta, c in points
        ]

    def noise_draws(self, k, count, rng):
        """Draws of the averaged plant."""
        rows = self._draws[self.segments[k].group]
        return rows[rng.integers(len(rows), size=count)].T

    def repeatability_rms(self, k):
        rows, s = self._draws[self.segments[k].group], self.segments[k]
        return {o.name: float(np.sqrt(np.mean(rows[:, o.rows] ** 2))) for o in s.observables}


def _feature_slope_per_hz(condition):
    """Change of the features per hertz of drive frequency: that of the frequency word."""
    out = [
        np.repeat(np.array(loop_runs.NAMES) == "f_word", len(edges) - 1)
        for edges in (loop_runs.bins(condition), loop_runs.fine_bins(condition))
    ]
    return np.concatenate(out).astype(float)


def _segments(measured):
    for c in measured.conditions:
        count = len(loop_runs.bins(c)) - 1
        observables = tuple(
            Observable(name, features.OBSERVABLES[name].unit, slice(i * count, (i + 1) * count))
            for i, name in enumerate(loop_runs.NAMES)
        )
        what = {"a_um": c.a_um, "rate_dps": c.rate_dps, "degc": c.temperature_degc, "detune_deg": c.detune_deg}
        for r in range(len(measured.values[c.id])):
            yield Segment(f"{c.id}.{r}", what, c.id, r, c.role, observables)

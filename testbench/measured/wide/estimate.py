"""From a data sheet to a calibration, in stages: each fits what its observables show best, the last one everything.

    frequency   frequency words                               f_x
    quadrature  V_q^2 over temperatures                       coupling stiffness
    drive       frequency and amplitude, drive detuned        f_x, Q_x, drive force and phase, their temperature
    rate        force, sense codes and V_q^2 behind a step    scale factor, f_y, Q_y, damping coupling, sense phase
    all         every observable but the one of slips         every parameter
    slips       every observable, draws of the exact engine   every parameter
Each stage minimises |w z|^2 + |u|^2 by Gauss-Newton within a trusted region; z in sigmas, w caps the rms of an
observable at CAP sigmas, so that one that is far off does not silence the others.
Source    docs/wide_priors.md
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from testbench.errors import ConfigError
from testbench.measured.closed_loop.loop_runs import EXACT, NAMES
from testbench.measured.residual.parameters import WALL
from testbench.measured.wide import noise_levels
from testbench.measured.wide.averaged_loop import AveragedLoop

CAP = 300.0
NOISE, DRAWS, MOST_EXACT_ATTEMPTS = 8, 8, 3  # of the averaged plant: for its noise, for a prediction of the last stage
SMALL_STEP, SHORT = (
    5.0,
    0.02,
)  # a step of fewer sigmas, as noise alone moves 18 parameters, or of this share of the residual
MISSED = 0.3  # share of a step by which its end may miss what the columns promised, for them to serve again
REGION, SHRINK = 1.0, 0.3  # sds of the priors: the largest step; factor of a region
SPLIT, RING = "plant.fy_hz", "plant.qy"  # another well is an sd of the one away; the other then begins at the sheet
FITTED = 2.0  # sigmas rms: no well is lower by much
POOR, GOOD = 0.3, 0.7  # share of a promised decrease
TINY = 1e-12  # of a cost: nothing is promised


class Stage(NamedTuple):
    """Observables that are fitted, parameters that are moved (of [plant]; empty: all), most steps."""

    name: str
    observables: tuple
    keys: tuple
    steps: int


DRIVE = (
    "fx_hz qx k_vf_drive_n_per_v dcdx_f_per_m drive_pole_1_s drive_pole_2_s drive_pole_3_s sid_switch_s "
    "cref_drive_f tcf_per_k dlnq_per_k"
)
QUADRATURE = "kxy_n_per_m kq_n_per_m_per_v2 kxy_tc_below_per_k kxy_tc_above_per_k"
RATE = "k_vf_sense_n_per_v dxy_ratio fy_hz qy dcdy_f_per_m sense_pole_1_s kxy_n_per_m coriolis_mass_kg cref_sense_f"
STAGES = (
    Stage("frequency", ("f_word",), ("fx_hz",), 3),
    Stage("quadrature", ("v_q2",), tuple(QUADRATURE.split()), 6),
    Stage("drive", ("f_word", "amplitude"), tuple(DRIVE.split()), 8),
    Stage("rate", ("force", "adc_yI", "adc_yQ", "v_q2"), tuple(RATE.split()), 8),
    Stage("all", tuple(name for name in NAMES if name != "adc_xI"), (), 12),
    Stage("slips", NAMES, (), 8),
)
ALL = -2


class Step(NamedTuple):
    """A step of a stage: rms of its observables before it, in sigmas; how far it goes by the columns, in sigmas."""

    stage: str
    rms: float
    length_sigmas: float
    gain_ratio: float  # share of the promised decrease
    radius: float  # of the region, in sds of the priors


class Estimate(NamedTuple):
    """Where the stages have led."""

    parameters: tuple  # with `start`
    config: object
    steps: tuple
    at_wall: tuple  # keys at WALL prior sds
    rms: float  # of all features at the end, in sigmas
    converged: bool
    noise: tuple = ()  # lines on levels above the declared ones

    def lines(self):
        """Lines for the report: how the stages have ended."""
        end = f"rms residual of the features {self.rms:.3g} sigma" + ("" if self.converged else ", NOT converged")
        summary_line = f"wide priors: {len(self.parameters)} parameters estimated from the record, {end}"
        return (summary_line, *(f"wide priors: {key} is at the edge of its prior" for key in self.at_wall), *self.noise)


class Work:
    """Point, prediction and columns there, and what is needed to move it."""

    def __init__(self, loop, progress=None):
        self.loop, self.progress, self.steps, self.last_columns = loop, progress, [], None
        self.u, self.whitening = np.zeros(len(loop.parameters)), None
        self.exact_excess = 0.0  # what the exact engine has besides the averaged plant
        first = loop.mean(self.u, NOISE)
        if first is None:
            raise ConfigError("wide priors: the configured board does not lock under the conditions of the record")
        self.sigma = loop.sigma(first[1])

    def weights(self, predicted, observables):
        """Matrix (n, n) that whitens features, 0 for observables that are not fitted.

        In the last stage by their covariance, before it by 1 / sigma; the rms of an observable counts as CAP at most.
        """
        if self.whitening is not None:
            return self.whitening
        z = self.loop.residual(predicted) / self.sigma
        w = np.zeros(len(z))
        for name in observables:
            rows = self.loop.observable == name
            w[rows] = 1 / max(1.0, np.sqrt(np.mean(z[rows] ** 2)) / CAP)
        return np.diag(w / self.sigma)

    def cost(self, u, predicted, weights):
        """What a stage minimises, at a point; infinite without lock."""
        return np.inf if predicted is None else float(np.sum((weights @ self.loop.residual(predicted)) ** 2) + u @ u)

    def rms(self, predicted, observables):
        """Rms of the residual of some observables, in sigmas."""
        z = self.loop.residual(predicted) / self.sigma
        return float(np.sqrt(np.mean(z[np.isin(self.loop.observable, observables)] ** 2)))

    def step(self, residual, columns, which, weights, radius):
        """(change, matrix, right side) of the least squares of a stage, priors as rows, within a region and WALL."""
        a = np.concatenate([weights @ columns, np.eye(len(which))])
        b = np.concatenate([weights @ residual, -self.u[which]])
        low, high = np.maximum(-WALL - self.u[which], -radius), np.minimum(WALL - self.u[which], radius)
        return lsq_linear(a, b, bounds=(np.minimum(low, -1e-9), np.maximum(high, 1e-9))).x, a, b

    def predict_features(self, u):
        """Features at a point: of the averaged plant, and what the exact engine has beyond it. None without lock."""
        slip_free_features = self.loop.slip_free_features(u)
        return None if slip_free_features is None else slip_free_features + self.exact_excess

    def run_exact_stage(self, stage):
        """The last stage, on the averaged plant beside the exact engine, until another look at both moves little.

        The difference is of slips and jumps with the point; the averaged plant is smooth. True if it moved little.
        """
        # gains and Q of the board, and with them its noise, are known by now
        try:
            self.sigma, self.whitening = self.loop.whitening_matrix(self.u)
        except ConfigError:
            return False
        for attempt in range(MOST_EXACT_ATTEMPTS):
            mean, slip_free_features = self.loop.mean(self.u, DRAWS, EXACT), self.loop.slip_free_features(self.u)
            if mean is None or slip_free_features is None:
                return False
            self.exact_excess, begun = mean[0] - slip_free_features, slip_free_features
            ended = self.run_stage(stage, self.last_columns[1] if attempt else None)
            if ended and np.linalg.norm(self.whitening @ (self.loop.slip_free_features(self.u) - begun)) < SMALL_STEP:
                return True
        return False

    def run_stage(self, stage, columns=None):
        """Gauss-Newton steps of a stage within a region that is trusted; True if the last one was short.

        A step is taken where it lowers the cost. The region grows and shrinks with what a step has kept of its promise.
        """
        keys = [p.key.partition(".")[2] for p in self.loop.parameters]
        which = [k for k, key in enumerate(keys) if not stage.keys or key in stage.keys]
        if not which:
            return True
        radius, features = REGION, self.predict_features(self.u)
        if features is None:
            return False
        for k in range(stage.steps):
            if self.progress:
                self.progress(f"wide priors: {stage.name}", k, stage.steps)
            fresh = columns is None
            if fresh:
                tangents = self.loop.columns(self.u, which, self.sigma, measured=not stage.keys)
                if tangents is None:
                    return False
                columns = tangents[1][:, which]
                self.last_columns = which, columns
            w, gap = self.weights(features, stage.observables), self.loop.residual(features)
            full_region_step, a, b = self.step(gap, columns, which, w, REGION)
            change = full_region_step if radius == REGION else self.step(gap, columns, which, w, radius)[0]
            ahead = self.u.copy()
            ahead[which] += change
            new_features = self.predict_features(ahead)
            before = self.cost(self.u, features, w)
            promised = float(b @ b - np.sum((b - a @ change) ** 2))
            gain_ratio = (before - self.cost(ahead, new_features, w)) / max(promised, TINY)
            step_sigma, free = (float(np.linalg.norm((a @ d)[: len(w)])) for d in (change, full_region_step))
            self.steps.append(Step(stage.name, self.rms(features, stage.observables), step_sigma, gain_ratio, radius))
            if gain_ratio > GOOD:
                radius = min(REGION, radius / SHRINK)
            elif gain_ratio < POOR and fresh:
                radius = SHRINK * min(radius, float(np.max(np.abs(change))))
            if gain_ratio > 0:
                missed = np.linalg.norm(w @ (new_features - features - columns @ change))
                self.u, features = ahead, new_features
            # a small region makes a step short, but is no end; a short step that new columns break their word for is
            if free < max(SMALL_STEP, SHORT * float(np.linalg.norm(b))) or (
                gain_ratio <= 0 and fresh and free < 2 * SMALL_STEP
            ):
                return True
            if (gain_ratio > 0 and missed > max(SMALL_STEP, MISSED * step_sigma)) or (gain_ratio <= 0 and not fresh):
                columns = None
        return False

    def try_other_minima(self, ended):
        """Two stages again from a split an sd to both sides where they ended above FITTED; stays at the lowest cost.

        The ring at the split has a phase at the end of each bin, so the cost has more than one minimum along f_y.
        True if the stage of the lowest has ended (`ended`: the first one).
        """
        keys, last = [p.key for p in self.loop.parameters], STAGES[ALL]
        features = self.loop.slip_free_features(self.u)
        if SPLIT not in keys or features is None or self.rms(features, last.observables) < FITTED:
            return ended
        begun, weights, minima = self.u, self.weights(features, last.observables), []
        minima.append((self.cost(begun, features, weights), 0, begun, ended))
        for side in (-1, 1):
            self.u = begun.copy()
            self.u[keys.index(SPLIT)] = np.clip(begun[keys.index(SPLIT)] + side, -WALL, WALL)
            if RING in keys:
                self.u[keys.index(RING)] = 0.0
            ended = [self.run_stage(stage) for stage in STAGES[ALL - 1 : ALL + 1]][-1]
            new_features = self.loop.slip_free_features(self.u)
            minima.append((self.cost(self.u, new_features, weights), side, self.u, ended))
            if new_features is not None and self.rms(new_features, last.observables) < FITTED:
                break
        *_, self.u, ended = min(minima)
        return ended


def estimate(measured, model, parameters, bench, progress=None):
    """`Estimate` of a recording (`loop_problem.Measured`) from wide priors about a configuration."""
    loop = AveragedLoop(measured, model, parameters, bench)
    work = Work(loop, progress)
    ends = []
    for stage in STAGES:
        ends.append(work.run_exact_stage(stage) if stage is STAGES[-1] else work.run_stage(stage))
        if stage is STAGES[ALL]:
            ends[-1] = work.try_other_minima(ends[-1])
    fitted_parameters = tuple(p._replace(start=p.value(float(x))) for p, x in zip(parameters, work.u))
    walls = tuple(p.key for p, x in zip(parameters, work.u) if abs(x) > WALL - 1e-6)
    end = loop.mean(work.u, DRAWS, EXACT)
    if end is None:
        raise ConfigError("wide priors: the estimated board does not lock under the conditions of the record")
    cfg, noise = noise_levels.fit_flicker_level(loop, loop.config(work.u))
    return Estimate(fitted_parameters, cfg, tuple(work.steps), walls, work.rms(end[0], NAMES), ends[-1], noise)

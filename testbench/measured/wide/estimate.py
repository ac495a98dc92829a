"""From a data sheet to a calibration, in stages: each fits what its observables show best, the last one everything.

    frequency   frequency words                               f_x
    quadrature  V_q^2 over temperatures                       coupling stiffness
    drive       frequency and amplitude, drive detuned        f_x, Q_x, drive force and phase, their temperature
    rate        force, sense codes and V_q^2 behind a step    scale factor, f_y, Q_y, damping coupling, sense phase
    all         every observable but the one of slips         every parameter
    slips       every observable, draws of the exact engine   every parameter
Each stage minimises |w z|^2 + |u|^2 by bounded Gauss-Newton with the averaged plant; z in sigmas, w caps the rms of an
observable at CAP sigmas, so that one that is far off does not silence the others.
Source    docs/wide_priors.md
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from testbench.errors import ConfigError
from testbench.measured.closed_loop.loop_runs import EXACT, NAMES
from testbench.measured.residual.parameters import WALL
from testbench.measured.wide.averaged_loop import AveragedLoop

CAP = 300.0
NOISE, DRAWS = 8, 4  # of the averaged plant: for its noise, for a prediction of the last stage
NEAR, SHORT = 5.0, 0.02  # a step of fewer sigmas, as noise alone moves 18 parameters, or of this share of the residual
MISSED = 0.3  # share of a step by which its end may miss what the columns promised


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
    Stage("frequency", ("f_word",), ("fx_hz",), 1),
    Stage("quadrature", ("v_q2",), tuple(QUADRATURE.split()), 1),
    Stage("drive", ("f_word", "amplitude"), tuple(DRIVE.split()), 2),
    Stage("rate", ("force", "adc_yI", "adc_yQ", "v_q2"), tuple(RATE.split()), 2),
    Stage("all", tuple(name for name in NAMES if name != "adc_xI"), (), 2),
    Stage("slips", NAMES, (), 8),
)


class Step(NamedTuple):
    """A step of a stage: rms of its observables before it, in sigmas; how far it goes by the columns, in sigmas."""

    stage: str
    rms: float
    moved: float


class Estimate(NamedTuple):
    """Where the stages have led."""

    parameters: tuple  # with `start`
    config: object
    steps: tuple
    at_wall: tuple  # keys at WALL prior sds
    rms: float  # of all features at the end, in sigmas
    converged: bool

    def lines(self):
        """Lines for the report: how the stages have ended."""
        end = f"rms of the features {self.rms:.3g} sigmas" + ("" if self.converged else ", NOT converged")
        told = f"wide priors: {len(self.parameters)} parameters from the record itself, {end}"
        return (told, *(f"wide priors: {key} is at the edge of its prior" for key in self.at_wall))


class Work:
    """Point, prediction and columns there, and what is needed to move it."""

    def __init__(self, loop, progress=None):
        self.loop, self.progress, self.steps = loop, progress, []
        self.u = np.zeros(len(loop.parameters))
        first = loop.mean(self.u, NOISE)
        if first is None:
            raise ConfigError("wide priors: the configured board does not lock under the conditions of the record")
        self.sigma = loop.sigma(first[1])

    def target(self, predicted, columns, which, observables):
        """(matrix, right side) of the least squares of a stage at the point, priors as rows."""
        z = self.loop.residual(predicted) / self.sigma
        w = np.zeros(len(z))
        for name in observables:
            rows = self.loop.observable == name
            w[rows] = 1 / max(1.0, np.sqrt(np.mean(z[rows] ** 2)) / CAP)
        j = columns[:, which] / self.sigma[:, None] * w[:, None]
        return np.concatenate([j, np.eye(len(which))]), np.concatenate([z * w, -self.u[which]])

    def rms(self, predicted, observables):
        """Rms of the residual of some observables, in sigmas."""
        z = self.loop.residual(predicted) / self.sigma
        return float(np.sqrt(np.mean(z[np.isin(self.loop.observable, observables)] ** 2)))

    def predicted(self, which, stage, known):
        """(features, columns) at the point; in the last stage features of the exact engine. None without lock.

        known  (columns, features that they promised here, sigmas moved): they serve again where they have kept it
        """
        if stage is not STAGES[-1]:
            return self.loop.columns(self.u, which, self.sigma, not stage.keys)
        mean = self.loop.mean(self.u, DRAWS, EXACT)
        if mean is None:
            return None
        if known:
            columns, promised, moved = known
            if np.linalg.norm((mean[0] - promised) / self.sigma) < max(NEAR, MISSED * moved):
                return mean[0], columns
        found = self.loop.columns(self.u, which, self.sigma, measured=True)
        return found and (mean[0], found[1])

    def stage(self, stage):
        """Bounded Gauss-Newton steps of a stage; True if the last one was short."""
        keys, last = [p.key.partition(".")[2] for p in self.loop.parameters], stage is STAGES[-1]
        which = [k for k, key in enumerate(keys) if not stage.keys or key in stage.keys]
        before, short, known = self.u, not which, None
        if last:
            # gains and Q of the board, and with them its noise, are known by now
            noisy = self.loop.mean(self.u, NOISE)
            self.sigma = self.loop.sigma(noisy[1]) if noisy else self.sigma
        for k in range(stage.steps if which else 0):
            if self.progress:
                self.progress(f"wide priors: {stage.name}", k, stage.steps)
            found = self.predicted(which, stage, known)
            if found is None:
                # no lock there: halfway back
                self.u, known = (self.u + before) / 2, None
                continue
            a, b = self.target(*found, which, stage.observables)
            bounds = np.minimum(-WALL - self.u[which], -1e-9), np.maximum(WALL - self.u[which], 1e-9)
            change = lsq_linear(a, b, bounds=bounds).x
            moved = float(np.linalg.norm((a @ change)[: len(self.sigma)]))
            self.steps.append(Step(stage.name, self.rms(found[0], stage.observables), moved))
            before, known = self.u.copy(), (found[1], found[0] + found[1][:, which] @ change, moved)
            self.u[which] = before[which] + change
            short = moved < max(NEAR, SHORT * float(np.linalg.norm(b)))
            if short:
                break
        return short


def estimate(measured, model, parameters, bench, progress=None):
    """`Estimate` of a recording (`loop_problem.Measured`) from wide priors about a configuration."""
    loop = AveragedLoop(measured, model, parameters, bench)
    work = Work(loop, progress)
    ends = [work.stage(stage) for stage in STAGES]
    found = tuple(p._replace(start=p.value(float(x))) for p, x in zip(parameters, work.u))
    walls = tuple(p.key for p, x in zip(parameters, work.u) if abs(x) > WALL - 1e-6)
    end = loop.mean(work.u, DRAWS, EXACT)
    if end is None:
        raise ConfigError(
            "wide priors: the stages end at a board that does not lock under the conditions of the record"
        )
    return Estimate(found, loop.config(work.u), tuple(work.steps), walls, work.rms(end[0], NAMES), ends[-1])

"""Tangents of laws that are products of states at ports, from a few runs: responses to a port's own states.

    law         puts a(t) B1 + b(t) B2 into its port along the trajectory (loop_phasors.py)
    responses   of the averaged loop to a constant share from the first tick on, and to one from the dwell's begin on
    column      sum over both shares: share before the dwell x constant response + its step at the dwell's begin x step
                response + the rest, block by block, x the derivative of the constant response from its first block on
    force_x x   moves the drive frequency, -1 / (8 pi^2 m f) Hz per N/m; its step moves what the loop has to follow

A run per port, quadrature and slow function takes the place of one per law: first order in a law is exact, as its own
change of the trajectory is of second order. The rest takes the loop for linear and unchanging within a condition.
Source    docs/measured.md
"""

import numpy as np
from scipy.signal import fftconvolve

from analog_frontend.effects import law
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench.measured.closed_loop import loop_phasors, loop_runs
from testbench.measured.closed_loop.loop_difference_plant import AIM, FREQUENCY_TOLERANCE_HZ, disable_retiming
from testbench.measured.closed_loop.loop_phasors import BASIS

SMALL = 1e-9  # share of the rest, of the whole, below which there is none
F_WORD = loop_runs.NAMES.index("f_word")
V_Q2 = loop_runs.NAMES.index("v_q2")
FREQUENCY, SPRING = ("force_x", "x"), ("force_y", "x")


SENSE_MOTION_STATES = {"y", "vy", "cy"}  # is noise and transients: a law of these is run by itself


NOT_COVERED = SENSE_MOTION_STATES | set(law.TIMES) - {"lag"}


def covers(laws):
    """True if the responses give the column of a sum of `law.Law`s."""
    return bool(laws) and not any(f.name in NOT_COVERED for one in laws for f in one.factors)


class Responses:
    """Responses of the conditions with a role, made once, and columns of laws made of them."""

    def __init__(self, of, role):
        self.of, self.conditions = of, [c for c in of.conditions.values() if c.role == role]
        self.base_model = of.model_at(of.first, {})
        self.base_model = self.base_model._replace(config=disable_retiming(self.base_model.config))
        self.at, self.kept = {}, {}
        run_requests = [(self.base_model, c, 0, 0.0) for c in self.conditions]
        for c, (rows, states) in zip(self.conditions, of.smooth(run_requests, self._base)):
            self.at[c.id] = rows, states
        self._make()

    def _base(self, run, rows):
        states = loop_phasors.probe(self.of.bench, run)
        return loop_runs.block_means(run, rows), loop_phasors.trajectory(run, states, rows)

    def _dwell(self, c):
        """First block of the dwell, and its time in s from power-on, half a frame early."""
        run = self.of.describe_run(self.base_model, c, 0)
        settle = loop_runs.settling(run)
        return settle // loop_runs.BLOCK, (loop_runs.begin_tick(run) + (settle - 0.5) * FRAME_TICKS) / TICK_HZ

    def _courses(self, c, base):
        """{number: text} of the slow functions at a base: 0 constant, 1 a step where the rate has one."""
        out = {} if base == FREQUENCY else {0: ""}
        return out | ({1: f"step({self._dwell(c)[1]:.7f})"} if loop_runs.before_dps(c) != c.rate_dps else {})

    def _compute_block_changes(self, trials):
        """{key: change of the blocks} of {key: (condition, port, state, step, coefficient)}; frequency held."""
        per_hz, todo, out = self.of.per_hz, list(trials), {}
        hertz = {
            key: -v / per_hz if (port, state) == FREQUENCY else 0.0 for key, (_, port, state, _, v) in trials.items()
        }
        for _ in range(2):
            run_requests = []
            for key in todo:
                c, port, state, step, value = trials[key]
                # what steps the frequency itself is held at its end: it has another before the dwell
                stiffness_law = f"force_x = {per_hz * hertz[key]!r} {'' if (port, state) == FREQUENCY else step} x"
                laws = (*self.base_model.laws, f"{port} = {value!r} {step} {state}", stiffness_law)
                run_requests.append((self.base_model._replace(laws=laws), c, 0, 0.0))
            again = []
            for key, rows in zip(todo, self.of.smooth(run_requests, loop_runs.block_means)):
                c, step = trials[key][0], trials[key][3]
                change = rows - self.at[c.id][0]
                more = float(change[F_WORD, -1])
                change[F_WORD, self._dwell(c)[0] if step else 0 :] += hertz[key]
                out[key] = change
                if abs(more) > FREQUENCY_TOLERANCE_HZ:
                    hertz[key] += more
                    again.append(key)
            todo = again
        return out

    def features(self, c, change):
        """Features of a change of blocks."""
        return loop_runs.features_of_blocks(c, change[:, self._dwell(c)[0] :])

    def _make(self):
        """{(condition, port, state, step): change of the blocks per unit of a share}."""
        bases = [(port, state) for port, pair in BASIS.items() for state in pair]
        c = max(self.conditions, key=lambda one: (len(self._courses(one, FREQUENCY)), one.a_um, abs(one.rate_dps)))
        values = {base: self._trial_coefficient(c, *base) for base in bases}
        tried = {b: (c, *b, next(iter(self._courses(c, b).values())), values[b]) for b in bases if self._courses(c, b)}
        for base, change in self._compute_block_changes(tried).items():
            size = self.of.size({c.id: self.features(c, change)}) * np.sqrt(len(self.of.conditions))
            values[base] *= float(np.clip(AIM / max(size, 1e-3), 1e-3, 1e4))
        trials = {
            (c.id, *base, step, side): (c, *base, text, side * values[base])
            for c in self.conditions
            for base in bases
            for step, text in self._courses(c, base).items()
            for side in (1.0, -1.0)
        }
        block_changes = self._compute_block_changes(trials)
        for name, *base, step, side in trials:
            if side > 0:
                both = block_changes[name, *base, step, 1.0] - block_changes[name, *base, step, -1.0]
                self.kept[name, *base, step] = both / (2 * values[tuple(base)])

    def _trial_coefficient(self, c, port, state):
        """A coefficient that puts 1e-4 of the drive's force, or of the C/V output, into a port."""
        states = self.at[c.id][1]
        reference_phasors = states["cx" if port in law.CV_PORTS else "vx"]
        board = self.of.model.plant
        gain = 1.0 if port in law.CV_PORTS else 2 * np.pi * board.fx_hz * board.mass_kg / board.qx
        return float(1e-4 * gain * np.abs(reference_phasors[0]) / np.abs(states[state][0]))

    def column(self, laws, later_s):
        """{condition: features per unit} of a sum of `law.Law`s; later_s: {condition: seconds by which it is later}."""
        out = {}
        for c in self.conditions:
            states, change = self.at[c.id][1], 0.0
            states = states | {"s": states["s"] + later_s[c.id]}
            temp_ref = self.of.model.plant.temp_ref_degc
            for one in laws:
                for state, share in zip(BASIS[one.port], loop_phasors.shares(one, states, temp_ref)):
                    change = change + self._response_to_share(c, (one.port, state), share)
            out[c.id] = self.features(c, change)
        return out

    def _response_to_share(self, c, base, share):
        """Change of the blocks by a share of a basis, (blocks,)."""
        dwell = self._dwell(c)[0]
        settled = share[dwell // 2 : dwell].mean()
        step = np.zeros(len(share))
        if (c.id, *base, 1) in self.kept:
            step[dwell:] = share[(dwell + len(share)) // 2 :].mean() - settled
        if base == FREQUENCY:
            change = np.zeros((len(loop_runs.NAMES), len(share)))
            change[F_WORD] = -(share - step) / self.of.per_hz
        else:
            change = settled * self.kept[c.id, *base, 0]
        if step[-1]:
            change = change + step[-1] * self.kept[c.id, *base, 1]
        residual_share = share - settled - step
        if base != FREQUENCY and np.abs(residual_share).max() > SMALL * np.abs(share).max():
            kernel = np.diff(self.kept[c.id, *base, 0], axis=1, prepend=0.0)
            change = change + fftconvolve(kernel, residual_share[None], axes=1)[:, : len(share)]
        # V_q at its rail does not answer
        change[V_Q2, self.kept[c.id, *SPRING, 0][V_Q2] == 0.0] = 0.0
        return change

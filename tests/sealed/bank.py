"""What effects do to the features of a sealed record, in sigmas, by the second plant alone.

    s_k   change of the features per unit of an effect: runs with the same noise, at hundreds of sigmas to both sides
    J     the same per unit of what a calibration has left unknown, with the priors as rows
    N     covariance of power-ons without effect: sigma of a condition, correlations of all conditions together
    r_k = (1 - Q Q') W s_k        d of a coefficient c: |r_k| c        rivals: cosines of r_k

Features are means of the eight observables over the first 8 ms of a dwell, the next 120 ms and the rest, of the fitted
conditions. It uses no tangent, no noise and no anchor of the tracer. Each column is kept in a file of its own.
Source    docs/sealed.md
"""

import hashlib
import json
import os
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from testbench.config import Config
from testbench.errors import ConfigError, FileError
from testbench.measured.closed_loop import loop_record, loop_runs
from testbench.measured.record import produce, schema
from testbench.run import build
from tests.sealed import second_plant
from tests.sealed.strata import own_text, plan

EDGES = (0, 1, 16)  # first fine bins of the three features of an observable
DRAWS = 24  # power-ons of each condition for N
SEED = 4 * 10**12  # of all runs here: no record has it
WANTED, LEAST, MOST = 400.0, 120.0, 1500.0  # sigmas of a change that is measured
PASSES, GROWTH = 5, 100.0  # at most, and of the size from one to the next
ALIKE = 0.5  # cosine of an effect's column from both sides of zero, below which it is none; priors hold a weak nuisance
SEEN = 0.02  # of a change, which the nuisances must leave: less is not measured well enough


class Unit(NamedTuple):
    """Measured change of an effect per unit of its coefficient."""

    change: np.ndarray
    size: float  # coefficient at which it was measured


class Bank:
    """Columns and noise of the conditions of `strata`; files in `folder`."""

    def __init__(self, strata, folder, draws=DRAWS):
        self.strata, self.folder, self.draws = strata, folder, draws
        folder.mkdir(parents=True, exist_ok=True)
        firmware = schema.bitstream_sha256(build.firmware(Config()))
        told = strata.plan, strata.every, strata.priors, second_plant.sha256(), firmware
        self.key = hashlib.sha256(repr(told).encode()).hexdigest()
        self.count = len(loop_runs.NAMES) * len(EDGES)
        self.conditions = [c["id"] for c in strata.plan["condition"] if c.get("role", "fit") == "fit"]
        self.slope = np.repeat(np.array(loop_runs.NAMES) == "f_word", len(EDGES)).astype(float)
        self.base = self._kept("base", lambda: self._run({}, "", 1)[:, 0])
        self.chol = self._kept(f"noise {draws}", self._noise)

    def _path(self, name):
        return self.folder / f"{hashlib.sha256(f'{self.key} {name}'.encode()).hexdigest()[:24]}.npy"

    def _kept(self, name, make):
        """Array of a name, made where it is not yet in its file."""
        path = self._path(name)
        if path.exists():
            return np.load(path, allow_pickle=False)
        found = np.asarray(make(), float)
        part = path.with_suffix(f".{os.getpid()}.npy")
        np.save(part, found)
        part.replace(path)
        return found

    def _run(self, values, lines, repeats, scatter_hz=0.0):
        """(conditions, repeats, features) of the fitted conditions; ConfigError where a board does not lock."""
        own = self.folder / f"own.{os.getpid()}.txt"
        own.write_text(own_text(self.strata, {"steps": 1, "effects": lines}))
        try:
            made = plan(self.strata, "bank", SEED, values, own, repeats, ("fit",), scatter_hz)
            rows = loop_record.measured_features(produce.record(made), "bank", {}).values
        finally:
            own.unlink()
        out = []
        for name, c in zip(self.conditions, made.conditions):
            fine = rows[name][:, loop_runs.feature_count(c) :].reshape(repeats, len(loop_runs.NAMES), -1)
            parts = np.split(fine, EDGES[1:], axis=2)
            out.append(np.stack([p.mean(axis=2) for p in parts], axis=2).reshape(repeats, -1))
        return np.array(out)

    def _noise(self):
        """(conditions, n, n) Cholesky factors of the noise of one power-on, Hartlap's factor in it."""
        scatter_hz = self.strata.plan["fx_scatter_hz"]
        rows = self._run({}, "", self.draws, scatter_hz)
        count = len(self.conditions)
        for r in range(self.draws):
            for k in range(count):
                # as `produce.Sitting` draws it
                moved = scatter_hz * np.random.default_rng([9, SEED + r * count + k]).normal()
                rows[k, r] -= moved * self.slope
        rest = rows - rows.mean(axis=1, keepdims=True)
        sigma = rest.std(axis=1, ddof=1)
        z = (rest / sigma[:, None]).reshape(-1, self.count)
        freedom = len(z) - count
        pooled = z.T @ z / (freedom - self.count - 2)
        out = []
        for own in sigma:
            c = pooled * np.outer(own, own) + scatter_hz**2 * np.outer(self.slope, self.slope)
            out.append(np.linalg.cholesky(c))
        return np.array(out)

    def whiten_rows(self, change):
        """Stacked features of unit variance, repeats counted, of (conditions, features)."""
        rows = [solve_triangular(chol, v, lower=True) for chol, v in zip(self.chol, change)]
        return np.sqrt(self.strata.plan["repeats"]) * np.concatenate(rows)

    def _measured(self, name, run, first, alike=-1.0):
        """`Unit` of something: `run(size)` gives features; the size is sought.

        NaN where no size locks, or where both sides of zero have a cosine below `alike`.
        """

        def seek():
            size, best = first, np.full((len(self.conditions) + 1, self.count), np.nan)
            nearest = np.inf
            for _ in range(PASSES):
                try:
                    change = run(size)[:, 0] - self.base
                except (ConfigError, FileError):
                    # out of lock, or of a key's limits; motion without limit
                    size /= 8
                    continue
                sigmas = max(np.linalg.norm(self.whiten_rows(change)), 1e-3)
                if abs(np.log(WANTED / sigmas)) < nearest:
                    nearest = abs(np.log(WANTED / sigmas))
                    best = np.concatenate([change / size, np.full((1, self.count), size)])
                if LEAST < sigmas < MOST:
                    break
                size *= min(GROWTH, WANTED / sigmas)
            return best

        found = self._kept(name, seek)
        change, size = found[:-1], float(found[-1, 0])

        def back():
            try:
                return (run(-size)[:, 0] - self.base) / -size
            except (ConfigError, FileError):
                # from two sizes on one side: what a step to the other side would have given to second order
                half = (run(size / 2)[:, 0] - self.base) / (size / 2)
                return 4 * half - 3 * change

        if np.isfinite(size):
            change = self._common(change, self._kept(f"other side {name}", back), alike)
        return Unit(change, size)

    def _common(self, one, other, alike):
        """Mean of a column from both sides of zero, which has no term of the second order; NaN if they are not alike.

        Then most of it is of the second order, or noise of another way to lock.
        """
        a, b = self.whiten_rows(one), self.whiten_rows(other)
        same = a @ b >= alike * np.linalg.norm(a) * np.linalg.norm(b)
        return (one + other) / 2 if same else np.full_like(one, np.nan)

    def has(self, effect):
        """True if the column of an effect is in its file."""
        return self._path(_told(effect)).exists()

    def effect(self, effect):
        """`Unit` of an effect; not finite where no size could be measured, or where both sides are not alike."""

        def run(size):
            return self._run(effect.values(size, {}), effect.lines(size), 1)

        return self._measured(_told(effect), run, (effect.sign or 1) * effect.first, ALIKE)

    def nuisance(self, key):
        """`Unit` of a parameter of the priors."""
        mean, sd, _ = self.strata.priors[key]
        return self._measured(f"nuisance {key}", lambda size: self._run({key: mean + size}, "", 1), 30 * sd)


def _told(effect):
    return json.dumps([effect.texts, effect.sign or 1] + ([effect.key] if effect.key else []))


class Space:
    """What the nuisances leave of effects: `rest` {name: vector per unit}, `size` {name: d per unit}."""

    def __init__(self, bank, effects, say=None):
        sd = np.array([row[1] for row in bank.strata.priors.values()])
        columns = []
        for key in bank.strata.priors:
            columns.append(bank.whiten_rows(bank.nuisance(key).change))
        j = np.concatenate([np.stack(columns, axis=1), np.diag(1 / sd)])
        self.q, _ = np.linalg.qr(j / np.linalg.norm(j, axis=0))
        self.rest, self.size, self.same = {}, {}, {e.name: e.same for e in effects}
        for k, effect in enumerate(effects):
            change = bank.effect(effect).change
            if say:
                say(f"column {k + 1} of {len(effects)}: {effect.name}")
            if np.all(np.isfinite(change)):
                white = np.concatenate([bank.whiten_rows(change), np.zeros(len(sd))])
                rest = white - self.q @ (self.q.T @ white)
                if np.linalg.norm(rest) > SEEN * np.linalg.norm(white):
                    self.rest[effect.name], self.size[effect.name] = rest, float(np.linalg.norm(rest))

    def rival(self, name, among):
        """(most similar other law of `among`, sine of the angle to it); one with its text in `same` is no other."""
        own, best = self.rest[name] / self.size[name], ("", 0.0)
        for other in among:
            twin = other == name or (self.same[name] and self.same.get(other) == self.same[name])
            if other in self.rest and not twin:
                cosine = abs(own @ self.rest[other]) / self.size[other]
                best = max(best, (other, cosine), key=lambda row: row[1])
        return best[0], float(np.sqrt(max(0.0, 1 - best[1] ** 2)))
